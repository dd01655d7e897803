"""The messages of an estimate, serialised: the node sends the bytes, a log holds the same."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
import math
from typing import Any, NamedTuple

from rovid_core.identify.estimate import DofEstimate, Estimate
from rovid_core.model.dofs import DOFS, Four, NAN4, PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical
from rovid_core.settings.run import Scales, Settings
from rovid_ros.results.current import current_message, current_values, told
from rovid_ros.results.model_rows import AGE, age, model_columns, model_row, UPDATED
from rovid_ros.results.wire_encoding import (
    ArrayEncoder,
    diagnostic_array,
    JointStateEncoder,
    StampedEncoder,
    StatusBody,
)

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


class Output(NamedTuple):
    """A message that goes out."""

    topic: str
    type: str
    cdr: bytes


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
        names, self._frames, self._base = settings.dofs, settings.frames, settings.base_frame
        self._parameters_array = ArrayEncoder(names, PARAMETERS)
        self._couplings_array = ArrayEncoder(names, self._coupling_names)
        self._model_array = ArrayEncoder(names, model_columns(self._coupling_names))
        self._covariance_array = ArrayEncoder('xy', 'xy')
        self._joints = JointStateEncoder(self._base, names)
        self._twists = StampedEncoder(self._base, 6)
        self._currents = StampedEncoder(WORLD_FRAMES[self._frames], 3)
        self._has_current = settings.estimates_current
        self.topics = {**TOPICS, **(COUPLING_TOPICS if self._coupling_names else {}),
                       **(CURRENT_TOPICS if self._has_current else {})}
        self._makers: dict[str, Callable[[], bytes]] = {
            'rov/params': lambda: self._row_array(0),
            'rov/params_std': lambda: self._row_array(1),
            'rov/identifier_state': self._state, 'rov/velocity': self._twist,
            'rov/model': self._model, 'rov/estimate': self._diagnostics,
            'rov/couplings': lambda: self._coupling_array(0),
            'rov/couplings_std': lambda: self._coupling_array(1),
            'rov/current': self._current, 'rov/current_covariance': self._current_covariance}
        self._told: dict[str, DofEstimate] = {}  # what ``_rows`` and ``_kappas`` have seen
        self._models: dict[str, tuple[DofEstimate, list[float]]] = {}
        self._statuses: dict[str, tuple[DofEstimate, int, StatusBody]] = {}
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
            if self._told.get(dof.dof) is dof:
                continue
            self._told[dof.dof] = dof
            if dof.status not in ('invalid', 'stale'):
                self._rows[dof.dof] = (dof.parameters, dof.std)
                names = self._couplings[dof.dof]
                self._kappas[dof.dof] = (
                    dict(zip(names, dof.couplings)), dict(zip(names, dof.couplings_std)))
        for topic in topics:
            yield self._output(topic)

    def reset(self) -> list[Output]:
        """Go back to the initial values; return the messages that say so without a step."""
        self._rows, self._kappas = dict(self._initial), dict(self._initial_kappas)
        self._estimate = self._nothing
        self._told.clear()
        return self.latched([topic for topic in LATCHED if topic in self.topics])

    def latched(self, topics: Collection[str]) -> list[Output]:
        """Return the messages of ``LATCHED`` topics as they are after the last estimate."""
        return [self._output(topic) for topic in topics]

    def _output(self, topic: str) -> Output:
        return Output(topic, self.topics[topic], self._makers[topic]())

    def _diagnostics(self) -> bytes:
        estimate = self._estimate
        statuses = [self._status(dof, index in estimate.stepped)
                    for index, dof in enumerate(estimate.dofs)]
        if self._has_current:
            current = told(estimate.current, self._frames)
            statuses.append((CURRENT_LEVELS[current.status], StatusBody(
                'current', current_message(current), '', current_values(current)).encode()))
        return diagnostic_array(estimate.time, self._base, statuses)

    def _state(self) -> bytes:
        estimate = self._estimate
        return self._joints.encode(estimate.time, [dof.v_hat for dof in estimate.dofs],
                                   [dof.force for dof in estimate.dofs])

    def _twist(self) -> bytes:
        estimate = self._estimate
        # a DOF that is not identified has no velocity here: NaN, not a claim of standing still
        velocity = {dof.dof: dof.velocity for dof in estimate.dofs}
        return self._twists.encode(
            estimate.time, [velocity.get(name, math.nan) for name in DOFS])

    def _current(self) -> bytes:
        current = told(self._estimate.current, self._frames)
        return self._currents.encode(self._estimate.time, (current.x, current.y, 0.0))

    def _current_covariance(self) -> bytes:
        xx, xy, yy = told(self._estimate.current, self._frames).covariance
        return self._covariance_array.encode([(xx, xy), (xy, yy)])

    def _status(self, dof: DofEstimate, stepped: bool) -> tuple[int, bytes]:
        """Return level and status of a DOF; without a step, only ``updated`` is another."""
        known, level, body = self._statuses.get(dof.dof, (None, OK, None))
        if known is not dof or body is None:
            level = ERROR if dof.stale_for > LONG else LEVELS[dof.status]
            body = StatusBody(dof.dof, dof_message(dof), '',
                              _values(dof, self._couplings[dof.dof]), 'updated')
            self._statuses[dof.dof] = dof, level, body
        return level, body.encode(stepped)

    def _model(self) -> bytes:
        """Return ``rov/model``."""
        now, stepped = self._estimate.now, self._estimate.stepped
        rows = []
        for index, dof in enumerate(self._estimate.dofs):
            known, row = self._models.get(dof.dof, (None, []))
            if known is not dof:
                row = model_row(dof, self._couplings[dof.dof], self._coupling_names)
                self._models[dof.dof] = dof, row
            row[AGE], row[UPDATED] = age(dof, now), float(index in stepped)
            rows.append(row)
        return self._model_array.encode(rows)

    def _row_array(self, which: int) -> bytes:
        """Return ``rov/params`` (0) or ``rov/params_std`` (1)."""
        return self._parameters_array.encode([row[which] for row in self._rows.values()])

    def _coupling_array(self, which: int) -> bytes:
        """Return the same of the couplings, NaN where a DOF has no such one."""
        names = self._coupling_names
        return self._couplings_array.encode([
            [row[which].get(name, math.nan) for name in names] for row in self._kappas.values()])


def dof_message(dof: DofEstimate) -> str:
    """Return status and reasons in one line."""
    reasons = dof.reasons
    return f'{dof.status}: {", ".join(reasons)}' if reasons else dof.status


def _values(dof: DofEstimate, couplings: Sequence[str]) -> dict[str, Any]:
    """Return all that ``rov/estimate`` says of a DOF, by key; ``updated`` is put in later."""
    values: dict[str, Any] = {
        **dict(zip(PARAMETERS, dof.parameters)),
        **dict(zip(_STDS, dof.std)),
        **dict(zip(PHYSICAL, physical(dof.parameters))),
        **{key: value for name, interval in dof.intervals.items()
           for key, value in zip(_ENDS[name], interval)},
        'velocity': dof.velocity,
        'v_hat': dof.v_hat,
        'dv': dof.dv,
        'force': dof.force,
        'excitation': dof.excitation,
        'steps': dof.steps,
        'status': dof.status,
        'reasons': ', '.join(dof.reasons),
        'time': dof.time,
        'updated': None,
    }
    for name in ('delay', 'delay_std', 'W'):
        if not math.isnan(getattr(dof, name)):
            values[name] = getattr(dof, name)
    for name, kappa, std in zip(couplings, dof.couplings, dof.couplings_std):
        values[f'kappa_{name}'], values[f'kappa_{name}_std'] = kappa, std
    if dof.stale_for:
        values['age'] = dof.stale_for
    return values


_STDS = [f'{name}_std' for name in PARAMETERS]
_ENDS = {name: (f'{name}_low', f'{name}_high') for name in (*PARAMETERS, *PHYSICAL)}
