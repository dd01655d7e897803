"""A simulated vehicle with its sensors: the plant of eq. 2, thrusters, noise and stamps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from heapq import heappop, heappush
import math

import numpy as np
from rovid_core.model.dofs import ANGULAR_DOFS, DOFS, LINEAR_DOFS, Quaternion, Vector
from rovid_core.model.plant import advance, lumped
from rovid_core.settings.run import Settings, SettingsError, SimulatedDof
from rovid_core.simulation.profiles import Profile, Sinusoid, Waveform
from rovid_core.simulation.thruster_commands import ThrusterCommands
from rovid_core.thrust.force_history import Thrust
from rovid_core.velocity.quaternions import product, rotate

NS = 1e-9
STEP = 5_000_000
"""[ns] Longest integration step; the mean force of a step is exact."""

Measurement = tuple[int, str, tuple[float, ...]]

# the sensors of a vehicle do not fire together: [ns] of the first sample of each
PHASE = {'thrusters': 0, 'attitude': 3_000_000, 'angular_velocity': 5_000_000,
         'depth': 7_000_000, 'position': 11_000_000, 'velocity': 13_000_000,
         'reference': 17_000_000}


def simulate(settings: Settings, duration: float, seed: int,
             profile: Profile | None = None) -> Iterator[Measurement]:
    """
    Simulate the vehicle under ``settings.simulation`` and its configured sensors.

    Parameters
    ----------
    settings : Settings
        The run; only inputs with a topic are measured.
    duration : float
        [s]
    seed : int
        Of the sensor noise; the same seed gives the same values.
    profile : mapping, optional
        Thrust per DOF; the others have that of the settings.

    Yields
    ------
    time : int
        [ns] from 0, never decreasing.
    input : str
        Name of the input.
    value : tuple of float
        As in ``Sample``; thrusters: the raw command of every thruster.

    Raises
    ------
    SettingsError
        If there is no truth for a DOF, or the thrusters can not give the profile.

    """
    vehicle = _Vehicle(settings, profile)
    sensors = _Sensors(settings, vehicle, np.random.default_rng(seed))
    queue: list[tuple[int, int, tuple[str, ...], int]] = []
    for order, (names, rate) in enumerate(sensors.rates().items()):
        heappush(queue, (PHASE[names[0]], order, names, round(1e9 / rate)))
    end = round(duration / NS)
    while queue[0][0] <= end:
        time, order, names, period = heappop(queue)
        vehicle.advance(time)
        for name in names:
            yield time, name, sensors.read(name, time)
        heappush(queue, (time + period, order, names, period))


def profile_of(truth: Mapping[str, SimulatedDof], given: Profile | None = None) -> Profile:
    """
    Return the profile of a trial.

    Parameters
    ----------
    truth : mapping
        The simulated DOFs, with the sinusoids of the settings.
    given : mapping, optional
        Waveforms of some DOFs, instead of those.

    Raises
    ------
    SettingsError
        If a DOF that is not simulated is to move.

    """
    for dof, waveforms in (given or {}).items():
        if dof not in truth and waveforms:
            raise SettingsError(f'simulation.{dof}.mass', 'is required to simulate')
    profile: dict[str, tuple[Waveform, ...]] = {
        # 0 Hz is no thrust
        dof: tuple([Sinusoid(f, hz) for f, hz in zip(true.forces, true.frequencies) if hz])
        for dof, true in truth.items()}
    return {**profile, **(given or {})}


class _Vehicle:
    """Position, attitude and body velocity under commanded thrust."""

    def __init__(self, settings: Settings, profile: Profile | None) -> None:
        truth = settings.simulation.dofs
        for dof in settings.dofs:
            if dof not in truth:
                raise SettingsError(f'simulation.{dof}.mass', 'is required to simulate')
        self._dofs = tuple(d for d in DOFS if d in truth)
        self._parameters = [
            lumped(t.mass, t.quadratic_drag, t.linear_drag, t.bias)
            for t in (truth[d] for d in self._dofs)]
        # however many topics the commands come on, they are given all at once
        self._thrust = Thrust(replace(
            settings.thrusters, timeout=0.0, topics=settings.thrusters.topics[:1]), self._dofs)
        self._commands = ThrusterCommands(
            settings.thrusters, profile_of(truth, profile))
        self.velocity = [0.0] * 6
        self.position: Vector = (0.0, 0.0, 0.0)
        self.attitude: Quaternion = (0.0, 0.0, 0.0, 1.0)
        self.time = 0

    def command(self, time: int) -> tuple[float, ...]:
        """Command the profile's thrust at ``time`` [ns] and return the raw commands."""
        raw = self._commands.at(time * NS)
        self._thrust.command(time, raw)
        return raw

    def advance(self, time: int) -> None:
        """Move on to ``time`` [ns]."""
        while self.time < time:
            step = min(STEP, time - self.time)
            dt = step * NS
            before = list(self.velocity)
            force = self._force(self.time, self.time + step)
            for dof, parameters, f in zip(self._dofs, self._parameters, force):
                i = DOFS.index(dof)
                self.velocity[i] = advance(parameters, before[i], f, dt)
            mean = [0.5 * (a + b) for a, b in zip(before, self.velocity)]
            self._move(mean, dt)
            self.time += step
        self._thrust.forget(self.time)

    def _force(self, start: int, end: int) -> tuple[float, ...]:
        if self._thrust.missing(start, end):
            return (0.0,) * len(self._dofs)
        a, b = self._thrust.impulses((start, end), range(len(self._dofs)))
        dt = (end - start) * NS
        return tuple([(y - x) / dt for x, y in zip(a, b)])

    def _move(self, mean: Sequence[float], dt: float) -> None:
        u, v, w, p, q, r = mean
        turn = math.sqrt(p * p + q * q + r * r)
        middle = end = self.attitude
        if turn:
            half = 0.5 * turn * dt
            for angle in (0.5 * half, half):
                s = math.sin(angle) / turn
                middle, end = end, product(
                    self.attitude, (p * s, q * s, r * s, math.cos(angle)))
        shift = rotate(middle, (u * dt, v * dt, w * dt))
        x, y, z = self.position
        self.position = (x + shift[0], y + shift[1], z + shift[2])
        self.attitude = end


