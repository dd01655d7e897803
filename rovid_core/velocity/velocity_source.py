"""Body velocity from what the sensors give, each source at its own rate."""

from __future__ import annotations

from collections import deque
import math
from typing import Final

from rovid_core.model.dofs import ANGULAR_DOFS, LINEAR_DOFS, Quaternion, Vector
from rovid_core.model.samples import Motion, NS
from rovid_core.settings.run import BURST, Settings
from rovid_core.velocity.attitude_history import (
    cross,
    MAX_KEPT,
    rotate,
    rotate_back,
    rotation_between,
    SharedMotion,
)

SPEED_SPAN: Final = 0.1
"""[s] Least span of a speed that is too fast: at 1 kHz fixes of 5 mm seem to move at 7 m/s."""

SHORTEST: Final = 0.001
"""[s] Least interval of which that holds; below, a burst was stamped as it came."""

Fix = tuple[int, tuple[float, ...]]
"""A measurement: time [ns] and value."""


class VelocitySource:
    """
    The velocity of some DOFs from one input.

    Differences of position, depth or attitude are means over their interval, turned into
    the body with the attitude of its middle; a velocity or angular-velocity sensor gives
    point values. What needs an attitude, or an angular velocity, waits until that is known.

    A measurement that would be too fast, or comes in a burst, is refused, and the next is
    compared with the one before it.

    Parameters
    ----------
    settings : Settings
        The run.
    input : str
        ``position``, ``depth``, ``attitude``, ``velocity`` or ``angular_velocity``.
    shared : SharedMotion
        What the sources know of each other.

    Attributes
    ----------
    input : str
        As given.
    dofs : tuple of str
        The DOFs that this input measures.
    waiting : deque
        Measurements that no velocity was made of yet.
    timeout : int
        Longest time between two measurements of a difference [ns].

    """

    def __init__(self, settings: Settings, input: str, shared: SharedMotion) -> None:
        self.input = input
        self.dofs = tuple(d for d in settings.dofs if settings.source(d) == input)
        names = ANGULAR_DOFS if input in ('attitude', 'angular_velocity') else LINEAR_DOFS
        self._axes = [names.index(d) for d in self.dofs]
        self._is_point = input in ('velocity', 'angular_velocity')
        self._needs_attitude = bool(settings.attitude.topic) and input in ('position', 'depth')
        self.change(settings)
        arm = settings.input(input).lever_arm
        # without an attitude nobody knows where that of a position points
        self._lever = arm if any(arm) and (self._needs_attitude or input == 'velocity') else None
        self._shared = shared
        self.restart()

    def change(self, settings: Settings) -> None:
        """Use other limits: timeouts and ``velocity.max``."""
        self.timeout = round(settings.timeout_of(self.input) / NS)
        waits_for = 'angular_velocity' if self._is_point else 'attitude'
        self._patience = round(settings.timeout_of(waits_for) / NS)
        self._max_speed = settings.max_speed

    def restart(self) -> None:
        """Forget all measurements."""
        self.waiting: deque[tuple[int, tuple[float, ...], str]] = deque()
        self._last: Fix | None = None
        self._interval = 0  # [ns] of the last difference
        self._attitude: Quaternion | None = None  # in the middle of the last interval

    def add_sample(self, time: int, value: tuple[float, ...], jumped: str = '') -> bool:
        """
        Add a measurement.

        Parameters
        ----------
        time : int
            [ns]
        value : tuple of float
            What was measured.
        jumped : str
            Why no difference to the measurement before may be taken, '' where it may.

        Returns
        -------
        bool
            False if too many measurements wait already for their attitude.

        """
        if len(self.waiting) >= MAX_KEPT:
            return False
        self.waiting.append((time, value, jumped))
        return True

    def next_velocity(self, now: int) -> Motion | str | None:
        """
        Return the next velocity, or why the next measurement gives none.

        None if no measurement waits, or the next one has to wait on.

        Parameters
        ----------
        now : int
            Time of the newest event [ns]; a measurement does not wait longer for its attitude,
            or for the angular velocity at its lever arm, than the timeout of that input.

        """
        if not self.waiting:
            return None
        time, value, jumped = self.waiting[0]
        if self._is_point and not jumped:
            return self._point_velocity(time, value, now)
        last = self._last
        missing = jumped or ('gap' if last else 'first')
        if last is not None and not jumped and time - last[0] <= self.timeout:
            missing = self._missing_attitude(last[0], time) if self._needs_attitude else ''
            if missing == 'later' and now - time <= self._patience:
                return None
        self.waiting.popleft()
        if missing or last is None:
            self._attitude = None
            if self.input == 'depth':
                self._shared.forget_depths()
            self._last = time, value
            return 'no_attitude' if missing == 'later' else missing
        interval = time - last[0]
        if BURST * interval < self._interval:
            return 'burst'
        motion = self._difference(last, (time, value))
        if motion is None:
            return 'too_fast'
        self._last, self._interval = (time, value), interval
        return motion

    def _point_velocity(self, time: int, value: tuple[float, ...],
                        now: int) -> Motion | str | None:
        """Return what a sensor of the velocity itself says, as ``next_velocity``."""
        body = value[0], value[1], value[2]
        missing = self._shared.rates.missing(time) if self._lever else ''
        if missing == 'later' and now - time <= self._patience:
            return None
        self.waiting.popleft()
        if missing:
            return 'no_rate'
        if self._lever:
            x, y, z = cross(self._shared.rates.at(time), self._lever)
            body = body[0] - x, body[1] - y, body[2] - z
        velocity = tuple([body[i] for i in self._axes])
        if not self._is_slow(velocity, 0.0):
            return 'too_fast'
        return Motion(time, time, time, velocity, 0.0, (), body)

    def _missing_attitude(self, start: int, end: int) -> str:
        """Return '' if the attitudes of an interval are known, or why they are not."""
        missing = self._shared.attitude.missing
        why = missing((start + end) // 2)
        if why or self._lever is None:
            return why
        # the lever arm is taken off at both ends
        return missing(start) or missing(end)

    def _difference(self, last: Fix, new: Fix) -> Motion | None:
        """Return the velocity between two measurements, None if it is too fast."""
        start, end = last[0], new[0]
        dt, middle = (end - start) * NS, (start + end) // 2
        world, measured = self._in_world(last, new, dt)
        body, turn = world, 0.0
        if self._needs_attitude:
            attitude = self._shared.attitude.at(middle)
            body = rotate_back(attitude, world)
            if self._shared.attitude.needs_noise:
                turn = math.hypot(*rotation_between(self._attitude or attitude, attitude))
        velocity = tuple([body[i] for i in self._axes])
        if not (self._is_slow(measured, dt) and self._is_slow(velocity, dt)):
            return None
        # only now: what is refused must not reach the other sources either
        if self._needs_attitude:
            self._attitude = attitude
        if self.input == 'depth':
            if self._shared.vertical_velocity(end, 1) is None:
                self._shared.add_depth(start, last[1][0])
            self._shared.add_depth(end, new[1][0])
        fix = (0.0, 0.0)
        if self.input == 'position':
            self._shared.horizontal = end, world[0], world[1]
            at = self._without_lever(start, last[1]) if self._lever else last[1]
            fix = at[0], at[1]
        # in the order of the fields: by their names it would take three times as long
        return Motion(start, end, middle, velocity, turn, self._path_noise(body, dt), body, fix)

    def _in_world(self, last: Fix, new: Fix, dt: float) -> tuple[Vector, tuple[float, ...]]:
        """
        Return the velocity between two measurements in the world, and what they measure of it.

        The rest of it comes from other inputs. An attitude gives the angular velocity, which is
        that in the body already.
        """
        (start, a), (end, b) = last, new
        if self.input == 'attitude':
            x, y, z = self._shared.attitude.known_rotation(start, end) or rotation_between(
                a, b)  # type: ignore[arg-type]
            return (x / dt, y / dt, z / dt), ()
        if self.input == 'depth':
            up = (b[0] - a[0]) / dt
            return (*self._shared.horizontal_velocity(end), up), (up,)
        if self._lever:
            a, b = self._without_lever(start, a), self._without_lever(end, b)
        vertical = self._shared.vertical_velocity(end, end - start)
        x, y = (b[0] - a[0]) / dt, (b[1] - a[1]) / dt
        return (x, y, (b[2] - a[2]) / dt if vertical is None else vertical), (x, y)

    def _without_lever(self, time: int, value: tuple[float, ...]) -> Vector:
        """Return where the origin of the body is when the sensor is at ``value``."""
        assert self._lever is not None
        lx, ly, lz = rotate(self._shared.attitude.at(time), self._lever)
        return (value[0] - lx, value[1] - ly, value[2] - lz)

    def _path_noise(self, body: Vector, dt: float) -> tuple[float, ...]:
        """
        Return the standard deviation of the path from the attitude's noise [m or rad], per DOF.

        Angles of the body turn with its other axes, as distances along it do.
        """
        if not ((self._needs_attitude or self.input == 'attitude')
                and self._shared.attitude.needs_noise):
            return ()
        variance = self._shared.attitude.noise_density * dt
        square = body[0] * body[0] + body[1] * body[1] + body[2] * body[2]
        return tuple([
            math.sqrt(variance * max(square - body[i] * body[i], 0.0)) for i in self._axes])

    def _is_slow(self, velocity: tuple[float, ...], dt: float) -> bool:
        """Tell whether a velocity is within ``velocity.max``."""
        limit = self._max_speed
        if 0.0 < dt < SPEED_SPAN:
            limit *= SPEED_SPAN / max(dt, SHORTEST)
        for v in velocity:
            # written so that a NaN (positions of 1e300 give some) is too fast as well
            if not -limit <= v <= limit:
                return False
        return True
