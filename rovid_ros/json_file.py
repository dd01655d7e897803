"""Results, in JSON or other text, in files that are never seen half written."""

from __future__ import annotations

import json
import os
from pathlib import Path
import sys
from typing import Any

from rovid_ros.leftovers import remove_leftovers

STDOUT = Path('/dev/stdout')


def write_json(path: Path, document: Any, indent: int = 2) -> None:
    """
    Write a document as :func:`write_text` writes a text.

    Raises
    ------
    OSError
        If the file cannot be written.
    ValueError
        If there is a number that is not finite.

    """
    write_text(path, json.dumps(document, indent=indent, allow_nan=False) + '\n')


def write_text(path: Path, text: str) -> None:
    """
    Write a text; at every moment the file is the old or the new one, whole.

    What a symbolic link points to is replaced, not the link. A pipe or a device is written
    to as it is.

    Raises
    ------
    OSError
        If the file cannot be written; it names ``path``.

    """
    try:
        if path == STDOUT:  # opened anew, it would go over what was printed to a file
            sys.stdout.write(text)
        elif path.exists() and not path.is_file():
            path.write_text(text, encoding='utf-8')
        else:
            _replace(Path(os.path.realpath(path)), text)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def sync_folder(folder: Path) -> None:
    """Let new names in a folder outlast a loss of power."""
    directory = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)


def _replace(path: Path, text: str) -> None:
    prefix = f'.{path.name}.'
    remove_leftovers(path.parent, prefix)
    temporary = path.with_name(f'{prefix}{os.getpid()}')
    try:
        with temporary.open('w', encoding='utf-8') as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)
