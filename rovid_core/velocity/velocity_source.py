"""Body velocity from what the sensors give, each source at its own rate."""

from __future__ import annotations

from collections import deque
import math

from rovid_core.model.dofs import ANGULAR_DOFS, DOFS, Quaternion, Vector
from rovid_core.model.samples import Motion
from rovid_core.settings.run import Settings
from rovid_core.velocity.attitude_history import MOST_KEPT, World
from rovid_core.velocity.quaternions import rotate, rotate_back, rotation_between

NS = 1e-9

SPEED_SPAN = 0.1
"""[s] Least span of a speed that is too fast: at 1 kHz fixes of 5 mm seem to move at 7 m/s."""

SHORTEST = 0.001
"""[s] Least interval of which that holds; below, a burst was stamped as it came."""

Fix = tuple[int, tuple[float, ...]]
"""A measurement: time [ns] and value."""


class MotionSource:
    """
    The velocity of some DOFs from one input.

    Differences of position, depth or attitude are means over their interval, turned into
    the body with the attitude of its middle; a velocity or angular-velocity sensor gives
    point values. A difference waits until the attitude that it needs is known.

    A measurement that would be too fast is refused and the next is taken against the one
    before it. If two refused ones agree with each other, the fix itself has shifted, and
    they are where the source takes up.

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
        self.change(settings)
        # without an attitude nobody knows where it points, nor is the position turned
        self._lever = settings.lever_arm if self._turned and input == 'position' and any(
            settings.lever_arm) else None
        self._shared = shared
        self.restart()

    def change(self, settings: Settings) -> None:
        """Take other limits: timeouts and ``velocity.max``."""
        self._timeout = round(settings.timeout_of(self.input) / NS)
        self._patience = round(settings.timeout_of('attitude') / NS)
        self._max_speed = settings.max_speed

    def restart(self) -> None:
        """Forget all measurements."""
        self._waiting: deque[tuple[int, tuple[float, ...], str]] = deque()
        self._last: Fix | None = None
        self._refused: Fix | None = None
        self._attitude: Quaternion | None = None  # of the last interval

    def add(self, time: int, value: tuple[float, ...], anew: str = '') -> bool:
        """
        Take a measurement.

        Parameters
        ----------
        time : int
            [ns]
        value : tuple of float
            What was measured.
        anew : str
            A reason to take up from there, '' for none.

        Returns
        -------
        bool
            False if too many wait already for their attitude.

        """
        if len(self._waiting) >= MOST_KEPT:
            return False
        self._waiting.append((time, value, anew))
        return True

    @property
    def is_waiting(self) -> bool:
        """Tell whether a measurement has not been taken."""
        return bool(self._waiting)

    def take(self, now: int) -> Motion | str | None:
        """
        Return the next velocity, why a measurement gives none, or None.

        Parameters
        ----------
        now : int
            Time of the newest event [ns]; a measurement does not wait longer than
            ``attitude.timeout`` for its attitude.

        """
        if not self._waiting:
            return None
        time, value, anew = self._waiting[0]
        if anew:
            self._waiting.popleft()
            self._take_up_anew((time, value))
            return anew
        if self._is_point:
            self._waiting.popleft()
            return self._body(time, time, value) or 'too_fast'
        last = self._last
        missing = 'gap' if last else 'first'
        if last is not None and time - last[0] <= self._timeout:
            missing = self._missing(last[0], time) if self._turned else ''
            if missing == 'later' and now - time <= self._patience:
                return None
        self._waiting.popleft()
        new = time, value
        if missing or last is None:
            self._take_up_anew(new)
            return 'no_attitude' if missing == 'later' else missing
        motion = self._difference(last, new)
        if motion is not None:
            self._last, self._refused = new, None
            return motion
        refused = self._refused
        if refused and not (self._turned and self._missing(refused[0], time)) and (
                self._difference(refused, new) is not None):
            self._take_up_anew(new)
            return 'shifted'
        self._refused = new
        return 'too_fast'

    def _take_up_anew(self, fix: Fix) -> None:
        self._attitude = None
        if self.input == 'depth':
            self._shared.forget_depths()
        self._last, self._refused = fix, None

    def _missing(self, start: int, end: int) -> str:
        """Return '' if the attitudes of an interval are known, or why they are not."""
        missing = self._shared.attitude.missing
        if self._lever is None:
            return missing((start + end) // 2)
        # the lever arm is taken off at both ends; else the middle will do
        return missing(start) or missing(end)

    def _difference(self, last: Fix, new: Fix) -> Motion | None:
        """Return the velocity between two measurements, None if it is too fast."""
        start, end = last[0], new[0]
        dt = (end - start) * NS
        if self.input == 'attitude':
            x, y, z = rotation_between(last[1], new[1])  # type: ignore[arg-type]
            return self._body(start, end, (x / dt, y / dt, z / dt))
        velocity = self._world_velocity(last, new, dt)
        if velocity is None:
            return None
        if not self._turned:
            motion = self._body(start, end, velocity)
        else:
            attitude = self._shared.attitude.at((start + end) // 2)
            body = rotate_back(attitude, velocity)
            motion = self._body(start, end, body)
            if motion is not None and self._shared.attitude.noisy:
                motion = motion._replace(turn=math.hypot(*rotation_between(
                    self._attitude or attitude, attitude)), slips=self._slips(body, dt))
        if motion is None:
            return None
        if self._turned:
            self._attitude = attitude
        # only now: what is refused must not reach the other sources either
        if self.input == 'depth':
            if not self._shared.vertical(end, 1):
                self._shared.note_depth(*_scalar(last))
            self._shared.note_depth(*_scalar(new))
        else:
            self._shared.note_horizontal(end, velocity)
        return motion

    def _world_velocity(self, last: Fix, new: Fix, dt: float) -> Vector | None:
        world, end = self._shared, new[0]
        if self.input == 'depth':
            own: tuple[float, ...] = ((new[1][0] - last[1][0]) / dt,)
            velocity: Vector = (*world.horizontal(end), own[0])
        else:
            a, b = self._body_origin(*last), self._body_origin(*new)
            vertical = world.vertical(end, end - last[0])
            own = ((b[0] - a[0]) / dt, (b[1] - a[1]) / dt)
            velocity = (own[0], own[1], (b[2] - a[2]) / dt if vertical is None else vertical)
        return velocity if self._is_slow(own, dt) else None

    def _body_origin(self, time: int, value: tuple[float, ...]) -> Vector:
        x, y, z = value
        if self._lever:
            lx, ly, lz = rotate(self._shared.attitude.at(time), self._lever)
            return (x - lx, y - ly, z - lz)
        return (x, y, z)

    def _slips(self, body: Vector, dt: float) -> tuple[float, ...]:
        variance = self._shared.attitude.wander * dt
        square = body[0] * body[0] + body[1] * body[1] + body[2] * body[2]
        return tuple([
            math.sqrt(variance * max(square - body[i] * body[i], 0.0)) for i in self._axes])

    def _body(self, start: int, end: int, velocity: tuple[float, ...]) -> Motion | None:
        """Return the velocity of the DOFs over an interval, None if it is too fast."""
        own = tuple([velocity[i] for i in self._axes])
        if not self._is_slow(own, (end - start) * NS):
            return None
        return Motion(start, end, (start + end) // 2, own)

    def _is_slow(self, velocity: tuple[float, ...], dt: float) -> bool:
        limit = self._max_speed
        if 0.0 < dt < SPEED_SPAN:
            limit *= SPEED_SPAN / max(dt, SHORTEST)
        for v in velocity:
            # written so that a NaN (positions of 1e300 give some) is too fast as well
            if not -limit <= v <= limit:
                return False
        return True


def _scalar(fix: Fix) -> tuple[int, float]:
    return (fix[0], fix[1][0])
