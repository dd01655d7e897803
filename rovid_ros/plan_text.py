"""What ``rovid plan`` prints and writes."""

from __future__ import annotations

from collections.abc import Iterator
import math
from pathlib import Path
import shlex
from typing import Any

import numpy as np
from rovid_core.dofs import ANGULAR_DOFS, PARAMETERS, PHYSICAL
from rovid_core.planning import fleet
from rovid_core.planning.fleet import Array
from rovid_core.planning.plan import Plan, STEP
from rovid_core.planning.prospect import Prospect, samples, times
from rovid_core.settings import Settings
from rovid_ros.plan import Proposal
from rovid_ros.profile_text import profile_text
from rovid_ros.report import number, table
from rovid_ros.units import unit

POOR = 0.1
"""Relative uncertainty above which a parameter is poorly determined."""

ALIKE = 0.9
"""Correlation above which two drags cannot be told apart."""

NAMES = ('mass', 'quadratic drag', 'linear drag', 'bias')


def plan_text(proposal: Proposal, params_file: Path) -> str:
    """Return what the command prints."""
    parts = [_of_dof(dof, proposal) for dof in proposal.plans]
    parts.append('Half the width of the 95 % intervals at best (Cramer-Rao), in percent of the '
                 'value. Worst: of\nthe model and of vehicles whose mass and drags are up to '
                 f'{proposal.asked.factor:g} times off, all of which keep the limits.')
    command = ['rovid', 'simulate', '--params-file', str(params_file), '--output',
               'planned.mcap', '--duration', f'{proposal.asked.duration:g}',
               '--profile', profile_text(proposal.profile)]
    return '\n\n'.join([*parts, f'simulate it with: {shlex.join(command)}'])


def _of_dof(dof: str, proposal: Proposal) -> str:
    plan = proposal.plans[dof]
    speed, length = ('rad/s', 'rad') if dof in ANGULAR_DOFS else ('m/s', 'm')
    planned, limits = plan.planned, plan.limits

    def within(reached: Array, limit: float, unit: str) -> str:
        most = 'no limit' if math.isinf(limit) else f'limit {number(limit)}'
        return (f'up to {number(float(reached.max()))} {unit} ({most}; the model '
                f'{number(float(reached[0]))})')

    lines = [
        profile_text({dof: planned.waveforms}),
        f'  model   {proposal.sources[dof]}',
        f'  thrust  up to {number(planned.force)} {unit(dof, "bias")} '
        f'(limit {number(limits.force)})',
        f'  speed   {within(planned.speed, limits.speed, speed)}',
        f'  room    {within(planned.room, limits.room, length)}',
        table(list(_rows(dof, plan)))]
    return '\n'.join([*lines, *_sentences(dof, plan)])


def _rows(dof: str, plan: Plan) -> Iterator[list[str]]:
    yield ['', *NAMES, *PARAMETERS]
    naive = profile_text({dof: plan.naive.waveforms[:1]}).partition('=')[2]
    for name, prospect in (('planned', plan.planned), (naive, plan.naive)):
        yield [name, *(_cell(dof, plan, prospect, i, True) for i in range(8))]
        if len(prospect.speed) > 1:
            yield ['  worst', *(_cell(dof, plan, prospect, i, False) for i in range(8))]


def _cell(dof: str, plan: Plan, prospect: Prospect, i: int, of_model: bool) -> str:
    """Return one uncertainty, in percent where the value is not 0."""
    if not plan.vehicles.active[i % 4]:
        return '-'
    relative = _relative(plan, prospect, i)
    if not math.isfinite(relative[0]):
        half = prospect.uncertainty(i < 4)[:, i % 4]
        name = (*PHYSICAL, *PARAMETERS)[i]
        return f'{half[0] if of_model else half.max():.2g} {unit(dof, name)}'
    return _percent(float(relative[0] if of_model else relative.max()))


def _relative(plan: Plan, prospect: Prospect, i: int) -> Any:
    """Return an uncertainty over the value for each vehicle, inf where that is 0."""
    alpha = plan.vehicles.parameters[0]
    values = plan.vehicles.parameters[i % 4]
    values = values if i >= 4 else 1.0 / alpha if i == 0 else values / alpha
    half = prospect.uncertainty(i < 4)[:, i % 4]
    return np.divide(half, np.abs(values), out=np.full(len(half), np.inf), where=values != 0.0)


def _percent(share: float) -> str:
    return f'{100.0 * share:.2g} %' if share < 1.0 else f'{100.0 * share:,.0f} %'


