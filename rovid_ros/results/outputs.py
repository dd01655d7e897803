"""
The messages of an estimate, as plain fields.

The node fills ROS messages with them and the log writer those of a log, so both say the
same.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from rovid_core.identify.estimate import DofEstimate, Estimate
from rovid_core.model.dofs import DOFS, Four, NAN4, PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical
from rovid_core.settings.run import Scales, Settings
from rovid_ros.results.current import current_message, current_values, told
from rovid_ros.results.model_rows import model_columns, model_row

ARRAY_TYPE = 'std_msgs/msg/Float64MultiArray'
DIAGNOSTIC_TYPE = 'diagnostic_msgs/msg/DiagnosticArray'

TOPICS = {
    'rov/params': ARRAY_TYPE,
    'rov/params_std': ARRAY_TYPE,
    'rov/identifier_state': 'sensor_msgs/msg/JointState',
    'rov/velocity': 'geometry_msgs/msg/TwistStamped',
    'rov/model': ARRAY_TYPE,
    'rov/estimate': DIAGNOSTIC_TYPE,
}
"""Output topics, relative to the namespace of the node, and their types."""

COUPLING_TOPICS = {'rov/couplings': ARRAY_TYPE, 'rov/couplings_std': ARRAY_TYPE}
"""Further ones where a DOF has couplings."""

CURRENT_TOPICS = {'rov/current': 'geometry_msgs/msg/Vector3Stamped',
                  'rov/current_covariance': ARRAY_TYPE}
"""Further ones where the current of the water is estimated."""

LATCHED = ('rov/params', 'rov/params_std', *COUPLING_TOPICS, 'rov/model')
"""Those of which a late subscriber gets a message at once, the last or one of the last second."""

OF_STEPS = tuple(topic for topic in LATCHED if topic != 'rov/model')
"""Those in which only a step or a reset changes anything."""

WORLD_FRAMES = {'enu': 'map', 'ned': 'map_ned'}
"""Frames of what is told in the world, by ``frames``."""

OK, WARN, ERROR, STALE = 0, 1, 2, 3
LEVELS = {'waiting': WARN, 'unexcited': WARN, 'converging': OK, 'converged': OK, 'frozen': OK,
          'invalid': ERROR, 'stale': WARN}
"""Status of a DOF to level of a ``DiagnosticStatus``."""

CURRENT_LEVELS = {'off': OK, 'unobservable': WARN, 'converging': OK, 'known': OK,
                  'inconsistent': WARN}
"""The same of the current."""

LONG = 10.0
"""[s] What has been stale for so long is an ERROR."""


_Kappas = dict[str, float]


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

    Attributes
    ----------
    topics : dict
        Topic -> type of all that there are: ``TOPICS``, ``COUPLING_TOPICS`` where a DOF has
        couplings, and ``CURRENT_TOPICS`` where the current is estimated.

    """

    def __init__(self, settings: Settings) -> None:
        self._initial: dict[str, tuple[Four, Four]] = {
            name: (Scales.of(settings.dof[name]).initial, NAN4) for name in settings.dofs}
        self._rows = dict(self._initial)
        self._couplings = {name: settings.couplings(name) for name in settings.dofs}
        # as the parameters, initially 0
        self._initial_kappas: dict[str, tuple[_Kappas, _Kappas]] = {
            name: (dict.fromkeys(names, 0.0), {}) for name, names in self._couplings.items()}
        self._kappas = dict(self._initial_kappas)
        self._coupling_names = tuple(dict.fromkeys(
            name for names in self._couplings.values() for name in names))
        self._frames, self._base = settings.frames, settings.base_frame
        self._has_current = settings.estimates_current
        self.topics = {**TOPICS, **(COUPLING_TOPICS if self._coupling_names else {}),
                       **(CURRENT_TOPICS if self._has_current else {})}
        self._latched: dict[str, Callable[[], dict[str, Any]]] = {
            topic: make for topic, make in zip(LATCHED, (
                lambda: self._values(0), lambda: self._values(1),
                lambda: self._coupling_values(0), lambda: self._coupling_values(1),
                self._model))
            if topic in self.topics}
        self._makers: dict[str, Callable[[Estimate], dict[str, Any]]] = {
            'rov/identifier_state': self._state, 'rov/velocity': self._twist,
            'rov/estimate': self._diagnostics,
            'rov/current': self._current, 'rov/current_covariance': self._current_covariance}
        self._statuses: dict[str, tuple[DofEstimate, bool, dict[str, Any]]] = {}
        self._nothing = Estimate(0, tuple([
            DofEstimate(name, row[0], couplings=tuple(self._initial_kappas[name][0].values()))
            for name, row in self._initial.items()]), ())
        self._estimate = self._nothing

    def messages(self, estimate: Estimate, topics: Collection[str] | None = None
                 ) -> list[Output]:
        """
        Return the messages of an estimate, in the order in which they are published.

        All at once; ``each`` makes one after the other.

        Parameters
        ----------
        estimate : Estimate
            What to tell.
        topics : collection of str, optional
            Those that somebody listens to, in the order of ``topics``; the others are not made.

        """
        return list(self.each(estimate, self.topics if topics is None else topics))

    def each(self, estimate: Estimate, topics: Collection[str]) -> Iterator[Output]:
        """Yield the same one by one, so that the first is out before the next is made."""
        self._estimate = estimate
        for dof in estimate.dofs:
            if dof.status not in ('invalid', 'stale'):
                self._rows[dof.dof] = (dof.parameters, dof.std)
                names = self._couplings[dof.dof]
                self._kappas[dof.dof] = (
                    dict(zip(names, dof.couplings)), dict(zip(names, dof.couplings_std)))
        for topic in topics:
            make = self._latched.get(topic)
            yield Output(topic, self.topics[topic],
                         self._makers[topic](estimate) if make is None else make())

    def reset(self) -> list[Output]:
        """Go back to the initial values; return the messages that say so without a step."""
        self._rows, self._kappas = dict(self._initial), dict(self._initial_kappas)
        self._estimate = self._nothing
        return self.latched(list(self._latched))

    def latched(self, topics: Collection[str]) -> list[Output]:
        """Return the messages of ``LATCHED`` topics as they are after the last estimate."""
        return [Output(topic, self.topics[topic], self._latched[topic]()) for topic in topics]

    def _diagnostics(self, estimate: Estimate) -> dict[str, Any]:
        statuses = [self._status(dof, index in estimate.stepped)
                    for index, dof in enumerate(estimate.dofs)]
        if self._has_current:
            current = told(estimate.current, self._frames)
            statuses.append({
                'level': CURRENT_LEVELS[current.status], 'name': 'current',
                'message': current_message(current), 'hardware_id': '',
                'values': key_values(current_values(current))})
        return {'header': header(estimate.time, self._base), 'status': statuses}

    def _state(self, estimate: Estimate) -> dict[str, Any]:
        return {
            'header': header(estimate.time, self._base),
            'name': [dof.dof for dof in estimate.dofs],
            'position': [],
            'velocity': [dof.v_hat for dof in estimate.dofs],
            'effort': [dof.force for dof in estimate.dofs],
        }

    def _twist(self, estimate: Estimate) -> dict[str, Any]:
        # a DOF that is not identified has no velocity here: NaN, not a claim of standing still
        velocity = {dof.dof: dof.velocity for dof in estimate.dofs}
        values = [velocity.get(name, math.nan) for name in DOFS]
        return {
            'header': header(estimate.time, self._base),
            'twist': {
                'linear': dict(zip('xyz', values[:3])),
                'angular': dict(zip('xyz', values[3:])),
            },
        }

    def _current(self, estimate: Estimate) -> dict[str, Any]:
        current = told(estimate.current, self._frames)
        return {'header': header(estimate.time, WORLD_FRAMES[self._frames]),
                'vector': {'x': current.x, 'y': current.y, 'z': 0.0}}

    def _current_covariance(self, estimate: Estimate) -> dict[str, Any]:
        xx, xy, yy = told(estimate.current, self._frames).covariance
        return _array(['x', 'y'], ['x', 'y'], [(xx, xy), (xy, yy)])

    def _status(self, dof: DofEstimate, stepped: bool) -> dict[str, Any]:
        """Return the status of a DOF; without a step, only ``updated`` is another."""
        known, before, status = self._statuses.get(dof.dof, (None, stepped, {}))
        if known is not dof:
            status = _status(dof, self._couplings[dof.dof], stepped)
        elif before is not stepped:
            updated, = key_values({'updated': stepped})
            status = {**status, 'values': [updated if value['key'] == 'updated' else value
                                           for value in status['values']]}
        self._statuses[dof.dof] = dof, stepped, status
        return status

    def _model(self) -> dict[str, Any]:
        """Return the fields of ``rov/model``."""
        now, stepped, names = self._estimate.now, self._estimate.stepped, self._coupling_names
        return _array([dof.dof for dof in self._estimate.dofs], model_columns(names), [
            model_row(dof, self._couplings[dof.dof], names, now, i in stepped)
            for i, dof in enumerate(self._estimate.dofs)])

    def _values(self, which: int) -> dict[str, Any]:
        """Return the fields of ``rov/params`` (0) or ``rov/params_std`` (1)."""
        return _array(list(self._rows), PARAMETERS, [row[which] for row in self._rows.values()])

    def _coupling_values(self, which: int) -> dict[str, Any]:
        """Return the same of the couplings, NaN where a DOF has no such one."""
        names = self._coupling_names
        return _array(list(self._kappas), names, [
            [row[which].get(name, math.nan) for name in names] for row in self._kappas.values()])


