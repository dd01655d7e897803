"""
Tell how often a vehicle that does not change is said to have changed.

The plants are those of ``test.support.real_vehicles`` that stay as they are. Every ten minutes
another drive begins, with other frequencies and phases, after a gap.

Usage: python -m benchmarks.accuracy.unchanged [--hours H] [--first SEED] [--only NAME]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from math import inf

from rovid_core.identify import make_identifier
from rovid_core.model.samples import Step
from rovid_core.settings.run import IdentifierSettings

from benchmarks.markdown import table
from test.support.real_vehicles import GUESS, pieces, VEHICLES

DRIVE, DRIVES = 600.0, 6
"""[s] of a drive, and how many of them make an hour."""


def changes(name: str, seed: int) -> int:
    """Return how often the vehicle is said to have changed in an hour."""
    identifier = make_identifier(IdentifierSettings('ekf'), GUESS, watched=('vr',))
    said = count = 0
    for k in range(DRIVES):
        for piece in pieces(VEHICLES[name], DRIVES * seed + k, DRIVE):
            if not isinstance(piece, Step):
                identifier.restart(piece)
                continue
            identifier.step(piece)
            now = 'changed' in identifier.note
            count += now and not said
            said = now
    return count


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--hours', type=int, default=5)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--only', default='')
    given = parser.parse_args(arguments)
    rows = []
    with ProcessPoolExecutor(2) as pool:
        for name, vehicle in VEHICLES.items():
            if vehicle.change[0] < inf or given.only not in name:
                continue
            found = list(pool.map(partial(changes, name),
                                  range(given.first, given.first + given.hours)))
            rows.append((name, given.hours, sum(found)))
    rows.append(('all', sum(row[1] for row in rows), sum(row[2] for row in rows)))
    print(table(('vehicle', 'hours', 'said to have changed'), rows))


if __name__ == '__main__':
    main()
