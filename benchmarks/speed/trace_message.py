"""
The route of one position message through the files: ``python -m benchmarks.speed.trace_message``.

A simulated log of the vehicle in ``config/jhurov.yaml`` is replayed with ``ekf``, and every call
of a function of the project is noted. Of each position message in the second half of the log
those calls are kept that belong to it alone: from the log reader until it waits in the order of
events, from its release until its step is made, and the writing of one estimate. What it
releases of other inputs is theirs.

Printed are the calls, the files, and how often one call is in another file than the call before;
then the route of the most common kind.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import redirect_stdout
from io import StringIO
from itertools import groupby
from operator import itemgetter
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any

from rovid_ros.commands.main import main as rovid

from benchmarks.markdown import table

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / 'config' / 'jhurov.yaml'
TOPIC, INPUT = '/sharps/position', 'position'

READ = 'rovid_ros/logs/log.py', 'Log.messages'
SAMPLE = 'rovid_core/pipeline/steps.py', 'Pipeline.add_sample'
WRITE = 'rovid_ros/results/outputs.py', 'Outputs.encoded'
"""Where the three parts of the route begin: file and function."""

Call = tuple[str, str]
"""File and function."""


class Trace:
    """The calls that belong to the position messages, as a profile function."""

    def __init__(self) -> None:
        self.routes: list[list[Call]] = []
        self._read: list[list[Call]] = []  # of the messages that wait in the order of events
        self._part: list[Call] | None = None
        self._sample: FrameType | None = None
        self._reading: list[Call] = []

    def __call__(self, frame: FrameType, event: str, argument: Any) -> None:
        """Note a call of a function of the project."""
        if event == 'return':
            self._returned(frame, argument)
        if event != 'call':
            return
        path = frame.f_code.co_filename
        if not path.startswith(f'{ROOT}/rovid_'):
            return
        call = path[len(str(ROOT)) + 1:], frame.f_code.co_qualname
        if call == READ:
            self._part = self._reading = []
        elif call == SAMPLE:
            self._part = None
            if frame.f_locals['sample'].input == INPUT and self._read:
                self._sample, self._part = frame, self._read.pop(0)
                self.routes.append(self._part)
        elif call == WRITE:
            # one estimate is written like the other
            self._part = self.routes[-1] if self.routes and WRITE not in self.routes[-1] else None
        elif call[1].endswith('.tick'):
            self._part = None
        if self._part is not None:
            self._part.append(call)

    def _returned(self, frame: FrameType, value: Any) -> None:
        if frame is self._sample:
            self._sample = self._part = None
        elif getattr(value, 'topic', '') == TOPIC and frame.f_code.co_qualname == READ[1]:
            self._read.append(self._reading)


def trace(log: Path, config: Path, method: str, *options: str) -> list[list[Call]]:
    """Replay a log and return the routes of its position messages."""
    found = Trace()
    with redirect_stdout(StringIO()):
        sys.setprofile(found)
        try:
            rovid(['replay', str(log), '--params-file', str(config), '--method', method, *options])
        finally:
            sys.setprofile(None)
    return found.routes


def figures(route: list[Call]) -> tuple[int, int, int]:
    """Return the number of calls, of files, and of changes of file."""
    files = [file for file, _ in route]
    return len(route), len(set(files)), sum(a != b for a, b in zip(files, files[1:]))


def typical(routes: list[list[Call]]) -> list[Call]:
    """Return a route with the most common figures in the second half of the log."""
    steady = routes[len(routes) // 2:]
    (common, _), *_ = Counter(map(figures, steady)).most_common()
    return next(route for route in steady if figures(route) == common)


def lines(route: list[Call]) -> Iterator[str]:
    """Yield a line for every change of file: the file, and the functions that are called."""
    for file, calls in groupby(route, key=itemgetter(0)):
        counts = Counter(function.partition('.<locals>')[0] for _, function in calls)
        yield f'{file}: ' + ', '.join(
            name if count == 1 else f'{name} ({count} times)' for name, count in counts.items())


def main() -> None:
    """Print the figures and the route."""
    with TemporaryDirectory() as folder:
        log, output = Path(folder, 'log.mcap'), Path(folder, 'output.mcap')
        with redirect_stdout(StringIO()):
            rovid(['simulate', '--params-file', str(CONFIG), '--output', str(log),
                   '--duration', '60'])
        routes = {f'the estimate of {method}': typical(trace(log, CONFIG, method))
                  for method in ('ekf', 'aid')}
        written = typical(trace(log, CONFIG, 'ekf', '--output', str(output)))
    if WRITE not in written:
        sys.exit(f'{": ".join(WRITE)} is not called any more')
    print(table(('one position message, from the log to', 'calls', 'files', 'changes of file'), [
        (name, *figures(route)) for name, route in
        (*routes.items(), ('the output topics of an estimate of ekf', written))]))
    print('\nThe route to the estimate of ekf:\n\n```')
    print(*lines(routes['the estimate of ekf']), sep='\n')
    print('```')


if __name__ == '__main__':
    main()
