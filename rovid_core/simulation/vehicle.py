"""A simulated vehicle: the plant of eq. 2 in six DOFs, and thrusters that follow a profile."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from rovid_core.model.dofs import DOFS, Quaternion, Vector
from rovid_core.model.plant import advance, Array, lumped
from rovid_core.model.samples import NS
from rovid_core.settings.run import Settings, SettingsError, SimulatedDof, ThrusterSettings
from rovid_core.simulation.coupled_plant import CoupledPlant, is_coupled, Water
from rovid_core.simulation.profiles import Profile, Sinusoid, Waveform
from rovid_core.thrust.force_history import ForceHistory
from rovid_core.thrust.thruster_curve import thruster_model, wrench
from rovid_core.velocity.attitude_history import product, rotate, rotate_back

MAX_STEP = 5_000_000
"""Longest integration step [ns]; the mean force of a step is exact."""


class Vehicle:
    """Position, attitude and body velocity, over ground, under commanded thrust."""

    def __init__(self, settings: Settings, profile: Profile | None,
                 random: np.random.Generator, whole: bool = False) -> None:
        truth = settings.simulation.dofs
        for dof in settings.dofs:
            if dof not in truth:
                raise SettingsError(f'simulation.{dof}.mass', 'is required to simulate')
        self._coupled = CoupledPlant(settings, random) if is_coupled(settings) else None
        self._water = Water(settings.simulation)
        self._dofs = tuple(d for d in DOFS if d in truth)
        self._parameters = [
            lumped(t.mass, t.quadratic_drag, t.linear_drag, t.bias)
            for t in (truth[d] for d in self._dofs)]
        # all commands are given at once, on however many topics they are published
        self._forces = ForceHistory(replace(
            settings.thrusters, timeout=0.0, topics=settings.thrusters.topics[:1]), self._dofs)
        self._commands = ThrusterCommands(
            settings.thrusters, profile_of(truth, profile))
        self._whole = whole
        self.velocity = [0.0] * 6
        self.position: Vector = (0.0, 0.0, 0.0)
        self.attitude: Quaternion = (0.0, 0.0, 0.0, 1.0)
        self.time = 0

    def command(self, time: int) -> tuple[float, ...]:
        """Command the profile's thrust at ``time`` [ns] and return the raw commands."""
        raw = self._commands.at(time * NS)
        if self._whole:  # the thrusters hear what is sent
            raw = tuple([float(round(one)) for one in raw])
        self._forces.add_commands(time, raw)
        return raw

    def advance(self, time: int) -> None:
        """Move on to ``time`` [ns]."""
        while self.time < time:
            step = min(MAX_STEP, time - self.time)
            dt = step * NS
            force = self._force(self.time, self.time + step)
            if self._coupled is not None:
                self._advance_coupled(self._coupled, force, dt)
            else:
                self._advance_decoupled(force, dt)
            self.time += step
        self._forces.forget(self.time)

    @property
    def through_water(self) -> list[float]:
        """Return the body velocity relative to the water [m/s, rad/s]."""
        return self.velocity if self._coupled is None else self._coupled.velocity

    def _advance_decoupled(self, force: Sequence[float], dt: float) -> None:
        before = list(self.velocity)
        for dof, parameters, f in zip(self._dofs, self._parameters, force):
            i = DOFS.index(dof)
            self.velocity[i] = advance(parameters, before[i], f, dt)
        self._move([0.5 * (a + b) for a, b in zip(before, self.velocity)], dt)

    def _advance_coupled(self, plant: CoupledPlant, force: Sequence[float], dt: float) -> None:
        self._move(plant.advance(self.attitude, force, dt), dt)
        x, y, z = self.position
        now = self.time * NS
        cx, cy = self._water.at(now + 0.5 * dt)
        self.position = (x + cx * dt, y + cy * dt, z)
        drift = rotate_back(self.attitude, (*self._water.at(now + dt), 0.0))
        self.velocity = [a + b for a, b in zip(plant.velocity, (*drift, 0.0, 0.0, 0.0))]

    def _force(self, start: int, end: int) -> tuple[float, ...]:
        if self._forces.missing(start, end):
            return (0.0,) * len(self._dofs)
        a, b = self._forces.integrals((start, end))
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


