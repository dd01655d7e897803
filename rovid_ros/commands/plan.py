"""``rovid plan``: the thrust profile to drive next, within what there is room for."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
import math
from pathlib import Path
import shlex
from typing import Any

import numpy as np
from rovid_core.model.dofs import ANGULAR_DOFS, DOFS, Four, LINEAR_DOFS, PARAMETERS, PHYSICAL
from rovid_core.model.plant import Array, lumped
from rovid_core.settings.run import Scales, Settings
from rovid_core.simulation.profiles import Profile, Steps, Waveform
from rovid_core.simulation.vehicle import ThrusterCommands
from rovid_core.trials.planning.information import (
    Limits,
    paths,
    reach,
    Sensor,
    SIDES,
    Vehicles,
)
from rovid_core.trials.planning.plan import (
    coupled_prospect,
    CoupledProspect,
    Plan,
    plan as find_plan,
    PlanError,
    Prospect,
    samples,
    STEP,
    times,
)
from rovid_ros.commands.arguments import (
    add_json,
    add_params_file,
    dofs as dof_list,
    duration as time_span,
    factor,
    per_dof,
)
from rovid_ros.commands.long_work import Progress
from rovid_ros.commands.profile_text import profile_text
from rovid_ros.commands.running import (
    check_written,
    CommandError,
    located_errors,
    print_written,
    printing,
    read_settings,
    UsageError,
    warn,
)
from rovid_ros.config.parameter_file import ParameterSource
from rovid_ros.files.whole_files import write_json, write_text
from rovid_ros.results.documents import Identified, json_number, read_estimates
from rovid_ros.results.text import NO_NEWTONS, number, table, unit

DESCRIPTION = (
    'Of the profiles that keep the limits it takes the one after which the least certain of '
    'mass, drags and bias is most certain, also where the model is wrong. Limits are one '
    'NUMBER for surge, sway and heave, or DOF=NUMBER[,DOF=NUMBER ...].')

MAX_DURATION = 3600.0  # [s] a longer trial tells nothing new: the profile can be repeated instead
MIN_DURATION = 10.0  # [s] a shorter trial tells nothing


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid plan`` takes."""
    add_params_file(command)
    command.add_argument(
        'estimates', nargs='?', type=Path, metavar='ESTIMATES.json',
        help="of rovid replay or compare (default: the parameter file's initial values)")
    command.add_argument(
        '--dofs', type=dof_list, default=(), metavar='DOF,...', help='plan these only')
    command.add_argument('--duration', type=time_span, default=300.0, metavar='S',
                         help='length of the trial [s] (default: 300)')
    command.add_argument('--max-force', type=per_dof, default={}, metavar='N',
                         help='largest thrust [N or N m] (default: typical.force)')
    command.add_argument('--max-speed', type=per_dof, default={}, metavar='V',
                         help='largest speed [m/s or rad/s] (default: velocity.max)')
    command.add_argument(
        '--room', type=per_dof, default={}, metavar='M',
        help='largest distance from the start, to either side [m or rad] (default: no limit)')
    command.add_argument(
        '--factor', type=factor, default=2.0, metavar='F',
        help='by how much the mass and drags of the model may be wrong (default: 2)')
    command.add_argument(
        '--output', type=Path, metavar='FILE',
        help='write the profile: .csv: time and thrust; .yaml: the text for rovid simulate')
    add_json(command, 'plan')


def run(args: argparse.Namespace) -> None:
    """Run ``rovid plan``."""
    if args.output and args.output.suffix not in ('.csv', '.yaml'):
        raise UsageError(f'--output: got {args.output}, takes a name that ends in .csv or .yaml')
    check_written([args.output, args.json], [args.estimates, *args.params_file.paths])
    settings = read_settings(args.params_file)
    models = read_estimates(args.estimates) if args.estimates else []
    with located_errors(args.params_file):
        proposal = propose(settings, models, Request(
            args.dofs, args.duration, args.max_force, args.max_speed, args.room, args.factor))
    for line in proposal.warnings:
        warn(args.prog, line)
    with printing(plan_text(proposal, args.params_file)):
        if args.output:
            write_text(args.output, profile_csv(proposal, settings)
                       if args.output.suffix == '.csv' else profile_yaml(proposal))
        if args.json:
            write_json(args.json, document(proposal))
    print_written(args.output, args.json)


