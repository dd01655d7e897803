"""
How far and how fast many vehicles move under many profiles, and what that tells of them.

All vehicles are stepped side by side: a search needs thousands of short trials, not a long one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rovid_core.model.trajectory import Array, midpoint_steps

CHUNK = 32
"""Measurements that are squared together, which is quicker than one by one."""


def reach(parameters: Array, force: Array, dt: float) -> tuple[Array, Array]:
    """
    Return how fast and how far vehicles get, from rest.

    Parameters
    ----------
    parameters : ndarray, shape (4, v)
        alpha, beta, gamma, delta with beta, gamma <= 0, of each vehicle.
    force : ndarray, shape (n, p)
        Mean force of each profile over each step [N or N m].
    dt : float
        Length of the steps [s].

    Returns
    -------
    speed, room : ndarray, shape (p, v)
        Largest ``|v|`` [m/s or rad/s] and ``|x - x0|`` [m or rad].

    """
    shape = force.shape[1], parameters.shape[1]
    speed, room, path = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for _, v, middle, _ in _steps(parameters, force, dt):
        path += dt * middle
        np.maximum(speed, np.abs(v), out=speed)
        np.maximum(room, np.abs(path), out=room)
    return speed, room


def information(parameters: Array, force: Array, dt: float, of_velocity: bool) -> Array:
    """
    Return the Fisher information for measurements after each step with unit white noise.

    Parameters
    ----------
    parameters, force, dt
        As in ``reach``.
    of_velocity : bool
        Whether the velocity is measured, not the position.

    Returns
    -------
    information : ndarray, shape (p, v, 6, 6) or (p, v, 5, 5)
        Of alpha, beta, gamma, delta, the velocity and, if measured, the position at the start.

    """
    _, beta, gamma, _ = parameters
    shape = force.shape[1], parameters.shape[1]
    slopes = np.zeros((*shape, 5))  # of the velocity, by the parameters and its start
    slopes[..., 4] = 1.0
    paths = np.zeros((*shape, 6))
    paths[..., 5] = 1.0
    right = np.zeros((*shape, 5))
    right[..., 3] = dt
    total = np.zeros((*shape, 5, 5) if of_velocity else (*shape, 6, 6))
    rows: list[Array] = []
    for f, _, middle, size in _steps(parameters, force, dt):
        half = 0.5 * dt * (2.0 * beta * size + gamma)
        right[..., 0] = dt * f
        right[..., 1] = dt * middle * size
        right[..., 2] = dt * middle
        after = (slopes * (1.0 + half)[..., None] + right) / (1.0 - half)[..., None]
        paths[..., :5] += 0.5 * dt * (slopes + after)
        slopes = after
        rows.append(slopes if of_velocity else paths.copy())
        if len(rows) == CHUNK:
            total += _squares(rows)
            rows = []
    return total + _squares(rows) if rows else total


def regression(parameters: Array, force: Array, dt: float) -> Array:
    """
    Return the information of exact measurements where white noise is on the force.

    Parameters
    ----------
    parameters, force, dt
        As in ``reach``.

    Returns
    -------
    information : ndarray, shape (p, v, 4, 4)
        Of the physical parameters, for noise with a density of 1 [N^2 s or N^2 m^2 s]: the
        integral of the squared regressors of m v' + d_Q v|v| + d_L v + b = tau.

    """
    shape = force.shape[1], parameters.shape[1]
    total, rows = np.zeros((*shape, 4, 4)), []
    before = np.zeros(shape)
    for _, v, middle, size in _steps(parameters, force, dt):
        rows.append(np.stack([(v - before) / dt, middle * size, middle, np.ones(shape)], -1))
        before = v
        if len(rows) == CHUNK:
            total += dt * _squares(rows)
            rows = []
    return total + dt * _squares(rows) if rows else total


def _squares(rows: list[Array]) -> Array:
    measured = np.stack(rows, axis=-1)
    return np.asarray(measured @ measured.swapaxes(-1, -2))


def paths(parameters: Array, force: Array, dt: float) -> Array:
    """Return the position of each vehicle after each step, shape (n, p, v) [m or rad]."""
    steps = [dt * middle for _, _, middle, _ in _steps(parameters, force, dt)]
    return np.asarray(np.cumsum(steps, axis=0))


def _steps(parameters: Array, force: Array,
           dt: float) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Yield the force, shape (p, 1), v at the end, v at the middle and its size."""
    columns = force[:, :, None]
    start = np.zeros((force.shape[1], parameters.shape[1]))
    steps = midpoint_steps(parameters, start, np.full(len(force), dt), columns)
    for f, (middle, v) in zip(columns, steps):
        yield f, v, middle, np.abs(middle)
