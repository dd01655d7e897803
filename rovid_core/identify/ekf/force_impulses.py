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
        self._begin(0.0, 0.0)

    def _begin(self, time: float, value: float) -> None:
        self._times, self._values = [time], [value]
        self._slopes: list[float] = []  # of the spans
        self._bends: list[float] = []  # of the parabolas

    @property
    def end(self) -> float:
        """Return the newest time that is known [s]."""
        return self._times[-1]

    def add(self, spans: Sequence[float], forces: Sequence[float]) -> None:
        """Take the lengths of the next spans [s] and the mean force over each."""
        for span, force in zip(spans, forces):
            time = self._times[-1] + span
            if time > self._times[-1]:
                self._append(time, self._values[-1] + span * force)
        times = self._times
        if times[-1] - times[0] > 2.0 * KEPT:
            cut = bisect_right(times, times[-1] - KEPT)
            for nodes in (times, self._values, self._slopes, self._bends):
                del nodes[:cut]
            if len(times) > 2:  # there is nothing any more before the first span
                self._bends[0] = (self._slopes[1] - self._slopes[0]) / (times[2] - times[0])

    def _append(self, time: float, value: float) -> None:
        times, values, slopes, bends = self._times, self._values, self._slopes, self._bends
        slope = (value - values[-1]) / (time - times[-1])
        bend = 0.0
        if slopes:
            # the parabola of a span is the mean of those through three nodes on either side
            bend = (slope - slopes[-1]) / (time - times[-2])
            bends[-1] = 0.5 * (bends[-1] + bend) if len(slopes) > 1 else bend
        times.append(time)
        values.append(value)
        slopes.append(slope)
        bends.append(bend)

    def _restart(self, times: Sequence[float], values: Sequence[float]) -> None:
        """Take nodes anew."""
        self._begin(times[0], values[0])
        for time, value in zip(times[1:], values[1:]):
            self._append(time, value)

    def at(self, time: float) -> float:
        """Return the impulse up to ``time`` [s]."""
        times = self._times
        last = len(times) - 1
        if last == 0:
            return 0.0
        i = bisect_right(times, time) - 1
        if i < 0:
            i = 0
        elif i >= last:
            i = last - 1
        a, b = times[i], times[i + 1]
        past = time - a
        line = self._values[i] + self._slopes[i] * past
        return line + self._bends[i] * past * (time - b) if a <= time <= b else line

    def state(self) -> list[list[float]]:
        """Return all that is needed to go on from here."""
        return [list(self._times), list(self._values)]

    def restore(self, state: Sequence[Sequence[float]]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        times, values = ([float(x) for x in column] for column in state)
        if not len(times) == len(values) > 0 or sorted(set(times)) != times or not all(
                map(math.isfinite, (*times, *values))):
            raise ValueError('the impulses do not fit')
        self._restart(times, values)
