"""
All figures of docs/measurements/performance.md.

``python -m benchmarks.speed.all_sections [SECTION ...]``

They are ratios of what ran side by side, medians with their spread. ``make bench`` runs all of
them in about half an hour, and writes that file.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import subprocess
import sys

from benchmarks.sections import machine, write
from benchmarks.speed.commands import environment, ROOT

SECTIONS = {
    'replay': ('Replay', ('replay',)),
    'long': ('Ten hours', ('replay', '--ten', '--runs', '2')),
    'step': ('One step', ('step',)),
    'live': ('The live node', ('latency',)),
    'start': ('Start', ('start',)),
    'tune': ('Tuning', ('tune',)),
}
"""Title of each section, and the module that prints it, with its arguments."""

INTRODUCTION = """\
# What it costs

`make bench` measures everything below and writes this file;
`python -m benchmarks.speed.all_sections SECTION --output docs/measurements/performance.md`
measures one section anew.
All are ratios of what ran in turn beside each other, medians with the lowest and the highest.
"""


def main() -> None:
    """Measure, and print or write what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('sections', nargs='*', metavar='SECTION',
                        help=f'{", ".join(SECTIONS)}; default: all')
    parser.add_argument('--output', type=Path, metavar='FILE.md')
    given = parser.parse_args()
    for name in given.sections or SECTIONS:
        if name not in SECTIONS:
            parser.error(f'no section {name!r}: takes {", ".join(SECTIONS)}')
    for name in given.sections or SECTIONS:
        title, (module, *arguments) = SECTIONS[name]
        # on its own: a process that has imported much gives its peak memory to its children
        found = subprocess.run(
            [sys.executable, '-m', f'benchmarks.speed.{module}', *arguments], cwd=ROOT,
            env=environment(), stdout=subprocess.PIPE, text=True, check=True)
        write(given.output, INTRODUCTION, title,
              [found.stdout.rstrip(), '', f'On {machine()}.'])


if __name__ == '__main__':
    main()
