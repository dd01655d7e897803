"""What the innovations of a filter say: noise level, model error, outliers, a change."""

from __future__ import annotations

from collections.abc import Sequence
import math

from rovid_core.model.samples import Step

CLIP = 2.0
CLIPPED = 0.92064
"""Mean of min(r, 2)^2 for a standard normal r."""

FEW, MANY = 20, 2000
"""Measurements over which the noise level is averaged, in the beginning and in the end."""

HUBER = 3.0
"""Innovations above that count less [standard deviations]."""

BANDWIDTH = 2.2
"""[rad/s] of the filter while the model is in error: what is older is forgotten."""

SMOOTHING = 1.0
"""[s] over which innovations are averaged to see whether they hang together."""

WINDOW = 300
"""Measurements over which that is watched."""

CORRELATED, WHITE = 0.5, 0.25
"""Correlation above which the model is in error, and below which it is right again."""

PATIENCE = 200
"""Measurements without correlation before the model is believed again."""


class Innovations:
    """
    The noise level and whether the model explains the data, from normalised innovations.

    A model without error leaves white innovations. Where each goes on as the last ones went,
    the model is in error, and the filter has to forget how it came where it is.

    Parameters
    ----------
    noise : float
        Standard deviation of a measurement to begin with.
    model_error : bool
        Whether the model is taken to be in error.

    """

    def __init__(self, noise: float, model_error: bool = True) -> None:
        self.noise = noise
        self.model_error = model_error
        self._count = 0
        self._mean = self._product = self._square = 0.0
        self._spread = self._memory = 0.0
        self._quiet = 0

    @property
    def correlation(self) -> float:
        """Return how innovations go with the mean of those before, in typical sizes."""
        return self._product / self._square if self._square > 0.0 else 0.0

    @property
    def inflation(self) -> float:
        """Return by how much correlated innovations raise the variance of what is learned."""
        if not self.model_error:
            return 1.0
        # the sum of the autocorrelation, from the mean that falls off exponentially
        return max(1.0, 1.0 + 2.0 * self.correlation * self._memory)

    @property
    def mean_deviation(self) -> float:
        """Return how far the mean of the last innovations is from 0, in its own std."""
        return abs(self._mean) / self._spread if self._spread > 0.0 else 0.0

    def model_noise(self, step: Step) -> float:
        """
        Return the spectral density of the acceleration that the model does not know.

        As much, beside the noise of the measurements, as lets the filter follow with
        ``BANDWIDTH``; none while the model is right.
        """
        if not self.model_error:
            return 0.0
        power = 4 if step.interval else 2
        return float(BANDWIDTH**power * self.noise * self.noise * step.dt)

    def add_innovation(self, normalised: float, dt: float) -> None:
        """Learn from an innovation in standard deviations, ``dt`` [s] after the last."""
        r = min(abs(normalised), CLIP)
        share = 1.0 / min(self._count + FEW, MANY)
        self.noise *= math.sqrt(1.0 + share * (r * r / CLIPPED - 1.0))
        self.add_to_correlation(normalised, dt)
        if self._count < WINDOW:
            return
        self._quiet = self._quiet + 1 if self.correlation < WHITE else 0
        if self.correlation > CORRELATED:
            self.model_error = True
        elif self._quiet > PATIENCE:
            self.model_error = False

    def add_to_correlation(self, normalised: float, dt: float) -> None:
        """Take an innovation for the correlation alone."""
        self._count += 1
        r = max(-HUBER, min(HUBER, normalised))
        keep = math.exp(-dt / SMOOTHING)
        # of white innovations the mean has a variance of (1 - keep) / (1 + keep)
        size = math.sqrt((1.0 - keep) / (1.0 + keep))
        self._spread, self._memory = size, size / (1.0 - keep)
        share = 1.0 / min(self._count, WINDOW)
        self._product += share * (r * self._mean - self._product)
        self._square += share * (r * r * size - self._square)
        self._mean = keep * self._mean + (1.0 - keep) * r

    def state(self) -> list[float]:
        """Return all that is needed to go on from here."""
        return [self.noise, self.model_error, self._count, self._mean, self._product,
                self._square, self._spread, self._memory, self._quiet]

    def restore(self, state: Sequence[float]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        noise, error, count, mean, product, square, spread, memory, quiet = map(float, state)
        numbers = (noise, mean, product, square, spread, memory)
        if not (noise > 0.0 and all(map(math.isfinite, numbers))):
            raise ValueError('innovations out of range')
        self.noise, self.model_error, self._count = noise, bool(error), int(count)
        self._mean, self._product, self._square = mean, product, square
        self._spread, self._memory, self._quiet = spread, memory, int(quiet)


OUTLIER = 5.0
"""Standard deviations beyond which a measurement does not count."""

LOST = 4
"""Outliers in a row after which position and velocity are taken anew."""

SOON, SOON_LOST = 1.0, 2
"""
How many do in the first second [s].

The path may begin with one, and the velocity is so uncertain that it would soon explain it.
"""

LARGEST_MEAN = 6.0
"""Mean innovation, in its std, that tells a change of the vehicle from a small error."""

AGAIN = 10.0
"""[s] within which the filter has to be lost twice for that."""

FOLLOWING = 60.0
"""[s] after a change in which it is said."""


RETRY = 30.0
"""
[s] after a change in which the model has to become right, or its parameters are let go again.

What was no change but a fault of an input leaves a model that is sure and wrong.
"""


class ChangeDetection:
    """
    Outliers in a row, the last loss and the last change.

    Attributes
    ----------
    time : float
        Since the filter began [s].
    was_right : bool
        Whether the model has been since the last change.

    """

    def __init__(self) -> None:
        self.time = 0.0
        self.was_right = False
        self._missed = 0
        self._lost_at, self._changed_at = -AGAIN, -FOLLOWING

    @property
    def since_change(self) -> float:
        """Return the time since the vehicle changed [s], infinite after ``FOLLOWING``."""
        since = self.time - self._changed_at
        return since if since < FOLLOWING else math.inf

    @property
    def still_wrong(self) -> bool:
        """Tell whether the model has been wrong for ``RETRY`` since a change."""
        return not self.was_right and 0.0 <= self._changed_at <= self.time - RETRY

    def outlier(self, normalised: float) -> bool:
        """Tell whether an innovation in standard deviations is that of an outlier."""
        found = abs(normalised) > OUTLIER
        self._missed = self._missed + 1 if found else 0
        return found

    def lost(self, beginning: bool) -> bool:
        """Tell whether there were so many in a row that the filter has lost the vehicle."""
        if self._missed < (SOON_LOST if beginning else LOST):
            return False
        self._missed = 0
        return True

    def lost_again(self) -> bool:
        """Note a loss; tell whether it was so soon after one that the vehicle has changed."""
        again = self.was_right and self.time - self._lost_at < AGAIN
        self._lost_at = self.time
        return again

    def changed(self) -> None:
        """Note that the vehicle has changed."""
        self._changed_at, self.was_right = self.time, False

    def restart(self) -> None:
        """Forget the outliers in a row."""
        self._missed = 0

    def state(self) -> list[float]:
        """Return all that is needed to go on from here."""
        return [self.time, self.was_right, self._missed, self._lost_at, self._changed_at]

    def restore(self, state: Sequence[float]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        time, right, missed, lost, changed = map(float, state)
        if not all(map(math.isfinite, (time, missed, lost, changed))):
            raise ValueError('changes out of range')
        self.time, self.was_right, self._missed = time, bool(right), int(missed)
        self._lost_at, self._changed_at = lost, changed
