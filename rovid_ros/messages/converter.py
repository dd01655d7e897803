"""
Messages of any type to events in body FLU, world ENU and SI units.

This is the one place that knows about ROS conventions: field paths, stamps, NED and FRD.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
import math
from operator import attrgetter
from typing import Any, cast

from rovid_core.model.dofs import Quaternion, Vector
from rovid_core.model.samples import Event, Sample
from rovid_core.settings.run import Settings, SettingsError
from rovid_core.velocity.attitude_history import from_angles, from_yaw, product, rotate
from rovid_ros.config.parameters import Source, sources
from rovid_ros.messages.field_paths import (
    describe,
    field_names,
    FieldError,
    GEOGRAPHIC,
    getter,
    MissingIndexError,
    nearest,
    resolve,
    resolve_all,
    Step,
    walk,
)
from rovid_ros.messages.geographic import LocalMetres
from rovid_ros.messages.serialised_layout import find_layout, NoLayoutError
from rovid_ros.messages.types import standard_types, WireType

# Layouts to look for on one topic: where they change that often, they are of no use.
MAX_ATTEMPTS = 100
# Where the time of a message with a header is.
STAMP = ('header.stamp.sec', 'header.stamp.nanosec')
Floats = tuple[float, ...]
Turn = Callable[[Any, Any, Any], Floats]

_NAN3 = (math.nan, math.nan, math.nan)
_NO_ATTITUDE = (math.nan, math.nan, math.nan, math.nan)
_ROOT_HALF = math.sqrt(0.5)


class RefusedError(Exception):
    """A message that gives no sample; ``detail`` says what it got and what it takes."""

    def __init__(self, reason: str, detail: str = '') -> None:
        super().__init__(reason)
        self.reason = reason
        self.detail = detail


@dataclass(frozen=True, slots=True)
class Reading:
    """Which fields of a message a sample needs, and how its value is made of them."""

    # to the fields that are needed: numbers, or arrays of numbers or texts
    paths: tuple[tuple[Step, ...], ...]
    make: Callable[..., Floats]  # takes what is at the paths and returns the sample's value

    def fetch(self) -> Callable[[Any], tuple[Any, ...]]:
        """Return the function from a decoded message to what is at the paths."""
        names = [step for path in self.paths for step in path]
        if len(self.paths) > 1 and all(isinstance(name, str) for name in names):
            get: Callable[[Any], tuple[Any, ...]] = attrgetter(
                *['.'.join(map(str, path)) for path in self.paths])
            return get
        gets = [getter(path) for path in self.paths]
        return lambda message: tuple([get(message) for get in gets])


@dataclass(frozen=True, slots=True)
class Access:
    """How a source is read from messages of one class, or serialised in one layout."""

    source: Source
    reading: Reading
    # from the message to what the reading makes the value of
    fetch: Callable[[Any], tuple[Any, ...]]
    # from the message to seconds and nanoseconds; None for the receive time
    stamp: Callable[[Any], tuple[int, int]] | None

    def value(self, message: Any) -> tuple[float, ...]:
        """Return the value of a sample."""
        return self.reading.make(*self.fetch(message))


class Converter:
    """
    Turns messages into events.

    Parameters
    ----------
    count : callable
        Called with (input, reason) for what a message lacks: ``missing_index``,
        ``missing_name``, ``wrong_length`` and ``not_numeric`` give no sample,
        ``zero_stamp`` gives one at the receive time.

    Attributes
    ----------
    topics : dict of str to str
        The type of each topic to read; '' takes whatever it has.
    details : dict
        For some of what was counted, by (input, reason), what was wrong the first time.

    Raises
    ------
    SettingsError
        If two inputs expect one topic to have different types.

    """

    def __init__(self, settings: Settings, count: Callable[[str, str], None]) -> None:
        self.topics: dict[str, str] = {}
        self.details: dict[tuple[str, str], str] = {}
        self._settings = settings
        self._count = count
        self._sources: dict[str, list[Source]] = {}
        self._accesses: dict[tuple[str, type], list[Access]] = {}
        for source in sources(settings):
            self._sources.setdefault(source.topic, []).append(source)
            known = self.topics.setdefault(source.topic, source.type)
            if source.type and known and source.type != known:
                raise _type_conflict(source, next(
                    other for other in self._sources[source.topic] if other.type == known))
            self.topics[source.topic] = known or source.type

    def events(self, topic: str, message: Any, receive_time: int,
               origin: Any = None) -> list[Event]:
        """
        Convert a message, of rclpy or the dataclass that a log is decoded to.

        Return one event per time, which is one unless inputs differ in latency or stamp. Raises
        FieldError if the type of the message has no field that is configured.
        """
        accesses = self._accesses.get((topic, type(message)))
        if accesses is None:
            accesses = self._compile(topic, message)
        return self.read(accesses, message, receive_time, origin)

    def accesses(self, topic: str, message: Any) -> list[Access]:
        """Return how messages of this class are read; empty if the last one lacked a field."""
        return self._accesses.get((topic, type(message)), [])

    def read(self, accesses: Sequence[Access], message: Any, receive_time: int,
             origin: Any = None) -> list[Event]:
        """Return the events of a message, as in ``events``."""
        events: list[Event] = []
        for access in accesses:
            source = access.source
            try:
                value = access.reading.make(*access.fetch(message))
            except RefusedError as refused:
                self._refuse(source, refused.reason, refused.detail)
                continue
            except IndexError:
                self._refuse(source, 'missing_index', f'{source.field!r} is beyond the end')
                continue
            time = receive_time
            if access.stamp is not None:
                seconds, nanoseconds = access.stamp(message)
                if seconds or nanoseconds:
                    time = seconds * 1_000_000_000 + nanoseconds
                else:
                    self._count(source.input, 'zero_stamp')
            # in the order of the fields: by their names it would take twice as long
            events.append(Event(
                time - source.latency, (Sample(source.input, value, source.part),), origin))
        return events if len(events) < 2 else _merged_by_time(events, origin)

    def check_type(self, topic: str, blank: Any) -> None:
        """
        Refuse settings that do not fit a topic's type, before any message comes.

        ``blank`` is a message of the type with default values only. Raises FieldError, which names
        the input, the path, the type and the fields that are there.
        """
        for source in self._sources.get(topic, ()):
            _has_stamp(source, blank)
            try:
                _reading(source, blank, self._settings, blank=True)
            except MissingIndexError:  # what an empty array would hold is not known yet
                pass

    def _compile(self, topic: str, message: Any) -> list[Access]:
        sources = self._sources.get(topic, [])
        accesses = []
        for source in sources:
            stamp = attrgetter(*STAMP) if _has_stamp(source, message) else None
            try:
                found = _reading(source, message, self._settings)
            except MissingIndexError as missing:
                self._refuse(source, 'missing_index', str(missing))
            else:
                accesses.append(Access(source, found, found.fetch(), stamp))
        if len(accesses) == len(sources):
            self._accesses[topic, type(message)] = accesses
        return accesses

    def _refuse(self, source: Source, reason: str, detail: str) -> None:
        self._count(source.input, reason)
        if detail and (source.input, reason) not in self.details:
            self.details[source.input, reason] = f'{source.section}.field: {detail}'


class Unpacker:
    """
    Make events of the serialised messages of one topic.

    A message is decoded as a whole, and converted, unless it has the layout of one that was:
    then its values are read from where they were, to the same bits. What cannot be decoded is
    left to the decoder, also a message that lacks its end; what ``decode`` raises is passed on.
    """

    def __init__(self, converter: Converter, topic: str, wire: WireType,
                 decode: Callable[[bytes], Any]) -> None:
        self._converter = converter
        self._topic = topic
        self._wire = wire
        self._decode = decode
        self._left = MAX_ATTEMPTS
        self._known: dict[int, _Known] = {}  # by the length of the message

    def events(self, data: bytes, receive_time: int, origin: Any = None) -> list[Event]:
        """Convert a message."""
        known = self._known.get(len(data))
        if known is not None:
            fits, shape, accesses = known
            if fits(data) == shape:
                return self._converter.read(accesses, data, receive_time, origin)
        message = self._decode(data)
        events = self._converter.events(self._topic, message, receive_time, origin)
        if self._left:
            self._left -= 1
            self._learn(data, message)
        return events

    def _learn(self, data: bytes, message: Any) -> None:
        """Remember the layout of a message, if it gives what the whole message gives."""
        decoded = self._converter.accesses(self._topic, message)
        if not decoded:
            return
        try:
            layout = find_layout(self._wire, data)
            stamp = layout.fetch([name.split('.') for name in STAMP]) if any(
                access.stamp for access in decoded) else None
            accesses = [
                replace(access, fetch=layout.fetch(access.reading.paths),
                        stamp=stamp if access.stamp else None) for access in decoded]
        except NoLayoutError:
            return
        if [_comparable(access, data) for access in accesses] == [
                _comparable(access, message) for access in decoded]:
            self._known[len(data)] = layout.fits, layout.fits(data), accesses


_Known = tuple[Callable[[bytes], tuple[Any, ...]], tuple[Any, ...], list[Access]]


def _comparable(access: Access, message: Any) -> str:
    """Return value and stamp, or the refusal, as text that can be compared."""
    try:
        value: Any = access.value(message)
    except (RefusedError, IndexError) as refused:
        value = refused
    return repr((value, access.stamp(message) if access.stamp else None))


def _merged_by_time(events: Sequence[Event], origin: Any) -> list[Event]:
    """Return one event per time."""
    times: dict[int, tuple[Sample, ...]] = {}
    for event in events:
        times[event.time] = times.get(event.time, ()) + event.samples
    return [Event(time=time, samples=samples, origin=origin) for time, samples in times.items()]


def _has_stamp(source: Source, message: Any) -> bool:
    """Return whether the time is that of the header, and not the receive time."""
    if source.stamp == 'receive':
        return False
    header = getattr(message, 'header', None)
    if 'header' in field_names(message) and 'stamp' in field_names(header):
        return True
    if source.stamp == 'header':
        raise FieldError(
            f'{source.section}.stamp', f"is 'header', but {describe(message)} has none, it has "
                                   f"{', '.join(field_names(message))}; use 'receive'")
    return False


def _type_conflict(one: Source, other: Source) -> SettingsError:
    """Return the error for two types of one topic; one that ROS does not know is at fault."""
    types = standard_types().fielddefs
    if other.type not in types and one.type in types:
        one, other = other, one
    hint = '' if one.type in types else nearest(one.type, [other.type, *types])
    return SettingsError(
        f'{one.section}.type', f'is {one.type}, but {other.section}.type reads {one.topic} as '
                           f'{other.type}{hint}')


def _reading(source: Source, message: Any, settings: Settings, blank: bool = False) -> Reading:
    """Return how to read a source's value from messages like this, ``blank`` or with data."""
    key = f'{source.section}.field'
    if ',' in source.field:
        ways = resolve_all(source.input, source.field, message, key)
        make = _of_array(source, len(ways), settings)
        return Reading(tuple(map(tuple, ways)), lambda *values: make(values))
    steps, value, shape = resolve(source.input, source.field, message, key)
    commands = source.input in ('thrusters', 'sign')
    length = len(value) if blank and shape == 'array' else 0
    if shape == 'array' and not (commands and settings.thrusters.names):
        make = _of_array(source, length, settings)
        return _unless_not_estimated(message, steps, Reading((tuple(steps),), make))
    if commands:
        count = _command_count(source, shape, length, settings)
        return _commands(source, shape, steps, _names_path(source, steps, message, settings),
                         count, settings)
    if source.input == 'depth':
        scale, offset = settings.depth_scale, settings.depth_offset
        return Reading((tuple(steps),), lambda value: (scale * float(value) + offset,))
    if source.input == 'attitude':
        if shape == 'number':
            return Reading((tuple(steps),), _heading(settings))
        attitude = Reading(_component_paths(steps, 'xyzw'), _quaternion(settings))
        return _unless_not_estimated(message, steps, attitude)
    if shape == 'geographic':
        return _geographic(message, steps)
    turn = _turn(source.input, settings)
    if shape == 'twist':
        return _pair(steps, ('linear', 'angular'), turn)
    vector = _component_paths(steps, 'xyz')
    if source.input == 'reference':
        return Reading(vector, lambda x, y, z: turn(x, y, z) + _NAN3)
    return _unless_not_estimated(message, steps, Reading(vector, turn))


