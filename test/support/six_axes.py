"""
A BlueROV2 in all six axes, written for the tests alone: another simulator than the product's.

Equations of motion after Fossen (Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd
edition, section 8.1): a rigid body whose centre of mass lies below the origin, added mass, the
Coriolis forces of both, drag, weight and buoyancy, in a current that does not turn. A controller
holds it level, and depth and heading where it is told to, as ArduSub does; its eight thrusters
get pulses. What is logged are MAVROS' messages.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rovid_ros.logs.writer import LogWriter

Array = NDArray[np.float64]

STEP = 0.02  # [s]
START = 1_700_000_000.0  # [s]
CEILING = 28.0  # [N] that the controller asks of a thruster at most
# Of each thruster: surge, sway, heave, roll, pitch, yaw (ArduSub's frame vectored_6dof).
ALLOCATION = np.array([
    [-0.7071, -0.7071, 0.7071, 0.7071, 0.0, 0.0, 0.0, 0.0],
    [-0.7071, 0.7071, -0.7071, 0.7071, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, -1.0, -1.0, -1.0, -1.0],
    [-0.0601, 0.0601, -0.0601, 0.0601, 0.218, -0.218, 0.218, -0.218],
    [0.0601, 0.0601, -0.0601, -0.0601, 0.12, 0.12, -0.12, -0.12],
    [-0.1888, 0.1888, 0.1888, -0.1888, 0.0, 0.0, 0.0, 0.0]])
LARGEST = np.array([48.0, 48.0, 52.0, 3.6])  # [N] and [N m] of surge, sway, heave, yaw
DOFS = {'surge': 0, 'sway': 1, 'heave': 2, 'yaw': 5}


@dataclass(frozen=True)
class Dive:
    """How a vehicle is, how it is driven and what is logged of it."""

    together: int = 2  # axes that the pilot pushes at a time
    held: bool = False  # depth and heading, while the pilot does not push them
    current: tuple[float, float] = (0.0, 0.0)  # [m/s]
    tether: float = 0.0  # [N] rms, that changes within 5 s
    off_diagonal: float = 0.0  # [kg m] of added mass, at most
    drag_of_speed: float = 0.0  # share of the quadratic drag that goes with the whole speed
    reverse: float = 1.0  # thrust backwards
    lag: float = 0.0  # [s] of the thrusters
    weaker: float = 0.0  # share of the thrust that is lost until the end
    late: float = 0.0  # [s] that fixes are stamped late


def dive(path: Path, given: Dive, seed: int, duration: float = 360.0) -> dict[str, float]:
    """Write the log of a vehicle that is drawn; return its masses [kg], of yaw [kg m^2]."""
    draw = np.random.default_rng(seed)
    vehicle = Vehicle(given, draw)
    messages = sorted(_messages(vehicle, given, draw, duration), key=lambda one: one[0])
    with LogWriter(path) as writer:
        for time, topic, kind, fields in messages:
            writer.write(topic, kind, fields, round((START + time) * 1e9))
    return {dof: float(vehicle.mass[k, k]) for dof, k in DOFS.items()}


class Vehicle:
    """Masses and drags, drawn at random."""

    def __init__(self, given: Dive, draw: np.random.Generator) -> None:
        dry, below = draw.uniform(11.0, 16.0), draw.uniform(0.01, 0.03)
        inertia = np.diag(draw.uniform([0.2, 0.25, 0.3], [0.35, 0.4, 0.5]))
        arm = _skew(np.array([0.0, 0.0, -below]))
        added = np.diag(draw.uniform([4.0, 10.0, 14.0, 0.1, 0.1, 0.1],
                                     [10.0, 22.0, 32.0, 0.3, 0.3, 0.4]))
        for row, column in ((0, 4), (1, 3), (1, 5)):
            added[row, column] = added[column, row] = given.off_diagonal * draw.uniform(-1.0, 1.0)
        self.mass = added + np.block([
            [dry * np.eye(3), -dry * arm], [dry * arm, inertia - dry * arm @ arm]])
        self._inverse = np.linalg.inv(self.mass)
        self._linear = draw.uniform([4.0, 4.0, 5.0, 0.1, 0.1, 0.05],
                                    [15.0, 20.0, 25.0, 0.4, 0.5, 0.4])
        self._quadratic = draw.uniform([40.0, 80.0, 90.0, 0.5, 0.5, 0.6],
                                       [150.0, 250.0, 250.0, 1.5, 1.5, 2.0])
        self._buoyancy = draw.uniform(-3.0, 3.0)
        self._centre, self._weight = np.array([0.0, 0.0, -below]), 9.81 * dry
        self._share = given.drag_of_speed
        self._current = np.array([*given.current, 0.0])

    def accelerations(self, velocity: Array, turn: Array, thrust: Array, pull: Array) -> Array:
        """
        Return how the six velocities over ground change.

        ``turn`` turns body axes into the world's, ``thrust`` is that of each thruster [N], and
        ``pull`` a force in the world [N].
        """
        drift = turn.T @ self._current
        through = velocity - np.concatenate([drift, np.zeros(3)])
        linear, rates = through[:3], through[3:]
        momentum = self.mass @ through
        coriolis = np.concatenate([
            _cross(rates, momentum[:3]),
            _cross(linear, momentum[:3]) + _cross(rates, momentum[3:])])
        speed = np.abs(through)
        speed[:3] += self._share * (np.linalg.norm(linear) - speed[:3])
        drag = (self._linear + self._quadratic * speed) * through
        up = turn[2]
        outside = np.concatenate([
            self._buoyancy * up + turn.T @ pull, _cross(self._centre, -self._weight * up)])
        change = self._inverse @ (ALLOCATION @ thrust - coriolis - drag + outside)
        change[:3] -= _cross(rates, drift)  # the current turns in body axes
        return np.asarray(change)


class Controller:
    """Keeps a vehicle level; holds depth and heading while nobody pushes these."""

    def __init__(self, holds: bool) -> None:
        self._holds, self._depth, self._heading = holds, 0.0, 0.0
        self._trim = 0.0  # [N]
        self._shares = np.linalg.pinv(ALLOCATION)
        self._commands = np.linspace(-1.0, 1.0, 4001)
        self._thrust = np.maximum.accumulate(_thrust_of(self._commands))

    def pulses(self, push: Array, height: float, turn: Array, velocity: Array) -> Array:
        """Return the pulses [us] for what a pilot pushes (surge, sway, heave, yaw)."""
        heading, up = math.atan2(turn[1, 0], turn[0, 0]), turn[2]
        wish = np.array([push[0], push[1], push[2],
                         -14.0 * math.atan2(up[1], up[2]) - 3.0 * velocity[3],
                         14.0 * math.atan2(up[0], up[2]) - 3.0 * velocity[4], push[3]])
        if not self._holds or push[2]:
            self._depth = height
        else:
            self._trim = min(max(self._trim + 0.2 * (self._depth - height), -15.0), 15.0)
            wish[2] = 60.0 * (self._depth - height) - 50.0 * (turn @ velocity[:3])[2] + self._trim
        if not self._holds or push[3]:
            self._heading = heading
        else:
            away = math.remainder(self._heading - heading, 2.0 * math.pi)
            wish[5] = 6.0 * away - 3.0 * velocity[5]
        forces = self._shares @ wish
        forces *= min(1.0, CEILING / max(float(np.abs(forces).max()), 1e-9))
        commands = np.interp(forces, self._thrust, self._commands)
        return np.asarray(np.round(1500.0 + 400.0 * commands))


def _thrust_of(command: Array) -> Array:
    """Return the thrust [N] of a T200, by the curve of the shipped configuration."""
    powers = (8.9, 176.0, -404.1, 389.9, -140.3)
    return np.asarray(sum(c * command ** (2 * k + 1) for k, c in enumerate(powers)))


def _pushes(together: int, draw: np.random.Generator) -> Iterator[Array]:
    """Yield what a pilot pushes at each step: some axes for 2 to 7 s, and now and then none."""
    while True:
        push = np.zeros(4)
        for k in draw.choice(4, together, replace=False) if draw.random() > 0.15 else ():
            push[k] = LARGEST[k] * draw.uniform(0.25, 1.0) * draw.choice((-1.0, 1.0))
        for _ in range(int(draw.uniform(2.0, 7.0) / STEP)):
            yield push


def _messages(vehicle: Vehicle, given: Dive, draw: np.random.Generator,
              duration: float) -> Iterator[tuple[float, str, str, dict[str, Any]]]:
    """Yield time of receipt [s], topic, type and fields."""
    pilot, controller = _pushes(given.together, draw), Controller(given.held)
    attitude, place, velocity = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), np.zeros(6)
    thrust, pull = np.zeros(8), np.zeros(3)
    for k in range(int(duration / STEP)):
        time, turn = k * STEP, _turn(attitude)
        pulses = controller.pulses(next(pilot), float(place[2]), turn, velocity)
        commands = np.where(np.abs(pulses - 1500.0) < 25.0, 0.0, (pulses - 1500.0) / 400.0)
        wanted = _thrust_of(commands) * (1.0 - given.weaker * time / duration)
        wanted = np.where(wanted < 0.0, given.reverse * wanted, wanted)
        thrust = thrust + (wanted - thrust) * (
            -math.expm1(-STEP / given.lag) if given.lag else 1.0)
        pull = pull * math.exp(-STEP / 5.0) + given.tether * math.sqrt(
            -math.expm1(-2.0 * STEP / 5.0)) * draw.standard_normal(3)
        half = velocity + 0.5 * STEP * vehicle.accelerations(velocity, turn, thrust, pull)
        place = place + STEP * turn @ half[:3]
        attitude = _product(attitude, np.array([*(0.5 * STEP * half[3:]), 1.0]))
        velocity = velocity + STEP * vehicle.accelerations(half, turn, thrust, pull)
        if k % 2 == 0:
            yield time, '/mavros/rc/out', 'mavros_msgs/msg/RCOut', {
                **_header(time), 'channels': np.array([*pulses, *[1500] * 8], np.uint16)}
            seen = _product(attitude, np.array([*(0.00125 * draw.standard_normal(3)), 1.0]))
            yield time + STEP + 0.01, '/mavros/imu/data', 'sensor_msgs/msg/Imu', {
                **_header(time + STEP), 'orientation': _named('xyzw', seen),
                'angular_velocity': _named('xyz', velocity[3:]),
                'linear_acceleration': _named('xyz', np.zeros(3))}
        if k % 5 == 0:
            fix = place + 0.006 * draw.standard_normal(3)
            stamp = time + STEP + given.late
            yield stamp + 0.005, '/mavros/local_position/pose', 'geometry_msgs/msg/PoseStamped', {
                **_header(stamp), 'pose': {'position': _named('xyz', fix),
                                           'orientation': _named('xyzw', attitude)}}


def _header(time: float) -> dict[str, Any]:
    stamp = round((START + time) * 1e9)
    return {'header': {'stamp': {'sec': stamp // 10**9, 'nanosec': stamp % 10**9},
                       'frame_id': ''}}


def _named(names: str, values: Array) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values)}


def _cross(one: Array, other: Array) -> Array:
    """Return the cross product, to the bit that of numpy, which takes many times as long."""
    (a, b, c), (x, y, z) = one.tolist(), other.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def _skew(a: Array) -> Array:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _turn(q: Array) -> Array:
    """Return the matrix of a quaternion x, y, z, w."""
    axis = _skew(q[:3])
    return np.asarray(np.eye(3) + 2.0 * q[3] * axis + 2.0 * axis @ axis)


def _product(one: Array, other: Array) -> Array:
    """Return the product of two quaternions, as long as 1."""
    product = np.concatenate([
        one[3] * other[:3] + other[3] * one[:3] + _cross(one[:3], other[:3]),
        [one[3] * other[3] - one[:3] @ other[:3]]])
    return np.asarray(product / np.linalg.norm(product))
