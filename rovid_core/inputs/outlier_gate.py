"""Refuse outliers: measurements that do not follow from those before, on a learned scale."""

from __future__ import annotations

import math
from typing import Final

from rovid_core.model.dofs import ANGULAR_DOFS, Vector
from rovid_core.model.samples import NS
from rovid_core.settings.run import Scales, Settings
from rovid_core.velocity.attitude_history import rotation_between

LEARNED_AFTER: Final = 20
"""Innovations after which the scale is known."""

GAIN: Final = 0.05
"""Relative change of the scale with each innovation; it is larger at the beginning."""

OUTLIER_WEIGHT: Final = 0.2
"""Weight of a refused innovation in the learning of the scale."""

FOLLOW_AFTER: Final = 6
"""So many refused in a row that agree with each other are followed: no echo lasts that long."""

FACTOR: Final = 3.0
"""Factor by which typical sizes may be wrong."""

MIN_SCALE: Final = 0.002
"""Least scale, in typical velocities (times 1 s where it is a position)."""

MAX_SCALE: Final = 1e6
"""Greatest scale; it keeps an infinite value from opening the gate for ever."""

ANGULAR_ACCELERATION: Final = 10.0
"""[rad/s^2] A small vehicle rolls and pitches so fast, whatever is identified of it."""

PER_MEDIAN = {1: 1.483, 2: 0.849, 3: 0.650}
"""Standard deviation on one axis over the median length, by the number of axes."""

Floats = tuple[float, ...]
ZERO: Vector = (0.0, 0.0, 0.0)


