"""What ``/diagnostics`` says: inputs, refusals, degrees of freedom."""

from __future__ import annotations

import math
from typing import Any

from rovid_core.settings import Settings
from rovid_core.stream import Stream
from rovid_core.values import DofEstimate
from rovid_ros.outputs import (
    DIAGNOSTIC_TYPE,
    dof_message,
    header,
    key_values,
    LEVELS,
    OK,
    Output,
    WARN,
)

STALE_PERIODS = 5.0
"""An input is late when it has been silent for this many of its periods."""

ACCEPTABLE = 0.02
"""Share of refused samples above which something is wrong with the data."""


def diagnostics(stream: Stream, settings: Settings, node: str, now: int) -> Output:
    """
    Return the health of the node.

    Parameters
    ----------
    stream : Stream
        What runs.
    settings : Settings
        Its settings.
    node : str
        The full name of the node, put before the name of every status.
    now : int
        Time of the node's clock [ns]; the age of an input is the time since the stamp of
        its newest sample, so that clocks that disagree show up.

    """
    statuses = [_input(stream, settings, name, now) for name in settings.used_inputs()]
    statuses.append(_rejected(stream))
    if stream.estimate is not None:
        statuses += [
            _status(LEVELS[dof.status], dof.dof, dof_message(dof), _dof(dof))
            for dof in stream.estimate.dofs]
    else:
        statuses += [_status(WARN, dof, 'no step yet', {}) for dof in settings.dofs]
    for status in statuses:
        status['name'] = f'{node}: {status["name"]}'
    return Output('/diagnostics', DIAGNOSTIC_TYPE, {'header': header(now, ''),
                                                    'status': statuses})


def _input(stream: Stream, settings: Settings, name: str, now: int) -> dict[str, Any]:
    topics = settings.thrusters.topics if name == 'thrusters' else (
        settings.input(name).topic,)
    health = stream.inputs.get(name)
    values: dict[str, Any] = {'topic': ', '.join(topics)}
    if health is None or not health.count or health.last_time is None:
        values['count'] = 0
        return _status(WARN, name, 'nothing received yet', values)
    age = (now - health.last_time) / 1e9
    values.update(count=health.count, age_s=age, rate_hz=health.rate)
    limit = settings.max_gap
    if health.rate > 0.0:
        limit = max(limit, STALE_PERIODS / health.rate)
    if age > limit:
        return _status(WARN, name, f'the newest sample is {age:.1f} s old', values)
    if age < -limit:
        return _status(WARN, name, f'stamps are {-age:.1f} s ahead of this clock', values)
    return _status(OK, name, f'{health.rate:.1f} Hz', values)


def _dof(dof: DofEstimate) -> dict[str, Any]:
    values = {'status': dof.status, 'steps': dof.steps, 'excitation': dof.excitation}
    if math.isfinite(dof.delay):
        values.update(delay_s=dof.delay, delay_std_s=dof.delay_std)
    return values


def _rejected(stream: Stream) -> dict[str, Any]:
    counts = {f'{name}.{reason}': n for (name, reason), n in sorted(stream.rejected.items())}
    total = sum(counts.values())
    used = sum(health.count for health in stream.inputs.values())
    level = WARN if total > ACCEPTABLE * used else OK
    return _status(level, 'rejected', f'{total} refused, {used} used', counts)


def _status(level: int, name: str, message: str, values: dict[str, Any]) -> dict[str, Any]:
    return {'level': level, 'name': name, 'message': message, 'hardware_id': '',
            'values': key_values(values)}
