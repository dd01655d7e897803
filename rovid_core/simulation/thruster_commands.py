"""Thruster commands that give the thrust of a profile, as far as the thrusters can."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.dofs import DOFS
from rovid_core.settings.run import SettingsError, ThrusterSettings
from rovid_core.simulation.profiles import Profile
from rovid_core.thrust.thruster_curve import thruster_model, wrench


class ThrusterCommands:
    """
    Raw thruster commands that give a profile of body forces.

    A DOF with no waveforms gets no force, if the thrusters can move the others without it.

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

    def asked(self, t: float) -> tuple[float, ...]:
        """Return the profile's force [N or N m] on each of ``dofs`` at ``t`` [s]."""
        return tuple([math.fsum([w.at(t) for w in waveforms]) for waveforms in self._waveforms])

    def thrusters(self, t: float) -> list[float]:
        """Return what is asked of each thruster at ``t`` [s], before its gain."""
        if not self.dofs:
            return [0.0] * self._settings.count
        forces = self._inverse @ np.array(self.asked(t))
        return [float(f) / k if k else 0.0 for f, k in zip(forces, self._settings.gain)]

    def at(self, t: float) -> tuple[float, ...]:
        """Return the raw commands at ``t`` [s]."""
        return tuple([self._command(f) for f in self.thrusters(t)])


def _inverse_allocation(settings: ThrusterSettings, moved: Sequence[str],
                        still: Sequence[str]) -> NDArray[np.float64]:
    """Return the smallest thruster forces, shape (n, moved), that push only what is moved."""
    def rows(dofs: Sequence[str]) -> NDArray[np.float64]:
        found = np.array([settings.allocation[DOFS.index(d)] for d in dofs])
        working = [float(k != 0.0) for k in settings.gain]
        return np.asarray(found.reshape(len(dofs), settings.count) * working)

    pushed = rows(moved)
    if moved and np.linalg.matrix_rank(pushed) < len(moved):
        raise SettingsError(
            'thrusters.allocation', f'can not push {", ".join(moved)} independently')
    inverse = np.linalg.pinv(pushed)
    free = np.eye(settings.count) - inverse @ pushed  # what pushes none of the moved
    against = rows(still) @ free
    against[abs(against) < 1e-9] = 0.0  # rounding is no means of pushing
    return np.asarray(inverse - free @ np.linalg.pinv(against) @ rows(still) @ inverse)


def _inverse_model(
        settings: ThrusterSettings) -> tuple[Callable[[float], float], float, float]:
    """Return the raw command for a thruster force before its gain, and that force's limits."""
    most = settings.limit or math.inf
    offset, scale = settings.offset, settings.scale
    if settings.model == 'linear':
        return (lambda f: max(-most, min(most, f)) / scale + offset, -most, most)
    if settings.model == 'quadratic':
        return (lambda f: max(-most, min(most, math.copysign(math.sqrt(abs(f)), f))) / scale
                + offset, -most * most, most * most)
    ends = settings.limit or 1.0
    commands = (np.linspace(-ends, ends, 2001) if settings.model == 'polynomial'
                else np.array(settings.table_command))
    raw = commands / scale + offset
    model = thruster_model(settings)
    forces = np.array([model(float(u)) for u in raw])
    # a fitted curve can bend back at its ends, where no more force is to be had
    rising = slice(int(np.argmin(forces)), int(np.argmax(forces)) + 1)
    raw, forces = raw[rising], forces[rising]
    if len(forces) < 2 or np.any(np.diff(forces) < 0.0):
        raise SettingsError('thrusters.model', 'has to rise with the command to be simulated')
    return (lambda f: float(np.interp(f, forces, raw)), float(forces[0]), float(forces[-1]))


MOST_LOOKED = 20_000
"""Commands of a profile that are compared with what the thrusters can give; of more, some."""


@dataclass(frozen=True)
class Shortfall:
    """The moment when the thrusters stay furthest behind a profile."""

    dof: str
    time: float  # [s]
    asked: float  # [N or N m]
    given: float  # [N or N m]
    share: float  # of the time that a thruster is at its limit, 0 to 1


def shortfall(settings: ThrusterSettings, profile: Profile, rate: float,
              duration: float) -> Shortfall | None:
    """
    Find where the thrusters cannot give a profile, because their curve ends.

    Parameters
    ----------
    settings : ThrusterSettings
        The thrusters; a linear or quadratic model has no end.
    profile : mapping
        What is asked of them.
    rate, duration : float
        Of the commands [Hz], and of the trial [s].

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
    moments = range(0, count, math.ceil(count / MOST_LOOKED))
    worst: tuple[float, str, float, float, float] | None = None
    slack = 1e-9 * max(abs(low), abs(high))  # what rounding takes
    for i in moments:
        t = i / rate
        if all(low - slack <= f <= high + slack for f in commands.thrusters(t)):
            continue
        limited += 1
        given = wrench(settings, commands.at(t), commands.dofs)
        for dof, wanted, got in zip(commands.dofs, commands.asked(t), given):
            if worst is None or abs(wanted - got) > worst[0]:
                worst = (abs(wanted - got), dof, t, wanted, got)
    return Shortfall(*worst[1:], limited / len(moments)) if worst else None
