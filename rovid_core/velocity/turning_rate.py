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

import math
from typing import Final

from rovid_core.model.dofs import Vector

FILTERS: Final = 6
"""Side by side; over 1, 2, 4 to 32 intervals they look."""

MEMORY: Final = 100
"""Intervals over which the predictions are judged: some seconds, as motion comes and goes."""


class AngleFilter:
    """
    The filter of the angle about one axis, for one size of the noise.

    Attributes
    ----------
    gain : float
        Of the angle, 1 - c.
    rate_gain : float
        Of the rate, times the interval.
    rate : float
        [rad/s] that it goes on with.
    left : float
        [rad] By which the measured angle is ahead of the filter's.
    square : float
        Mean square of its innovations [rad^2].

    """

    __slots__ = ('gain', 'rate_gain', 'rate', 'left', 'square')

    def __init__(self, gain: float) -> None:
        self.gain, self.rate_gain = gain, gain * gain / (2.0 - gain)
        self.rate = self.left = self.square = 0.0

    def begin(self, rate: float) -> None:
        """Begin at a measured angle with a rate [rad/s]."""
        self.rate, self.left, self.square = rate, 0.0, 0.0

    def add(self, angle: float, dt: float, count: int) -> float:
        """
        Return the mean rate [rad/s] while a measured angle grew by ``angle`` [rad] in ``dt`` [s].

        ``count`` is over how many intervals the predictions are judged.
        """
        innovation = self.left + angle - self.rate * dt
        self.square += (innovation * innovation - self.square) / count
        mean = self.rate + self.gain / dt * innovation
        self.left = (1.0 - self.gain) * innovation
        self.rate += self.rate_gain / dt * innovation
        return mean


class TurningRate:
    """The rates about the three axes of the body, of filters side by side."""

    def __init__(self) -> None:
        self._axes = [[AngleFilter(0.5**k) for k in range(FILTERS)] for _ in range(3)]
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
        self._count = min(self._count + 1, MEMORY)
        x, y, z = rotation
        one, other, third = self._axes
        return self._mean(one, x, dt), self._mean(other, y, dt), self._mean(third, z, dt)

    def _mean(self, filters: list[AngleFilter], angle: float, dt: float) -> float:
        """Return the mean rate about an axis by the filter that has predicted best."""
        count = self._count
        if count == 1:
            for one in filters:
                one.begin(angle / dt)
            return angle / dt
        best, least = 0.0, math.inf
        for one in filters:
            mean = one.add(angle, dt, count)
            if one.square < least:
                best, least = mean, one.square
        return best
