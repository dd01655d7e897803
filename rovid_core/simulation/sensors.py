"""What the sensors of a simulated vehicle measure: rates, noise and stamps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from heapq import heappop, heappush
import math

import numpy as np
from rovid_core.model.dofs import ANGULAR_DOFS, LINEAR_DOFS
from rovid_core.settings.run import Settings
from rovid_core.simulation.profiles import Profile
from rovid_core.simulation.vehicle import Vehicle
from rovid_core.velocity.attitude_history import cross, product, rotate

Measurement = tuple[int, str, tuple[float, ...]]

FIRST_SAMPLE = {'thrusters': 0, 'sign': 0, 'attitude': 3_000_000, 'angular_velocity': 5_000_000,
         'depth': 7_000_000, 'position': 11_000_000, 'velocity': 13_000_000,
         'reference': 17_000_000}
"""Time of each sensor's first sample [ns]; the sensors of a vehicle are not synchronous."""


def simulate(settings: Settings, duration: float, seed: int,
             profile: Profile | None = None, whole: bool = False) -> Iterator[Measurement]:
    """
    Simulate the vehicle under ``settings.simulation`` and its configured sensors.

    Parameters
    ----------
    settings : Settings
        Of the run; only inputs with a topic are measured.
    duration : float
        [s]
    seed : int
        Seed of the sensor noise; the same seed gives the same values.
    profile : mapping, optional
        Thrust per DOF; the other DOFs have the thrust of the settings.
    whole : bool
        Whether commands are whole numbers, as in a message of integers.

    Yields
    ------
    time : int
        [ns] from 0, never decreasing.
    input : str
        Name of the input.
    value : tuple of float
        As in ``Sample``; for thrusters the raw command of every thruster.

    Raises
    ------
    SettingsError
        If a DOF has no true parameters, or the thrusters can not give the profile.

    """
    # two generators, so that the same seed gives the same noise whatever the vehicle is
    vehicle = Vehicle(settings, profile, np.random.default_rng((seed, 1)), whole)
    sensors = _Sensors(settings, vehicle, np.random.default_rng(seed))
    queue: list[tuple[int, int, tuple[str, ...], int]] = []
    for order, (names, rate) in enumerate(sensors.rates().items()):
        heappush(queue, (FIRST_SAMPLE[names[0]], order, names, round(1e9 / rate)))
    end = round(duration / 1e-9)
    while queue[0][0] <= end:
        time, order, names, period = heappop(queue)
        vehicle.advance(time)
        for name in names:
            yield time, name, sensors.read(name, time)
        heappush(queue, (time + period, order, names, period))


class _Sensors:
    """The configured sensors of a vehicle."""

    def __init__(self, settings: Settings, vehicle: Vehicle,
                 random: np.random.Generator) -> None:
        self._settings = settings
        self._vehicle = vehicle
        self._normal = _normal(random)

    def rates(self) -> dict[tuple[str, ...], float]:
        """Return the inputs of each topic with the rate [Hz] of the slowest of them."""
        s = self._settings.simulation
        rates = {
            'thrusters': s.thruster_rate, 'sign': s.thruster_rate, 'attitude': s.attitude_rate,
            'angular_velocity': s.angular_velocity_rate, 'depth': s.depth_rate,
            'position': s.position_rate, 'velocity': s.velocity_rate,
            'reference': s.velocity_rate}
        topics: dict[str, list[str]] = {}
        for name in rates:
            if name == 'thrusters':
                topics.setdefault(self._settings.thrusters.topics[0], []).append(name)
            elif name in self._settings.used_inputs():
                topics.setdefault(self._settings.input(name).topic, []).append(name)
        return {tuple(names): min(rates[name] for name in names) for names in topics.values()}

    def read(self, name: str, time: int) -> tuple[float, ...]:
        """Return one measurement."""
        s, v = self._settings.simulation, self._vehicle
        if name == 'thrusters':
            return self._noisy(self._as_told(v.command(time)), s.thruster_noise)
        if name == 'sign':
            offset = self._settings.thrusters.offset
            return tuple([math.copysign(1.0, u - offset) for u in v.command(time)])
        if name == 'position':
            arm = rotate(v.attitude, self._settings.position.lever_arm)
            x, y, z = v.position
            return self._noisy((x + arm[0], y + arm[1], z + arm[2]), s.position_noise)
        if name == 'depth':
            return self._noisy(v.position[2:], s.depth_noise)
        if name == 'attitude':
            half = self._noisy((0.0, 0.0, 0.0), 0.5 * s.attitude_noise)
            w = math.sqrt(max(0.0, 1.0 - math.fsum(x * x for x in half)))
            return product(v.attitude, (half[0], half[1], half[2], w))
        if name == 'velocity':
            velocity = (v.through_water if self._settings.relative_to == 'water'
                        else v.velocity)
            linear, arm = velocity[:len(LINEAR_DOFS)], self._settings.velocity.lever_arm
            if any(arm):
                p, q, r = v.velocity[-len(ANGULAR_DOFS):]
                linear = [a + b for a, b in zip(linear, cross((p, q, r), arm))]
            return self._noisy(linear, s.velocity_noise)
        if name == 'angular_velocity':
            return self._noisy(v.velocity[-len(ANGULAR_DOFS):], s.angular_velocity_noise)
        return tuple(v.velocity)

    def _as_told(self, commands: tuple[float, ...]) -> tuple[float, ...]:
        """Return commands without the direction that another input says."""
        if not self._settings.sign.topic:
            return commands
        offset = self._settings.thrusters.offset
        return tuple([offset + abs(u - offset) for u in commands])

    def _noisy(self, values: Sequence[float], sigma: float) -> tuple[float, ...]:
        if sigma == 0.0:
            return tuple(values)
        return tuple([x + sigma * noise for x, noise in zip(values, self._normal)])


def _normal(random: np.random.Generator) -> Iterator[float]:
    """Yield standard normal numbers, drawn in blocks, which is ten times as fast."""
    while True:
        yield from random.standard_normal(4096).tolist()
