"""
What the online methods are worth: bound, coverage, faults, guesses, rest, change, peers.

``python -m benchmarks.accuracy.online_methods [LOGS] [--seeds N]``

LOGS is a folder with the two tank recordings; without it, they are left out. All cores work.
"""

from __future__ import annotations

import argparse
from concurrent.futures import Executor, ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
import os
from pathlib import Path
from statistics import median

import numpy as np
from rovid_core.model.dofs import PARAMETERS, PHYSICAL

from benchmarks.accuracy.peers import installed, peer_errors, PEERS, times
from test.support.online_runs import (
    aid_error,
    followed_payload,
    guess_error,
    GUESSES,
    moved,
    piped,
    Rest,
    Run,
    run,
    scaled_error,
    SCALES,
    SETTINGS,
)
from test.support.online_trials import bound, CLEAN, FAULTS, HONEST, prediction_error, SPLIT
from test.support.surge import SURGE_TRUTH
from test.support.tank import LEAST, online_fits
from test.support.trials import Array

INTRODUCTION = """\
The surge case: mass 290, quadratic drag 290, linear drag 43.5, bias 2.9; thrust 150 N at 1/18 Hz
+ 80 N at 1/7.3 Hz; 10 Hz fixes of 5 mm; 300 s from rest; default settings; the guess 1.6 times
too heavy, its drags 1.8 and 2 times too small. Error: mean absolute error of the model's velocity
on another profile (120 N at 1/12 Hz + 60 N at 1/25 Hz), driven by the logged thrust with the
delay that the method found. Methods are given the steps that the pipe would give them, except
where the pipe is named.

* outliers, dropouts, delay: 2 % of the fixes are off by 1 m either way, 10 % are missing, the
  thrust is 0.1 s late, which nobody is told
* and thruster gains: besides, two thrusters push, three quarters from one whose true gain is 10 %
  above the given one, a quarter from one 10 % below; the truth that the model is judged against
  has that thrust too. When each sinusoid comes from a thruster of its own, no model of the summed
  thrust is right: that row stands beside the error of the true parameters with the same logged
  thrust.

The Cramer-Rao bound is that of what the filter estimates: the four parameters, start position and
velocity, and the delay, from position noise alone. "Same motion" scales mass, drag and force
alike, as another unit does; "same shape" scales length, so that a small vehicle is as much faster
as fixes of 5 mm at 10 Hz are coarser for it. A move in an hour without thrust is the largest over
all seeds, over the smaller of the standard deviations before and after.

The peers get the same fixes and thrust: filterpy's filter has position, velocity and the four
parameters as its state, the true R, a fixed Q and a gate of 5 standard deviations, set to be
among the best of 12 settings; padasip's takes low-passed regressors, with settings of a first
choice. Neither knows of a delay, nor does `aid`."""

MARKS = (60.0, 300.0)
TRUE = np.array(SURGE_TRUTH)


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('logs', nargs='?', type=Path, help='folder of the tank recordings')
    parser.add_argument('--seeds', type=int, default=1000, help='default: 1000')
    given = parser.parse_args()
    print(INTRODUCTION)
    os.environ['OPENBLAS_NUM_THREADS'] = '1'  # one process per core is enough
    with ProcessPoolExecutor(mp_context=get_context('spawn')) as pool:
        _print_surge(pool, given.seeds)
        _print_guesses(pool, min(given.seeds, 10))
        _print_rest(pool, min(given.seeds, 4))
        _print_payload(pool, min(given.seeds, 20))
        if installed():
            _print_peers(pool, min(given.seeds, 40))
        _print_piped(pool, min(given.seeds, 20))
    if given.logs:
        _print_tank(given.logs)


