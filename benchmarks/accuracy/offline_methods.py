"""
What the methods on whole trials are worth.

``python -m benchmarks.accuracy.offline_methods [LOGS] [--seeds N]``

LOGS is a folder with the two tank recordings; without it, they are left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
import os
from pathlib import Path

import numpy as np
from rovid_core.model.dofs import PARAMETERS

from benchmarks.markdown import table
from test.support.offline_trials import bias, bound_ratio, COMPARED, scores
from test.support.tank import offline_fits
from test.support.trials import TRIALS

SINUSOIDS = """\
**Trials of one sinusoid** (10 Hz, 300 s, all four terms; noise 5 mm, for heave 2 mm and for yaw 2
mrad; medians of {seeds} seeds, in mm/s or mrad/s). `aid` is the identifier in repeated passes
over the unfiltered velocity. Left: mean error of the model's velocity against the truth. Right:
the paper's score, against the measured velocity, both low-passed at 0.6 Hz; most of it is noise
of the fixes.
"""
BIAS = """
**Bias.** The truth of `config/jhurov.yaml`, but with a bias in heave only, as the paper's vehicle
has it. Largest thrust at 0.05 Hz, {seeds} seeds; delta in mm/s^2 or mrad/s^2 (std over the
seeds), errors as above.
"""
BOUND = """
**Output error against the Cramer-Rao bound**, a surge trial fitted to position, start position
and velocity unknown, {seeds} seeds.
"""
TANK = """
**Tank recordings**, output error on data that it was not trained on: `surge_sway_heave.mcap` on
`all_axes.mcap`; yaw on the last 40 % of `all_axes.mcap` from its first 60 %.
"""


def sinusoids(pool: Executor, seeds: int) -> str:
    """Return the table of the trials of one sinusoid."""
    rows = []
    for dof, trials in TRIALS.items():
        cases = [(dof, waves, seed) for waves in trials for seed in range(seeds)]
        found = 1e3 * np.array(list(pool.map(scores, *zip(*cases), chunksize=4)))
        medians = np.median(found.reshape(len(trials), seeds, len(COMPARED), -1), axis=1)
        for k, ((force, hz),) in enumerate(trials):
            numbers = [*medians[k, :, 1 + k], medians[k, 1, 1:].max(), *medians[k, :, 0]]
            rows.append((f'{dof}, {force:g}{" N m" if dof == "yaw" else " N"}, {hz:g} Hz',
                         *(f'{x:.2f}' for x in numbers)))
    return table(('thrust', 'least squares', 'aid', 'worst of the model of aid on all nine trials',
                  'score: least squares', 'aid'), rows)


def biases(pool: Executor, seeds: int) -> str:
    """Return the table of the bias that only heave has."""
    def rows() -> Iterator[tuple[str, ...]]:
        for dof in TRIALS:
            found = 1e3 * np.array(list(pool.map(partial(bias, dof), range(seeds))))
            middle, std = np.median(found, axis=0), found[:, 1].std(ddof=1)
            yield (dof, f'{middle[0]:.3f}', f'{middle[1]:.3f}', f'{std:.3f}',
                   f'{abs(middle[1]) / std:.1f}', *(f'{x:.2f}' for x in middle[2:]))

    return table(('DOF', 'true delta', 'median', 'std', 'median / std', 'error', 'without delta',
                  'score', 'without delta'), rows())


def bounds(seeds: int) -> str:
    """Return the table of output error against its bound."""
    ratio, bound = bound_ratio(seeds)
    return table(('', *PARAMETERS), (
        ('rms error over the bound', *(f'{x:.2f}' for x in ratio)),
        ('the bound [% of the parameter]', *(f'{100 * x:.3f}' for x in bound))))


def tank(logs: Path) -> str:
    """Return the table of the tank recordings."""
    return table(('DOF', 'mae [m/s, rad/s]', 'fit'), (
        (dof, f'{mae:.3f}', f'{100 * fit:.0f} %')
        for dof, (mae, fit) in offline_fits(logs).items()))


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('logs', nargs='?', type=Path, help='folder of the tank recordings')
    parser.add_argument('--seeds', type=int, default=20,
                        help='for the bound ten times as many; default: 20')
    given = parser.parse_args()
    os.environ['OPENBLAS_NUM_THREADS'] = '1'  # one process per core is enough
    seeds = given.seeds
    with ProcessPoolExecutor(mp_context=get_context('spawn')) as pool:
        print(f'{SINUSOIDS.format(seeds=seeds)}\n{sinusoids(pool, seeds)}', flush=True)
        print(f'{BIAS.format(seeds=seeds)}\n{biases(pool, seeds)}', flush=True)
    print(f'{BOUND.format(seeds=10 * seeds)}\n{bounds(10 * seeds)}', flush=True)
    if given.logs:
        print(f'{TANK}\n{tank(given.logs)}')


if __name__ == '__main__':
    main()
