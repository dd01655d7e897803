"""
The velocity that a model predicts for a whole trial, from the thrust alone.

The steps are those of ``plant.advance``. Newton's method solves all of them at once: with
``v[k + 1] = F_k(v[k])`` the changes of v follow a linear recurrence with the slopes of F.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np
from rovid_core.model.plant import advance
from rovid_core.model.recurrence import Array, recurrence

TOLERANCE = 1e-13  # of the largest velocity
MOST_ITERATIONS = 30
MOST_PIECES = 20
"""A model whose drag is so fast that a segment takes more goes step by step."""

MOST_VELOCITY = 1e6
"""A model that grows without bound has no velocity beyond this."""


def predict(parameters: Sequence[float], start: float, dt: Array, force: Array) -> Array:
    """
    Return the velocity at the start and after each segment of constant force.

    Parameters
    ----------
    parameters : sequence of 4 floats
        alpha, beta, gamma, delta.
    start : float
        Velocity at the start [m/s or rad/s].
    dt, force : ndarray, shape (n,)
        Length [s] and mean force [N or N m] of each segment.

    Returns
    -------
    velocity : ndarray, shape (n + 1,)
        [m/s or rad/s]; infinite from where a model with the wrong sign of drag runs away.

    """
    _, beta, gamma, delta = parameters
    drive = parameters[0] * force + delta
    largest = float(np.abs(drive).max(initial=0.0))
    # drag outweighs all thrust at this speed (Appendix of the paper)
    fastest = max(abs(start), math.sqrt(largest / -beta)) if beta < 0.0 else 0.0
    with np.errstate(all='ignore'):
        pieces = (2.0 * abs(beta) * fastest + abs(gamma)) * dt + 1.0
        if max(beta, gamma) <= 0.0 and pieces.max(initial=1.0) < MOST_PIECES:
            number = pieces.astype(int)
            found = _solved(beta, gamma, start, np.repeat(dt / number, number),
                            np.repeat(drive, number))
            if found is not None:
                return np.asarray(found[np.concatenate([[0], np.cumsum(number)])])
    return _step_by_step(parameters, start, dt, force)


def _solved(beta: float, gamma: float, start: float, dt: Array, drive: Array) -> Array | None:
    """Return the velocities by Newton's method, None if it does not settle."""
    v = np.full(len(dt) + 1, start)
    for _ in range(MOST_ITERATIONS):
        after, slope = _runge_kutta(beta, gamma, v[:-1], dt, drive)
        change = recurrence(slope, after - v[1:])
        v[1:] += change
        largest = float(np.abs(change).max(initial=0.0))
        if largest <= TOLERANCE * max(float(np.abs(v).max()), 1e-3):
            return v
    return None


def _runge_kutta(beta: float, gamma: float, v: Array, dt: Array,
                 drive: Array) -> tuple[Array, Array]:
    """Return the velocities after one step from each of ``v``, and their slopes by it."""
    rate = slope = rates = slopes = np.zeros_like(v)
    for share, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
        w = v + share * dt * rate
        speed = beta * np.abs(w)
        slope = (2.0 * speed + gamma) * (1.0 + share * dt * slope)
        rate = drive + (speed + gamma) * w
        rates, slopes = rates + weight * rate, slopes + weight * slope
    return v + dt / 6.0 * rates, 1.0 + dt / 6.0 * slopes


def _step_by_step(parameters: Sequence[float], start: float, dt: Array,
                  force: Array) -> Array:
    velocity = np.full(len(dt) + 1, math.inf)
    velocity[0] = v = start
    for k, (h, f) in enumerate(zip(dt.tolist(), force.tolist()), 1):
        try:
            v = advance(parameters, v, f, h)
        except (ValueError, ArithmeticError):  # no speed at which the drag settles
            break
        if not abs(v) < MOST_VELOCITY:
            break
        velocity[k] = v
    return velocity
