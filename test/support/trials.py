"""Simulated trials of one degree of freedom with a known truth, and errors of models on them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from math import pi
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.dofs import Four
from rovid_core.model.lowpass import LowPass
from rovid_core.model.plant import integral, lumped, trajectory
from rovid_core.settings.run import DofSettings
from rovid_core.trials.record import Record
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

CONFIG = Path(__file__).parents[2] / 'config'
RATE, NOISE, DURATION = 10.0, 0.005, 300.0  # [Hz], [m or rad], [s]
FINE = 4  # segments of the true response between two fixes

# magnitudes [N or N m] of each DOF's trials, from high to low
MAGNITUDES = {'surge': (150.0, 75.0, 30.0), 'heave': (400.0, 200.0, 80.0),
              'yaw': (30.0, 15.0, 6.0)}
NOISES = {'surge': NOISE, 'heave': 0.002, 'yaw': 0.002}
FREQUENCIES = (0.025, 0.05, 0.25)
CUTOFF = 0.6  # [Hz] of the paper's least squares, and of the velocity that is scored against
Array = NDArray[np.float64]
Waves = Sequence[tuple[float, float]]
TRIALS: dict[str, list[tuple[tuple[float, float], ...]]] = {
    dof: [((f, hz),) for f in magnitudes for hz in FREQUENCIES]
    for dof, magnitudes in MAGNITUDES.items()}


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
    force = force_of(waves, step / FINE, len(fine))
    true = integral(trajectory(np.array(truth), 0.0, fine, force), fine)[::FINE]
    fixes = true + np.random.default_rng(seed).normal(0.0, noise, count + 1)
    return Record(
        np.arange(count + 1) * step, fixes - fixes[0], np.diff(fixes) / step,
        np.full(2 * count, step / 2), force_of(waves, step / 2, 2 * count))


def error(truth: Four, parameters: Four, waves: Waves) -> float:
    """Return the mean absolute velocity error [m/s or rad/s] of a model on a profile."""
    if not np.isfinite(parameters).all():
        return float('nan')
    return float(np.abs(
        _velocity(_passive(parameters), tuple(waves)) - _true_velocity(truth, tuple(waves))
    ).mean())


def measured_error(record: Record, parameters: Four) -> float:
    """Return the paper's score: against the measured velocity, both filtered alike."""
    dt = np.diff(record.time)
    simulated = integral(trajectory(
        np.array(_passive(parameters)), 0.0, record.dt, record.force), record.dt)[::2]
    lowpass = LowPass(CUTOFF)
    both = [lowpass.step(h, pair) for h, pair in zip(
        dt.tolist(), zip((np.diff(simulated) / dt).tolist(), record.velocity.tolist()))]
    return float(np.abs(np.diff(both, axis=1)).mean())


def _passive(parameters: Four) -> Four:
    # least squares may find a drag that pushes
    alpha, beta, gamma, delta = parameters
    return alpha, min(beta, 0.0), min(gamma, 0.0), delta


def _velocity(parameters: Four, waves: Waves) -> Array:
    dt = np.full(round(DURATION * 20), 0.05)
    return trajectory(np.array(parameters), 0.0, dt, force_of(waves, 0.05, len(dt)))


_true_velocity = cache(_velocity)


def vehicle(dof: str) -> tuple[Four, DofSettings]:
    """Return truth and guess of the paper's vehicle."""
    settings = settings_from(load(CONFIG / 'jhurov.yaml'))
    true = settings.simulation.dofs[dof]
    return (lumped(true.mass, true.quadratic_drag, true.linear_drag, true.bias),
            settings.dof[dof])
