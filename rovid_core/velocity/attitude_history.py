"""
What the velocity sources need of each other: attitude and turn rate, velocities in the world.

Attitudes are unit quaternions (x, y, z, w) in plain floats: the online path needs no arrays.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
import math
from typing import Final

from rovid_core.model.dofs import Quaternion, Vector
from rovid_core.model.samples import NS
from rovid_core.settings.run import Settings

MAX_KEPT: Final = 65536
"""Attitudes and depths that are kept, however close their stamps are."""

SHARE: Final = 0.01
"""Of a new sample in the mean that tells the noise of the attitude."""


class AttitudeHistory:
    """
    The attitudes of the last moments, interpolated.

    Parameters
    ----------
    timeout : int
        [ns] Between two attitudes that are further apart, nothing is known.
    memory : int
        [ns] How far back attitudes are needed.
    needs_noise : bool
        Whether ``noise_density`` is computed.

    Attributes
    ----------
    needs_noise : bool
        As given.
    noise_density : float
        Spectral density of the attitude's noise on one axis [rad^2 s]. Multiplied with the
        speed squared it is how fast the variance of a path grows that is turned by them.

    """

    def __init__(self, timeout: int, memory: int, needs_noise: bool = True) -> None:
        self.needs_noise = needs_noise
        self.change(timeout, memory)
        self.restart()

    def change(self, timeout: int, memory: int) -> None:
        """Use other limits [ns]."""
        self._timeout = timeout
        self._memory = memory

    def restart(self) -> None:
        """Forget all attitudes."""
        self._times: list[int] = []
        self._values: list[Quaternion] = []
        self._rotations: list[Vector | None] = []  # to each from the one before, where known
        self._rotation: Vector = (0.0, 0.0, 0.0)  # between the last two attitudes
        self.noise_density = 0.0

    def add_sample(self, time: int, q: Quaternion, rotation: Vector | None = None) -> None:
        """
        Add an attitude.

        Parameters
        ----------
        time : int
            After that of the last one [ns].
        q : Quaternion
            Body to world.
        rotation : Vector, optional
            Rotation from the last one [rad], if it is known already.

        """
        times = self._times
        if len(times) > 1024:
            cut = max(bisect_left(times, time - self._memory), len(times) - MAX_KEPT)
            del times[:cut], self._values[:cut], self._rotations[:cut]
        # a gap says nothing about the noise
        if self.needs_noise and times and 0 < time - times[-1] <= self._timeout:
            rotation = rotation or rotation_between(self._values[-1], q)
            # the second difference of white noise has six times its variance, on three axes
            square = math.dist(rotation, self._rotation) ** 2 / 18.0
            self._rotation = rotation
            self.noise_density += (square * ((time - times[-1]) * NS) - self.noise_density) * (
                SHARE if self.noise_density else 1.0)
        times.append(time)
        self._values.append(q)
        self._rotations.append(rotation)

    def restart_from(self, time: int, q: Quaternion) -> None:
        """Add an attitude that has jumped: between the last one and it nothing is known."""
        del self._times[:], self._values[:], self._rotations[:]
        self.add_sample(time, q)

    def missing(self, time: int) -> str:
        """Return '' if the attitude at ``time`` is known, 'later' if it may become so."""
        i = bisect_left(self._times, time)
        if i == len(self._times):
            return 'later'
        if self._times[i] == time:
            return ''
        if i == 0 or self._times[i] - self._times[i - 1] > self._timeout:
            return 'no_attitude'
        return ''

    def known_at(self, time: int) -> Quaternion | None:
        """Return the attitude at a ``time``, or the nearest one known; None if there is none."""
        if not self._times:
            return None
        return self.at(min(max(time, self._times[0]), self._times[-1]))

    def known_rotation(self, start: int, end: int) -> Vector | None:
        """Return the rotation [rad] from one attitude to the next, None of any other times."""
        times, i = self._times, bisect_left(self._times, end)
        if 0 < i < len(times) and times[i] == end and times[i - 1] == start:
            return self._rotations[i]
        return None

    def at(self, time: int) -> Quaternion:
        """Return the attitude at a ``time`` for which ``missing`` is ''."""
        i = bisect_left(self._times, time)
        if self._times[i] == time:
            return self._values[i]
        before, after = self._times[i - 1], self._times[i]
        start, rotation = self._values[i - 1], self._rotations[i]
        if rotation is None:
            rotation = self._rotations[i] = rotation_between(start, self._values[i])
        return turned(start, rotation, (time - before) / (after - before))


class RateHistory:
    """
    Angular velocities in the body [rad/s], interpolated.

    Attributes
    ----------
    timeout : int
        [ns] Between two that are further apart nothing is known.
    memory : int
        [ns] How far back they are needed.

    """

    def __init__(self) -> None:
        self.timeout = self.memory = 0
        self._rates: deque[tuple[int, Vector]] = deque()

    def restart(self) -> None:
        """Forget all."""
        self._rates.clear()

    def add_sample(self, time: int, rate: Vector) -> None:
        """Add an angular velocity, at a time after that of the last one [ns]."""
        rates = self._rates
        if rates and time - rates[-1][0] > self.timeout:
            rates.clear()
        rates.append((time, rate))
        while rates[0][0] < time - self.memory:
            rates.popleft()

    def missing(self, time: int) -> str:
        """Return '' if the angular velocity at ``time`` is known, 'later' if it may become so."""
        if not self._rates or self._rates[-1][0] < time:
            return 'later'
        return '' if self._rates[0][0] <= time else 'no_rate'

    def at(self, time: int) -> Vector:
        """Return the angular velocity at a ``time`` for which ``missing`` is ''."""
        end, after = self._rates[-1]
        for start, before in reversed(self._rates):
            if start <= time:
                break
            end, after = start, before
        share = (time - start) / (end - start) if end > start else 0.0
        return (before[0] + share * (after[0] - before[0]),
                before[1] + share * (after[1] - before[1]),
                before[2] + share * (after[2] - before[2]))


class SharedMotion:
    """
    What the velocity sources know of each other.

    Attributes
    ----------
    attitude : AttitudeHistory
        The attitudes that were accepted.
    rates : RateHistory
        The angular velocities of a gyro, where ``needs_rates``.
    needs_rates : bool
        Whether a velocity sensor has a lever arm.
    horizontal : tuple of (int, float, float) or None
        Time [ns] and horizontal velocity in the world [m/s] of the newest position.

    """

    def __init__(self, settings: Settings) -> None:
        self.attitude = AttitudeHistory(0, 0, settings.watches)
        self.rates, self.needs_rates = RateHistory(), bool(
            settings.velocity.topic and any(settings.velocity.lever_arm))
        self.change(settings)
        self.restart()

    def change(self, settings: Settings) -> None:
        """Use other timeouts."""
        self._memory = 2 * round(settings.longest_timeout / NS)
        self._position_timeout, self._depth_timeout, attitude = (
            round(settings.timeout_of(name) / NS) for name in ('position', 'depth', 'attitude'))
        self.attitude.change(attitude, self._memory)
        self.rates.timeout, self.rates.memory = (
            round(settings.timeout_of('angular_velocity') / NS), self._memory)

    def restart(self) -> None:
        """Forget everything."""
        self.attitude.restart()
        self.rates.restart()
        self._depths: deque[tuple[int, float]] = deque(maxlen=MAX_KEPT)
        self.horizontal: tuple[int, float, float] | None = None

    def forget_depths(self) -> None:
        """Forget the depths: the next one has jumped."""
        self._depths.clear()

    def add_depth(self, time: int, z: float) -> None:
        """Add a depth [m, up] that was accepted."""
        self._depths.append((time, z))
        while self._depths[0][0] < time - self._memory:
            self._depths.popleft()

    def vertical_velocity(self, time: int, span: int) -> float | None:
        """
        Return the mean vertical velocity [m/s] over ``span`` [ns] up to the newest depth.

        The position with which it is turned into the body has the same span, so that one is
        no noisier than the other. None where the depth is too old.
        """
        if len(self._depths) < 2 or time - self._depths[-1][0] > self._depth_timeout:
            return None
        end, z = self._depths[-1]
        start, before = self._depths[0]
        for then, x in reversed(self._depths):
            if then <= end - span:
                start, before = then, x
                break
        return (z - before) / ((end - start) * NS)

    def heading(self, time: int) -> float | None:
        """Return the heading [rad] at a time [ns], None where it is not known."""
        if self.attitude.missing(time):
            return None
        return yaw_of(self.attitude.at(time))

    def horizontal_velocity(self, time: int) -> tuple[float, float]:
        """Return the newest horizontal velocity [m/s]; 0 where it is too old."""
        if self.horizontal is None or time - self.horizontal[0] > self._position_timeout:
            return (0.0, 0.0)
        return self.horizontal[1:]


def normalised(q: Quaternion) -> Quaternion:
    """Return ``q`` at unit length; raises ValueError when it has none (zero or non-finite)."""
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if not 0.0 < length < math.inf:
        raise ValueError(f'a quaternion of length {length}')
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


def yaw_of(q: Quaternion) -> float:
    """Return the yaw of an attitude [rad], as in REP 103: yaw is turned first."""
    x, y, z, w = q
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def from_yaw(yaw: float) -> Quaternion:
    """Return the attitude of a level body with this heading [rad], counter-clockwise."""
    return (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))


def angles_of(q: Quaternion) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [rad] of an attitude, as in REP 103; upright there is no roll."""
    x, y, z, w = q
    sine = 2.0 * (w * y - x * z)
    if abs(sine) > 1.0 - 1e-12:
        return 0.0, math.copysign(0.5 * math.pi, sine), 2.0 * math.atan2(z, w)
    return (math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)), math.asin(sine),
            yaw_of(q))


