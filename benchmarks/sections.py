"""Figures in Markdown files, a section for each kind, of which one can be measured anew alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import platform
import re


def write(path: Path | None, introduction: str, title: str, lines: Sequence[str]) -> None:
    """
    Put a section into a file, in the place of the one with the same title, or print it.

    Parameters
    ----------
    path : Path or None
        The file; None prints.
    introduction : str
        What the file begins with where it is not there yet.
    title : str
        Of the section.
    lines : sequence of str
        Its text.

    """
    text = f'## {title}\n\n' + '\n'.join(lines).rstrip() + '\n'
    if path is None:
        print(text)
        return
    before = path.read_text(encoding='utf-8') if path.exists() else introduction
    pattern = re.compile(rf'^## {re.escape(title)}\n.*?(?=^## |\Z)', re.M | re.S)
    after = pattern.sub(lambda _: text + '\n', before) if pattern.search(before) else (
        f'{before.rstrip()}\n\n{text}')
    path.write_text(after.rstrip() + '\n', encoding='utf-8')


def machine() -> str:
    """Return processor and Python."""
    names = re.findall(r'^model name\s*:\s*(.*)$', _cpuinfo(), re.M)
    return (f'{names[0] if names else platform.processor() or platform.machine()}, '
            f'{len(names) or "?"} cores, Python {platform.python_version()}')


def _cpuinfo() -> str:
    try:
        return Path('/proc/cpuinfo').read_text(encoding='utf-8')
    except OSError:
        return ''
