"""The noise of a regression, learned from its innovations, which need not be white."""

from __future__ import annotations

from collections.abc import Sequence
import math

MEMORY = 20.0
"""[s]"""

FREQUENCY = 0.5
"""[rad/s] below which the innovations' spectrum counts, for that is where a vehicle moves."""

ROBUST = 3.0
"""Standard deviations of an innovation beyond which it is an outlier."""

LEAST = 1e-10
"""Of the variance, in squares of typical velocity x 1 s."""

LEAST_SHARE = 0.02
"""Of the variance that white noise would need, however blue the innovations are."""


class RegressionNoise:
    """
    Variance of the innovations, and of white noise that would disturb the estimate as much.

    What disturbs an estimate is the noise's spectrum at the frequencies of the regressors.
    A low-pass gives it: y += h (e - y) of white noise has h / (2 - h) of its variance.

    Parameters
    ----------
    variance : float
        At first.

    """

    def __init__(self, variance: float) -> None:
        self._all = self._slow = variance
        self._y = 0.0
        self._time = 0.0

    @property
    def variance(self) -> float:
        """Return the variance that white noise would need to disturb as much."""
        return max(self._slow, LEAST_SHARE * self._all, LEAST)

    def weight(self, innovation: float, prediction: float) -> float:
        """Return Huber's weight of an innovation, 1 or less."""
        most = ROBUST * math.sqrt(self._all + prediction)
        return most / abs(innovation) if abs(innovation) > most else 1.0

    def add(self, innovation: float, prediction: float, dt: float) -> None:
        """Take an innovation, already weighted, with the variance of the prediction."""
        e = innovation * math.sqrt(self._all / (self._all + prediction))
        self._time += dt
        share = min(dt / min(self._time + 3.0, MEMORY), 1.0)
        h = -math.expm1(-FREQUENCY * dt)
        self._y += h * (e - self._y)
        self._all = max(self._all + share * (e * e - self._all), LEAST)
        self._slow += share * (self._y * self._y * (2.0 - h) / h - self._slow)
        self._slow = max(self._slow, LEAST_SHARE * LEAST)

    def state(self) -> list[float]:
        """Return all that is needed to go on from here."""
        return [self._all, self._slow, self._y, self._time]

    def restore(self, state: Sequence[float]) -> None:
        """Go on from ``state``."""
        self._all, self._slow, self._y, self._time = state
