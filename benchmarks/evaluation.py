"""
Print the figures of the offline methods; ``python -m benchmarks.evaluation [LOGS]``.

LOGS is a folder with the two tank recordings; without it, they are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import pi
from pathlib import Path
from statistics import median
import sys

import numpy as np
from numpy.typing import NDArray
from rovid_core.dofs import Four
from rovid_core.identifier import Scales
from rovid_core.least_squares import with_acceleration
from rovid_core.offline import METHODS
from rovid_core.output_error import information, output_error
from rovid_core.passes import repeated_passes
from rovid_core.plant import lumped
from rovid_core.residuals import noise
from rovid_core.response import path, response
from rovid_core.score import ScoreLog
from rovid_core.settings import DofSettings, Settings
from rovid_core.stream import Stream
from rovid_core.trial import Record
from rovid_ros.convert import Converter
from rovid_ros.logs import Log
from rovid_ros.parameter_file import load
from rovid_ros.parameters import settings_from

CONFIG = Path(__file__).parents[1] / 'config'
SEEDS = 20
RATE, NOISE, DURATION = 10.0, 0.005, 300.0  # [Hz], [m or rad], [s]
FINE = 4  # segments of the true response between two fixes

# magnitudes [N or N m] of each DOF's trials, from high to low
MAGNITUDES = {'surge': (150.0, 75.0, 30.0), 'heave': (400.0, 200.0, 80.0),
              'yaw': (30.0, 15.0, 6.0)}
NOISES = {'surge': NOISE, 'heave': 0.002, 'yaw': 0.002}
FREQUENCIES = (0.025, 0.05, 0.25)
Array = NDArray[np.float64]
Waves = Sequence[tuple[float, float]]


def force_of(waves: Waves, dt: float, count: int) -> Array:
    """Return the mean force of ``count`` steps of ``dt`` [s]."""
    t = np.arange(count + 1) * dt
    return sum(
        (-f / (2 * pi * hz) * np.diff(np.cos(2 * pi * hz * t)) / dt for f, hz in waves),
        np.zeros(count))


def trial(truth: Four, waves: Waves, seed: int, noise: float = NOISE,
          duration: float = DURATION) -> Record:
    """Return what a transponder measures of a vehicle that starts at rest."""
    step = 1.0 / RATE
    count = round(duration * RATE)
    fine = np.full(FINE * count, step / FINE)
    true = path(response(np.array(truth), 0.0, fine, force_of(waves, step / FINE, len(fine))),
                fine)[::FINE]
    fixes = true + np.random.default_rng(seed).normal(0.0, noise, count + 1)
    return Record(
        np.arange(count + 1) * step, fixes - fixes[0], np.diff(fixes) / step,
        np.full(2 * count, step / 2), force_of(waves, step / 2, 2 * count))


def error(truth: Four, parameters: Four, waves: Waves) -> float:
    """Return the mean absolute velocity error [m/s or rad/s] of a model on a profile."""
    dt = np.full(round(DURATION * 20), 0.05)
    force = force_of(waves, 0.05, len(dt))
    model = np.array(parameters)
    if not np.isfinite(model).all():
        return float('nan')
    model[1:3] = np.minimum(model[1:3], 0.0)  # least squares may find a drag that pushes
    return float(np.abs(response(model, 0.0, dt, force)
                        - response(np.array(truth), 0.0, dt, force)).mean())


def vehicle(dof: str) -> tuple[Four, DofSettings]:
    """Return truth and guess of the paper's vehicle."""
    settings = settings_from(load(CONFIG / 'jhurov.yaml'))
    true = settings.simulation.dofs[dof]
    return (lumped(true.mass, true.quadratic_drag, true.linear_drag, true.bias),
            settings.dof[dof])


Identify = Callable[[Record, Scales], Four]


def aid(integrator: str) -> Identify:
    """Return the repeated passes with an integrator."""
    return lambda record, scales: repeated_passes([record], scales, 3.0, integrator).parameters


def squares(record: Record, scales: Scales) -> Four:
    """Return the paper's least squares."""
    return with_acceleration([record], scales, 0.6).parameters


def errors_on(dof: str, waves: Waves, identify: Identify, judges: Sequence[Waves],
              seeds: int = SEEDS) -> list[float]:
    """Return the median over the seeds of a model's error on each profile."""
    truth, guess = vehicle(dof)
    models = [identify(trial(truth, waves, seed, NOISES[dof]), Scales.of(guess))
              for seed in range(seeds)]
    return [median(error(truth, model, judge) for model in models) for judge in judges]


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
    scores = ScoreLog(settings)
    stream = Stream(settings, scorer=scores)
    converter = Converter(settings, stream.reject)
    with Log([logs / name]) as log:
        for message in log.messages(converter.topics, start, duration):
            for event in converter.events(message.topic, message.data, message.time):
                stream.receive(event)
    stream.finish()
    return scores


def tank_fits(logs: Path) -> dict[str, tuple[float, float]]:
    """Return mae and fit of output error per DOF, on data that it was not trained on."""
    settings = settings_from(load(CONFIG / 'bluerov2_tank.yaml'))
    length = 165.395
    train = tank(logs, 'surge_sway_heave.mcap', settings)
    validate = tank(logs, 'all_axes.mcap', settings)
    first = tank(logs, 'all_axes.mcap', settings, 0.0, 0.6 * length)
    rest = tank(logs, 'all_axes.mcap', settings, 0.6 * length)
    fits = {}
    for dof, learn, judge in (('surge', train, validate), ('sway', train, validate),
                              ('heave', train, validate), ('yaw', first, rest)):
        fit = METHODS['output_error'](
            learn.records(dof), Scales.of(settings.dof[dof]), settings)
        score = judge.score(dof, fit.parameters)
        fits[dof] = (score.mae, score.fit)
    return fits


def _print_orderings() -> None:
    for dof, magnitudes in MAGNITUDES.items():
        judges = [((f, hz),) for f in magnitudes for hz in FREQUENCIES]
        print(f'\n{dof}: median error over {SEEDS} seeds, all four terms [mm/s or mrad/s]')
        print(f'{"thrust":<18}{"least squares":>15}{"aid, RK4":>12}{"aid, Euler":>12}'
              f'{"aid on all trials":>20}')
        for k, judge in enumerate(judges):
            (force, hz), = judge
            paper = errors_on(dof, judge, squares, [judge])[0]
            rk4 = errors_on(dof, judge, aid('rk4'), judges)
            euler = errors_on(dof, judge, aid('euler'), [judge])[0]
            print(f'{f"{force:g} at {hz:g} Hz":<18}{1e3 * paper:>15.2f}{1e3 * rk4[k]:>12.2f}'
                  f'{1e3 * euler:>12.2f}{1e3 * max(rk4):>20.2f}', flush=True)


def main() -> None:
    """Print all tables."""
    _print_orderings()
    ratio, bound = bound_ratio(200)
    print('output error, 200 seeds: rms over the Cramer-Rao bound of alpha, beta, gamma, delta: '
          + ', '.join(f'{x:.2f}' for x in ratio)
          + ' (bound ' + ', '.join(f'{100 * x:.3f} %' for x in bound) + ')')
    if len(sys.argv) > 1:
        for dof, (mae, fit) in tank_fits(Path(sys.argv[1])).items():
            print(f'tank, {dof}: mae {mae:.4f}, fit {100 * fit:.1f} %')


if __name__ == '__main__':
    main()
