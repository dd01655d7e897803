"""Tell the outliers of one input by what it measured before, on a scale that it learns."""

from __future__ import annotations

import math

from rovid_core.model.dofs import ANGULAR_DOFS, Vector
from rovid_core.settings.run import Settings
from rovid_core.settings.scales import Scales
from rovid_core.velocity.quaternions import rotation_between

NS = 1e-9

ENOUGH = 20
"""Innovations from which the scale is known."""

GAIN = 0.05
"""By how much the scale moves with each innovation, relative; more at the beginning."""

DOUBT = 0.2
"""What a refused innovation counts for in that."""

AGREEING = 6
"""So many refused in a row that agree with each other are followed: no echo lasts that long."""

FACTOR = 3.0
"""By how much typical sizes may be off."""

RESOLUTION = 0.002
"""Least scale, in typical velocities (times 1 s where it is a position)."""

LARGEST = 1e6
"""Greatest scale; keeps an infinite value from opening the gate for ever."""

WOBBLE = 10.0
"""[rad/s^2] A small vehicle rolls and pitches so fast, whatever is identified of it."""

PER_MEDIAN = {1: 1.483, 2: 0.849, 3: 0.650}
"""Standard deviation on one axis over the median length, by the number of axes."""

Floats = tuple[float, ...]
STILL: Vector = (0.0, 0.0, 0.0)


class Path:
    """
    Where an input is and how it moves.

    Attributes
    ----------
    time, value
        The newest measurement: [ns], and what it was.
    rate : Vector
        By how much it changes [1/s].
    count : int
        Measurements that agreed; after the first the rate is not known yet.

    """

    def __init__(self, time: int, value: Floats) -> None:
        self.time = time
        self.value = value
        self.rate = STILL
        self.count = 1