class Prediction:
    """
    Where an input was last, and how it moves: where it is next follows from that.

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
        self.rate = ZERO
        self.count = 1

    def advance(self, time: int, value: Floats, gain: float, innovation: Vector) -> None:
        """Go on to a measurement; ``gain`` [1/s] times the innovation changes the rate."""
        if gain:
            u, v, w = self.rate
            x, y, z = innovation
            self.rate = (u + gain * x, v + gain * y, w + gain * z)
        self.time, self.value = time, value
        self.count += 1


class OutlierGate:
    """
    Refuse measurements that do not follow from the ones before.

    A position, depth or attitude is predicted with its rate from the last good one; a
    velocity is predicted to stay what it was. The innovation is the difference between a
    measurement and its prediction. The gate learns the median length of the innovations, also
    from refused ones: each moves the median by a small step, however large it is. A measurement
    is an outlier when its innovation is beyond ``velocity.gate`` standard deviations, and beyond
    what the vehicle can accelerate by. Repeats of a value teach nothing, or the next step of a
    coarse sensor would be refused.

    When ``FOLLOW_AFTER`` outliers in a row follow from each other, the measurement has jumped,
    and is followed from there.

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
            self._acceleration = max(self._acceleration, ANGULAR_ACCELERATION)
        self._min_scale = MIN_SCALE * self._velocity
        self._input = input
        self.change_limits(settings)
        self.restart()

    def change_limits(self, settings: Settings) -> None:
        """Use another timeout, ``velocity.max`` and ``velocity.gate``."""
        self._timeout = round(settings.timeout_of(self._input) / NS)
        self._max_speed = settings.max_speed
        self._limit = settings.gate * PER_MEDIAN[self._axes]

    def restart(self) -> None:
        """Forget everything."""
        self._good: Prediction | None = None
        self._outliers: Prediction | None = None
        self._newest = 0  # [ns] time of the newest measurement, good or not
        self._scale = 0.0  # median length of the innovations
        self._innovations = 0
        self._period = 0.0  # [s] between measurements
        self.change: Vector | None = None

    def restart_from(self, time: int, value: Floats) -> None:
        """Accept a measurement, whatever was before."""
        self._good, self._outliers, self._newest = Prediction(time, value), None, time
        self.change = None

    def check(self, time: int, value: Floats) -> str:
        """
        Judge a measurement.

        Returns
        -------
        str
            '' if it is good, ``outlier``, ``too_fast`` for one beyond ``velocity.max``, or
            ``shifted`` if the measurement has jumped and is followed from here.

        """
        good = self._good
        if good is None or time - self._newest > self._timeout or time <= good.time:
            self.restart_from(time, value)
            return ''
        self._newest = time
        dt = (time - good.time) * NS
        change = self.change = self._change(good.value, value)
        u, v, w = good.rate
        x, y, z = innovation = (change[0] - u * dt, change[1] - v * dt, change[2] - w * dt)
        size = math.sqrt(x * x + y * y + z * z)
        is_good = (not self._limit or self._innovations < LEARNED_AFTER
                   or size <= self._allowed(good, dt))
        self._learn(dt, size, is_good)
        if is_good:
            self._outliers = None
            good.advance(time, value, self._rate_gain(good, dt), innovation)
            return ''
        speed = math.hypot(*(value if self._is_rate else change))
        if self._outliers_agree(time, value):
            return 'shifted'
        return 'outlier' if speed <= self._max_speed * (
            1.0 if self._is_rate else dt) else 'too_fast'

    def _change(self, a: Floats, b: Floats) -> Vector:
        """Return the change from one value to another, 0 on axes that do not count."""
        if self._is_rotation:
            return rotation_between(a, b)  # type: ignore[arg-type]
        if self._axes == 1:
            return (b[0] - a[0], 0.0, 0.0)
        return (b[0] - a[0], b[1] - a[1], b[2] - a[2] if self._axes == 3 else 0.0)

    def _allowed(self, prediction: Prediction, dt: float) -> float:
        """Return the greatest innovation that is no outlier."""
        period = self._period
        # what was refused in between says nothing: a long burst must not open the gate
        span = min(dt, 3.0 * period) if self._outliers is not None else dt
        noise = self._limit * self._scale
        if span > period > 0.0:
            noise *= span / period
        if self._is_rate:
            return noise + 2.0 * self._acceleration * span  # full astern at full speed
        if prediction.count == 1:
            return noise + FACTOR * self._velocity * span
        # the rate lags behind by 1.75 periods, see _rate_gain
        change = self._acceleration * (0.5 * span + 1.75 * period)
        if not self._is_rotation:  # over seconds, no further than from full astern to full ahead
            change = min(change, 2.0 * FACTOR * self._velocity)
        return noise + change * span

    def _rate_gain(self, prediction: Prediction, dt: float) -> float:
        """Return the gain [1/s] of the rate; a short interval says little about it."""
        if self._is_rate:
            return 0.0
        h = dt + 0.5 * self._period
        return 1.0 / dt if prediction.count == 1 else dt / (h * h)

    def _learn(self, dt: float, size: float, is_good: bool) -> None:
        """Learn the period and the scale from the length of an innovation."""
        period = self._period
        if self._outliers is None:
            longest = 2.0 * period or dt
            self._period += ((dt if dt < longest else longest) - period) * (
                GAIN if period else 1.0)
        if self.change == ZERO:
            return
        n = self._innovations = self._innovations + 1
        weight = GAIN if n > 60 else 3.0 / n
        if not is_good:
            weight *= OUTLIER_WEIGHT
        if dt > period > 0.0:
            size *= period / dt
        scale = self._scale or size
        scale = scale * (1.0 + weight) if size > scale else scale / (1.0 + weight)
        self._scale = min(max(scale, self._min_scale), MAX_SCALE)

    def _outliers_agree(self, time: int, value: Floats) -> bool:
        """Add an outlier, and tell whether enough of them agree to be followed."""
        outliers = self._outliers
        if outliers is not None:
            dt = (time - outliers.time) * NS
            x, y, z = self._change(outliers.value, value)
            u, v, w = outliers.rate
            innovation = (x - u * dt, y - v * dt, z - w * dt)
            if math.hypot(*innovation) <= self._allowed(outliers, dt):
                outliers.advance(time, value, self._rate_gain(outliers, dt), innovation)
                if outliers.count < FOLLOW_AFTER:
                    return False
                self._good, self._outliers = outliers, None
                return True
        self._outliers = Prediction(time, value)
        return False
