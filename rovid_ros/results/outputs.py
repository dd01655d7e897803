"""
The messages of an estimate, as plain fields.

The node fills ROS messages with them and the log writer those of a log, so both say the
same.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
import math
from typing import Any

from rovid_core.identify.estimate import DofEstimate, Estimate
from rovid_core.model.dofs import DOFS, Four, NAN4, PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical
from rovid_core.settings.run import Scales, Settings

ARRAY_TYPE = 'std_msgs/msg/Float64MultiArray'
DIAGNOSTIC_TYPE = 'diagnostic_msgs/msg/DiagnosticArray'

TOPICS = {
    'rov/params': ARRAY_TYPE,
    'rov/params_std': ARRAY_TYPE,
    'rov/identifier_state': 'sensor_msgs/msg/JointState',
    'rov/velocity': 'geometry_msgs/msg/TwistStamped',
    'rov/estimate': DIAGNOSTIC_TYPE,
}
"""Output topics, relative to the namespace of the node, and their types."""

LATCHED = ('rov/params', 'rov/params_std')
"""Those of which a late subscriber gets a message at once, the last or one of the last second."""

FRAME = 'base_link'

OK, WARN, ERROR, STALE = 0, 1, 2, 3
LEVELS = {'waiting': WARN, 'unexcited': WARN, 'converging': OK, 'converged': OK, 'frozen': OK,
          'invalid': ERROR}
"""Status of a DOF to level of a ``DiagnosticStatus``."""


@dataclass(frozen=True)
class Output:
    """A message that goes out: nested dicts and lists of plain values in ``fields``."""

    topic: str
    type: str
    fields: dict[str, Any]


class Outputs:
    """
    Make the messages of one estimate after the other.

    While a DOF is invalid, ``rov/params`` and ``rov/params_std`` repeat its last valid row, at
    first its initial values.

    Parameters
    ----------
    settings : Settings
        DOFs and initial values.

    """

    def __init__(self, settings: Settings) -> None:
        self._initial: dict[str, tuple[Four, Four]] = {
            name: (Scales.of(settings.dof[name]).initial, NAN4) for name in settings.dofs}
        self._rows = dict(self._initial)
        self._makers: dict[str, Callable[[Estimate], dict[str, Any]]] = dict(zip(TOPICS, (
            lambda _: self._params(), lambda _: self._params_std(), _state, _twist,
            self._diagnostics)))
        self._statuses: dict[str, tuple[DofEstimate, bool, dict[str, Any]]] = {}

    def messages(self, estimate: Estimate, topics: Collection[str] = TOPICS) -> list[Output]:
        """
        Return the messages of an estimate, in the order in which they are published.

        All at once; ``each`` makes one after the other.

        Parameters
        ----------
        estimate : Estimate
            What to tell.
        topics : collection of str
            Those that somebody listens to, in the order of ``TOPICS``; the others are not made.

        """
        return list(self.each(estimate, topics))

    def each(self, estimate: Estimate, topics: Collection[str]) -> Iterator[Output]:
        """Yield the same one by one, so that the first is out before the next is made."""
        for dof in estimate.dofs:
            if dof.status != 'invalid':
                self._rows[dof.dof] = (dof.parameters, dof.std)
        for topic in topics:
            yield Output(topic, TOPICS[topic], self._makers[topic](estimate))

    def reset(self) -> list[Output]:
        """Go back to the initial values; return the messages that say so without a step."""
        self._rows = dict(self._initial)
        return self.latched(LATCHED)

    def latched(self, topics: Collection[str]) -> list[Output]:
        """Return the messages of ``LATCHED`` topics as they are after the last estimate."""
        makers = dict(zip(LATCHED, (self._params, self._params_std)))
        return [Output(topic, TOPICS[topic], makers[topic]()) for topic in topics]

    def _diagnostics(self, estimate: Estimate) -> dict[str, Any]:
        return {'header': header(estimate.time),
                'status': [self._status(dof, index in estimate.stepped)
                           for index, dof in enumerate(estimate.dofs)]}

    def _status(self, dof: DofEstimate, stepped: bool) -> dict[str, Any]:
        """Return the status of a DOF; without a step, only ``updated`` is another."""
        known, before, status = self._statuses.get(dof.dof, (None, stepped, {}))
        if known is not dof:
            status = _status(dof, stepped)
        elif before is not stepped:
            updated, = key_values({'updated': stepped})
            status = {**status, 'values': [updated if value['key'] == 'updated' else value
                                           for value in status['values']]}
        self._statuses[dof.dof] = dof, stepped, status
        return status

    def _params(self) -> dict[str, Any]:
        """Return the fields of ``rov/params``."""
        return _array(list(self._rows), [values for values, _ in self._rows.values()])

    def _params_std(self) -> dict[str, Any]:
        """Return the fields of ``rov/params_std``."""
        return _array(list(self._rows), [std for _, std in self._rows.values()])


def header(time: int, frame: str = FRAME) -> dict[str, Any]:
    """Return the fields of a ``std_msgs/Header`` for a time [ns]."""
    sec, nanosec = divmod(time, 1_000_000_000)
    return {'stamp': {'sec': sec, 'nanosec': nanosec}, 'frame_id': frame}


def key_values(values: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return ``diagnostic_msgs/KeyValue`` fields; a float's text gives its exact bits back."""
    return [{'key': key, 'value': _text(value)} for key, value in values.items()]


