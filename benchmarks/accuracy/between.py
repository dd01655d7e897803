"""
Tell whether recordings of one vehicle agree as well as their standard deviations say.

Each piece of the tank recordings is identified by itself. A number is the root mean square,
over all pairs of pieces that do not overlap and push the DOF, of a parameter's difference over
its stated standard deviation; it is 1 where these are right.

Usage: python -m benchmarks.accuracy.between FOLDER
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import combinations
from math import inf
from pathlib import Path

import numpy as np
from rovid_core.model.dofs import PARAMETERS
from rovid_core.model.plant import Array
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

from benchmarks.markdown import table
from test.support.tank import replayed
from test.support.trials import CONFIG

PIECES = [
    *[('surge_sway_heave.mcap', start, 80.0) for start in (0.0, 80.0)],
    ('surge_sway_heave.mcap', 160.0, 55.0),
    *[('all_axes.mcap', start, 80.0) for start in (0.0, 80.0)],
    ('short_all_axes.mcap', 0.0, 39.0)]
"""Recording, start and duration [s]."""

KNOWN = 0.3
"""Relative standard deviation of alpha up to which a piece says something."""


MINUTE = 60.0
"""[s] from which the blocks of a piece can judge its standard deviations."""


def estimates(piece: tuple[str, float, float], folder: Path) -> dict[str, Array]:
    """Return the parameters of each DOF and their standard deviations, shape (2, 4)."""
    name, start, duration = piece
    settings = settings_from(load(CONFIG / 'bluerov2_tank.yaml'))
    _, estimate = replayed(folder, name, settings, start, duration)
    return {dof.dof: np.array([dof.parameters, dof.std]) for dof in estimate.dofs
            if dof.judgement.status != 'unexcited'}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('folder', type=Path)
    given = parser.parse_args()
    with ProcessPoolExecutor(2) as pool:
        found = list(pool.map(partial(estimates, folder=given.folder), PIECES))
    rows = []
    for least, known, which in (
            (0.0, inf, 'all'), (0.0, KNOWN, 'alpha known to 30 %'),
            (MINUTE, KNOWN, 'the same, longer than a minute')):
        together = []
        for dof in ('surge', 'sway', 'heave', 'yaw'):
            of_dof = [one[dof] for one, (_, _, duration) in zip(found, PIECES)
                      if dof in one and duration >= least
                      and one[dof][1, 0] < known * one[dof][0, 0]]
            squares = np.array([(a[0] - b[0])**2 / (a[1]**2 + b[1]**2)
                                for a, b in combinations(of_dof, 2)]).reshape(-1, 4)
            together.append(squares)
            rows.append((which, dof, len(squares), *_roots(squares)))
        squares = np.concatenate(together)
        rows.append((which, 'all', len(squares), *_roots(squares)))
    print('Pieces of the tank recordings, each identified by itself: rms over pairs of the '
          'difference of a\nparameter over its stated standard deviation, 1 where these are '
          'right. A piece that says little\nof a DOF agrees with everything: the second rows '
          'are of those that say something. In the third ones\nthere are blocks that judge the '
          'model.\n')
    print(table(('pieces', 'DOF', 'pairs', *PARAMETERS), rows))


def _roots(squares: Array) -> list[str]:
    return [f'{x:.2f}' for x in np.sqrt(np.nanmean(squares, axis=0))] if len(squares) else 4 * ['']


if __name__ == '__main__':
    main()
