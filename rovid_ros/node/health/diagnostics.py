"""
The messages of ``/diagnostics``, in the form of ROS' own ``diagnostic_updater``.

Names are ``<full name of the node>: <part>``, as it writes them with ``use_fqn``, so that two
vehicles stay apart. All statuses have one ``hardware_id``, which tools group by: without one
it is the full name too, because ``none`` would put every such node into one group. Units are
in the keys, so that a value that is a number alone can be plotted.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

from rovid_core.identify.estimate import DofEstimate
from rovid_core.inputs.refusals import REASONS
from rovid_core.model.dofs import PHYSICAL
from rovid_core.model.plant import physical
from rovid_ros import __version__
from rovid_ros.config.parameters import given_of, topics_of
from rovid_ros.files.whole_files import file_age
from rovid_ros.node.health.levels import (
    dof_level,
    HealthData,
    input_level,
    last_estimate,
    LevelAndMessage,
    rejected_level,
)
from rovid_ros.results.current import current_message, current_values, still_water, told
from rovid_ros.results.outputs import (
    CURRENT_LEVELS,
    DIAGNOSTIC_TYPE,
    ERROR,
    OK,
    Output,
    STALE,
    WARN,
)
from rovid_ros.results.text import unit
from rovid_ros.results.wire_encoding import begin_stamped, DiagnosticEncoder, status_body

ACTIVE = 'active'
LEVEL_NAMES = ('OK', 'WARN', 'ERROR', 'STALE')


@dataclass(frozen=True)
class NodeState:
    """What the node says of itself."""

    name: str  # its full name
    state: str = ACTIVE  # of its life cycle; only an ``active`` one takes data
    uptime: float = 0.0  # [s]
    record: str = ''  # file that it records to, '' if none
    recording: bool = True  # False: recording has ended by itself
    checkpoint: str = ''  # file that the state is saved to, '' if none


def diagnostics(data: HealthData, node: NodeState) -> Output:
    """Return the health of the node as a message for ``/diagnostics``."""
    settings = data.settings
    parts = [(name, input_level(data, name), _input(data, name))
             for name in settings.used_inputs()]
    parts.append(('rejected', rejected_level(data), {
        f'{name}.{reason}': n for (name, reason), n in sorted(data.stream.rejected.items())}))
    parts += [(dof, dof_level(data, dof), _dof(data, dof)) for dof in settings.dofs]
    if settings.estimates_current:
        parts.append(_current(data))
    elif still_water(settings):
        parts.append(('current', (OK, f'off: {still_water(settings)}'), {'status': 'off'}))
    if node.state != ACTIVE:
        parts = [(name, (STALE, f'the node is {node.state}'), values)
                 for name, _, values in parts]
    verdict, values = _state(data, node, {name: verdict for name, verdict, _ in parts})
    hardware = settings.hardware_id or node.name
    statuses = [
        (level, status_body(f'{node.name}: {name}', message, hardware, values))
        for name, (level, message), values in [('state', verdict, values), *parts]]
    return Output('/diagnostics', DIAGNOSTIC_TYPE,
                  DiagnosticEncoder('').encode(begin_stamped(data.now), statuses))


def _state(data: HealthData, node: NodeState, others: dict[str, LevelAndMessage]
           ) -> tuple[LevelAndMessage, dict[str, Any]]:
    """Return the status of the node as a whole, which is as bad as the worst of the others."""
    settings = data.settings
    doing = 'adapting' if data.stream.adapting else 'frozen'
    problems = [(WARN if level == STALE else level, name)
                for name, (level, _) in others.items() if level != OK]
    saved = file_age(node.checkpoint)
    if node.record and not node.recording:
        problems.append((ERROR, 'recording has ended'))
    overdue = 3.0 * settings.checkpoint_period
    if node.checkpoint and min(math.inf if saved is None else saved,
                                        node.uptime) > overdue:
        problems.append((WARN, 'the checkpoint is not written'))
    message = doing + (f'; look at {", ".join(name for _, name in problems)}' if problems else '')
    level = max([OK, *(level for level, _ in problems)])
    if node.state != ACTIVE:
        level, message = OK, node.state
    return (level, message), {
        'state': node.state, 'adaptation': doing, 'method': settings.identifier.method,
        'level': LEVEL_NAMES[level], 'uptime [s]': _number(node.uptime),
        'checkpoint path': node.checkpoint or 'none',
        'checkpoint age [s]': 'never written' if saved is None else _number(saved),
        'recording path': node.record or 'none', 'version': __version__}


def _input(data: HealthData, name: str) -> dict[str, Any]:
    settings, health = data.settings, data.stream.inputs[name]
    given = given_of(settings, name)
    topics = topics_of(settings, name)
    states = [data.topics[topic] for topic in topics if topic in data.topics]
    values: dict[str, Any] = {
        'topic': ', '.join([state.name for state in states] or topics),
        'type': given.type, 'field': given.field or '(all of it)',
        'count': health.count,
        'rate [Hz]': _number(data.rate(name)),
        'longest gap [s]': _number(health.longest_gap)}
    if health.last_time is not None and data.now:
        values['age [s]'] = _number((data.now - health.last_time) / 1e9)
    if states:
        values['publishers'] = min(state.publishers for state in states)
        problems = '; '.join(state.text for state in states if state.text)
        values['publishers, problems'] = problems or 'none'
    return {**values, **_refused(data, name)}


def _dof(data: HealthData, name: str) -> dict[str, Any]:
    values: dict[str, Any] = {'velocity from': data.settings.source(name)}
    dof = last_estimate(data.stream, name)
    if dof is None:
        return {**values, 'status': 'waiting', 'steps': 0}
    values.update({'status': dof.status, 'reasons': ', '.join(dof.reasons) or 'none',
                   'steps': dof.steps})
    if name in data.steps:
        values['age of the last step [s]'] = _number(data.steady - data.steps[name])
    values.update(_parameters(dof, data.settings.thrusters.newtons))
    values['excitation'] = _number(dof.excitation)
    if math.isfinite(dof.delay):
        values['delay of the thrust [s]'] = _number(dof.delay)
        values['delay of the thrust, std [s]'] = _number(dof.delay_std)
    return {**values, **_refused(data, name)}


def _current(data: HealthData) -> tuple[str, LevelAndMessage, dict[str, Any]]:
    """Return the part about the current of the water."""
    estimate = data.stream.estimate
    current = told(estimate.current if estimate else None, data.settings.frames)
    values = {name if name in ('chi2', 'status') else f'{name} [m/s]':
              _number(value) if isinstance(value, float) else value
              for name, value in current_values(current).items()}
    return 'current', (CURRENT_LEVELS[current.status], current_message(current)), values


def _refused(data: HealthData, name: str) -> dict[str, Any]:
    """Return what was refused of an input or DOF, each with the meaning of its reason."""
    values: dict[str, Any] = {}
    for (which, reason), count in sorted(data.stream.rejected.items()):
        if which == name:
            values[f'refused {reason}'] = count
            values[f'refused {reason}, meaning'] = REASONS.get(reason, reason)
    return values


def _parameters(dof: DofEstimate, newtons: bool) -> dict[str, str]:
    """Return mass, drags and bias, each with its 95 % interval where there is one."""
    values: dict[str, str] = {}
    for name, value in zip(PHYSICAL, physical(dof.parameters)):
        label, units = name.replace('_', ' '), unit(dof.dof, name, newtons)
        values[f'{label} [{units}]'] = _number(value)
        if name in dof.intervals:
            low, high = dof.intervals[name]
            values[f'{label}, 95 % [{units}]'] = f'{_number(low)} to {_number(high)}'
    return values


def _number(value: float) -> str:
    """Return four significant digits."""
    return f'{value:.4g}'