def _print_surge(pool: Executor, seeds: int) -> None:
    cases = {'clean': CLEAN, 'outliers, dropouts, delay': HONEST, 'and thruster gains': FAULTS}
    found = {name: list(pool.map(partial(run, case, 'ekf'), range(seeds), chunksize=5))
             for name, case in cases.items()}
    _print_bound(found['clean'], found['outliers, dropouts, delay'])
    _header('coverage of the 95 % intervals [%]', 'case', 'seeds', 'at', *PARAMETERS, *PHYSICAL)
    for name in ('clean', 'outliers, dropouts, delay'):
        for k, mark in enumerate(MARKS):
            _row(name, f'{len(found[name])}', f'{mark:.0f} s', *_numbers(
                100 * np.mean([r.covered[k] for r in found[name]], axis=0), 1))
    _header('error of the model on the other profile [mm/s]',
            'case', 'method', 'seeds', 'median', 'mean', 'worst')
    for name, runs in found.items():
        _errors(name, 'ekf', [r.error for r in runs])
    split = pool.map(partial(run, SPLIT, 'ekf'), range(min(seeds, 50)))
    _errors('each sinusoid on its own thruster', 'ekf', [r.error for r in split])
    _errors('the same', 'the truth', [prediction_error(SURGE_TRUTH, SPLIT.delay, SPLIT)])
    _errors('clean', 'aid', [r.error for r in pool.map(
        partial(run, CLEAN, 'aid'), range(seeds), chunksize=5)])
    _header('what else ekf says in the end', 'case', 'delay, mean [ms]', 'std [ms]',
            'the vehicle changed, though it had not')
    for name, runs in found.items():
        delays = 1e3 * np.array([r.delay for r in runs])
        _row(name, *_numbers([delays.mean(), delays.std()]),
             f'{sum(r.changed for r in runs)} of {len(runs)}')


def _print_bound(clean: list[Run], honest: list[Run]) -> None:
    _header('ekf, surge: rms error over the Cramer-Rao bound', 'case', 'seeds', 'at', *PARAMETERS)
    for delay, name in ((True, 'delay unknown'), (False, 'delay known')):
        for k, mark in enumerate(MARKS):
            _row(f'clean; {name} to the bound', f'{len(clean)}', f'{mark:.0f} s',
                 *_numbers(_rms(clean, k) / bound(mark, delay)))
    for k, mark in enumerate(MARKS):
        _row('outliers, dropouts, delay; the same bound', f'{len(honest)}', f'{mark:.0f} s',
             *_numbers(_rms(honest, k) / bound(mark, True)))
    for delay, name in ((True, 'delay unknown'), (False, 'delay known')):
        for mark in MARKS:
            _row(f'the bound [% of the parameter], {name}', '', f'{mark:.0f} s',
                 *_numbers(100 * bound(mark, delay) / np.abs(TRUE), 4))


def _print_guesses(pool: Executor, seeds: int) -> None:
    _header(f'ekf, units and vehicles, {seeds} seeds: error [mm/s]', 'what', 'median', 'worst',
            'median over the first', *(f'{p}: rms over bound' for p in PARAMETERS))
    usual = 0.0
    for name in SCALES:
        found = list(pool.map(partial(scaled_error, name), range(seeds)))
        errors = [error for error, _ in found]
        usual = usual or median(errors)
        _row(name, *_ratio(errors, usual),
             *_numbers(np.sqrt(np.mean([off**2 for _, off in found], axis=0))))
    for method, work, what in (('ekf, guesses', guess_error, GUESSES),
                               ('aid, settings', aid_error, SETTINGS)):
        _header(f'{method}, {seeds} seeds: error [mm/s]', 'what', 'median', 'worst',
                'median over the first')
        usual = 0.0
        for name in what:
            errors = list(pool.map(partial(work, name), range(seeds)))
            usual = usual or median(errors)
            _row(name, *_ratio(errors, usual))


