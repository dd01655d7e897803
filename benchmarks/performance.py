"""
All figures of docs/performance.md; ``python -m benchmarks.performance [SECTION ...]``.

They are ratios of what ran side by side, medians with their spread. ``make bench`` runs all of
them in about a quarter of an hour, and writes that file.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from benchmarks import latency, replay_speed, startup, step_cost, tune_speed
from benchmarks.sections import machine, write

RUNS = 5
SECTIONS: dict[str, tuple[str, Callable[[], list[str]]]] = {
    'replay': ('Replay', lambda: replay_speed.lines(RUNS)),
    'long': ('Ten hours', lambda: replay_speed.long_lines(2)),
    'step': ('One step', lambda: step_cost.lines(7)),
    'live': ('The live node', lambda: [latency.report((latency.PASSING, 'aid'), RUNS, 4.0)]),
    'start': ('Start', lambda: startup.lines(15)),
    'tune': ('Tuning', lambda: tune_speed.lines(RUNS)),
}
INTRODUCTION = """\
# What it costs

`make bench` measures everything below and writes this file;
`python -m benchmarks.performance SECTION --output docs/performance.md` measures one section anew.
All are ratios of what ran in turn beside each other, medians with the lowest and the highest.

## Where a figure is out of reach

* **Replay.** Reading and unpacking a message takes a third of what AnyReader takes to decode it.
  The rest is the pipe, in plain Python and one step after the other: gate, order, velocity and
  thrust on one interval, filter, identifier, score. Four of five messages make a step, for some
  50 us, of which the identifier's own arithmetic is 3. Gate and identifier go on from one step to
  the next; without them whole columns in numpy would do, but with the bits of the node only if
  every function rounds alike.
* **One step in the pipe.** What the method does not need and the user does (status, excitation,
  the watch on signs and sizes, the estimate itself) takes 3 us, as much as a step of `aid`.
* **Tuning.** The candidates of the gains are one run in vectors; that and the cross-validation of
  delay, lag and heading take 2.7 replays, and reading takes one.
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
        title, lines = SECTIONS[name]
        write(given.output, INTRODUCTION, title, [*lines(), '', f'On {machine()}.'])


if __name__ == '__main__':
    main()
