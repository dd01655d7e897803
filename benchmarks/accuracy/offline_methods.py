"""
Print the figures of the offline methods.

``python -m benchmarks.accuracy.offline_methods [LOGS]``

LOGS is a folder with the two tank recordings; without it, they are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from statistics import median
import sys

import numpy as np
from rovid_core.identify.estimate import Estimate
from rovid_core.model.dofs import Four, PARAMETERS
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Scales, Settings
from rovid_core.trials.least_squares import with_acceleration
from rovid_core.trials.offline import METHODS
from rovid_core.trials.output_error import information, noise, output_error
from rovid_core.trials.record import Record
from rovid_core.trials.repeated_passes import repeated_passes
from rovid_core.trials.score import ScoreLog
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.log import Log
from rovid_ros.messages.convert import Converter

from test.support.trials import (
    Array,
    CONFIG,
    CUTOFF,
    error,
    measured_error,
    NOISE,
    NOISES,
    trial,
    TRIALS,
    vehicle,
    Waves,
)

SEEDS = 20
TANK_LENGTH = 165.395  # [s] of all_axes.mcap


Identify = Callable[[Record, Scales], Four]


def aid(integrator: str) -> Identify:
    """Return the repeated passes with an integrator."""
    return lambda record, scales: repeated_passes([record], scales, 3.0, integrator).parameters


def squares(record: Record, scales: Scales) -> Four:
    """Return the paper's least squares."""
    return with_acceleration([record], scales, CUTOFF).parameters


def errors_on(dof: str, waves: Waves, identify: Identify, judges: Sequence[Waves],
              seeds: int = SEEDS) -> list[float]:
    """Return the median over the seeds of a model's error on each profile."""
    truth, guess = vehicle(dof)
    models = [identify(trial(truth, waves, seed, NOISES[dof]), Scales.of(guess))
              for seed in range(seeds)]
    return [median(error(truth, model, judge) for model in models) for judge in judges]


COMPARED = (squares, aid('rk4'), aid('euler'))


def scores(dof: str, waves: Waves, seed: int,
           methods: Sequence[Identify] = COMPARED) -> list[list[float]]:
    """
    Return what each method reaches with a trial.

    Returns
    -------
    list
        Per method the paper's score on the trial itself, then the error on each trial of
        the DOF.

    """
    truth, guess = vehicle(dof)
    record = trial(truth, waves, seed, NOISES[dof])
    models = [method(record, Scales.of(guess)) for method in methods]
    return [[measured_error(record, model), *(error(truth, model, j) for j in TRIALS[dof])]
            for model in models]


def bias(dof: str, seed: int) -> list[float]:
    """
    Return what the identifier finds of a bias that only heave has, as the paper's vehicle.

    Returns
    -------
    list
        True and identified delta, then the error with and without the bias term, and the
        paper's score with and without it.

    """
    truth, guess = vehicle(dof)
    truth = (*truth[:3], truth[3] if dof == 'heave' else 0.0)
    waves = TRIALS[dof][1]
    record = trial(truth, waves, seed, NOISES[dof])
    models = [aid('rk4')(record, Scales.of(replace(guess, terms=terms)))
              for terms in (PARAMETERS, PARAMETERS[:3])]
    return [truth[3], models[0][3], *(error(truth, model, waves) for model in models),
            *(measured_error(record, model) for model in models)]


def bound_ratio(seeds: int) -> tuple[Array, Array]:
    """Return relative rms errors of output error over the bound, and the bound itself."""
    truth, guess = vehicle('surge')
    waves = ((150.0, 1 / 18), (80.0, 1 / 7.3))
    scales = Scales.of(guess)
    found = np.array([
        output_error([trial(truth, waves, seed)], scales, scales.initial).parameters
        for seed in range(seeds)])
    rms = np.sqrt(np.mean((found - np.array(truth)) ** 2, axis=0))
    clean = trial(truth, waves, 0)
    bound = information([clean], scales, truth).covariance
    # for the noise that was put in, not for the one that is estimated from this seed
    sigma = np.sqrt(np.diag(bound)) * NOISE / noise_of(clean)
    return rms / sigma, sigma / np.abs(np.array(truth))


def noise_of(record: Record) -> float:
    """Return the noise that the methods see."""
    return noise([record])


def tank(logs: Path, name: str, settings: Settings, start: float = 0.0,
         duration: float | None = None) -> ScoreLog:
    """Return a part of a tank recording after the pipe."""
    return replayed(logs, name, settings, start, duration)[0]