def _of_array(source: Source, length: int, settings: Settings) -> Callable[[Any], Floats]:
    """Return how to make a value of an array of this length, 0 if it is open."""
    if source.input in ('thrusters', 'sign'):
        count = _command_count(source, 'array', length, settings)
        return lambda value: _numbers(value, count)
    if source.input == 'attitude':
        return _attitude_of_numbers(settings)
    turn = _turn(source.input, settings)
    if length == 2 and source.input in ('position', 'velocity'):
        if settings.source('heave') == source.input and 'heave' in settings.dofs:
            raise FieldError(f'{source.section}.field', f'{source.field!r} has no z, which heave '
                                                        'needs')

        def of_plane(value: Any) -> Floats:  # of what stays at the surface
            x, y = _numbers(value, 2)
            return turn(x, y, 0.0)

        return of_plane
    return lambda value: turn(*_numbers(value, 3))


def _turn(name: str, settings: Settings) -> Turn:
    """Return the turn of a vector to ENU (of a position) or FLU (of all others)."""
    ned = settings.frames_of(name) == 'ned'
    if name == 'position':
        return _ned_to_enu if ned else _floats
    turn = _frd_to_flu if ned else _floats
    mounting = settings.input(name).mounting
    if not any(mounting):
        return turn
    sensor = from_angles(*mounting)
    return lambda x, y, z: rotate(sensor, cast(Vector, turn(x, y, z)))