class _Sensors:
    """What the configured sensors read off the vehicle."""

    def __init__(self, settings: Settings, vehicle: _Vehicle,
                 random: np.random.Generator) -> None:
        self._settings = settings
        self._vehicle = vehicle
        self._normal = _normal(random)

    def rates(self) -> dict[tuple[str, ...], float]:
        """Return the inputs of each topic with their rate [Hz], that of the slowest."""
        s = self._settings.simulation
        rates = {
            'thrusters': s.thruster_rate, 'attitude': s.attitude_rate,
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
            return self._noisy(v.command(time), s.thruster_noise)
        if name == 'position':
            arm = rotate(v.attitude, self._settings.lever_arm)
            x, y, z = v.position
            return self._noisy((x + arm[0], y + arm[1], z + arm[2]), s.position_noise)
        if name == 'depth':
            return self._noisy(v.position[2:], s.depth_noise)
        if name == 'attitude':
            half = self._noisy((0.0, 0.0, 0.0), 0.5 * s.attitude_noise)
            w = math.sqrt(max(0.0, 1.0 - math.fsum(x * x for x in half)))
            return product(v.attitude, (half[0], half[1], half[2], w))
        if name == 'velocity':
            return self._noisy(v.velocity[:len(LINEAR_DOFS)], s.velocity_noise)
        if name == 'angular_velocity':
            return self._noisy(v.velocity[-len(ANGULAR_DOFS):], s.angular_velocity_noise)
        return tuple(v.velocity)

    def _noisy(self, values: Sequence[float], sigma: float) -> tuple[float, ...]:
        if sigma == 0.0:
            return tuple(values)
        return tuple([x + sigma * noise for x, noise in zip(values, self._normal)])


def _normal(random: np.random.Generator) -> Iterator[float]:
    """Yield standard normal numbers; many at once are drawn ten times as fast."""
    while True:
        yield from random.standard_normal(4096).tolist()
