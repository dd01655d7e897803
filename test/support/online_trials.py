"""Surge trials as a method sees them online: outliers, dropouts, delay, payload, rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import inf, pi

import numpy as np
from rovid_core.identify.method import Identifier
from rovid_core.model.dofs import Four
from rovid_core.model.lowpass import filtered
from rovid_core.model.plant import integral, sensitivities, trajectory
from rovid_core.model.samples import Step

from test.support.surge import SURGE_TRUTH, TRAINING, VALIDATION
from test.support.trials import Array, CUTOFF, NOISE, RATE, Waves

FINE = 32
"""Segments of the true response between two fixes: exact to 1e-5 m."""

Pieces = list[Step | float]


@dataclass(frozen=True)
class Case:
    """
    A trial of 10 Hz fixes of 5 mm, and what is wrong with it.

    Attributes
    ----------
    outliers, dropouts : float
        Share of the fixes that are off by ``size`` [m] either way, and that are missing.
    delay : float
        Of the true thrust against the logged one [s].
    gains : tuple of 2 floats
        True over logged thrust of each sinusoid.
    payload : float
        Time [s] from which the vehicle is ``loaded``.
    stop, quiet : float
        Time [s] from which there is no thrust, and from which the fixes have no noise.

    """

    duration: float = 300.0
    truth: Four = SURGE_TRUTH
    waves: tuple[tuple[float, float], ...] = TRAINING
    outliers: float = 0.0
    size: float = 1.0
    dropouts: float = 0.0
    delay: float = 0.0
    gains: tuple[float, float] = (1.0, 1.0)
    payload: float = inf
    loaded: Four = SURGE_TRUTH
    stop: float = inf
    quiet: float = inf


CLEAN = Case()
HONEST = Case(outliers=0.02, dropouts=0.1, delay=0.1)
"""With the model's own form: the intervals have to hold."""

FAULTS = replace(HONEST, gains=(1.05, 1.05))
"""Three quarters of the thrust are starboard's, 10 % high, a quarter is port's, 10 % low."""

SPLIT = replace(HONEST, gains=(1.1, 0.9))
"""Each sinusoid comes from a thruster of its own: no model of the sum is right."""


@dataclass(frozen=True)
class Trial:
    """Times [s] of the fixes, the fixes [m] and the logged thrust's impulse at any time."""

    case: Case
    time: Array
    fixes: Array

    def impulse(self, time: Array) -> Array:
        """Return the impulse of the logged thrust [N s]."""
        return impulse(self.case.waves, np.minimum(time, self.case.stop))

    def pieces(self) -> Pieces:
        """Return what the pipe makes of it: the first velocity, then the steps."""
        t, interval = self.time, np.diff(self.time)
        mean = np.diff(self.fixes) / interval
        middle = 0.5 * (t[1:] + t[:-1])
        dt = np.diff(middle)
        parts = t[1:-1] - middle[:-1], middle[1:] - t[1:-1]
        at_fix, at_middle = self.impulse(t[1:-1]), self.impulse(middle)
        forces = (at_fix - at_middle[:-1]) / parts[0], (at_middle[1:] - at_fix) / parts[1]
        velocity = filtered(CUTOFF, np.append(1.0, dt), mean)
        force = filtered(CUTOFF, dt, np.diff(at_middle) / dt)
        columns = [column.tolist() for column in (
            dt, velocity[:-1], velocity[1:], force, mean[1:], interval[1:], *parts, *forces)]
        return [float(mean[0]), *(
            Step(h, (a, 0.5 * (a + b), b), (f, f, f), m, span, (p, q), (g, k), 0.0)
            for h, a, b, f, m, span, p, q, g, k in zip(*columns))]


def impulse(waves: Waves, time: Array) -> Array:
    """Return the integral of sinusoids that begin at 0 [N s]."""
    time = np.maximum(time, 0.0)
    return sum((f / (2 * pi * hz) * (1.0 - np.cos(2 * pi * hz * time)) for f, hz in waves),
               np.zeros_like(time))


def gained(waves: Waves, gains: Sequence[float]) -> Waves:
    """Return what the thrusters really give."""
    return [(f * gain, hz) for (f, hz), gain in zip(waves, gains)]


@cache
def _true_path(case: Case) -> Array:
    h = 1.0 / (RATE * FINE)
    time = np.arange(round(case.duration / h) + 1) * h
    thrust = impulse(gained(case.waves, case.gains), np.minimum(time, case.stop) - case.delay)
    dt, force = np.full(len(time) - 1, h), np.diff(thrust) / h
    k = round(min(case.payload, case.duration) / h)
    velocity = trajectory(np.array(case.truth), 0.0, dt[:k], force[:k])
    if k < len(dt):
        later = trajectory(np.array(case.loaded), float(velocity[-1]), dt[k:], force[k:])
        velocity = np.concatenate([velocity, later[1:]])
    return integral(velocity, dt)[::FINE]