def _unless_not_estimated(message: Any, steps: Sequence[Step], reading: Reading) -> Reading:
    """Refuse what the sensor does not estimate; sensor_msgs/Imu says so by a covariance of -1."""
    if not steps:
        return reading
    name = f'{steps[-1]}_covariance'
    if name not in field_names(getter(steps[:-1])(message)):
        return reading

    def make(variance: Any, *values: Any) -> Floats:
        if variance == -1.0:
            raise RefusedError('not_estimated')
        return reading.make(*values)

    return Reading(((*steps[:-1], name, 0), *reading.paths), make)


def _geographic(message: Any, steps: Sequence[Step]) -> Reading:
    """Return how to read latitude and longitude, which are the same whatever the frames are."""
    position = Reading(tuple([(*steps, name) for name in GEOGRAPHIC]), LocalMetres())
    status = (*steps, 'status', 'status')  # of a NavSatFix
    if 'status' not in field_names(getter(steps)(message)):
        return position

    def make(status: Any, *values: Any) -> Floats:
        if status < 0:
            raise RefusedError('not_estimated')
        return position.make(*values)

    return Reading((status, *position.paths), make)


def _component_paths(steps: Sequence[Step], names: Sequence[str]) -> tuple[tuple[Step, ...], ...]:
    return tuple([(*steps, name) for name in names])