def profile_of(truth: Mapping[str, SimulatedDof], given: Profile | None = None) -> Profile:
    """
    Return the thrust profile of a trial.

    Parameters
    ----------
    truth : mapping
        The simulated DOFs with the sinusoids of the settings.
    given : mapping, optional
        Waveforms that replace those of some DOFs.

    Raises
    ------
    SettingsError
        If thrust is given for a DOF that is not simulated.

    """
    for dof, waveforms in (given or {}).items():
        if dof not in truth and waveforms:
            raise SettingsError(f'simulation.{dof}.mass', 'is required to simulate')
    profile: dict[str, tuple[Waveform, ...]] = {
        # 0 Hz means no thrust
        dof: tuple([Sinusoid(f, hz) for f, hz in zip(true.forces, true.frequencies) if hz])
        for dof, true in truth.items()}
    return {**profile, **(given or {})}


class ThrusterCommands:
    """
    Raw thruster commands that give a profile of body forces.

    A DOF without waveforms gets no force if the thrusters can move the others without it.

    Raises
    ------
    SettingsError
        If the thrusters cannot push the DOFs of the profile independently.

    """

    def __init__(self, settings: ThrusterSettings, profile: Profile) -> None:
        self._settings = settings
        self.dofs = tuple(d for d in DOFS if profile.get(d))
        self._waveforms = [profile[d] for d in self.dofs]
        still = tuple(d for d in DOFS if d in profile and d not in self.dofs)
        self._inverse = _inverse_allocation(settings, self.dofs, still)
        self._command, *self.limits = _inverse_model(settings)

    def forces(self, t: float) -> tuple[float, ...]:
        """Return the profile's force [N or N m] on each of ``dofs`` at ``t`` [s]."""
        return tuple([math.fsum([w.at(t) for w in waveforms]) for waveforms in self._waveforms])

    def thruster_forces(self, t: float) -> list[float]:
        """Return the force wanted of each thruster at ``t`` [s], before its gain."""
        if not self.dofs:
            return [0.0] * self._settings.count
        forces = self._inverse @ np.array(self.forces(t))
        return [float(f) / abs(k) if k else 0.0 for f, k in zip(forces, self._settings.gain)]

    def at(self, t: float) -> tuple[float, ...]:
        """Return the raw commands at ``t`` [s]."""
        raw = [self._command(f) for f in self.thruster_forces(t)]
        twice = 2.0 * self._settings.offset
        return tuple([u if k >= 0.0 else twice - u for u, k in zip(raw, self._settings.gain)])


def _inverse_allocation(settings: ThrusterSettings, moved: Sequence[str],
                        still: Sequence[str]) -> Array:
    """Return the smallest thruster forces, shape (n, moved), that push only those DOFs."""
    def allocation(dofs: Sequence[str]) -> Array:
        found = np.array([settings.allocation[DOFS.index(d)] for d in dofs])
        working = [float(k != 0.0) for k in settings.gain]
        return np.asarray(found.reshape(len(dofs), settings.count) * working)

    pushed = allocation(moved)
    if moved and np.linalg.matrix_rank(pushed) < len(moved):
        raise SettingsError(
            'thrusters.allocation', f'can not push {", ".join(moved)} independently')
    inverse = np.linalg.pinv(pushed)
    free = np.eye(settings.count) - inverse @ pushed  # forces that push none of the moved
    against = allocation(still) @ free
    against[abs(against) < 1e-9] = 0.0  # rounding errors
    return np.asarray(inverse - free @ np.linalg.pinv(against) @ allocation(still) @ inverse)