def trial(case: Case, seed: int, noise: float = NOISE) -> Trial:
    """Return what a transponder measures of a vehicle that starts at rest."""
    random = np.random.default_rng(seed)
    true = _true_path(case)
    n = len(true)
    time, error = np.arange(n) / RATE, random.normal(0.0, noise, n)
    if case.quiet < case.duration:
        error[time > case.quiet] = 0.0
    fixes = true + error
    fixes += case.size * (random.random(n) < case.outliers) * random.choice([-1.0, 1.0], n)
    kept = random.random(n) >= case.dropouts
    kept[:3] = True
    return Trial(case, time[kept], fixes[kept])


@dataclass(frozen=True)
class Found:
    """What a method says at a moment, and when it first said that the vehicle changed."""

    parameters: Four
    std: Four
    covariance: tuple[float, ...]
    delay: float
    delay_std: float
    changed_at: float


def follow(identifier: Identifier, pieces: Pieces, marks: Sequence[float] = (inf,),
           since: float = 0.0) -> list[Found]:
    """
    Go through a trial.

    Parameters
    ----------
    identifier : Identifier
        Any method.
    pieces : list
        Of a trial.
    marks : sequence of float
        Times [s] at which to look; the end for what comes after it.
    since : float
        Time [s] from which a change is looked for.

    """
    found, time, changed_at, left = [], 0.0, inf, list(marks)

    def look() -> Found:
        return Found(identifier.parameters, identifier.std, identifier.covariance,
                     identifier.delay, identifier.delay_std, changed_at)

    for piece in pieces:
        if not isinstance(piece, Step):
            identifier.restart(piece)
            continue
        identifier.step(piece)
        time += piece.dt
        if time > since and changed_at == inf and 'vehicle changed' in identifier.note:
            changed_at = time
        while left and time >= left[0] - 1e-6:
            left.pop(0)
            found.append(look())
    return found + [look() for _ in left]


def prediction_error(parameters: Four, delay: float, case: Case,
                     waves: Waves = VALIDATION) -> float:
    """
    Return the mean absolute velocity error [m/s] of a model on another profile, from rest.

    The model is driven by the logged thrust, with the delay that it found; the truth by what
    the thrusters give of it.
    """
    dt = np.full(6000, 0.05)
    time = np.append(0.0, np.cumsum(dt))
    true = _validation(case, tuple(waves))
    logged = np.diff(impulse(waves, time - (delay if np.isfinite(delay) else 0.0))) / dt
    if not np.isfinite(parameters).all():
        return inf
    alpha, beta, gamma, delta = parameters
    model = trajectory(np.array([alpha, min(beta, 0.0), min(gamma, 0.0), delta]), 0.0, dt, logged)
    return float(np.abs(model - true).mean())


@cache
def _validation(case: Case, waves: tuple[tuple[float, float], ...]) -> Array:
    dt = np.full(6000, 0.05)
    time = np.append(0.0, np.cumsum(dt))
    thrust = impulse(gained(waves, case.gains), time - case.delay)
    return trajectory(np.array(case.truth), 0.0, dt, np.diff(thrust) / dt)


@cache
def bound(duration: float, delay: bool, case: Case = CLEAN) -> Array:
    """
    Return the Cramer-Rao bound of alpha to delta for a case without outliers or dropouts.

    Start position and velocity are unknown, and the delay of the thrust if ``delay``.
    """
    h = 1.0 / (4 * RATE)
    time = np.arange(round(duration / h) + 1) * h
    dt, force = np.full(len(time) - 1, h), np.diff(impulse(case.waves, time)) / h
    truth = np.array(case.truth)
    velocity = trajectory(truth, 0.0, dt, force)
    columns = [integral(sensitivities(truth, velocity, dt, force), dt)[::4],
               np.ones((round(duration * RATE) + 1, 1))]
    if delay:
        small = 1e-3
        late = np.diff(impulse(case.waves, time - small)) / h
        change = trajectory(truth, 0.0, dt, late) - velocity
        columns.append((integral(change, dt) / small)[::4, None])
    derivatives = np.hstack(columns)
    scale = np.abs(derivatives).max(axis=0)
    scaled = derivatives / scale
    variances = np.diag(np.linalg.inv(scaled.T @ scaled))
    return np.asarray((NOISE * np.sqrt(variances) / scale)[:4])