def _pair(steps: Sequence[Step], names: tuple[str, str], turn: Turn) -> Reading:
    one, other = (_component_paths([*steps, name], 'xyz') for name in names)
    return Reading(one + other, lambda a, b, c, d, e, f: turn(a, b, c) + turn(d, e, f))


def _floats(x: float, y: float, z: float) -> Floats:
    return (float(x), float(y), float(z))


def _four_floats(x: float, y: float, z: float, w: float) -> Quaternion:
    return (float(x), float(y), float(z), float(w))


def _ned_to_enu(x: float, y: float, z: float) -> Floats:
    return (float(y), float(x), -float(z))


def _frd_to_flu(x: float, y: float, z: float) -> Floats:
    return (float(x), -float(y), -float(z))


def _quaternion(settings: Settings) -> Callable[[Any, Any, Any, Any], Quaternion]:
    """Return the conversion of body to world, both turned where the messages are in NED."""
    ned = settings.frames_of('attitude') == 'ned'
    body = _body_of_sensor(settings)
    offset = from_yaw(settings.yaw_offset) if settings.yaw_offset else None
    if not (ned or offset or any(settings.attitude.mounting)):
        return _four_floats

    def read(x: Any, y: Any, z: Any, w: Any) -> Quaternion:
        q = (float(x), float(y), float(z), float(w))
        if ned:
            # (1, 1, 0, 0)/sqrt(2) takes NED to ENU, (1, 0, 0, 0) takes FLU to FRD
            x, y, z, w = q
            s = _ROOT_HALF
            q = (s * (x + y), s * (x - y), s * (w - z), s * (w + z))
        return body(q if offset is None else product(offset, q))

    return read


def _body_of_sensor(settings: Settings) -> Callable[[Quaternion], Quaternion]:
    """Return the turn of the attitude of the sensor to that of the body."""
    mounting = settings.attitude.mounting
    if not any(mounting):
        return lambda q: q
    x, y, z, w = from_angles(*mounting)
    return lambda q: product(q, (-x, -y, -z, w))


