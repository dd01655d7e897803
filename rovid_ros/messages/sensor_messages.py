"""The messages that a vehicle's sensors would have sent: ``convert.py`` backwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rovid_core.settings.run import InputSettings, Settings, SettingsError, ThrusterSettings
from rovid_ros.messages import sensor_values
from rovid_ros.messages.convert import Converter
from rovid_ros.messages.field_paths import parse, resolve, Step
from rovid_ros.messages.sensor_values import Values
from rovid_ros.messages.types import build, standard_types


class SimulationError(SettingsError):
    """A simulation that cannot be written; the text names the key and says why."""


@dataclass(frozen=True)
class SensorMessage:
    """A message with its topic, type, nested fields and receive time [ns]."""

    topic: str
    type: str
    fields: dict[str, Any]
    time: int


@dataclass(frozen=True)
class _Place:
    """Where an input goes in a message; ``part`` is a thruster when it has its own topic."""

    input: str
    part: int | None
    steps: tuple[Step, ...]
    shape: str  # as field_values.resolve calls it
    whole: bool  # takes whole numbers only


@dataclass(frozen=True)
class _Topic:
    """A topic, with all the inputs that are read from it."""

    name: str
    type: str
    latency: int  # [ns]
    stamped: bool
    named: bool  # a JointState, whose entries have names
    places: tuple[_Place, ...]


class SensorMessages:
    """
    Make messages out of what the simulator says.

    Parameters
    ----------
    settings : Settings
        Topics, types, field paths, frames, units, scales and latencies.

    Raises
    ------
    SimulationError
        If a type is unknown.
    FieldError
        If a type has nothing at the field path that could hold the value.

    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._converter = Converter(settings, lambda name, reason: None)
        self._topics = [self._topic(topic) for topic in self._converter.topics]

    @property
    def soonest(self) -> int:
        """Return the shortest latency [ns]."""
        return min(topic.latency for topic in self._topics)

    def messages(self, time: int, values: Mapping[str, Values]) -> list[SensorMessage]:
        """
        Return the messages of one instant.

        Parameters
        ----------
        time : int
            Event time [ns].
        values : mapping of str to tuple of float
            Value of each input that was measured then, in body FLU, world ENU and SI units.
            A topic that serves several inputs is sent when all of them are there.

        """
        return [
            SensorMessage(
                topic.name, topic.type, self._fields(topic, time + topic.latency, values),
                time + topic.latency)
            for topic in self._topics
            if all(place.input in values for place in topic.places)]

    def _topic(self, topic: str) -> _Topic:
        inputs = _inputs(self._settings, topic)
        type_name = self._converter.topics[topic]
        if type_name not in standard_types().fielddefs:
            raise SimulationError(
                f'{_key(inputs[0][0])}.type', f'got {type_name or "none"}, takes a message type '
                'that comes with ROS 2: rovid simulate knows no others')
        skeleton: dict[str, Any] = {}
        for name, _, given in inputs:
            _put(skeleton, parse(given.field, f'{_key(name)}.field'), None)
        store = standard_types()
        # there and back, for only a decoded message tells whole numbers from others
        blank = store.deserialize_cdr(
            store.serialize_cdr(build(store, type_name, skeleton), type_name), type_name)
        self._converter.check_type(topic, blank)
        places = []
        for name, part, given in inputs:
            if given.latency != inputs[0][2].latency:
                raise SimulationError(
                    f'{_key(name)}.latency', f'differs from that of {inputs[0][0]}, which comes '
                    f'in the same message on {topic}; rovid simulate sends them at one time')
            steps, like, shape = resolve(name, given.field, blank, f'{_key(name)}.field')
            whole = isinstance(like, int) or (
                isinstance(like, np.ndarray) and like.dtype.kind in 'iu')
            places.append(_Place(name, part, tuple(steps), shape, whole))
        return _Topic(topic, type_name, round(inputs[0][2].latency * 1e9),
                      hasattr(blank, 'header'), hasattr(blank, 'name'), tuple(places))

    def _fields(self, topic: _Topic, stamp: int, values: Mapping[str, Values]
                ) -> dict[str, Any]:
        fields: dict[str, Any] = {}
        names = self._settings.thrusters.names
        for place in topic.places:
            _put(fields, place.steps, self._leaf(place, values[place.input]))
            if topic.named and names and place.input in ('thrusters', 'sign'):
                fields['name'] = [*names] if place.part is None else [names[place.part]]
        if topic.stamped:
            sec, nanosec = divmod(stamp, 1_000_000_000)
            fields['header'] = {'stamp': {'sec': sec, 'nanosec': nanosec}}
        return fields

    def _leaf(self, place: _Place, value: Values) -> Any:
        """Return what stands for the value in a field of this shape."""
        settings = self._settings
        if place.shape == 'quaternion':
            return dict(zip('xyzw', sensor_values.quaternion(settings, value)))
        if place.shape == 'vector':
            return dict(zip('xyz', sensor_values.vector(settings, place.input, value)))
        if place.shape in ('twist', 'wrench'):
            names = ('linear', 'angular') if place.shape == 'twist' else ('force', 'torque')
            return {
                name: dict(zip('xyz', sensor_values.vector(settings, name, part)))
                for name, part in zip(names, (value[:3], value[3:]))}
        if place.input in ('position', 'velocity', 'angular_velocity'):
            numbers: Sequence[float] = sensor_values.vector(settings, place.input, value)
        elif place.input in ('thrusters', 'sign'):
            numbers = value if place.part is None else (value[place.part],)
        else:
            numbers = (getattr(sensor_values, {
                'attitude': 'heading', 'depth': 'depth'}[place.input])(settings, value),)
        rounded = [round(x) for x in numbers] if place.whole else [*numbers]
        return rounded[0] if place.shape == 'number' else rounded


def _key(name: str) -> str:
    return 'thrusters.sign' if name == 'sign' else name


def _inputs(settings: Settings, topic: str
            ) -> list[tuple[str, int | None, InputSettings | ThrusterSettings]]:
    """Return what is read from a topic: the input, which part of it, and its settings."""
    found: list[tuple[str, int | None, InputSettings | ThrusterSettings]] = []
    for name in settings.used_inputs():
        if name != 'thrusters':
            if settings.input(name).topic == topic:
                found.append((name, None, settings.input(name)))
            continue
        topics = settings.thrusters.topics
        found += [(name, part if len(topics) > 1 else None, settings.thrusters)
                  for part, one in enumerate(topics) if one == topic]
    return found


def _put(fields: dict[Any, Any], steps: Sequence[Step], value: Any) -> None:
    """Put a value at a path; arrays are mappings from index, as ``build`` takes them."""
    if not steps:
        fields.update(value or {})
        return
    for step in steps[:-1]:
        fields = fields.setdefault(step, {})
    last = steps[-1]
    if isinstance(last, slice):
        indices = range(last.start, last.stop)
        fields.update(zip(indices, [None] * len(indices) if value is None else value))
    elif isinstance(value, dict):
        fields.setdefault(last, {}).update(value)
    else:
        fields[last] = value
