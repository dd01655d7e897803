"""The thrust delay and lag: the force of the last seconds, and what a body feels of it later."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
import math
from typing import Any, Final

from rovid_core.model.dofs import Three
from rovid_core.model.lag import driven, inertia_of, spun, turns_of
from rovid_core.model.thrusters import AS_CONFIGURED, DEAD_BAND, Thrusters

KEPT: Final = 4.0
"""[s] that are kept, at least, before the step that a filter may still stand in."""


class DelayedForce:
    """
    A force in spans that follow each other, each of them a straight line.

    Where commands are held the force is known exactly: it stays the same over a span and jumps
    between two. Of a force that changes smoothly only the means over spans are known; there the
    line leans by what the means on either side say. After the newest span, and before the
    oldest, the force is the mean of that span. Thrusters may follow what they are asked for with
    a first-order lag besides, L' = (F - L) / lag, of which all integrals are exact.

    Parameters
    ----------
    forgets : bool
        Whether what is older than ``KEPT`` may go.
    thrusters : Thrusters
        What is to be made of the force that is asked for.

    Attributes
    ----------
    bend : float
        Below which the force that ``bent`` returns is in proportion: ``DEAD_BAND`` of the force
        so far, which counts by its square, and of 1 at most. A force that never gets beyond it
        would tell nothing of a dead band.

    """

    def __init__(self, forgets: bool = True, thrusters: Thrusters = AS_CONFIGURED) -> None:
        self._forgets = forgets
        self._work_as(thrusters)
        # at the start of each span, where there is a lag: the force, or the root of it
        self._lagged: list[float] = []
        self._times = [0.0]
        self._means: list[float] = []
        self._slopes: list[float] = []
        self._each: list[Three] = []  # of each span, where thrusters drive other DOFs, too
        self._held = False  # the newest span
        self._step = 0.0  # [s] where the newest spans begin
        self._near = 0  # the span that was asked for last
        self._squares = self._cubes = 0.0  # integrals of the force's
        self.bend = DEAD_BAND

    @property
    def end(self) -> float:
        """Return the newest time that is known [s]."""
        return self._times[-1]

    def _work_as(self, thrusters: Thrusters) -> None:
        self._thrusters, self._lag = thrusters, thrusters.lag
        self._is_curved, self._turns = thrusters.is_curved, thrusters.turns
        self._inertia = inertia_of(thrusters.lag, thrusters.lag_at)

    def add(self, spans: Sequence[tuple[float, float]], held: bool = False,
            unit: float = 1.0, each: Sequence[Three] = ()) -> None:
        """
        Take the next spans.

        Parameters
        ----------
        spans : sequence of (float, float)
            Length [s] and mean force of each.
        held : bool
            Whether the force stays the same over each.
        unit : float
            What the force is to be divided by.
        each : sequence of tuples of 3 floats
            ``EACH`` over each of the spans.

        """
        times, means, slopes = self._times, self._means, self._slopes
        squares, cubes = self._squares, self._cubes
        last, self._step = self._step, times[-1]
        for k, (length, force) in enumerate(spans):
            begin = times[-1]
            time = begin + length
            if not time > begin:
                continue
            mean = force / unit
            if self._is_curved:
                mean = self._thrusters.given(mean)
            square = mean * mean * length
            squares += square
            cubes += abs(mean) * square
            if held and self._held and mean == means[-1] and (
                    not each or each[k] == self._each[-1]):
                times[-1] = time
                continue
            slope = 0.0
            if means and not (held or self._held):
                slope = 2.0 * (mean - means[-1]) / (time - times[-2])
                slopes[-1] = 0.5 * (slopes[-1] + slope) if len(means) > 1 else slope
            if self._lag:
                self._lagged.append(self._lagged_at(begin) if means else self._steady(mean))
            times.append(time)
            means.append(mean)
            slopes.append(slope)
            if each:
                self._each.append(each[k])
            self._held = held
        self._set_size(squares, cubes)
        if self._forgets and times[-1] - times[0] > 2.0 * KEPT:
            cut = max(bisect_right(times, last - KEPT) - 1, 0)
            for column in (times, means, slopes, self._lagged):
                del column[:cut]
            del self._each[:cut]
            self._near = 0

    def set_thrusters(self, thrusters: Thrusters) -> None:
        """Let them work otherwise; before the oldest span the force was what it is there."""
        for i, mean in enumerate(self._means):
            self._means[i] = new = thrusters.given(self._thrusters.asked(mean))
            self._slopes[i] *= new / mean if mean else 1.0
        self._work_as(thrusters)
        self._lagged = []
        for i in range(len(self._means) if self._lag else 0):
            self._lagged.append(
                self._lagged_end(i - 1) if i else self._steady(self._means[0]))

    def _steady(self, force: float) -> float:
        """Return what lags as it is while a force is held."""
        return turns_of(force) if self._turns else force

    def _followed(self, lagged: float, force: float, elapsed: float) -> float:
        """Return what lags [s] after it was that, while a force is held."""
        if self._inertia:
            return driven(lagged, force, elapsed, self._inertia)[2]
        steady = self._steady(force)
        return steady + (lagged - steady) * math.exp(-elapsed / self._lag)

    def _lagged_end(self, i: int) -> float:
        """Return what lags at the end of a span."""
        return self._lagged_in(i, self._times[i + 1] - self._times[i])

    def _lagged_in(self, i: int, elapsed: float) -> float:
        """Return what lags [s] after the start of a span."""
        if self._turns:
            return self._followed(self._lagged[i], self._means[i], elapsed)
        # behind a line it follows a line that is late by the lag
        late = self._slopes[i] * self._lag
        start = self._means[i] - 0.5 * self._slopes[i] * (self._times[i + 1] - self._times[i])
        return start + self._slopes[i] * elapsed - late + (
            self._lagged[i] - start + late) * math.exp(-elapsed / self._lag)

    def _lagged_at(self, time: float) -> float:
        """Return what lags at any time [s]."""
        if time <= self._times[0]:
            return self._lagged[0]
        newest = len(self._means) - 1
        after = time - self._times[newest + 1]
        if after >= 0.0:
            return self._followed(self._lagged_end(newest), self._means[newest], after)
        i = self._span(time)
        return self._lagged_in(i, time - self._times[i])

    def _set_size(self, squares: float, cubes: float) -> None:
        self._squares, self._cubes = squares, cubes
        if cubes:
            self.bend = DEAD_BAND * min(cubes / squares, 1.0)

    def _span(self, time: float) -> int:
        """Return the number of the span that holds a time, the first or the last beyond them."""
        times, i = self._times, self._near  # who asks goes on in short steps
        while i > 0 and times[i] > time:
            i -= 1
        newest = len(self._means) - 1
        while i < newest and times[i + 1] <= time:
            i += 1
        self._near = i
        return i

    def over(self, start: float, end: float,
             delay: float = 0.0) -> tuple[float, float, float, float]:
        """
        Return what a body feels from ``start`` to ``end`` [s], the later one.

        Parameters
        ----------
        start, end, delay : float
            [s]; each force acts a delay after it was asked for.

        Returns
        -------
        impulse, moment, first, last : float
            The integral of the force, that of the force times the time left to ``end``, which
            is how far the impulse has moved a unit mass by then, and the force at both times.

        """
        start -= delay
        end -= delay
        if not self._means:
            return 0.0, 0.0, 0.0, 0.0
        if not self._lag:
            return self._asked(start, end)
        if self._turns:
            return self._of_turns(start, end)
        impulse, moment, _, _ = self._asked(start, end)
        first, last = self._lagged_at(start), self._lagged_at(end)
        # L = F - lag L', once and twice integrated
        impulse -= self._lag * (last - first)
        moment += self._lag * (first * (end - start) - impulse)
        return impulse, moment, first, last

    def _of_turns(self, start: float, end: float) -> tuple[float, float, float, float]:
        """Return the same of propellers whose turns lag; what is asked for goes in stairs."""
        times, newest = self._times, len(self._means) - 1
        turns = first = self._lagged_at(start)
        impulse = moment = 0.0
        if start < times[0]:
            stop = min(times[0], end)
            impulse = turns * abs(turns) * (stop - start)
            moment = impulse * (end - 0.5 * (start + stop))
            start = stop
        i = self._span(start)
        while start < end:
            stop = end if i == newest or times[i + 1] > end else times[i + 1]
            length, mean = stop - start, self._means[i]
            push, way, turns = driven(turns, mean, length, self._inertia) if (
                self._inertia) else spun(turns, self._steady(mean), length, self._lag)
            impulse += push
            moment += way + push * (end - stop)
            i += 1
            start = stop
        return impulse, moment, first * abs(first), turns * abs(turns)

    def _asked(self, start: float, end: float) -> tuple[float, float, float, float]:
        """Return the same of the force that was asked for, without delay or lag."""
        times, means = self._times, self._means
        if start < times[0] or end > times[-1]:
            return self._beyond(start, end)
        slopes = self._slopes
        i = self._span(start)
        slope, mean = slopes[i], means[i]
        first = mean + slope * (start - 0.5 * (times[i] + times[i + 1])) if slope else mean
        impulse = moment = 0.0
        while True:
            stop = times[i + 1]
            if stop > end:
                stop = end
            length, middle = stop - start, 0.5 * (start + stop)
            if slope:
                mean += slope * (middle - 0.5 * (times[i] + times[i + 1]))
                moment -= slope * length * length * length / 12.0
            part = mean * length
            impulse += part
            moment += part * (end - middle)
            if stop == end:
                break
            i += 1
            start, slope, mean = stop, slopes[i], means[i]
        return impulse, moment, first, mean + 0.5 * slope * length

    def bent(self, start: float, end: float,
             delay: float = 0.0) -> tuple[tuple[float, float], tuple[float, float]]:
        """
        Return impulse and moment of the force in reverse, and of what a dead band takes of it.

        The latter is ``DEAD_BAND`` and has the sign of the force, and is less below ``bend``. Of
        each span by itself: the mean of commands that jump is none of the forces that acted.
        ``start`` is before ``end`` [s]; ``delay`` as above.
        """
        start -= delay
        end -= delay
        times, means, slopes, bend = self._times, self._means, self._slopes, self.bend
        newest = len(means) - 1
        i = self._span(start)
        reverse, reverse_moment, cut, cut_moment = 0.0, 0.0, 0.0, 0.0
        while newest >= 0:
            stop = end if i == newest or times[i + 1] > end else times[i + 1]
            length, middle = stop - start, 0.5 * (start + stop)
            force = means[i]
            if slopes[i]:
                force += slopes[i] * (middle - 0.5 * (times[i] + times[i + 1]))
            if self._turns:
                force = self._of_turns(start, stop)[0] / length if length > 0.0 else 0.0
            elif self._lag:
                gained = self._lagged_at(stop) - self._lagged_at(start)
                force -= self._lag * gained / length if length > 0.0 else 0.0
            left = end - middle
            if force < 0.0:
                reverse += force * length
                reverse_moment += force * length * left
            size = abs(force)
            part = DEAD_BAND * force / (size if size > bend else bend) * length
            cut += part
            cut_moment += part * left
            if stop == end:
                break
            i += 1
            start = stop
        return (reverse, reverse_moment), (cut, cut_moment)

    def each(self, start: float, end: float,
             delay: float = 0.0) -> tuple[float, float, float, float, float]:
        """
        Return impulse and moment of what ``EACH`` gives, of the last one the impulse alone.

        The arguments are those of ``over``. A lag acts as a delay: only its moment is told apart.
        """
        start -= delay + self._lag
        end -= delay + self._lag
        times, each = self._times, self._each
        newest = len(each) - 1
        i = self._span(start)
        reverse = reverse_moment = cut = cut_moment = root = 0.0
        while newest >= 0:
            stop = end if i == newest or times[i + 1] > end else times[i + 1]
            length, left = stop - start, end - 0.5 * (start + stop)
            one, other, last = each[i]
            reverse += one * length
            reverse_moment += one * length * left
            cut += other * length
            cut_moment += other * length * left
            root += last * length
            if stop == end:
                break
            i += 1
            start = stop
        return reverse, reverse_moment, cut, cut_moment, root

    def _beyond(self, start: float, end: float) -> tuple[float, float, float, float]:
        """Return the same where the span leaves what is known."""
        oldest, newest = self._times[0], self._times[-1]
        before, after = self._means[0], self._means[-1]
        a, b = min(max(start, oldest), newest), max(min(end, newest), oldest)
        impulse, moment, first, last = self._asked(a, b) if b > a else (0.0, 0.0, after, before)
        if start < oldest:
            first, early = before, min(end, oldest) - start
            moment += before * early * (min(end, newest) - start - 0.5 * early)
            impulse += before * early
        if end > newest:
            last, late = after, end - max(start, newest)
            moment += impulse * late + 0.5 * after * late * late
            impulse += after * late
        return impulse, moment, first, last

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'times': list(self._times), 'means': list(self._means),
                'slopes': list(self._slopes), 'lagged': list(self._lagged), 'held': self._held,
                'step': self._step,
                'each': [list(one) for one in self._each],
                'squares': self._squares, 'cubes': self._cubes}

    def restore(self, state: Any) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        times, means, slopes, lagged = (
            [float(x) for x in state[name]] for name in ('times', 'means', 'slopes', 'lagged'))
        if len(lagged) != (len(means) if self._lag else 0) or not all(map(math.isfinite, lagged)):
            raise ValueError('the lagged force does not fit')
        if not len(times) - 1 == len(means) == len(slopes) or sorted(set(times)) != times or (
                not all(map(math.isfinite, (*times, *means, *slopes)))):
            raise ValueError('the recent force does not fit')
        each = [(float(a), float(b), float(c)) for a, b, c in state['each']]
        if len(each) not in (0, len(means)) or not all(
                math.isfinite(x) for one in each for x in one):
            raise ValueError('what each thruster did does not fit')
        squares, cubes, step = [float(state[name]) for name in ('squares', 'cubes', 'step')]
        if not step <= times[-1]:
            raise ValueError('a step that does not fit')
        if not (0.0 <= squares < math.inf and 0.0 <= cubes < math.inf) or cubes > 0.0 == squares:
            raise ValueError('the size of the force does not fit')
        self.bend = DEAD_BAND
        self._set_size(squares, cubes)
        self._times, self._means, self._slopes, self._lagged = times, means, slopes, lagged
        self._each = each
        self._held, self._near, self._step = bool(state['held']), 0, step
