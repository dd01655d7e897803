"""What upsets the filter: outliers, losses of the vehicle, changes of it."""

from __future__ import annotations

from collections.abc import Sequence
import math

OUTLIER = 5.0
"""Standard deviations beyond which a measurement does not count."""

LOST = 4
"""Outliers in a row after which position and velocity are taken anew."""

SOON, SOON_LOST = 1.0, 2
"""
How many do in the first second [s].

The path may begin with one, and the velocity is so uncertain that it would soon explain it.
"""

SURPRISE = 6.0
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


class Upsets:
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
            raise ValueError('upsets out of range')
        self.time, self.was_right, self._missed = time, bool(right), int(missed)
        self._lost_at, self._changed_at = lost, changed