def from_angles(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the attitude of roll, pitch and yaw [rad], as in REP 103: yaw is turned first."""
    x, y, z = 0.5 * roll, 0.5 * pitch, 0.5 * yaw
    return product((0.0, 0.0, math.sin(z), math.cos(z)), product(
        (0.0, math.sin(y), 0.0, math.cos(y)), (math.sin(x), 0.0, 0.0, math.cos(x))))


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the Hamilton product ``p q``: first ``q``, then ``p``."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return (
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    )


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Turn a body vector into the world."""
    x, y, z, w = q
    # v + 2 u x (u x v + w v), with u the vector part of q
    cx = y * v[2] - z * v[1] + w * v[0]
    cy = z * v[0] - x * v[2] + w * v[1]
    cz = x * v[1] - y * v[0] + w * v[2]
    return (
        v[0] + 2.0 * (y * cz - z * cy),
        v[1] + 2.0 * (z * cx - x * cz),
        v[2] + 2.0 * (x * cy - y * cx),
    )


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def rotate_back(q: Quaternion, v: Vector) -> Vector:
    """Turn a world vector into the body."""
    return rotate((-q[0], -q[1], -q[2], q[3]), v)


def rotation_between(p: Quaternion, q: Quaternion) -> Vector:
    """
    Return the rotation vector [rad] in body axes that takes attitude ``p`` to ``q``.

    ``q`` and ``-q`` are the same attitude; the short way round is taken, so headings
    never wrap.
    """
    x, y, z, w = product((-p[0], -p[1], -p[2], p[3]), q)
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    # the limit of angle / sin(angle / 2) for small angles is 2
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
    return (x * scale, y * scale, z * scale)


def turned(p: Quaternion, rotation: Vector, fraction: float) -> Quaternion:
    """Return ``p`` turned on by a ``fraction`` of a rotation vector [rad] in body axes."""
    rx, ry, rz = rotation
    angle = math.sqrt(rx * rx + ry * ry + rz * rz)
    if angle < 1e-12:
        return p
    half = 0.5 * angle * fraction
    scale = math.sin(half) / angle
    return product(p, (rx * scale, ry * scale, rz * scale, math.cos(half)))
