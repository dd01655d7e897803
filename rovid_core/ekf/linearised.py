"""
A linearised filter for position, velocity and parameters of one degree of freedom.

    x' = v        v' = alpha tau(t - d) + beta v|v| + gamma v + delta

All in units in which the typical force and velocity are 1: alpha to delta are accelerations
in typical velocities per second. The state is predicted by Runge-Kutta.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np
from numpy.typing import NDArray
from rovid_core.ekf.impulses import Impulses

Array = NDArray[np.float64]

POSITION, VELOCITY, ALPHA, BETA, GAMMA, DELTA, DELAY = range(7)
SIZE = 7

FASTEST = 1e4
"""Typical velocities beyond which the state means nothing."""

Bounds = Sequence[tuple[int, float, float]]
"""Index, lowest and highest value of what is bounded."""


class DivergenceError(ArithmeticError):
    """The state of a filter means nothing any more."""


class Linearised:
    """
    A Kalman filter around a nominal motion.

    The estimate is the nominal state plus a deviation. ``relinearise`` moves the nominal
    state there: after each measurement that makes an extended Kalman filter, once at the
    end of a trial a step of Gauss-Newton.

    Parameters
    ----------
    nominal : sequence of 7 floats
        Position, velocity, the four parameters, delay [s].
    covariance : ndarray, shape (7, 7)
        Of the estimate.

    Attributes
    ----------
    begun : float
        Velocity at ``remember_beginning``.

    """

    def __init__(self, nominal: Sequence[float], covariance: Array) -> None:
        self.nominal = list(nominal)
        self.deviation = np.zeros(SIZE)
        self.covariance = covariance.copy()
        self._cross: Array | None = None
        self.begun = 0.0

    def deviate(self, initial: Sequence[float]) -> None:
        """Let the estimate of parameters and delay be ``initial``, wherever it is linearised."""
        self.deviation[ALPHA:] = [p - n for p, n in zip(initial, self.nominal[ALPHA:])]

    def set_motion(self, velocity: float, variance: tuple[float, float]) -> None:
        """Take position 0 and a velocity with their variances; the parameters stay."""
        p = self.covariance
        p[:2] = 0.0
        p[:, :2] = 0.0
        p[0, 0], p[1, 1] = variance
        self.nominal[:2] = 0.0, velocity
        self.deviation[:2] = 0.0

    def remember_beginning(self) -> None:
        """Estimate the present velocity from all that follows, as ``begun``."""
        self.begun = self.nominal[VELOCITY]
        self._cross = self.covariance[VELOCITY].copy()

    def predict(self, impulses: Impulses, start: float, end: float, noise: float) -> None:
        """
        Move from ``start`` to ``end`` [s].

        Parameters
        ----------
        impulses : Impulses
            Of the force.
        start, end : float
            [s]
        noise : float
            Spectral density of the acceleration that the model does not know.

        """
        h = end - start
        x, v, alpha, beta, gamma, delta, delay = self.nominal
        begin, half, last = (impulses.at(t - delay) for t in (start, start + 0.5 * h, end))
        force = (last - begin) / h
        # the force is taken as a straight line over the step; this is half its rise
        rise = 2.0 * (begin + last - 2.0 * half) / h
        u, du = alpha * force + delta, alpha * rise
        k1 = u - du + (beta * abs(v) + gamma) * v
        w = v + 0.5 * h * k1
        k2 = u + (beta * abs(w) + gamma) * w
        w = v + 0.5 * h * k2
        k3 = u + (beta * abs(w) + gamma) * w
        z = v + h * k3
        k4 = u + du + (beta * abs(z) + gamma) * z
        self.nominal[0] = x + h * v + h * h / 6.0 * (k1 + k2 + k3)
        self.nominal[1] = v + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        if not abs(self.nominal[1]) < FASTEST:
            raise DivergenceError(f'a speed of {self.nominal[1]}')
        decay = h * (2.0 * beta * abs(w) + gamma)
        share = h * (1.0 + 0.5 * decay)
        # held commands are a staircase: its slope inside a step says nothing of the delay
        top = min(end + h, impulses.end + delay)
        a, b, c, d = (impulses.at(t - delay) for t in (start - h, start, top - h, top))
        slope = ((d - c) - (b - a)) / (h * (top - start))
        phi = (force, w * abs(w), w, 1.0, -alpha * slope)
        self._propagate(np.array((
            (1.0, share, *[0.5 * h * h * y for y in phi]),
            (0.0, 1.0 + decay * (1.0 + 0.5 * decay), *[share * y for y in phi]))), h, noise)

    def _propagate(self, rows: Array, h: float, noise: float) -> None:
        """Move deviation and covariance; ``rows`` are the derivatives of the motion."""
        p = self.covariance
        self.deviation[:2] = rows @ self.deviation
        if self._cross is not None:
            self._cross[:2] = rows @ self._cross
        moved = rows @ p
        corner = moved @ rows.T
        p[:2] = moved
        p[:, :2] = moved.T
        p[0, 0] = corner[0, 0] + noise * h * h * h / 3.0
        p[0, 1] = p[1, 0] = corner[0, 1] + noise * h * h / 2.0
        p[1, 1] = corner[1, 1] + noise * h

    def innovation(self, i: int, value: float, variance: float) -> tuple[float, float]:
        """Return by how much a measurement of state ``i`` is off, and the variance of that."""
        return (value - self.nominal[i] - float(self.deviation[i]),
                float(self.covariance[i, i]) + variance)

    def update(self, i: int, error: float, variance: float, adapt: bool = True) -> None:
        """Take an innovation of state ``i``; the parameters stay if not ``adapt``."""
        root = math.sqrt(variance)
        row = self.covariance[i] / root
        change = np.outer(row, row)  # symmetric to the last bit
        if self._cross is not None:
            share = self._cross[i] / root
            self.begun += float(share * error / root)
            self._cross -= share * row
        if not adapt:
            row[ALPHA:] = 0.0
            change[ALPHA:, ALPHA:] = 0.0
        self.deviation += row * (error / root)
        self.covariance -= change

    def walk(self, scale: Array, share: float) -> None:
        """Let the parameters change by ``share`` of a diagonal covariance ``scale``."""
        self.covariance += share * scale

    def loosen_motion(self, variance: float) -> None:
        """Forget position and velocity by this variance."""
        self.covariance[POSITION, POSITION] += variance
        self.covariance[VELOCITY, VELOCITY] += variance

    def loosen_parameters(self, share: float) -> None:
        """Forget the parameters by this share of each."""
        for i in range(ALPHA, DELAY):
            self.covariance[i, i] += (share * self.nominal[i]) ** 2

    def relinearise(self, bounds: Bounds) -> None:
        """Move the nominal state to the estimate, inside the bounds."""
        nominal = [x + d for x, d in zip(self.nominal, self.deviation.tolist())]
        self.deviation[:] = 0.0
        for i, low, high in bounds:
            if low <= nominal[i] <= high:
                continue
            bound = low if nominal[i] < low else high
            variance = self.covariance[i, i]
            if variance > 0.0:
                # the others move with it, or they would contradict it
                share = (self.covariance[i] * ((bound - nominal[i]) / variance)).tolist()
                nominal = [x + d for x, d in zip(nominal, share)]
            nominal[i] = bound
        self.nominal = nominal
        variances = self.covariance.diagonal().tolist()
        if not all(0.0 <= x < math.inf for x in variances):
            raise DivergenceError('the covariance is not positive')