def header(time: int, frame: str) -> dict[str, Any]:
    """Return the fields of a ``std_msgs/Header`` for a time [ns]."""
    sec, nanosec = divmod(time, 1_000_000_000)
    return {'stamp': {'sec': sec, 'nanosec': nanosec}, 'frame_id': frame}


def key_values(values: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return ``diagnostic_msgs/KeyValue`` fields; a float's text gives its exact bits back."""
    return [{'key': key, 'value': _text(value)} for key, value in values.items()]


def dof_message(dof: DofEstimate) -> str:
    """Return status and reasons in one line."""
    return f'{dof.status}: {", ".join(dof.reasons)}' if dof.reasons else dof.status


def _array(names: list[str], labels: Sequence[str], rows: Sequence[Sequence[float]]
           ) -> dict[str, Any]:
    size, columns = len(rows), len(labels)
    return {
        'layout': {
            'dim': [
                {'label': ','.join(names), 'size': size, 'stride': columns * size},
                {'label': ','.join(labels), 'size': columns, 'stride': columns},
            ],
            'data_offset': 0,
        },
        'data': [value for row in rows for value in row],
    }


def _status(dof: DofEstimate, couplings: Sequence[str], stepped: bool) -> dict[str, Any]:
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
    for name, kappa, std in zip(couplings, dof.couplings, dof.couplings_std):
        values[f'kappa_{name}'], values[f'kappa_{name}_std'] = kappa, std
    if dof.stale_for:
        values['age'] = dof.stale_for
    return {
        'level': ERROR if dof.stale_for > LONG else LEVELS[dof.status],
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