class Gate:
    """
    Refuse measurements that do not follow from the ones before.

    A position, depth or attitude is predicted with its rate from the last good one; a
    velocity stays what it was. The median of what they miss by is learned, also from what is
    refused: that moves it by a step and no further, however wild it is. What misses by more
    than ``velocity.gate`` standard deviations, and more than the vehicle can accelerate by,
    is an outlier. Repeats of a value teach nothing, or a coarse sensor would be refused its
    next step.

    Outliers in a row that follow from each other for ``AGREEING`` times are where the
    measurement goes on.

    Parameters
    ----------
    settings : Settings
        The run.
    input : str
        Name of the input.

    Attributes
    ----------
    change : Vector or None
        From the last good measurement to the newest [m, rad, m/s or rad/s]; None after a
        pause, and while nothing is judged.

    """

    def __init__(self, settings: Settings, input: str) -> None:
        is_angular = input in ('attitude', 'angular_velocity')
        self._is_rotation = input == 'attitude'
        self._is_rate = input in ('velocity', 'angular_velocity')
        # the depth counts instead of z
        self._axes = 1 if input == 'depth' else (
            2 if input == 'position' and settings.depth.topic else 3)
        known = [(Scales.of(settings.dof[d]), settings.dof[d].mass) for d in settings.dofs
                 if (d in ANGULAR_DOFS) == is_angular]
        self._velocity = max((s.velocity for s, _ in known), default=0.5)
        self._acceleration = FACTOR * max((s.force / mass for s, mass in known), default=0.5)
        if is_angular:
            self._acceleration = max(self._acceleration, WOBBLE)
        self._least = RESOLUTION * self._velocity
        self._input = input
        self.change_limits(settings)
        self.restart()

    def change_limits(self, settings: Settings) -> None:
        """Take another timeout, ``velocity.max`` and ``velocity.gate``."""
        self._timeout = round(settings.timeout_of(self._input) / NS)
        self._max_speed = settings.max_speed
        self._limit = settings.gate * PER_MEDIAN[self._axes]

    def restart(self) -> None:
        """Forget everything."""
        self._path: Path | None = None
        self._other: Path | None = None  # that of the outliers
        self._seen = 0  # [ns] newest measurement, good or not
        self._scale = 0.0  # median of what predictions miss by
        self._learned = 0
        self._period = 0.0  # [s] between measurements
        self.change: Vector | None = None

    def take_up(self, time: int, value: Floats) -> None:
        """Go on from a measurement, whatever was before."""
        self._path, self._other, self._seen = Path(time, value), None, time
        self.change = None

    def take(self, time: int, value: Floats) -> str:
        """
        Judge a measurement.

        Returns
        -------
        str
            '' if it is good, ``outlier``, ``too_fast`` for one beyond ``velocity.max``, or
            ``shifted``: it goes on from here.

        """
        path = self._path
        if path is None or time - self._seen > self._timeout or time <= path.time:
            self.take_up(time, value)
            return ''
        self._seen = time
        dt = (time - path.time) * NS
        change = self.change = self._between(path.value, value)
        x, y, z = rest = _unexpected(change, path.rate, dt)
        missed = math.sqrt(x * x + y * y + z * z)
        good = missed <= self._allowed(path, dt) or self._learned < ENOUGH
        self._learn(dt, missed, good)
        if good:
            self._other = None
            self._advance(path, time, value, dt, rest)
            return ''
        speed = math.hypot(*(value if self._is_rate else change))
        return self._refuse(time, value, 'outlier' if speed <= self._max_speed * (
            1.0 if self._is_rate else dt) else 'too_fast')

    def _between(self, a: Floats, b: Floats) -> Vector:
        if self._is_rotation:
            return rotation_between(a, b)  # type: ignore[arg-type]
        if self._axes == 1:
            return (b[0] - a[0], 0.0, 0.0)
        return (b[0] - a[0], b[1] - a[1], b[2] - a[2] if self._axes == 3 else 0.0)

    def _allowed(self, path: Path, dt: float) -> float:
        """Return by how much a measurement may miss what a path predicts."""
        period = self._period
        # what was refused in between says nothing: a long burst must not open the gate
        span = min(dt, 3.0 * period) if self._other is not None else dt
        noise = self._limit * self._scale
        if span > period > 0.0:
            noise *= span / period
        if self._is_rate:
            return noise + 2.0 * self._acceleration * span  # full astern at full speed
        if path.count == 1:
            return noise + FACTOR * self._velocity * span
        # the rate lags behind by 1.75 periods, see _advance
        return noise + self._acceleration * span * (0.5 * span + 1.75 * period)

    def _advance(self, path: Path, time: int, value: Floats, dt: float, rest: Vector) -> None:
        """Go on to a good measurement; a short interval says little of the rate."""
        if not self._is_rate:
            h = dt + 0.5 * self._period
            share = 1.0 / dt if path.count == 1 else dt / (h * h)
            u, v, w = path.rate
            path.rate = (u + share * rest[0], v + share * rest[1], w + share * rest[2])
        path.time, path.value = time, value
        path.count += 1

    def _learn(self, dt: float, missed: float, good: bool) -> None:
        period = self._period
        if self._other is None:
            longest = 2.0 * period or dt
            self._period += ((dt if dt < longest else longest) - period) * (
                GAIN if period else 1.0)
        if self.change == STILL:
            return
        n = self._learned = self._learned + 1
        weight = GAIN if n > 60 else 3.0 / n
        if not good:
            weight *= DOUBT
        if dt > period > 0.0:
            missed *= period / dt
        scale = self._scale or missed
        scale = scale * (1.0 + weight) if missed > scale else scale / (1.0 + weight)
        self._scale = min(max(scale, self._least), LARGEST)

    def _refuse(self, time: int, value: Floats, reason: str) -> str:
        """Refuse a measurement, unless it is the last of many that agree."""
        other = self._other
        if other is not None:
            dt = (time - other.time) * NS
            rest = _unexpected(self._between(other.value, value), other.rate, dt)
            if math.hypot(*rest) <= self._allowed(other, dt):
                self._advance(other, time, value, dt, rest)
                if other.count >= AGREEING:
                    self._path, self._other = other, None
                    return 'shifted'
                return reason
        self._other = Path(time, value)
        return reason


def _unexpected(change: Vector, rate: Vector, dt: float) -> Vector:
    """Return what a rate leaves of a change."""
    return (change[0] - rate[0] * dt, change[1] - rate[1] * dt, change[2] - rate[2] * dt)