def _print_rest(pool: Executor, seeds: int) -> None:
    _header(f'one hour without thrust, ekf, {seeds} seeds: largest move over the std',
            'case', *PARAMETERS, 'delay')
    for rest in Rest:
        found = list(pool.map(partial(moved, rest, 'ekf'), range(seeds)))
        _row(rest.value, *_numbers(np.max(found, axis=0), 3))


def _print_payload(pool: Executor, seeds: int) -> None:
    _header(f'mass +20 % at 200 s, ekf, {seeds} seeds', 'case', 'detected',
            'after: median, worst [s]', 'alpha off 60 s later: median, worst')
    for name, case in (('clean', CLEAN), ('outliers, dropouts, delay', HONEST)):
        found = list(pool.map(partial(followed_payload, case), range(seeds)))
        after = [x.after for x in found]
        off = [abs(x.alpha) for x in found]
        _row(name, f'{sum(np.isfinite(after))} of {seeds}',
             f'{median(after):.1f}, {max(after):.1f}',
             f'{100 * median(off):.2f} %, {100 * max(off):.2f} %')


def _print_peers(pool: Executor, seeds: int) -> None:
    columns = ('ekf', 'aid', *PEERS)
    per_step = times(CLEAN)
    for name, case in (('clean', CLEAN), ('outliers, dropouts, delay', HONEST)):
        found = list(pool.map(partial(peer_errors, case), range(seeds), chunksize=2))
        _header(f'peers, {name}, {seeds} seeds: medians', 'method', 'mae [mm/s]', 'worst',
                *(f'{p} off [%]' for p in PARAMETERS), 'time per step / aid')
        for method in columns:
            rows = np.array([x[method] for x in found])
            off = 100 * np.median(np.abs(rows[:, 1:]), axis=0)
            _row(method, f'{1e3 * np.median(rows[:, 0]):.3f}',
                 f'{1e3 * np.max(rows[:, 0]):.3f}', *_numbers(off, 3),
                 f'{per_step[method] / per_step["aid"]:.1f}')


def _print_piped(pool: Executor, seeds: int) -> None:
    found = list(pool.map(piped, range(seeds)))
    _header(f'the whole pipe, with the noise of the attitude, ekf, {seeds} seeds', '',
            *PARAMETERS, *PHYSICAL)
    _row('coverage [%]', *_numbers(100 * np.mean([r.covered[0] for r in found], axis=0), 0))
    _row('rms over the bound', *_numbers(_rms(found, 0) / bound(300.0, True)))
    _row('error [mm/s]: median, worst', *_numbers(
        [1e3 * median(r.error for r in found), 1e3 * max(r.error for r in found)], 3))


def _print_tank(logs: Path) -> None:
    _header('tank recordings: fit [%] on data not trained on', 'method', *LEAST)
    _row('asked of ekf', *(f'{x}' for x in LEAST.values()))
    for method in ('ekf', 'aid'):
        _row(method, *_numbers([100 * x for x in online_fits(logs, method).values()], 1))


def _rms(runs: list[Run], k: int) -> Array:
    errors = np.array([r.parameters[k] for r in runs]) - TRUE
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)))


def _errors(case: str, method: str, errors: list[float]) -> None:
    mm = 1e3 * np.array(errors)
    _row(case, method, f'{len(mm)}', *_numbers([np.median(mm), np.mean(mm), np.max(mm)], 3))


def _numbers(values: Array | list[float], digits: int = 2) -> list[str]:
    return ['-' if np.isnan(x) else f'{x:.{digits}f}' for x in values]


def _ratio(errors: list[float], usual: float) -> list[str]:
    return [f'{1e3 * median(errors):.3f}', f'{1e3 * max(errors):.3f}',
            f'{median(errors) / usual:.2f}']


def _header(title: str, *cells: str) -> None:
    print(f'\n**{title}**\n')
    _row(*cells)
    _row(*('---' for _ in cells))


def _row(*cells: str) -> None:
    print('| ' + ' | '.join(cells) + ' |', flush=True)


if __name__ == '__main__':
    main()
