"""What the innovations of a filter say: noise level, outliers, and whether they are white."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Final

FEW: Final = 20
MANY: Final = 2000
"""Measurements over which the noise level is averaged, in the beginning and in the end."""

HUBER: Final = 3.0
CLIPPED: Final = 0.99501
"""
Innovations above that count less [standard deviations], and the mean of min(r, 3)^2 for a
standard normal r.

The noise level takes in all that count in full: the errors of a model that is not quite right
are large where the vehicle is driven, and a level of the small ones would have it learned from
the rest.
"""

LEAST_NOISE: Final = 1e-4
"""
Of a measurement, in typical velocities (times 1 s). What is simulated has none, and errors of the
steps by which a filter goes on would then be taken for errors of the model.
"""

OUTLIER: Final = 5.0
"""Those above that do not count [standard deviations, times the local level]."""

LOCAL: Final = 20
LARGEST_LEVEL: Final = 25.0
"""Measurements over which the local level is averaged, and the square that counts at most."""

LOST: Final = 4
"""Outliers in a row after which path and velocity are widened."""

SOON: Final = 1.0
SOON_LOST: Final = 2
"""
How many do in the first second [s].

The path may begin with one, and the velocity is so uncertain that it would soon explain it.
"""

WINDOW: Final = 300
"""Measurements over which the correlation is averaged."""

MEMORY: Final = 3000
"""Measurements over which the likelihood is summed up."""


def clipped(normalised: float) -> float:
    """Return an innovation in standard deviations, of an outlier one at ``HUBER``."""
    return HUBER if normalised > HUBER else -HUBER if normalised < -HUBER else normalised


def surprise(normalised: float, variance: float) -> float:
    """Return -2 log of how likely an innovation is; of an outlier, that of one at ``HUBER``."""
    r = clipped(normalised)
    return math.log(variance) + r * r


class Innovations:
    """
    Statistics of normalised innovations.

    The outlier gate widens with their local level: a vehicle that the model does not explain
    is listened to, while a jump among innovations of the usual size stays an outlier.

    Parameters
    ----------
    noise : float
        Standard deviation of a measurement to begin with.
    axes : int
        How many are measured at once.

    Attributes
    ----------
    noise : float
        Standard deviation of a measurement.
    least : float
        Below which that does not fall; where it is already, it stays.
    correlation : float
        Of an innovation with the one before it.
    likelihood : float
        -2 log of the likelihood of the last ``MEMORY`` measurements, robust.

    """

    def __init__(self, noise: float, axes: int = 1) -> None:
        self.noise, self.least = noise, 0.0
        self.likelihood = 0.0
        self.count = 0
        self._level = 1.0
        self._missed = 0
        self._last = [0.0] * axes
        self._product = self._square = 0.0

    @property
    def correlation(self) -> float:
        """
        Return how an innovation goes with the one before it, -1 to 1.

        Those that are smaller than the filter takes them to be say as much less.
        """
        return self._product / max(self._square, 1.0)

    @property
    def inflation(self) -> float:
        """Return by how much correlated innovations raise the variance of what is learned."""
        correlation = min(self.correlation, 0.9)
        return (1.0 + correlation) / (1.0 - correlation) if correlation > 0.2 else 1.0

    def is_outlier(self, normalised: float) -> bool:
        """Tell whether an innovation in standard deviations is that of an outlier."""
        square = normalised * normalised
        level = self._level
        outlier = square > OUTLIER * OUTLIER * (level if level > 1.0 else 1.0)
        self._level = level + (
            (square if square < LARGEST_LEVEL else LARGEST_LEVEL) - level) / LOCAL
        self._missed = self._missed + 1 if outlier else 0
        return outlier

    def is_lost(self, beginning: bool) -> bool:
        """Tell whether there were so many in a row that the filter has lost the vehicle."""
        if self._missed < (SOON_LOST if beginning else LOST):
            return False
        self._missed = 0
        return True

    def forget_outliers(self) -> None:
        """Forget the outliers in a row, as after a gap."""
        self._missed = 0

    def learn_noise(self, normalised: float) -> None:
        """Learn the noise level from an innovation in standard deviations."""
        square = normalised * normalised
        share = 1.0 / (self.count + FEW if self.count < MANY - FEW else MANY)
        self.scale_noise(math.sqrt(1.0 + share * (
            (square if square < HUBER * HUBER else HUBER * HUBER) / CLIPPED - 1.0)))

    def scale_noise(self, factor: float) -> float:
        """Let the noise level be larger or smaller by a factor; return that by which it is."""
        before, noise = self.noise, factor * self.noise
        if noise >= self.least or factor > 1.0:
            self.noise = noise
            return factor
        self.noise = min(before, self.least)
        return self.noise / before

    def add(self, normalised: float, variance: float, axis: int = 0) -> None:
        """Add an innovation of an axis in standard deviations, and the variance it had."""
        r = clipped(normalised)
        square = r * r
        self.likelihood += math.log(variance) + square - self.likelihood / MEMORY
        self.count += 1
        share = 1.0 / (self.count if self.count < WINDOW else WINDOW)
        self._product += share * (r * self._last[axis] - self._product)
        self._square += share * (square - self._square)
        self._last[axis] = r

    def state(self) -> list[float]:
        """Return all that is needed to go on from here."""
        return [self.noise, self.likelihood, self.count, self._level, self._missed,
                self._product, self._square, *self._last]

    def restore(self, state: Sequence[float]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        values = [float(x) for x in state]
        noise, likelihood, count, level, missed, product, square, *last = values
        if not (noise > 0.0 and all(map(math.isfinite, values))) or (
                len(last) != len(self._last)):
            raise ValueError('innovations out of range')
        self.noise, self.likelihood, self.count = noise, likelihood, int(count)
        self._level, self._missed, self._last = level, int(missed), last
        self._product, self._square = product, square
