"""The impulse of the force over the last moments, at any time."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
import math

KEPT = 4.0
"""[s] that are kept, at least."""


class Impulses:
    """
    The integral of a force from spans of known mean.

    Between the nodes it is interpolated by a parabola, for a force that changes smoothly is
    not constant over a span; after the newest the force stays as it is.
    """

    def __init__(self) -> None:
        self._times = [0.0]
        self._values = [0.0]

    @property
    def end(self) -> float:
        """Return the newest time that is known [s]."""
        return self._times[-1]

    def add(self, spans: Sequence[float], forces: Sequence[float]) -> None:
        """Take the lengths of the next spans [s] and the mean force over each."""
        for span, force in zip(spans, forces):
            if span > 0.0:
                self._times.append(self._times[-1] + span)
                self._values.append(self._values[-1] + span * force)
        if self._times[-1] - self._times[0] > 2.0 * KEPT:
            cut = bisect_right(self._times, self._times[-1] - KEPT)
            del self._times[:cut], self._values[:cut]

    def at(self, time: float) -> float:
        """Return the impulse up to ``time`` [s]."""
        times, values = self._times, self._values
        last = len(times) - 1
        if last == 0:
            return 0.0
        i = min(max(bisect_right(times, time) - 1, 0), last - 1)
        a, b, start, end = times[i], times[i + 1], values[i], values[i + 1]
        slope = (end - start) / (b - a)
        past = time - a
        line = start + slope * past
        if not a <= time <= b:
            return line
        bend, sides = 0.0, 0
        if i > 0:
            before = times[i - 1]
            bend += (slope - (start - values[i - 1]) / (a - before)) / (b - before)
            sides += 1
        if i < last - 1:
            after = times[i + 2]
            bend += ((values[i + 2] - end) / (after - b) - slope) / (after - a)
            sides += 1
        return line + bend / sides * past * (time - b) if sides else line

    def state(self) -> list[list[float]]:
        """Return all that is needed to go on from here."""
        return [list(self._times), list(self._values)]

    def restore(self, state: Sequence[Sequence[float]]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        times, values = ([float(x) for x in column] for column in state)
        if not len(times) == len(values) > 0 or sorted(set(times)) != times or not all(
                map(math.isfinite, (*times, *values))):
            raise ValueError('the impulses do not fit')
        self._times, self._values = times, values