def dof_message(dof: DofEstimate) -> str:
    """Return status and reasons in one line."""
    return f'{dof.status}: {", ".join(dof.reasons)}' if dof.reasons else dof.status


def _array(names: list[str], rows: list[Four]) -> dict[str, Any]:
    size, columns = len(rows), len(PARAMETERS)
    return {
        'layout': {
            'dim': [
                {'label': ','.join(names), 'size': size, 'stride': columns * size},
                {'label': ','.join(PARAMETERS), 'size': columns, 'stride': columns},
            ],
            'data_offset': 0,
        },
        'data': [value for row in rows for value in row],
    }


def _state(estimate: Estimate) -> dict[str, Any]:
    return {
        'header': header(estimate.time),
        'name': [dof.dof for dof in estimate.dofs],
        'position': [],
        'velocity': [dof.v_hat for dof in estimate.dofs],
        'effort': [dof.force for dof in estimate.dofs],
    }


def _twist(estimate: Estimate) -> dict[str, Any]:
    # a DOF that is not identified has no velocity here: NaN, not a claim of standing still
    velocity = {dof.dof: dof.velocity for dof in estimate.dofs}
    values = [velocity.get(name, math.nan) for name in DOFS]
    return {
        'header': header(estimate.time),
        'twist': {
            'linear': dict(zip('xyz', values[:3])),
            'angular': dict(zip('xyz', values[3:])),
        },
    }


def _status(dof: DofEstimate, stepped: bool) -> dict[str, Any]:
    values: dict[str, Any] = {
        **dict(zip(PARAMETERS, dof.parameters)),
        **dict(zip([f'{name}_std' for name in PARAMETERS], dof.std)),
        **dict(zip(PHYSICAL, physical(dof.parameters))),
        **{f'{name}_{end}': value for name, interval in dof.intervals.items()
           for end, value in zip(('low', 'high'), interval)},
        'velocity': dof.velocity,
        'v_hat': dof.v_hat,
        'dv': dof.dv,
        'force': dof.force,
        'excitation': dof.excitation,
        'steps': dof.steps,
        'status': dof.status,
        'reasons': ', '.join(dof.reasons),
        'time': dof.time,
        'updated': stepped,
    }
    for name in ('delay', 'delay_std', 'W'):
        if not math.isnan(getattr(dof, name)):
            values[name] = getattr(dof, name)
    return {
        'level': LEVELS[dof.status],
        'name': dof.dof,
        'message': dof_message(dof),
        'hardware_id': '',
        'values': key_values(values),
    }


def _text(value: Any) -> str:
    if type(value) is float:  # as almost all are
        return repr(value)
    if isinstance(value, bool):
        return 'true' if value else 'false'
    # numpy's floats are floats, with another repr
    return float.__repr__(value) if isinstance(value, float) else str(value)
