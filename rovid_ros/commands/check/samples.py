"""What the samples of one input look like: times, gaps, speeds and ranges, in one pass."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import cast

from rovid_core.model.dofs import Quaternion
from rovid_core.velocity.quaternions import normalised, rotation_between

NS = 1e-9

Value = Sequence[float]


class Samples:
    """
    The samples of one input, or of one topic of several, told one after the other.

    Parameters
    ----------
    input : str
        Which one; decides what a speed is.
    max_speed : float
        [m/s or rad/s] Faster steps are counted.

    Attributes
    ----------
    count, backward, not_finite : int
        Samples; those stamped no later than the one before; those with a NaN or infinity.
    first, last : int
        Event times [ns].
    longest_gap : float
        [s]
    behind : list of float
        Least and largest time [s] from the stamp to the receipt.
    low, high : list of float
        Range of each value; of an attitude that of the heading [rad], unwrapped.
    steps, fast : int
        Steps from one sample to the next, and how many of them are too fast.
    fastest : float
        [m/s or rad/s]

    """

    def __init__(self, input: str, max_speed: float) -> None:
        self.input = input
        self._max_speed = max_speed
        self.count = self.backward = self.not_finite = 0
        self.first = self.last = 0
        self.longest_gap = 0.0
        self.behind = [math.inf, -math.inf]
        self._lag = 0.0
        self.low: list[float] = []
        self.high: list[float] = []
        self.steps = self.fast = 0
        self.fastest = 0.0
        self._before: tuple[int, tuple[float, ...]] | None = None
        self._heading = 0.0

    @property
    def rate(self) -> float:
        """Return the mean rate [Hz], 0 for less than two samples."""
        span = (self.last - self.first) * NS
        return (self.count - 1) / span if span > 0.0 else 0.0

    @property
    def lag(self) -> float:
        """Return the mean time [s] from the stamp to the receipt."""
        return self._lag / max(self.count, 1)

    def take(self, time: int, receive_time: int, value: tuple[float, ...]) -> None:
        """Take a sample with its event time and the receive time of its message [ns]."""
        lag = (receive_time - time) * NS
        self._lag += lag
        self.behind = [min(self.behind[0], lag), max(self.behind[1], lag)]
        if not self.count:
            self.first = self.last = time
        elif time <= self.last:
            self.backward += 1
        self.longest_gap = max(self.longest_gap, (time - self.last) * NS)
        self.first, self.last = min(self.first, time), max(self.last, time)
        self.count += 1
        if all(map(math.isfinite, value)):
            self._measure(time, value)
        elif self.input != 'reference':  # there a NaN is a DOF that it does not have
            self.not_finite += 1

    def _measure(self, time: int, value: tuple[float, ...]) -> None:
        if self.input == 'attitude':
            try:
                value = normalised(cast(Quaternion, value))
            except (ValueError, OverflowError):
                self.not_finite += 1
                return
        before = self._before
        if before is None or time > before[0]:
            self._before = (time, value)
            if before is not None:
                self._step((time - before[0]) * NS, before[1], value)
        shown = self._unwrapped(value) if self.input == 'attitude' else value
        self.low = list(map(min, self.low or shown, shown))
        self.high = list(map(max, self.high or shown, shown))

    def _step(self, dt: float, before: tuple[float, ...], value: tuple[float, ...]) -> None:
        if self.input in ('position', 'depth'):
            speed = math.dist(before, value) / dt
        elif self.input == 'attitude':
            speed = math.hypot(*rotation_between(
                cast(Quaternion, before), cast(Quaternion, value))) / dt
        elif self.input in ('velocity', 'angular_velocity'):
            speed = math.hypot(*value)
        else:
            return
        self.steps += 1
        self.fast += speed > self._max_speed
        self.fastest = max(self.fastest, speed)

    def _unwrapped(self, value: tuple[float, ...]) -> tuple[float, ...]:
        x, y, z, w = value
        yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        self._heading += math.remainder(yaw - self._heading, 2.0 * math.pi)
        return (self._heading,)
