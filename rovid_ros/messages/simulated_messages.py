"""The messages that a vehicle's sensors would have sent: ``converter.py`` backwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any, cast

import numpy as np
from rovid_core.model.dofs import Quaternion, Vector
from rovid_core.settings.run import Settings, SettingsError
from rovid_core.velocity.attitude_history import (
    angles_of,
    from_angles,
    from_yaw,
    product,
    rotate_back,
    yaw_of,
)
from rovid_ros.config.parameters import sources
from rovid_ros.messages.converter import Converter
from rovid_ros.messages.field_paths import (
    GEOGRAPHIC,
    getter,
    parse_all,
    resolve,
    resolve_all,
    Step,
)
from rovid_ros.messages.geographic import metres_per_degree
from rovid_ros.messages.types import build, standard_types

Values = tuple[float, ...]
NED_TO_ENU: Quaternion = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)  # and back: half a turn
FRD_TO_FLU: Quaternion = (1.0, 0.0, 0.0, 0.0)


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
    ways: tuple[tuple[Step, ...], ...]  # one, or one to each number
    shape: str  # as resolve calls it
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

    Raises SimulationError if a type is unknown, and FieldError if a type has nothing at the field
    path that could hold the value.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._converter = Converter(settings, lambda name, reason: None)
        self._topics = [self._topic(topic) for topic in self._converter.topics]

    @property
    def soonest(self) -> int:
        """Return the shortest latency [ns]."""
        return min(topic.latency for topic in self._topics)

    @property
    def whole_commands(self) -> bool:
        """Tell whether the thrusters' commands are sent as whole numbers."""
        return any(place.whole for topic in self._topics for place in topic.places
                   if place.input == 'thrusters')

    def messages(self, time: int, values: Mapping[str, Values]) -> list[SensorMessage]:
        """
        Return the messages of one instant [ns].

        ``values`` has each input that was measured then, in body FLU, world ENU and SI units. A
        topic that serves several inputs is sent when all of them are there.
        """
        return [
            SensorMessage(
                topic.name, topic.type, self._fields(topic, time + topic.latency, values),
                time + topic.latency)
            for topic in self._topics
            if all(place.input in values for place in topic.places)]

    def _topic(self, topic: str) -> _Topic:
        read = [source for source in sources(self._settings) if source.topic == topic]
        type_name = self._converter.topics[topic]
        if type_name not in standard_types().fielddefs:
            raise SimulationError(
                f'{read[0].section}.type', f'got {type_name or "none"}, takes a message type '
                'that comes with ROS 2: rovid simulate knows no others')
        skeleton: dict[str, Any] = {}
        for source in read:
            for way in parse_all(source.field, f'{source.section}.field'):
                _put(skeleton, way, None)
        store = standard_types()
        # there and back, for only a decoded message tells whole numbers from others
        blank = store.deserialize_cdr(
            store.serialize_cdr(build(store, type_name, skeleton), type_name), type_name)
        self._converter.check_type(topic, blank)
        places = []
        for source in read:
            if source.latency != read[0].latency:
                raise SimulationError(
                    f'{source.section}.latency', f'differs from that of {read[0].input}, which '
                    f'comes in the same message on {topic}; rovid simulate sends them at one time')
            key = f'{source.section}.field'
            if ',' in source.field:
                ways = resolve_all(source.input, source.field, blank, key)
                like, shape = getter(ways[0])(blank), 'array'
            else:
                way, like, shape = resolve(source.input, source.field, blank, key)
                ways = [way]
            whole = isinstance(like, int) or (
                isinstance(like, np.ndarray) and like.dtype.kind in 'iu')
            is_part = source.input == 'thrusters' and len(self._settings.thrusters.topics) > 1
            places.append(_Place(
                source.input, source.part if is_part else None, tuple(map(tuple, ways)), shape,
                whole))
        return _Topic(topic, type_name, read[0].latency, hasattr(blank, 'header'),
                      hasattr(blank, 'name'), tuple(places))

    def _fields(self, topic: _Topic, stamp: int, values: Mapping[str, Values]) -> dict[str, Any]:
        fields: dict[str, Any] = {}
        names = self._settings.thrusters.names
        for place in topic.places:
            leaf = self._leaf(place, values[place.input])
            for way, value in zip(place.ways, leaf if len(place.ways) > 1 else [leaf]):
                _put(fields, way, value)
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
            return dict(zip('xyzw', _quaternion(settings, value)))
        if place.shape == 'vector':
            return dict(zip('xyz', _vector(settings, place.input, value)))
        if place.shape == 'geographic':  # of a world that begins where both are 0
            (north, east), (x, y, z) = metres_per_degree(0.0), value[:3]
            return dict(zip(GEOGRAPHIC, (y / north, x / east, z)))
        if place.shape in ('twist', 'wrench'):
            names = ('linear', 'angular') if place.shape == 'twist' else ('force', 'torque')
            return {
                name: dict(zip('xyz', _vector(settings, place.input, part)))
                for name, part in zip(names, (value[:3], value[3:]))}
        if place.input in ('position', 'velocity', 'angular_velocity'):
            numbers: Sequence[float] = _vector(settings, place.input, value)
        elif place.input in ('thrusters', 'sign'):
            numbers = value if place.part is None else (value[place.part],)
        elif place.input == 'attitude' and place.shape == 'array':
            numbers = _quaternion(settings, value) if (
                len(place.ways) == 4) else _angles(settings, value)
        else:
            convert = _heading if place.input == 'attitude' else _depth
            numbers = (convert(settings, value),)
        rounded = [round(x) for x in numbers] if place.whole else [*numbers]
        return rounded[0] if place.shape == 'number' else rounded


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


