"""
How fast the body turns, from attitudes that are noisy.

A difference of two attitudes has the noise of both in it: 2 mrad twenty times a second are
3 degrees per second, more than many a vehicle pitches by. A regressor that is made of it, such as
``wq``, hands this on to the parameters as a bias. So a turn is one of the angles that a Kalman
filter has: behind white noise, with a rate that changes at random, in the steady state. With c
between 0 and 1, the larger the noise is against the changes of the rate, an innovation e changes

    angle by (1 - c) e,    rate by (1 - c)^2 / (1 + c) e / dt

which a comparison of the coefficients of the angles' second differences gives. Some filters run
side by side, and about each axis that one counts whose predictions were best. Without noise this
is the one with c = 0, which has the angles as they are measured.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from rovid_core.model.dofs import Vector

GAINS: Final = 0.5 ** np.arange(6.0)
"""Of the angles, 1 - c: over so many intervals, 1 to 32, a filter looks."""

MEMORY: Final = 100
"""Intervals over which the predictions are judged: some seconds, as motion comes and goes."""


class TurningRate:
    """The rates about the three axes of the body, of filters side by side."""

    def __init__(self) -> None:
        shape = (3, GAINS.size)
        self._rates, self._left, self._squares = np.zeros((3, *shape))
        self._rate_gains = GAINS**2 / (2.0 - GAINS)
        self._count = 0

    def interrupt(self) -> None:
        """Begin with the next interval."""
        self._count = 0

    def add(self, rotation: Vector, dt: float) -> Vector:
        """
        Add the rotation from one attitude to the next.

        Parameters
        ----------
        rotation : tuple of 3 floats
            About the axes of the body [rad].
        dt : float
            Between the two [s].

        Returns
        -------
        tuple of 3 floats
            The mean angular velocity in between [rad/s].

        """
        angles = np.array(rotation)[:, np.newaxis]
        count = self._count = min(self._count + 1, MEMORY)
        if count == 1:
            self._rates[:] = angles / dt
            self._left[:] = self._squares[:] = 0.0
            return rotation[0] / dt, rotation[1] / dt, rotation[2] / dt
        innovations = self._left + angles - self._rates * dt
        self._squares += (innovations * innovations - self._squares) / count
        means = self._rates + GAINS / dt * innovations
        self._left = (1.0 - GAINS) * innovations
        self._rates += self._rate_gains / dt * innovations
        x, y, z = means[range(3), self._squares.argmin(axis=1)].tolist()
        return x, y, z
