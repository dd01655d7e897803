"""How often an input comes, and so which silence of it is a gap."""

from __future__ import annotations

from collections import deque
from typing import Final

from rovid_core.settings.run import BURST, LEAST_GAP

PERIODS: Final = 5.0
"""A silence of more than so many usual intervals is a gap: some fixes may be lost in between."""

KEPT: Final = 15
"""Intervals of which the usual one is the median: it takes no notice of jitter and of gaps."""

KNOWN_AFTER: Final = 3
"""Intervals after which one is usual."""

CHANGED: Final = 0.1
"""Relative change of the gap from which it is another one."""

SHORT: Final = round(LEAST_GAP / PERIODS * 1e9)
"""[ns] Usual intervals of so much have the least gap."""


class Cadence:
    """
    The usual interval between the samples of one input, by their event times alone.

    Attributes
    ----------
    gap : float
        Longest interval [s] that is no gap, at least ``LEAST_GAP``.

    """

    def __init__(self) -> None:
        self.gap = LEAST_GAP
        self._intervals: deque[int] = deque(maxlen=KEPT)
        self._last: int | None = None

    def restart(self) -> None:
        """Forget when the last sample came, not how often they come."""
        self._last = None

    def add_time(self, time: int) -> bool:
        """Add the event time [ns] of a sample, and tell whether ``gap`` is another one now."""
        last = self._last
        if last is not None and self._intervals and 0 < time - last <= SHORT and (
                BURST * (time - last) < self._intervals[-1]):
            return False  # the same sample once more: the next interval is from the first of them
        self._last = time
        if last is None or time <= last:
            return False
        self._intervals.append(time - last)
        count = len(self._intervals)
        if count < KNOWN_AFTER or (  # a short interval lengthens no gap
                self.gap == LEAST_GAP and time - last <= SHORT and count > KNOWN_AFTER):
            return False
        gap = max(LEAST_GAP, PERIODS * self.interval)
        if abs(gap - self.gap) <= CHANGED * self.gap:
            return False
        self.gap = gap
        return True

    @property
    def interval(self) -> float:
        """Return the usual interval [s], 0 before the second sample."""
        intervals = sorted(self._intervals)
        return intervals[len(intervals) // 2] * 1e-9 if intervals else 0.0
