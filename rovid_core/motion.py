"""Body velocity from what the sensors give, each source at its own rate."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from dataclasses import dataclass

from rovid_core.dofs import ANGULAR_DOFS, DOFS, Quaternion, Vector
from rovid_core.rotation import between, rotate, rotate_back, rotation_between
from rovid_core.settings import Settings

NS = 1e-9


@dataclass(frozen=True, slots=True)
class Motion:
    """
    One measured velocity.

    Attributes
    ----------
    start, end : int
        The interval over which it is the mean [ns]; the same for a point measurement.
    velocity : tuple of float
        One value per DOF of the source [m/s or rad/s], in the body frame.

    """

    start: int
    end: int
    velocity: tuple[float, ...]

    @property
    def time(self) -> int:
        """Return the time at which the velocity stands: the middle of its interval [ns]."""
        return (self.start + self.end) // 2


class AttitudeHistory:
    """The attitudes of the last moments, interpolated."""

    def __init__(self, max_gap: int) -> None:
        self._max_gap = max_gap
        self.restart()

    def restart(self) -> None:
        """Forget all attitudes."""
        self._times: list[int] = []
        self._values: list[Quaternion] = []

    def add(self, time: int, q: Quaternion) -> None:
        """Take an attitude at ``time`` [ns], after the last one."""
        if len(self._times) > 1024:
            cut = bisect_left(self._times, time - 2 * self._max_gap)
            del self._times[:cut], self._values[:cut]
        self._times.append(time)
        self._values.append(q)

    def missing(self, time: int) -> str:
        """Return '' if the attitude at ``time`` is known, 'later' if it may become so."""
        i = bisect_left(self._times, time)
        if i == len(self._times):
            return 'later'
        if self._times[i] == time:
            return ''
        if i == 0 or self._times[i] - self._times[i - 1] > self._max_gap:
            return 'no_attitude'
        return ''

    def at(self, time: int) -> Quaternion:
        """Return the attitude at a ``time`` for which ``missing`` is ''."""
        i = bisect_left(self._times, time)
        if self._times[i] == time:
            return self._values[i]
        before, after = self._times[i - 1], self._times[i]
        return between(
            self._values[i - 1], self._values[i], (time - before) / (after - before))


class MotionSource:
    """
    The velocity of some DOFs from one input.

    Differences of position, depth or attitude are means over their interval, turned into
    the body with the attitude of its middle; a velocity or angular-velocity sensor gives
    point values. A difference waits until the attitude that it needs is known.

    Parameters
    ----------
    settings : Settings
        The run.
    input : str
        ``position``, ``depth``, ``attitude``, ``velocity`` or ``angular_velocity``.
    shared : World
        What the sources know of each other.

    """

    def __init__(self, settings: Settings, input: str, shared: World) -> None:
        self.input = input
        self.dofs = tuple(d for d in settings.dofs if settings.source(d) == input)
        axes = ANGULAR_DOFS if input in ('attitude', 'angular_velocity') else DOFS[:3]
        self._axes = [axes.index(d) for d in self.dofs]
        self._is_point = input in ('velocity', 'angular_velocity')
        self._turned = bool(settings.attitude.topic) and input in ('position', 'depth')
        self._max_gap = round(settings.max_gap / NS)
        self._max_speed = settings.max_speed
        self._lever = settings.lever_arm if input == 'position' and any(
            settings.lever_arm) else None
        self._shared = shared
        self.restart()

    def restart(self) -> None:
        """Forget all measurements."""
        self._waiting: deque[tuple[int, tuple[float, ...]]] = deque()
        self._last: tuple[int, tuple[float, ...]] | None = None

    def add(self, time: int, value: tuple[float, ...]) -> None:
        """Take a measurement at ``time`` [ns]."""
        self._waiting.append((time, value))

    def take(self, now: int) -> Motion | str | None:
        """
        Return the next velocity, why a measurement gives none, or None.

        Parameters
        ----------
        now : int
            Time of the newest event [ns]; a measurement does not wait longer than
            ``max_gap`` for its attitude.

        """
        if not self._waiting:
            return None
        time, value = self._waiting[0]
        last = self._last
        if self._is_point:
            self._waiting.popleft()
            return self._checked(Motion(time, time, value[:3]))
        if last is None or time - last[0] > self._max_gap:
            self._waiting.popleft()
            self._last = (time, value)
            return 'gap' if last else 'first'
        missing = self._missing(last[0], time)
        if missing == 'later' and now - time <= self._max_gap:
            return None
        self._waiting.popleft()
        if missing:
            self._last = (time, value)
            return 'no_attitude'
        result = self._checked(self._difference(last, (time, value)))
        if isinstance(result, Motion):
            self._last = (time, value)
        return result

    def _missing(self, start: int, end: int) -> str:
        if not self._turned:
            return ''
        # the lever arm is taken off at both ends; else the middle will do
        times = (start, end) if self._lever else ((start + end) // 2,)
        return next((m for m in map(self._shared.attitude.missing, times) if m), '')

    def _difference(self, last: tuple[int, tuple[float, ...]],
                    new: tuple[int, tuple[float, ...]]) -> Motion:
        start, end = last[0], new[0]
        dt = (end - start) * NS
        if self.input == 'attitude':
            turn = rotation_between(last[1], new[1])  # type: ignore[arg-type]
            return Motion(start, end, tuple([x / dt for x in turn]))
        world = self._shared
        if self.input == 'depth':
            world.note_vertical(end, (new[1][0] - last[1][0]) / dt)
            velocity = world.velocity(end, self._max_gap)
        else:
            a, b = self._body_origin(*last), self._body_origin(*new)
            velocity = world.note_position(
                end, ((b[0] - a[0]) / dt, (b[1] - a[1]) / dt, (b[2] - a[2]) / dt),
                self._max_gap)
        if self._turned:
            velocity = rotate_back(world.attitude.at((start + end) // 2), velocity)
        return Motion(start, end, velocity)

    def _body_origin(self, time: int, value: tuple[float, ...]) -> Vector:
        x, y, z = value
        if self._lever:
            lx, ly, lz = rotate(self._shared.attitude.at(time), self._lever)
            return (x - lx, y - ly, z - lz)
        return (x, y, z)

    def _checked(self, motion: Motion) -> Motion | str:
        velocity = tuple([motion.velocity[i] for i in self._axes])
        # written so that a NaN (positions of 1e300 give some) is too fast as well
        if not all(-self._max_speed <= v <= self._max_speed for v in velocity):
            return 'too_fast'
        return Motion(motion.start, motion.end, velocity)


class World:
    """World velocity of the horizontal and the vertical source, and the attitude."""

    def __init__(self, settings: Settings) -> None:
        self.attitude = AttitudeHistory(round(settings.max_gap / NS))
        self._has_depth = bool(settings.depth.topic)
        self.restart()

    def restart(self) -> None:
        """Forget everything."""
        self.attitude.restart()
        self._horizontal = (0.0, 0.0)
        self._horizontal_time: int | None = None
        self._vertical = 0.0
        self._vertical_time: int | None = None

    def note_vertical(self, time: int, rate: float) -> None:
        """Take the rate of the depth input [m/s, up]."""
        self._vertical, self._vertical_time = rate, time

    def note_position(self, time: int, velocity: Vector, max_gap: int) -> Vector:
        """Take the rate of the position and return it, with the depth's vertical part."""
        self._horizontal, self._horizontal_time = velocity[:2], time
        if not self._has_depth:
            return velocity
        return self.velocity(time, max_gap)

    def velocity(self, time: int, max_gap: int) -> Vector:
        """Return the newest world velocity [m/s]; parts older than ``max_gap`` are 0."""
        x, y, z = *self._horizontal, self._vertical
        if self._horizontal_time is None or time - self._horizontal_time > max_gap:
            x, y = 0.0, 0.0
        if self._vertical_time is None or time - self._vertical_time > max_gap:
            z = 0.0
        return (x, y, z)
