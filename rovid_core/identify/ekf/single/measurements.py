"""What is measured when along the steps of the pipe, and with which force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, Final

from rovid_core.identify.ekf.single.delayed_force import DelayedForce
from rovid_core.identify.ekf.single.linearised_filter import POSITION, VELOCITY
from rovid_core.identify.method import floats
from rovid_core.model.samples import Step
from rovid_core.model.thrusters import Thrusters

LEAST_INTERVAL: Final = 0.039
"""[s] between two measurements; fixes that come faster are taken together, 25 Hz come alone."""

SAME: Final = 1e-9
"""By which a value that is repeated may seem to differ, in typical ones or m, for rounding."""

OF_ROUNDING: Final = math.sqrt(1.0 / 12.0)
"""Standard deviation of what rounding leaves, in the steps to which values are rounded."""


class Resolution:
    """
    The steps to which a sensor rounds, as it shows where it repeats a value.

    What is measured of a vehicle at rest then does not scatter at all, which says nothing of how
    far it is off.
    """

    def __init__(self) -> None:
        self._repeats, self._least, self._value = False, math.inf, math.nan

    def add_value(self, value: float) -> None:
        """Look at the next value."""
        self.add_change(value - self._value)
        self._value = value

    def add_change(self, change: float) -> None:
        """Look at a change from one value to the next."""
        size = abs(change)
        if size <= SAME:
            self._repeats = True
        elif size < self._least:
            self._least = size

    @property
    def noise(self) -> float:
        """Return the standard deviation of rounding: 0 for none, inf if all were repeated."""
        return OF_ROUNDING * self._least if self._repeats else 0.0

    def state(self) -> list[Any]:
        """Return all that is needed to go on from here."""
        return [self._repeats, *[x if math.isfinite(x) else None
                                 for x in (self._least, self._value)]]

    def restore(self, state: Sequence[Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        repeats, least, value = state
        self._repeats = bool(repeats)
        self._least = math.inf if least is None else floats([least], 1)[0]
        self._value = math.nan if value is None else floats([value], 1)[0]


class Along:
    """
    What there is along the way since the last measurement, part by part.

    Fixes that are taken together stand at the mean of their times, which lies between two of
    them: what belongs to the span up to there are the parts of it, each as long as it lasts.
    """

    def __init__(self) -> None:
        self._parts: list[list[float]] = []  # length [s], and the values along it

    @property
    def is_empty(self) -> bool:
        """Tell whether nothing is left of it."""
        return not self._parts

    def add(self, length: float, values: list[float]) -> None:
        """Take the next part: its length [s] and what its means are."""
        self._parts.append([length, *values])

    def take(self, length: float) -> list[float]:
        """Take so many seconds off its begin; return the means over them."""
        sums, left = [0.0] * (len(self._parts[0]) - 1), length
        while left > 0.0 and self._parts:
            part = self._parts[0]
            used = min(part[0], left)
            sums = [total + used * value for total, value in zip(sums, part[1:])]
            left -= used
            if used < part[0]:
                part[0] -= used
            else:
                del self._parts[0]
        return [total / (length - left) for total in sums]

    def clear(self) -> None:
        """Forget what is left."""
        self._parts = []

    def state(self) -> list[list[float]]:
        """Return all that is needed to go on from here."""
        return [list(part) for part in self._parts]

    def restore(self, state: Sequence[Any], count: int) -> None:
        """Go on from ``state`` with so many values; raises ValueError if it does not fit."""
        self._parts = [floats(part, 1 + count) for part in state]


class Measurement:
    """
    The span that a filter moves over, and what is measured at its end.

    Attributes
    ----------
    start, end : float
        [s] on the clock of the force.
    i : int
        ``POSITION`` or ``VELOCITY``.
    value : float or None
        In typical velocities (times 1 s); None for the first fix, where the path begins.
    turn : float
        By which the body turned [rad]: the noise of a fix times this goes into the path.
    slip : float
        Standard deviation of what the attitude puts the path wrong by.
    dt : float
        [s] since the last measurement.
    couplings : sequence of m floats
        The mean of each regressor of the couplings over the span.
    rises : sequence of m floats
        By how much each rises from its mean to the end of the span; empty if by nothing.
    watched : sequence of floats
        The same of those that are only watched.
    rounding : float
        ``Resolution.noise`` of what measures it.

    """

    __slots__ = ('start', 'end', 'i', 'value', 'turn', 'slip', 'dt', 'couplings', 'watched',
                 'rounding', 'rises')

    def __init__(self, start: float, end: float, i: int, value: float | None, turn: float,
                 slip: float, dt: float, couplings: Sequence[float], watched: Sequence[float],
                 rounding: float, rises: Sequence[float] = ()) -> None:
        self.start, self.end, self.i, self.value = start, end, i, value
        self.turn, self.slip, self.dt = turn, slip, dt
        self.couplings, self.watched, self.rounding = couplings, watched, rounding
        self.rises = rises


class MeasurementClock:
    """
    Turn steps into measurements of the path or the velocity.

    With fixes the measurement is the path along the body axis, which is summed up from the
    mean velocities, from 0 at the first fix; with a velocity sensor it is the velocity. The
    force of the half interval after a fix is known when the next mean velocity is; so a
    filter stands at the fix before the end of a step. Fixes that come fast are taken together:
    their noise hangs together more often than not, and a filter of all of them costs more.

    Parameters
    ----------
    force, velocity : float
        The units.
    couplings, watched : int
        How many there are; those of a step without any are taken as 0.
    own : tuple of 2 ints
        Index among the parameters of those that the filter makes itself; here they are 0.
    forgets : bool
        Whether the force may go when it is old.
    thrusters : Thrusters
        How they work, in typical forces.

    Attributes
    ----------
    recent : DelayedForce
        The force.
    ahead : float
        [s] from the last measurement to the end of the last step.

    """

    def __init__(self, force: float, velocity: float, couplings: int, watched: int,
                 own: tuple[int, int], forgets: bool, thrusters: Thrusters) -> None:
        self._force, self._velocity = force, velocity
        self.couplings = couplings
        self.watched = watched
        self._forgets, self._thrusters = forgets, thrusters
        self._own = [i - 4 for i in own if i >= 0]
        self._no_couplings, self._nothing_watched = [0.0] * couplings, (0.0,) * watched
        self._resolution = Resolution()
        self.restart()

    def restart(self) -> None:
        """Begin a new path."""
        self.recent = DelayedForce(self._forgets, self._thrusters)
        self._path = 0.0
        self._fix = self._last = -1.0  # [s] time of the last measurement, and of its last fix
        self._group: list[list[float]] = []
        self._along = Along()
        self._before: list[float] = []  # length [s] of the interval before, and its couplings
        self.ahead = 0.0

    def set_thrusters(self, thrusters: Thrusters) -> None:
        """Let them work otherwise."""
        self._thrusters = thrusters
        self.recent.set_thrusters(thrusters)

    def add_step(self, step: Step) -> Measurement | None:
        """Return what a step measures, None where more fixes come into the measurement."""
        recent, first, unit = self.recent, self._fix < 0.0, self._velocity
        dt, interval = step.dt, step.interval
        before, after = step.parts if interval else (dt, 0.0)
        at = recent.end + before
        if step.pieces:
            recent.add(step.pieces, True, self._force, step.each)
        else:
            recent.add(((before, step.forces[0]), (after, step.forces[1])), False, self._force,
                       step.each)
        end = recent.end
        couplings = [mean for mean, _ in step.couplings] or self._no_couplings
        for i in self._own:
            couplings[i] = 0.0
        watched = step.watched or self._nothing_watched
        rises = self._rises(step, at, couplings) if step.couplings else ()
        start = end - dt if first else self._fix
        i, value = VELOCITY, step.mean / unit
        if interval:
            i, value, change = POSITION, self._path, step.mean * interval / unit
            self._resolution.add_change(change)
            self._path += change
            if first:
                self._fix, self._last, self.ahead = at, at, end - at
                return Measurement(start, at, i, None, step.turn, step.path_noise / unit, dt,
                                   couplings, watched, self._resolution.noise)
        else:
            self._resolution.add_value(value)
        alone = at - self._last >= LEAST_INTERVAL
        if alone and self._along.is_empty:
            found = Measurement(start, at, i, value, step.turn, step.path_noise / unit, dt,
                                couplings, watched, self._resolution.noise, rises)
        else:
            before = self._group[-1][0] if self._group else self._last
            self._along.add(at - before, [*couplings, *watched])
            self._group.append([at, value, step.turn, step.path_noise, dt])
            if not alone:
                self.ahead = end - self._fix
                return None
            found = self._mean(start, i)
        self._fix, self._last, self.ahead = found.end, at, end - found.end
        if found.end == at:
            self._along.clear()  # but for rounding
        return found

    def _rises(self, step: Step, at: float, couplings: Sequence[float]) -> Sequence[float]:
        """
        Return by how much the means of an interval rise up to its end.

        That goes by the intervals on both sides of it, or by the one before where the one after
        is not known yet, as it is not of a velocity sensor.
        """
        goes_on = step.interval and self._last >= 0.0
        before, h = self._before, at - self._last if goes_on else step.dt
        self._before = [h, *couplings]
        if not before:
            return ()
        follows = [mean for _, mean in step.couplings] if step.interval else couplings
        share = 0.5 * h / (0.5 * before[0] + h + 0.5 * step.interval
                           if step.interval else 0.5 * (before[0] + h))
        rises = [share * (new - old) for new, old in zip(follows, before[1:])]
        for i in self._own:
            rises[i] = 0.0
        return rises

    def _mean(self, start: float, i: int) -> Measurement:
        """Return the mean of the fixes that came together, which is one of less noise."""
        group, self._group = self._group, []
        n, sums = len(group), [0.0] * len(group[0])
        turn = slip = 0.0
        for row in group:
            sums = [x + y for x, y in zip(sums, row)]
            turn += row[2] * row[2]
            slip += row[3] * row[3]
        end = sums[0] / n
        means = self._along.take(end - start)
        return Measurement(
            start, end, i, sums[1] / n, math.sqrt(turn), math.sqrt(slip) / self._velocity,
            sums[4], means[:self.couplings], means[self.couplings:], self._resolution.noise)

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'recent': self.recent.state(), 'path': self._path, 'fix': self._fix,
                'last': self._last, 'ahead': self.ahead, 'resolution': self._resolution.state(),
                'group': [list(row) for row in self._group], 'along': self._along.state(),
                'before': list(self._before)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        path, fix, last, ahead = floats(
            [state[name] for name in ('path', 'fix', 'last', 'ahead')], 4)
        group = [floats(row, 5) for row in state['group']]
        self._along.restore(state['along'], self.couplings + self.watched)
        before = state['before']
        self._before = floats(before, 1 + self.couplings) if before else []
        self.recent.restore(state['recent'])
        self._resolution.restore(state['resolution'])
        self._path, self._fix, self._last, self.ahead = path, fix, last, ahead
        self._group = group
