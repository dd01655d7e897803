"""
The velocity response of a model and its derivatives, for a whole trial at once.

Implicit midpoint rule, ``v1 - v0 = h f((v0 + v1) / 2, tau)``: second order, and stable for
any drag. All steps are solved together by Newton's method, whose changes follow a linear
recurrence, so that hours of log take milliseconds.
"""

from __future__ import annotations

import numpy as np
from rovid_core.model.recurrence import Array, recurrence

TOLERANCE = 1e-12  # of the largest velocity change in the last Newton step
MOST_ITERATIONS = 50


def response(parameters: Array, start: float, dt: Array, force: Array) -> Array:
    """
    Return the velocity at the start and after each segment of constant force.

    Parameters
    ----------
    parameters : ndarray, shape (4,)
        alpha, beta, gamma, delta with beta, gamma <= 0.
    start : float
        Velocity at the start [m/s or rad/s].
    dt, force : ndarray, shape (n,)
        Length [s] and mean force [N or N m] of each segment.

    Returns
    -------
    velocity : ndarray, shape (n + 1,)
        [m/s or rad/s]

    """
    _, beta, gamma, delta = parameters
    drive = parameters[0] * force + delta
    v = np.full(len(dt) + 1, start)
    size = max(abs(start), 1e-3)
    for _ in range(MOST_ITERATIONS):
        middle = 0.5 * (v[:-1] + v[1:])
        residual = v[1:] - v[:-1] - dt * (
            drive + beta * middle * np.abs(middle) + gamma * middle)
        change = _solve(parameters, middle, dt, -residual)
        # far from the solution a full step can go round in a circle over v|v|'s kink
        v[1:] += change
        size = max(size, float(np.abs(v).max()))
        if float(np.abs(change).max()) <= TOLERANCE * size:
            break
    return v


def sensitivities(parameters: Array, velocity: Array, dt: Array, force: Array) -> Array:
    """
    Return the derivatives of a response.

    Parameters
    ----------
    parameters, dt, force
        As in ``response``.
    velocity : ndarray, shape (n + 1,)
        The response.

    Returns
    -------
    derivatives : ndarray, shape (n + 1, 5)
        By alpha, beta, gamma, delta and the velocity at the start.

    """
    middle = 0.5 * (velocity[:-1] + velocity[1:])
    right = np.stack([dt * force, dt * middle * np.abs(middle), dt * middle, dt,
                      np.zeros_like(dt)])
    right[4, 0] = 1.0 + _half_slope(parameters, middle, dt)[0]
    derivatives = np.zeros((len(dt) + 1, 5))
    derivatives[0, 4] = 1.0
    derivatives[1:] = _solve(parameters, middle, dt, right).T
    return derivatives


def path(values: Array, dt: Array) -> Array:
    """Return the integral from the start of values at the nodes (shape (n + 1, ...))."""
    steps = (0.5 * (values[:-1] + values[1:]).T * dt).T
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(steps, axis=0)])


def _solve(parameters: Array, middle: Array, dt: Array, right: Array) -> Array:
    """Return x of ``(1 - s[k]) x[k] - (1 + s[k]) x[k - 1] = right[k]``."""
    slope = _half_slope(parameters, middle, dt)
    return recurrence((1.0 + slope) / (1.0 - slope), right / (1.0 - slope))


def _half_slope(parameters: Array, middle: Array, dt: Array) -> Array:
    return np.asarray(0.5 * dt * (2.0 * parameters[1] * np.abs(middle) + parameters[2]))