def _attitude_of_numbers(settings: Settings) -> Callable[[Any], Quaternion]:
    """Return the conversion of a quaternion x, y, z, w, or of roll, pitch and yaw."""
    quaternion = _quaternion(settings)
    turned = _quaternion(replace(settings, attitude=replace(
        settings.attitude, frames=settings.heading_frames or settings.attitude.frames)))
    unit = math.pi / 180.0 if settings.heading_unit == 'deg' else 1.0

    def read(value: Any) -> Quaternion:
        if len(value) == 4:
            return quaternion(*_numbers(value, 4))
        roll, pitch, yaw = [unit * angle for angle in _numbers(value, 3)]
        if not math.isfinite(roll + pitch + yaw):
            return _NO_ATTITUDE
        return turned(*from_angles(roll, pitch, yaw))

    return read


def _heading(settings: Settings) -> Callable[[Any], Quaternion]:
    """Return the conversion of a heading; a compass counts clockwise from north, as NED does."""
    unit = math.pi / 180.0 if settings.heading_unit == 'deg' else 1.0
    sign, zero = (-1.0, 0.5 * math.pi) if (
        settings.heading_frames or settings.frames_of('attitude')) == 'ned' else (1.0, 0.0)
    zero += settings.yaw_offset
    body = _body_of_sensor(settings)

    def read(value: Any) -> Quaternion:
        yaw = zero + sign * unit * float(value)
        return body(from_yaw(yaw)) if math.isfinite(yaw) else _NO_ATTITUDE

    return read


def _commands(source: Source, shape: str, steps: Sequence[Step],
              joint_names: tuple[Step, ...] | None, count: int, settings: Settings) -> Reading:
    """Return how to read thruster values: a wrench, one number, or an array of them."""
    if shape == 'wrench':
        return _pair(steps, ('force', 'torque'),
                     _frd_to_flu if settings.frames == 'ned' else _floats)
    if shape == 'number':
        return Reading((tuple(steps),), lambda value: (float(value),))
    if joint_names is None:  # a sign without names beside it
        return Reading((tuple(steps),), lambda value: _numbers(value, count))
    return Reading((joint_names, tuple(steps)), _pick_by_name(settings.thrusters.names))


def _pick_by_name(names: Sequence[str]) -> Callable[[Any, Any], Floats]:
    """Return how to pick an array's entries by the names beside it."""
    known: Sequence[str] | None = None  # the names hardly ever change
    places: list[int] = []

    def read(there: Sequence[str], value: Any) -> Floats:
        nonlocal known, places
        values = _numbers(value, len(there))
        if there != known:
            try:
                places = [there.index(name) for name in names]
            except ValueError:
                raise RefusedError('missing_name') from None
            known = there
        return tuple([values[place] for place in places])

    return read


def _numbers(value: Any, count: int) -> Floats:
    try:
        if len(value) != count:
            raise RefusedError('wrong_length', f'got {len(value)} values, takes {count}')
        return tuple(map(float, value))
    except (TypeError, ValueError):
        raise RefusedError('not_numeric') from None


def _command_count(source: Source, shape: str, length: int, settings: Settings) -> int:
    """Return how many commands one message must hold; refuse a field that cannot."""
    thrusters = settings.thrusters
    count = 1 if len(thrusters.topics) > 1 and source.input == 'thrusters' else thrusters.count
    if source.input == 'sign' and shape == 'number':
        return count  # one direction for all
    gives = {'number': 1, 'wrench': 6}.get(shape, count)
    if shape == 'array' and not thrusters.names:
        gives = length or count
    if gives != count:
        hint = f'; pick with [0:{count}]' if gives > count and shape == 'array' else ''
        raise FieldError(
            f'{source.section}.field', f'{source.field!r} gives {gives} values for {count} '
                                   f'thrusters (the length of thrusters.gain){hint}')
    return count


def _names_path(source: Source, steps: Sequence[Step], message: Any,
                 settings: Settings) -> tuple[Step, ...] | None:
    """Return the path to the names beside an array, where entries are picked by name."""
    if not settings.thrusters.names:
        return None
    parent = walk(message, steps[:-1], source.field, f'{source.section}.field')
    if 'name' in field_names(parent):
        return (*steps[:-1], 'name')
    if source.input == 'sign':
        return None
    raise FieldError(
        'thrusters.names', f'needs an array name beside {source.field!r}, but '
                           f'{describe(parent)} has {", ".join(field_names(parent))}')