def replayed(logs: Path, name: str, settings: Settings, start: float = 0.0,
             duration: float | None = None) -> tuple[ScoreLog, Estimate]:
    """Return a part of a tank recording after the pipe, and the last estimate."""
    scores = ScoreLog(settings)
    stream = Stream(settings, scorer=scores)
    converter = Converter(settings, stream.reject)
    with Log([logs / name]) as log:
        for message in log.messages(converter.topics, start, duration):
            for event in converter.events(message.topic, message.data, message.time):
                stream.receive(event)
    stream.finish()
    assert stream.estimate is not None
    return scores, stream.estimate


def tank_fits(logs: Path) -> dict[str, tuple[float, float]]:
    """Return mae and fit of output error per DOF, on data that it was not trained on."""
    settings = settings_from(load(CONFIG / 'bluerov2_tank.yaml'))
    train = tank(logs, 'surge_sway_heave.mcap', settings)
    validate = tank(logs, 'all_axes.mcap', settings)
    first = tank(logs, 'all_axes.mcap', settings, 0.0, 0.6 * TANK_LENGTH)
    rest = tank(logs, 'all_axes.mcap', settings, 0.6 * TANK_LENGTH)
    fits = {}
    for dof, learn, judge in (('surge', train, validate), ('sway', train, validate),
                              ('heave', train, validate), ('yaw', first, rest)):
        fit = METHODS['output_error'](
            learn.records(dof), Scales.of(settings.dof[dof]), settings)
        score = judge.score(dof, fit.parameters)
        fits[dof] = (score.mae, score.fit)
    return fits


def _print_orderings(pool: Executor) -> None:
    seeds = range(SEEDS)
    for dof, trials in TRIALS.items():
        print(f'\n{dof}: medians of {SEEDS} seeds, all four terms [mm/s or mrad/s]\n'
              f'{"":<18}{"error against the truth":>36}{"RK4 on all":>12}'
              f'{"score of the paper":>36}\n{"thrust":<18}'
              + f'{"least sq.":>12}{"aid, RK4":>12}{"aid, Euler":>12}{"trials":>12}'
              + f'{"least sq.":>12}{"aid, RK4":>12}{"aid, Euler":>12}')
        cases = [(dof, waves, seed) for waves in trials for seed in seeds]
        found = 1e3 * np.array(list(pool.map(scores, *zip(*cases), chunksize=4)))
        table = np.median(found.reshape(len(trials), SEEDS, len(COMPARED), -1), axis=1)
        for k, ((force, hz),) in enumerate(trials):
            columns = [*table[k, :, 1 + k], table[k, 1, 1:].max(), *table[k, :, 0]]
            print(f'{f"{force:g} at {hz:g} Hz":<18}'
                  + ''.join(f'{x:>12.2f}' for x in columns), flush=True)


def _print_bias(pool: Executor) -> None:
    print('\nbias only in heave, aid with RK4: delta [mm/s^2 or mrad/s^2], error against the '
          'truth and score of the paper [mm/s or mrad/s]\n'
          f'{"":<8}{"truth":>8}{"median":>9}{"std":>9}{"over std":>10}{"error":>9}'
          f'{"without":>9}{"score":>9}{"without":>9}')
    for dof in TRIALS:
        found = 1e3 * np.array(list(pool.map(bias, [dof] * SEEDS, range(SEEDS))))
        middle, std = np.median(found, axis=0), found[:, 1].std(ddof=1)
        print(f'{dof:<8}{middle[0]:>8.3f}{middle[1]:>9.3f}{std:>9.3f}'
              f'{abs(middle[1]) / std:>10.1f}' + ''.join(f'{x:>9.2f}' for x in middle[2:]))


def main() -> None:
    """Print all tables."""
    with ProcessPoolExecutor() as pool:
        _print_orderings(pool)
        _print_bias(pool)
    ratio, bound = bound_ratio(200)
    print('output error, 200 seeds: rms over the Cramer-Rao bound of alpha, beta, gamma, delta: '
          + ', '.join(f'{x:.2f}' for x in ratio)
          + ' (bound ' + ', '.join(f'{100 * x:.3f} %' for x in bound) + ')')
    if len(sys.argv) > 1:
        for dof, (mae, fit) in tank_fits(Path(sys.argv[1])).items():
            print(f'tank, {dof}: mae {mae:.4f}, fit {100 * fit:.1f} %')


if __name__ == '__main__':
    main()
