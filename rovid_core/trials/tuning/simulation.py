"""Many models over many blocks of a trial, step by step in vectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.trajectory import Array, mean_velocity


def simulate(theta: Array, start: Array, dt: Array, force: Array) -> Array:
    """
    Return the mean velocity of every step by the implicit midpoint rule.

    Parameters
    ----------
    theta : ndarray, shape (4, ...)
        alpha, beta <= 0, gamma <= 0, delta.
    start : ndarray, shape (...)
        Velocity at the start.
    dt : ndarray, shape (steps, pieces)
        [s]
    force : ndarray, shape (steps, ...)

    Returns
    -------
    ndarray, shape (steps, ...)

    """
    alpha, beta, gamma, delta = theta
    v = start
    means = np.empty((len(dt), *np.broadcast_shapes(start.shape, alpha.shape)))
    for k, h in enumerate(0.5 * dt):
        w = mean_velocity(v, h, alpha * force[k] + delta, beta, gamma)
        means[k] = w
        v = 2.0 * w - v
    return means


def smoothed(weights: Array, values: Array) -> Array:
    """Return values, shape (steps, ..., pieces), after the low-pass with ``weights``."""
    result = np.empty_like(values)
    y = np.zeros_like(values[0])
    for k, weight in enumerate(weights):
        y = y + weight * (values[k] - y)
        result[k] = y
    return result


@dataclass
class Normal:
    """
    Errors of the candidates, and normal equations per piece without the start's velocity.

    Attributes
    ----------
    limit : ndarray, shape (candidates,)
        Beyond which residuals count less.
    cost, before : ndarray, shape (candidates,)
        With this limit, and with the one before.
    inside, slope : ndarray, shape (candidates, pieces, 4, 4) and (candidates, pieces, 4)
        Matrix and right-hand side.
    cross, right : ndarray, shape (candidates, pieces, 4) and (candidates, pieces)
        How the start's velocity follows the parameters, and its own step.

    """

    limit: Array
    cost: Array
    before: Array
    inside: Array
    slope: Array
    cross: Array
    right: Array

    def take(self, which: NDArray[np.bool_], other: Normal) -> None:
        """Take the candidates ``which`` of another."""
        for mine, new in zip(vars(self).values(), vars(other).values()):
            mine[which] = new[which]
