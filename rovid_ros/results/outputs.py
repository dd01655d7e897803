"""The messages of an estimate, serialised: the node sends the bytes, a log holds the same."""

from __future__ import annotations

from collections.abc import Collection, Iterator
import math
from typing import NamedTuple

from rovid_core.identify.estimate import DofEstimate, Estimate
from rovid_core.model.dofs import DOFS, PARAMETERS
from rovid_core.settings.run import Scales, Settings
from rovid_ros.results.current import current_message, current_values, told
from rovid_ros.results.dof_encoder import DofEncoder, model_columns
from rovid_ros.results.wire_encoding import (
    ArrayEncoder,
    begin_stamped,
    DiagnosticEncoder,
    JointStateEncoder,
    StampedEncoder,
    status_body,
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
        names, self._frames, base = settings.dofs, settings.frames, settings.base_frame
        own = [settings.couplings(name) for name in names]
        couplings = tuple(dict.fromkeys(name for some in own for name in some))
        self._nothing = Estimate(0, tuple([
            DofEstimate(name, Scales.of(settings.dof[name]).initial, couplings=(0.0,) * len(some))
            for name, some in zip(names, own)]), ())
        self._dofs = [DofEncoder(dof, some, couplings)
                      for dof, some in zip(self._nothing.dofs, own)]
        self._parameters_array = ArrayEncoder(names, PARAMETERS)
        self._couplings_array = ArrayEncoder(names, couplings)
        self._model_array = ArrayEncoder(names, model_columns(couplings))
        self._covariance_array = ArrayEncoder('xy', 'xy')
        self._joints = JointStateEncoder(base, names)
        self._twists = StampedEncoder(base, len(DOFS))
        self._diagnostics = DiagnosticEncoder(base)
        self._currents = StampedEncoder(WORLD_FRAMES[self._frames], 3)
        self._has_current = settings.estimates_current
        self.topics = {**TOPICS, **(COUPLING_TOPICS if couplings else {}),
                       **(CURRENT_TOPICS if self._has_current else {})}
        # a DOF that is not identified has no velocity: NaN, not a claim of standing still
        self._velocity = [math.nan] * len(DOFS)
        self._places = [DOFS.index(name) for name in names]
        self._estimate, self._begin = self._nothing, begin_stamped(0)

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
        self._take(estimate)
        for topic in topics:
            yield self._output(topic)

    def encoded(self, estimate: Estimate, topics: Collection[str]) -> list[bytes]:
        """Return the bytes of the same, for who writes them all."""
        self._take(estimate)
        return [self._encode(topic) for topic in topics]

    def reset(self) -> list[Output]:
        """Go back to the initial values; return the messages that say so without a step."""
        self._take(self._nothing)
        return self.latched([topic for topic in LATCHED if topic in self.topics])

    def latched(self, topics: Collection[str]) -> list[Output]:
        """Return the messages of ``LATCHED`` topics as they are after the last estimate."""
        return [self._output(topic) for topic in topics]

    def _take(self, estimate: Estimate) -> None:
        self._estimate = estimate
        self._begin = begin_stamped(estimate.time)
        for encoder, dof in zip(self._dofs, estimate.dofs):
            encoder.take(dof)

    def _output(self, topic: str) -> Output:
        return Output(topic, self.topics[topic], self._encode(topic))

    def _encode(self, topic: str) -> bytes:
        """Return the message of a topic."""
        dofs = self._dofs
        if topic == 'rov/params':
            return self._parameters_array.encode([dof.parameters for dof in dofs])
        if topic == 'rov/params_std':
            return self._parameters_array.encode([dof.std for dof in dofs])
        if topic == 'rov/identifier_state':
            return self._state()
        if topic == 'rov/velocity':
            return self._twist()
        if topic == 'rov/model':
            return self._model()
        if topic == 'rov/estimate':
            return self._status()
        if topic == 'rov/couplings':
            return self._couplings_array.encode([dof.kappas for dof in dofs])
        if topic == 'rov/couplings_std':
            return self._couplings_array.encode([dof.kappas_std for dof in dofs])
        current = told(self._estimate.current, self._frames)
        if topic == 'rov/current':
            return self._currents.encode(self._begin, (current.x, current.y, 0.0))
        xx, xy, yy = current.covariance
        array = self._covariance_array
        return array.encode([array.row((xx, xy)), array.row((xy, yy))])

    def _state(self) -> bytes:
        dofs = self._estimate.dofs
        return self._joints.encode(
            self._begin, [dof.v_hat for dof in dofs], [dof.force for dof in dofs])

    def _twist(self) -> bytes:
        for place, dof in zip(self._places, self._estimate.dofs):
            self._velocity[place] = dof.velocity
        return self._twists.encode(self._begin, self._velocity)

    def _model(self) -> bytes:
        now, stepped = self._estimate.now, self._estimate.stepped
        return self._model_array.encode([
            dof.model(now, index in stepped) for index, dof in enumerate(self._dofs)])

    def _status(self) -> bytes:
        stepped = self._estimate.stepped
        statuses = [
            (ERROR if dof.stale_for > LONG else LEVELS[dof.status],
             self._dofs[index].status(index in stepped))
            for index, dof in enumerate(self._estimate.dofs)]
        if self._has_current:
            current = told(self._estimate.current, self._frames)
            statuses.append((CURRENT_LEVELS[current.status], status_body(
                'current', current_message(current), '', current_values(current))))
        return self._diagnostics.encode(self._begin, statuses)