def _sentences(dof: str, plan: Plan) -> Iterator[str]:
    """Yield what is poorly determined and why, and what an unknown bias does."""
    relative = [float(_relative(plan, plan.planned, i).max()) for i in range(4)]
    poor = [i for i in range(4) if plan.vehicles.active[i] and POOR < relative[i] < math.inf]
    if poor:
        what = ', '.join(f'{NAMES[i]} to {_percent(relative[i])}' for i in poor)
        yield f'  {_reason(dof, plan)}: at worst {what}{_alike(plan, poor)}'
    limits = plan.limits
    if math.isfinite(limits.room) and plan.vehicles.active[3]:
        extra = 0.01 * limits.force
        t = times(limits.duration, STEP)
        force = samples(plan.planned.waveforms, t)[:, None] + np.array([-extra, extra])
        room = float(fleet.reach(plan.vehicles.parameters[:, :1], force, STEP)[1].max())
        if room > limits.room:
            yield (f'  watch it: a bias of {number(extra)} {unit(dof, "bias")} that the model '
                   f'does not know would take it {number(room)} '
                   f'{"rad" if dof in ANGULAR_DOFS else "m"} away')


def _reason(dof: str, plan: Plan) -> str:
    angular, limits = dof in ANGULAR_DOFS, plan.limits
    name = max(plan.used, key=lambda key: plan.used[key])
    if plan.used[name] < 0.9:
        return f'in {limits.duration:g} s'
    return {'room': f'room of {number(limits.room)} {"rad" if angular else "m"}',
            'max_speed': f'speed up to {number(limits.speed)} {"rad/s" if angular else "m/s"}',
            'max_force': f'thrust up to {number(limits.force)} {unit(dof, "bias")}'}[name]


def _alike(plan: Plan, poor: list[int]) -> str:
    covariance = plan.planned.physical[0]
    spread = math.sqrt(covariance[1, 1] * covariance[2, 2])
    if not {1, 2} & set(poor) or not spread > 0.0:
        return ''
    correlation = covariance[1, 2] / spread
    if abs(correlation) < ALIKE:
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
                       'room': limits.room if math.isfinite(limits.room) else None},
            'planned': _numbers(plan, plan.planned),
            'naive': {'profile': profile_text({dof: plan.naive.waveforms}),
                      **_numbers(plan, plan.naive)}}
    return {'profile': profile_text(proposal.profile), 'duration_s': proposal.asked.duration,
            'factor': proposal.asked.factor, 'dofs': dofs, 'warnings': list(proposal.warnings)}


def _numbers(plan: Plan, prospect: Prospect) -> dict[str, Any]:
    """Return costs, and half the 95 % intervals: of the model, and relative of the worst."""
    names = [(i, name) for i, name in enumerate((*PHYSICAL, *PARAMETERS))
             if plan.vehicles.active[i % 4]]
    worst = {name: float(_relative(plan, prospect, i).max()) for i, name in names}
    return {
        'force': prospect.force,
        'speed': {'model': float(prospect.speed[0]), 'worst': float(prospect.speed.max())},
        'room': {'model': float(prospect.room[0]), 'worst': float(prospect.room.max())},
        'uncertainty': {name: float(prospect.uncertainty(i < 4)[0, i % 4]) for i, name in names},
        'worst_relative': {name: value if math.isfinite(value) else None
                           for name, value in worst.items()}}


def as_csv(proposal: Proposal, settings: Settings) -> str:
    """Return time and force on each DOF, a row per command."""
    names = [f'{dof}_{unit(dof, "bias").replace(" ", "_")}' for dof in proposal.plans]
    rate = settings.simulation.thruster_rate
    t = np.arange(math.floor(proposal.asked.duration * rate + 1e-9) + 1) / rate
    columns = [samples(plan.planned.waveforms, t) for plan in proposal.plans.values()]
    rows = [','.join(f'{x:.6g}' if i else f'{x:.10g}' for i, x in enumerate(row))
            for row in np.stack([t, *columns], axis=1).tolist()]
    return '\n'.join([','.join(['time_s', *names]), *rows]) + '\n'


def as_yaml(proposal: Proposal) -> str:
    """Return the profile as rovid simulate --profile takes it, in a file to keep."""
    lines = [f'# Of rovid plan. Forces in N, N m for {", ".join(ANGULAR_DOFS)}.',
             f"profile: '{profile_text(proposal.profile)}'  # for rovid simulate --profile",
             f'duration: {float(proposal.asked.duration)!r}  # [s]']
    return '\n'.join(lines) + '\n'
