"""``rovid plan``: the thrust profile to drive next, within what there is room for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from rovid_core.dofs import DOFS, Four, LINEAR_DOFS, PARAMETERS
from rovid_core.identifier import Scales
from rovid_core.planning import fleet
from rovid_core.planning.plan import Plan, plan, STEP
from rovid_core.planning.prospect import Limits, PlanError, samples, Sensor, times, Vehicles
from rovid_core.plant import lumped
from rovid_core.profile import Profile, Steps, Waveform
from rovid_core.settings import Settings
from rovid_core.thruster_commands import ThrusterCommands
from rovid_ros.command import CommandError, UsageError
from rovid_ros.estimates import Identified
from rovid_ros.progress import Progress
from rovid_ros.report import number

LONGEST = 3600.0
"""[s] A longer trial tells the same again: repeat the profile."""

SHORTEST = 10.0
"""[s] Of a trial that tells anything."""


@dataclass(frozen=True)
class Asked:
    """
    What the command line asks for.

    ``max_force``, ``max_speed`` and ``room`` are by DOF; under '' for all linear DOFs.
    """

    dofs: tuple[str, ...]
    duration: float
    max_force: Mapping[str, float]
    max_speed: Mapping[str, float]
    room: Mapping[str, float]
    factor: float


@dataclass(frozen=True)
class Proposal:
    """The plans by DOF, what each model is from, all profiles together, and warnings."""

    asked: Asked
    plans: Mapping[str, Plan]
    sources: Mapping[str, str]
    profile: Profile
    warnings: tuple[str, ...]


def propose(settings: Settings, models: Sequence[Identified], asked: Asked) -> Proposal:
    """
    Plan a profile for each DOF that is asked for; the others get no thrust.

    Parameters
    ----------
    settings : Settings
        The vehicle, its sensors, and the initial values for DOFs that have no model.
    models : sequence of Identified
        What was identified so far.
    asked : Asked
        What the command line asks for.

    Raises
    ------
    CommandError, UsageError, SettingsError
        If the DOFs, the limits or the thrusters do not allow it.

    """
    dofs = _dofs(settings, asked)
    limits = _within_thrusters(
        settings, {dof: _limits(settings, asked, dof) for dof in dofs})
    known = {model.dof: model for model in models}
    plans: dict[str, Plan] = {}
    sources: dict[str, str] = {}
    warnings: list[str] = []
    with Progress('plan', lambda: len(plans) / len(dofs)) as progress:
        for dof in dofs:
            parameters, sources[dof] = _model(settings, known.get(dof), dof)
            scales = Scales.of(settings.dof[dof])
            clipped = (parameters[0], min(parameters[1], 0.0), min(parameters[2], 0.0),
                       parameters[3])
            if clipped != parameters:
                warnings.append(f'{dof}: the model has a drag below 0, which is taken as 0')
            vehicles = Vehicles.around(clipped, scales.active, asked.factor)
            try:
                plans[dof] = plan(vehicles, Sensor.of(settings, dof), limits[dof])
            except PlanError as error:
                raise CommandError(f'{dof}: --{str(error).replace("_", "-", 1)}') from None
            progress.tick()
    still = [d for d in DOFS if d not in dofs and (
        d in settings.dofs or d in settings.simulation.dofs)]
    profile: dict[str, tuple[Waveform, ...]] = dict.fromkeys(still, ())
    profile.update({dof: own.planned.waveforms for dof, own in plans.items()})
    return Proposal(replace(asked, dofs=dofs), plans, sources, profile,
                    (*warnings, *_turning(plans)))


def _dofs(settings: Settings, asked: Asked) -> tuple[str, ...]:
    """Return the DOFs to plan, once what is asked for has been checked."""
    for dof in asked.dofs:
        if dof not in settings.dofs:
            raise CommandError(f'--dofs: {dof} is not configured: dofs has '
                               f'{", ".join(settings.dofs)}')
    dofs = tuple(d for d in DOFS if d in (asked.dofs or settings.dofs))
    for option in ('max_force', 'max_speed', 'room'):
        for dof in getattr(asked, option):
            name = f'--{option.replace("_", "-")}'
            if dof and dof not in dofs:
                raise UsageError(f'{name}: {dof} is not planned; planned: {", ".join(dofs)}')
            if not dof and not set(dofs) & set(LINEAR_DOFS):
                raise UsageError(f'{name}: a number alone is for surge, sway and heave; takes '
                                 f'{dofs[0]}=NUMBER')
    if not SHORTEST <= asked.duration <= LONGEST:
        raise UsageError(f'--duration: got {asked.duration:g}, takes {SHORTEST:g} to '
                         f'{LONGEST:g} s')
    return dofs


def _limits(settings: Settings, asked: Asked, dof: str) -> Limits:
    def given(values: Mapping[str, float], default: float) -> float:
        return values.get(dof, values.get('', default) if dof in LINEAR_DOFS else default)

    return Limits(given(asked.max_force, Scales.of(settings.dof[dof]).force),
                  given(asked.max_speed, settings.max_speed),
                  given(asked.room, math.inf), asked.duration)


def _within_thrusters(settings: Settings, limits: Mapping[str, Limits]) -> dict[str, Limits]:
    """Return limits of force that the thrusters can give to all DOFs at the same moment."""
    share = np.zeros(settings.thrusters.count)
    for dof, own in limits.items():
        # a force on one DOF and none on the others
        force = {d: (Steps((own.force * (d == dof), own.force * (d == dof)), 1.0),)
                 for d in limits}
        commands = ThrusterCommands(settings.thrusters, force)
        low, high = commands.limits
        most = min(high, -low)
        if not most > 0.0:
            raise CommandError('thrusters: can only push one way, so nothing can be planned')
        share += np.abs(commands.thrusters(0.0)) / most
    less = max(1.0, float(share.max()))
    return {dof: replace(own, force=own.force / less) for dof, own in limits.items()}


def _model(settings: Settings, known: Identified | None, dof: str) -> tuple[Four, str]:
    """Return the model of a DOF, without terms that are left out, and where it is from."""
    own = settings.dof[dof]
    parameters, source = (known.parameters, known.source) if known else (
        lumped(own.mass, own.quadratic_drag, own.linear_drag, own.bias), 'initial values')
    alpha, beta, gamma, delta = [
        value if name in own.terms else 0.0 for name, value in zip(PARAMETERS, parameters)]
    return (alpha, beta, gamma, delta), source


def _turning(plans: Mapping[str, Plan]) -> list[str]:
    """Return what yaw does to the room: it is along the body, and the body turns."""
    level = [dof for dof in ('surge', 'sway') if dof in plans]
    room = math.hypot(*(plans[dof].limits.room for dof in level))
    if 'yaw' not in plans or not level or math.isinf(room):
        return []
    path = {}
    for dof in (*level, 'yaw'):
        own = plans[dof]
        force = samples(own.planned.waveforms, times(own.limits.duration, STEP))[:, None]
        path[dof] = fleet.paths(own.vehicles.parameters, force, STEP)[:, 0]
    ahead = [np.diff(path[dof], axis=0) if dof in path else 0.0 for dof in ('surge', 'sway')]
    moves = (ahead[0] + 1j * ahead[1]) * np.exp(1j * path['yaw'][1:])
    furthest = float(np.abs(np.cumsum(moves, axis=0)).max())
    if furthest <= room:
        return []
    return [f'yaw turns the vehicle meanwhile: it gets up to {number(furthest)} m away, not '
            f'{number(room)} m; for less, plan {" and ".join(level)} without yaw (--dofs)']