def _vector(settings: Settings, name: str, value: Values) -> Values:
    """Return x, y, z of a position (world) or of a velocity (body) in the message's frame."""
    ned = settings.frames_of(name) == 'ned'
    if name == 'position':
        x, y, z = value[:3]
        return (y, x, -z) if ned else (x, y, z)
    x, y, z = cast(Vector, value[:3])
    if name != 'thrusters':
        x, y, z = rotate_back(from_angles(*settings.input(name).mounting), (x, y, z))
    return (x, -y, -z) if ned else (x, y, z)


def _quaternion(settings: Settings, value: Values) -> Quaternion:
    """Return the attitude in the message's frames, before ``yaw_offset`` was added."""
    x, y, z, w = value
    turned = product(from_yaw(-settings.yaw_offset), product(
        (x, y, z, w), from_angles(*settings.attitude.mounting)))
    if settings.frames_of('attitude') == 'enu':
        return turned
    return product(product(NED_TO_ENU, turned), FRD_TO_FLU)


def _angles(settings: Settings, value: Values) -> Values:
    """Return roll, pitch and yaw in the message's unit and sense."""
    angles = angles_of(_quaternion(replace(settings, attitude=replace(
        settings.attitude, frames=settings.heading_frames or settings.attitude.frames)), value))
    return tuple(map(math.degrees, angles)) if settings.heading_unit == 'deg' else angles


def _heading(settings: Settings, value: Values) -> float:
    """Return the heading in the message's unit and sense."""
    turned = product(value, from_angles(*settings.attitude.mounting))  # type: ignore[arg-type]
    yaw = yaw_of(turned) - settings.yaw_offset
    frames = settings.heading_frames or settings.frames_of('attitude')
    angle = math.remainder(0.5 * math.pi - yaw if frames == 'ned' else yaw, 2.0 * math.pi)
    return math.degrees(angle) if settings.heading_unit == 'deg' else angle


def _depth(settings: Settings, value: Values) -> float:
    """Return the reading that ``scale`` and ``offset`` turn into this z [m]."""
    return (value[0] - settings.depth_offset) / settings.depth_scale
