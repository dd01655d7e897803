"""
Tell what comes out for a BlueROV2 that moves in all six axes.

Its logs come from ``test/support/six_axes.py``, another simulator than ``rovid simulate``. Each
is replayed with the shipped ``bluerov2_ardusub.yaml`` as it is, with what ``rovid init`` writes
for it, and with what ``rovid tune`` makes of that. The table says of surge, sway, heave and yaw
together how far masses are off (median and largest), how often the interval holds the true one,
how often the status is ``converged``, and how often it is so with the true mass outside.

Usage: python -m benchmarks.accuracy.six_axes [--seeds N] [--duration S] [--only WORD]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
import json
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import NamedTuple

from benchmarks.accuracy.first_hour import rovid
from benchmarks.markdown import table
from test.support.six_axes import Dive, dive
from test.support.trials import CONFIG

DIVES = {
    'one axis at a time': Dive(together=1),
    'two axes': Dive(),
    'two axes, depth and heading held': Dive(held=True),
    'all four axes': Dive(together=4),
    'two axes, current 0.18 m/s': Dive(current=(0.15, -0.1)),
    'two axes, off-diagonal added mass': Dive(off_diagonal=0.5),
    'two axes, tether 1 N': Dive(tether=1.0),
    'two axes, half of the drag by the speed': Dive(drag_of_speed=0.5),
    'two axes, thrust 5 % weaker in the end': Dive(weaker=0.05),
    'two axes, reverse thrust x 0.8': Dive(reverse=0.8),
    'two axes, lag 0.15 s': Dive(lag=0.15),
    'two axes, fixes 0.15 s late': Dive(late=0.15),
}
"""By what is drawn from the vehicles of a range, all else as it is in ``Dive``."""


class Found(NamedTuple):
    """A mass that was found."""

    off: float  # share
    held: bool
    converged: bool


def found(folder: Path, log: Path, masses: dict[str, float], made: Path) -> list[Found]:
    """Replay a log with a parameter file."""
    result = folder / f'{log.stem}_{made.stem}.json'
    if rovid('replay', log, '--params-file', made, '--json', result):
        raise SystemExit(f'{log.name} could not be replayed with {made.name}')
    dofs = json.loads(result.read_text())['dofs']
    rows = []
    for dof, mass in masses.items():
        if dof in dofs:
            low, high = dofs[dof]['intervals']['mass']
            rows.append(Found(dofs[dof]['mass'] / mass - 1.0,
                              low <= mass and (high is None or mass <= high),
                              dofs[dof]['status'] == 'converged'))
        else:  # what is not even looked for is not found
            rows.append(Found(float('inf'), False, False))
    return rows


def one(folder: Path, name: str, seed: int, duration: float) -> dict[str, list[Found]]:
    """Go the three ways with one vehicle."""
    log = folder / f'{list(DIVES).index(name)}_{seed}.mcap'
    masses = dive(log, DIVES[name], seed, duration)
    made, tuned = log.with_suffix('.yaml'), log.with_name(f'{log.stem}_tuned.yaml')
    if rovid('init', log, '--output', made) or rovid(
            'tune', log, '--params-file', made, '--output', tuned):
        raise SystemExit(f'{log.name}: no configuration')
    shipped = CONFIG / 'bluerov2_ardusub.yaml'
    return {way: found(folder, log, masses, file) for way, file in (
        ('shipped', shipped), ('init', made), ('init, tune', tuned))}


def rows(name: str, results: list[dict[str, list[Found]]]) -> Iterator[tuple[str, ...]]:
    """Return the rows of the table."""
    for way in results[0]:
        masses = [mass for result in results for mass in result[way]]
        sizes = [100.0 * abs(mass.off) for mass in masses]
        yield (name, way, f'{median(sizes):.1f} %', f'{max(sizes):.0f} %', *(
            f'{100.0 * sum(told) / len(masses):.0f} %' for told in (
                [mass.held for mass in masses], [mass.converged for mass in masses],
                [mass.converged and not mass.held for mass in masses])))
        name = ''


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--duration', type=float, default=360.0)
    parser.add_argument('--only', default='')
    given = parser.parse_args()
    names = [name for name in DIVES if given.only in name]
    seeds = range(1, given.seeds + 1)
    with TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
        running = {name: [pool.submit(one, Path(folder), name, seed, given.duration)
                          for seed in seeds] for name in names}
        lines = [line for name in names
                 for line in rows(name, [each.result() for each in running[name]])]
    print(table(('dive', 'parameter file', 'mass off: median', 'worst', 'interval holds it',
                 'converged', 'converged, outside'), lines))


if __name__ == '__main__':
    main()