_NOTHING = 1e-9  # [N] is what a force of 0 is after the allocation


def _inverse_model(
        settings: ThrusterSettings) -> tuple[Callable[[float], float], float, float]:
    """Return the raw command for a thruster force before its gain, and that force's limits."""
    limit, reverse = settings.limit or math.inf, settings.reverse
    offset, scale, lost = settings.offset, settings.scale, settings.dead_zone
    if settings.model in ('linear', 'quadratic'):
        root = 1.0 if settings.model == 'linear' else 0.5

        def command(f: float) -> float:
            if f == 0.0 or f < 0.0 and reverse == 0.0:
                return offset
            size = abs(f if f > 0.0 else f / reverse)**root + lost
            return math.copysign(min(limit, size), f) / scale + offset

        most = max(limit - lost, 0.0)**(1.0 / root)
        return command, -reverse * most, most
    is_table = settings.model == 'table'
    ends = lost + max(map(abs, settings.table_command)) if is_table else settings.limit or 1.0
    commands = (np.array(settings.table_command) if is_table and not lost
                else np.linspace(-ends, ends, 2001))
    raw = commands / scale + offset
    model = thruster_model(settings)
    forces = np.array([model(float(u)) for u in raw])
    # a fitted curve can bend back at its ends; beyond them there is no more force
    rising = slice(int(np.argmin(forces)), int(np.argmax(forces)) + 1)
    raw, forces = raw[rising], forces[rising]
    if len(forces) < 2 or np.any(np.diff(forces) < 0.0):
        raise SettingsError('thrusters.model', 'has to rise with the command to be simulated')
    # in a dead-band many commands give no force; what is sent then is the neutral one
    least = 1e-9 * float(max(abs(forces))) if model(offset) == 0.0 else -1.0
    return (lambda f: offset if abs(f) <= least else float(np.interp(f, forces, raw)),
            float(forces[0]), float(forces[-1]))


MAX_CHECKED = 20_000
"""Largest number of commands of a profile that are checked; of a longer one, evenly spaced."""


@dataclass(frozen=True)
class Shortfall:
    """The moment at which the thrusters fall short of a profile most."""

    dof: str
    time: float  # [s]
    asked: float  # [N or N m]
    given: float  # [N or N m]
    share: float  # of the time that a thruster is at its limit, 0 to 1


def shortfall(settings: ThrusterSettings, profile: Profile, rate: float,
              duration: float) -> Shortfall | None:
    """
    Find where the thrusters cannot give a profile because their curve ends.

    Parameters
    ----------
    settings : ThrusterSettings
        The thrusters; a linear or quadratic model has no end.
    profile : mapping
        The wanted thrust.
    rate, duration : float
        Rate of the commands [Hz] and length of the trial [s].

    Returns
    -------
    Shortfall or None
        None if the thrusters can give all of it.

    Raises
    ------
    SettingsError
        If the thrusters cannot push the DOFs of the profile independently.

    """
    commands = ThrusterCommands(settings, profile)
    low, high = commands.limits
    if math.isinf(low):
        return None
    count, limited = math.floor(duration * rate) + 1, 0
    moments = range(0, count, math.ceil(count / MAX_CHECKED))
    worst: tuple[float, str, float, float, float] | None = None
    slack = 1e-9 * max(abs(low), abs(high))  # for rounding
    for i in moments:
        t = i / rate
        if all(low - slack <= f <= high + slack for f in commands.thruster_forces(t)):
            continue
        limited += 1
        given = wrench(settings, commands.at(t), commands.dofs)
        for dof, wanted, got in zip(commands.dofs, commands.forces(t), given):
            if worst is None or abs(wanted - got) > worst[0]:
                worst = (abs(wanted - got), dof, t, wanted, got)
    return Shortfall(*worst[1:], limited / len(moments)) if worst else None