@dataclass(frozen=True)
class Request:
    """
    What the command line asks for.

    ``max_force``, ``max_speed`` and ``room`` are by DOF, and under '' for all linear DOFs.
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

    request: Request
    plans: Mapping[str, Plan]
    coupled: Mapping[str, CoupledProspect]  # of DOFs with couplings
    sources: Mapping[str, str]
    profile: Profile
    warnings: tuple[str, ...]
    newtons: bool = True  # whether forces are
    turn: float = 0.0  # [s] the bounds of surge and sway count on a turn so often; 0: on none


def propose(settings: Settings, models: Sequence[Identified], request: Request) -> Proposal:
    """
    Plan a profile for each DOF that is asked for; the others get no thrust.

    A DOF without a model has its initial values. Raises CommandError, UsageError or SettingsError
    if the DOFs, the limits or the thrusters do not allow it.
    """
    dofs = _dofs(settings, request)
    limits = _limits_within_thrusters(
        settings, {dof: _limits(settings, request, dof) for dof in dofs})
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
            vehicles = Vehicles.around(clipped, scales.active, request.factor)
            try:
                plans[dof] = find_plan(vehicles, Sensor.of(settings, dof), limits[dof])
            except PlanError as error:
                raise CommandError(f'{dof}: --{str(error).replace("_", "-", 1)}') from None
            progress.tick()
    coupled = {}
    for dof in plans:
        if names := settings.dof[dof].couplings:
            found = known[dof].couplings if dof in known else {}
            coupled[dof] = coupled_prospect(
                dof, plans, Scales.of(settings.dof[dof]), Sensor.of(settings, dof),
                [found.get(name, 0.0) for name in names])
    still = [d for d in DOFS if d not in dofs and (
        d in settings.dofs or d in settings.simulation.dofs)]
    profile: dict[str, tuple[Waveform, ...]] = dict.fromkeys(still, ())
    profile.update({dof: own.planned.waveforms for dof, own in plans.items()})
    return Proposal(replace(request, dofs=dofs), plans, coupled, sources, profile,
                    (*warnings, *_turning_warnings(plans)), settings.thrusters.newtons,
                    request.duration / SIDES if settings.estimates_current
                    and {'surge', 'sway'} & plans.keys() else 0.0)


def _dofs(settings: Settings, request: Request) -> tuple[str, ...]:
    """Return the DOFs to plan, once what is asked for has been checked."""
    for dof in request.dofs:
        if dof not in settings.dofs:
            raise CommandError(f'--dofs: {dof} is not configured: dofs has '
                               f'{", ".join(settings.dofs)}')
    dofs = tuple(d for d in DOFS if d in (request.dofs or settings.dofs))
    for option in ('max_force', 'max_speed', 'room'):
        for dof in getattr(request, option):
            name = f'--{option.replace("_", "-")}'
            if dof and dof not in dofs:
                raise UsageError(f'{name}: {dof} is not planned; planned: {", ".join(dofs)}')
            if not dof and not set(dofs) & set(LINEAR_DOFS):
                raise UsageError(f'{name}: a number alone is for surge, sway and heave; takes '
                                 f'{dofs[0]}=NUMBER')
    if not MIN_DURATION <= request.duration <= MAX_DURATION:
        raise UsageError(f'--duration: got {request.duration:g}, takes {MIN_DURATION:g} to '
                         f'{MAX_DURATION:g} s')
    return dofs


def _limits(settings: Settings, request: Request, dof: str) -> Limits:
    def given(values: Mapping[str, float], default: float) -> float:
        return values.get(dof, values.get('', default) if dof in LINEAR_DOFS else default)

    return Limits(given(request.max_force, Scales.of(settings.dof[dof]).force),
                  given(request.max_speed, settings.max_speed),
                  given(request.room, math.inf), request.duration)


def _limits_within_thrusters(settings: Settings,
                             limits: Mapping[str, Limits]) -> dict[str, Limits]:
    """Return limits of force that the thrusters can give to all DOFs at the same moment."""
    share = np.zeros(settings.thrusters.count)
    for dof, own in limits.items():
        # a force on one DOF and none on the others
        force = {d: (Steps((own.force * (d == dof), own.force * (d == dof)), 1.0),)
                 for d in limits}
        commands = ThrusterCommands(settings.thrusters, force)
        low, high = commands.limits
        largest = min(high, -low)
        if not largest > 0.0:
            raise CommandError('thrusters: can only push one way, so nothing can be planned')
        share += np.abs(commands.thruster_forces(0.0)) / largest
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


def _turning_warnings(plans: Mapping[str, Plan]) -> list[str]:
    """Return what yaw does to the room: it is along the body, and the body turns."""
    level = [dof for dof in ('surge', 'sway') if dof in plans]
    room = math.hypot(*(plans[dof].limits.room for dof in level))
    if 'yaw' not in plans or not level or math.isinf(room):
        return []
    path = {}
    for dof in (*level, 'yaw'):
        own = plans[dof]
        force = samples(own.planned.waveforms, times(own.limits.duration, STEP))[:, None]
        path[dof] = paths(own.vehicles.parameters, force, STEP)[:, 0]
    ahead = [np.diff(path[dof], axis=0) if dof in path else 0.0 for dof in ('surge', 'sway')]
    moves = (ahead[0] + 1j * ahead[1]) * np.exp(1j * path['yaw'][1:])
    furthest = float(np.abs(np.cumsum(moves, axis=0)).max())
    if furthest <= room:
        return []
    return [f'yaw turns the vehicle meanwhile: it gets up to {number(furthest)} m away, not '
            f'{number(room)} m; for less, plan {" and ".join(level)} without yaw (--dofs)']


POOR = 0.1  # relative uncertainty above which a parameter is poorly determined
ALIKE_CORRELATION = 0.9  # correlation above which two drags cannot be told apart
NAMES = ('mass', 'quadratic drag', 'linear drag', 'bias')
Units = Callable[[str], str]  # that of a quantity, by its name


def plan_text(proposal: Proposal, params_file: ParameterSource) -> str:
    """Return what the command prints."""
    parts = [_dof_text(dof, proposal) for dof in proposal.plans]
    parts.append('Half the width of the 95 % intervals at best (Cramer-Rao), in percent of the '
                 'value. Worst: of\nthe model and of vehicles whose mass and drags are up to '
                 f'{proposal.request.factor:g} times off, all of which keep the limits.\n'
                 'AMPLITUDE@FREQUENCY: the same for one sinusoid, for comparison.')
    if not proposal.newtons:
        parts.append(f'{NO_NEWTONS}.')
    if proposal.turn:
        parts.append(
            f'Turn by 90 degrees, 45 at least, every {proposal.turn:g} s: at one heading a '
            'current looks like bias\nand linear drag. What is said of surge and sway counts on '
            'that, and on a current that is not known.')
    command = ['rovid', 'simulate', *params_file.arguments, '--output',
               'planned.mcap', '--duration', f'{proposal.request.duration:g}',
               '--profile', profile_text(proposal.profile)]
    return '\n\n'.join([*parts, f'simulate it with: {shlex.join(command)}'])


def _dof_text(dof: str, proposal: Proposal) -> str:
    plan, units = proposal.plans[dof], partial(unit, dof, newtons=proposal.newtons)
    speed, length = ('rad/s', 'rad') if dof in ANGULAR_DOFS else ('m/s', 'm')
    planned, limits = plan.planned, plan.limits

    def within(reached: Array, limit: float, unit: str) -> str:
        most = 'no limit' if math.isinf(limit) else f'limit {number(limit)}'
        return (f'up to {number(float(reached.max()))} {unit} ({most}; the model '
                f'{number(float(reached[0]))})')

    lines = [
        profile_text({dof: planned.waveforms}),
        f'  model   {proposal.sources[dof]}',
        f'  thrust  up to {number(planned.force)} {units("bias")} '
        f'(limit {number(limits.force)})',
        f'  speed   {within(planned.speed, limits.speed, speed)}',
        f'  room    {within(planned.room, limits.room, length)}',
        table(list(_rows(dof, plan, units)))]
    if dof in proposal.coupled:
        lines += _coupled_lines(proposal.coupled[dof])
    return '\n'.join([*lines, *_remarks(dof, plan, units)])


def _coupled_lines(coupled: CoupledProspect) -> Iterator[str]:
    """Yield what the profiles tell of the couplings of a DOF."""
    told = [f'kappa of {name} to +-{half:.2g}' for name, half in coupled.kappas.items()
            if math.isfinite(half)]
    if told:
        driven = (f'the profiles of {" and ".join(coupled.partners)} at once'
                  if coupled.partners else 'this profile')
        yield (f'  with {driven}: {", ".join(told)}; '
               f'then alpha to {_percent(coupled.alpha)}')
    untold = [name for name, half in coupled.kappas.items() if not math.isfinite(half)]
    if untold:
        yield (f'  not told: {", ".join(untold)}, for the motion of a DOF that is in it is not '
               'planned')


def _rows(dof: str, plan: Plan, units: Units) -> Iterator[list[str]]:
    yield ['', *NAMES, *PARAMETERS]
    naive = profile_text({dof: plan.naive.waveforms[:1]}).partition('=')[2]
    for name, prospect in (('planned', plan.planned), (naive, plan.naive)):
        yield [name, *(_cell(units, plan, prospect, i, True) for i in range(8))]
        if len(prospect.speed) > 1:
            yield ['  worst', *(_cell(units, plan, prospect, i, False) for i in range(8))]


def _cell(units: Units, plan: Plan, prospect: Prospect, i: int, of_model: bool) -> str:
    """Return one uncertainty, in percent where the value is not 0."""
    if not plan.vehicles.active[i % 4]:
        return '-'
    relative = _relative(plan, prospect, i)
    if not math.isfinite(relative[0]):
        half = prospect.uncertainty(i < 4)[:, i % 4]
        name = (*PHYSICAL, *PARAMETERS)[i]
        return f'{half[0] if of_model else half.max():.2g} {units(name)}'
    return _percent(float(relative[0] if of_model else relative.max()))


def _relative(plan: Plan, prospect: Prospect, i: int) -> Array:
    """Return an uncertainty over the value for each vehicle, inf where that is 0."""
    alpha = plan.vehicles.parameters[0]
    values = plan.vehicles.parameters[i % 4]
    values = values if i >= 4 else 1.0 / alpha if i == 0 else values / alpha
    half = prospect.uncertainty(i < 4)[:, i % 4]
    return np.asarray(
        np.divide(half, np.abs(values), out=np.full(len(half), np.inf), where=values != 0.0))


def _percent(share: float) -> str:
    return f'{100.0 * share:.2g} %' if share < 1.0 else f'{100.0 * share:,.0f} %'


def _remarks(dof: str, plan: Plan, units: Units) -> Iterator[str]:
    """Yield what is poorly determined and why, and what an unknown bias does."""
    relative = [float(_relative(plan, plan.planned, i).max()) for i in range(4)]
    poor = [i for i in range(4) if plan.vehicles.active[i] and POOR < relative[i] < math.inf]
    if poor:
        what = ', '.join(f'{NAMES[i]} to {_percent(relative[i])}' for i in poor)
        yield (f'  {_limiting_factor(dof, plan, units)}: at worst {what}'
               f'{_alike_drags(plan, poor)}')
    limits = plan.limits
    if math.isfinite(limits.room) and plan.vehicles.active[3]:
        extra = 0.01 * limits.force
        t = times(limits.duration, STEP)
        force = samples(plan.planned.waveforms, t)[:, None] + np.array([-extra, extra])
        room = float(reach(plan.vehicles.parameters[:, :1], force, STEP)[1].max())
        if room > limits.room:
            yield (f'  watch it: a bias of {number(extra)} {units("bias")} that the '
                   f'model does not know would take it {number(room)} '
                   f'{"rad" if dof in ANGULAR_DOFS else "m"} away')


def _limiting_factor(dof: str, plan: Plan, units: Units) -> str:
    angular, limits = dof in ANGULAR_DOFS, plan.limits
    name = max(plan.used, key=lambda key: plan.used[key])
    if plan.used[name] < 0.9:
        return f'in {limits.duration:g} s'
    return {'room': f'room of {number(limits.room)} {"rad" if angular else "m"}',
            'max_speed': f'speed up to {number(limits.speed)} {"rad/s" if angular else "m/s"}',
            'max_force': f'thrust up to {number(limits.force)} {units("bias")}'}[name]


def _alike_drags(plan: Plan, poor: list[int]) -> str:
    covariance = plan.planned.physical[0]
    spread = math.sqrt(covariance[1, 1] * covariance[2, 2])
    if not {1, 2} & set(poor) or not spread > 0.0:
        return ''
    correlation = covariance[1, 2] / spread
    if abs(correlation) < ALIKE_CORRELATION:
        return ''
    return (f'; up to {number(float(plan.planned.speed[0]))} in speed the two drags look alike '
            f'(correlation {correlation:.2f})')


def document(proposal: Proposal) -> dict[str, Any]:
    """Return the plan as JSON; a non-finite number is null."""
    dofs = {}
    for dof, plan in proposal.plans.items():
        limits = plan.limits
        dofs[dof] = {
            'model': proposal.sources[dof],
            'profile': profile_text({dof: plan.planned.waveforms}),
            'limits': {'force': limits.force, 'speed': limits.speed,
                       'room': json_number(limits.room)},
            'planned': _prospect_document(plan, plan.planned),
            **({'couplings': {name: json_number(half) for name, half in
                              proposal.coupled[dof].kappas.items()}}
               if dof in proposal.coupled else {}),
            'naive': {'profile': profile_text({dof: plan.naive.waveforms}),
                      **_prospect_document(plan, plan.naive)}}
    return {'profile': profile_text(proposal.profile), 'duration_s': proposal.request.duration,
            'factor': proposal.request.factor, 'turn_every_s': proposal.turn or None,
            'dofs': dofs, 'warnings': list(proposal.warnings)}


def _prospect_document(plan: Plan, prospect: Prospect) -> dict[str, Any]:
    """Return costs, and half the 95 % intervals: of the model, and relative of the worst."""
    names = [(i, name) for i, name in enumerate((*PHYSICAL, *PARAMETERS))
             if plan.vehicles.active[i % 4]]
    worst = {name: float(_relative(plan, prospect, i).max()) for i, name in names}
    return {
        'force': prospect.force,
        'speed': {'model': float(prospect.speed[0]), 'worst': float(prospect.speed.max())},
        'room': {'model': float(prospect.room[0]), 'worst': float(prospect.room.max())},
        'uncertainty': {name: float(prospect.uncertainty(i < 4)[0, i % 4]) for i, name in names},
        'worst_relative': {name: json_number(value) for name, value in worst.items()}}


def profile_csv(proposal: Proposal, settings: Settings) -> str:
    """Return time and force on each DOF, a row per command."""
    names = [f'{dof}_{unit(dof, "bias", proposal.newtons)}'.replace(' ', '_')
             for dof in proposal.plans]
    rate = settings.simulation.thruster_rate
    t = np.arange(math.floor(proposal.request.duration * rate + 1e-9) + 1) / rate
    columns = [samples(plan.planned.waveforms, t) for plan in proposal.plans.values()]
    rows = [','.join(f'{x:.6g}' if i else f'{x:.10g}' for i, x in enumerate(row))
            for row in np.stack([t, *columns], axis=1).tolist()]
    return '\n'.join([','.join(['time_s', *names]), *rows]) + '\n'


def profile_yaml(proposal: Proposal) -> str:
    """Return the profile as rovid simulate --profile takes it, in a file to keep."""
    units = (f'N, N m for {", ".join(ANGULAR_DOFS)}' if proposal.newtons
             else 'what a command of 1 pushes')
    lines = [f'# Of rovid plan. Forces in {units}.',
             f"profile: '{profile_text(proposal.profile)}'  # for rovid simulate --profile",
             f'duration: {float(proposal.request.duration)!r}  # [s]']
    return '\n'.join(lines) + '\n'
