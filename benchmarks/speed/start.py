"""
How long a start takes.

``python -m benchmarks.speed.start [--runs N]``

Whole processes, one after the other in turn: an empty Python, what is imported, and the command's
help, as a module and as it is installed. All are compiled before, as an installation is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
import sys
from tempfile import TemporaryDirectory

from benchmarks.speed.commands import environment, run, show

EMPTY, NUMPY = 'empty Python', 'import numpy'
PROGRAMS = {
    EMPTY: 'pass',
    NUMPY: 'import numpy',
    'import rovid_core': 'import rovid_core',
    'import rovid_core.pipeline.stream': 'import rovid_core.pipeline.stream',
}
"""The core's package holds nothing; its stream needs all that a run does."""

Times = list[tuple[float, float]]
"""Of each run: by the clock on the wall, and that the cores worked [ms]."""


def commands() -> dict[str, list[str]]:
    """Return what is started."""
    found = {name: [sys.executable, '-c', text] for name, text in PROGRAMS.items()}
    found['python -m rovid_ros.commands --help'] = [
        sys.executable, '-m', 'rovid_ros.commands', '--help']
    script = Path(sys.executable).with_name('rovid')
    if script.exists():
        found['rovid --help'] = [str(script), '--help']
    return found


def measure(commands: Mapping[str, Sequence[str]], runs: int) -> dict[str, Times]:
    """Start everything in turn, ``runs`` times; the first time everything is compiled."""
    found: dict[str, Times] = {name: [] for name in commands}
    with TemporaryDirectory() as folder:
        own = {**environment(), 'PYTHONPYCACHEPREFIX': folder}
        own.pop('PYTHONDONTWRITEBYTECODE', None)
        for turn in range(-1, runs):
            for name, command in commands.items():
                usage = run(command, own)
                if turn >= 0:
                    found[name].append((1e3 * usage.elapsed, 1e3 * usage.processor))
    return found


def table(found: Mapping[str, Times]) -> str:
    """Return the times, what they are above an empty Python's, and by numpy's, as Markdown."""
    lines = ['| start | time [ms] | above empty | lowest to highest | cores [ms] | above empty | '
             'lowest to highest | by numpy |', '|---|---|---|---|---|---|---|---|']
    columns = {name: list(zip(*times)) for name, times in found.items()}
    above = {name: [[a - b for a, b in zip(mine, empty)]
                    for mine, empty in zip(column, columns[EMPTY])]
             for name, column in columns.items()}
    for name, column in columns.items():
        cells = [f'{median(times):.0f} | {median(more):.0f} | {min(more):.0f} to {max(more):.0f}'
                 for times, more in zip(column, above[name])]
        ratio = median(column[1]) / median(columns[NUMPY][1])
        lines.append(f'| {name} | {" | ".join(cells)} | {ratio:.2f} |')
    return '\n'.join(lines)


def lines(runs: int) -> list[str]:
    """Return the table, and what it is of."""
    return [f'{runs} runs in turn; *cores* is processor time. Asked for: the core at most 1.3 '
            'times numpy alone, the help at most 50 ms above an empty Python.', '',
            table(measure(commands(), runs))]


if __name__ == '__main__':
    show(__doc__, lines, 15)
