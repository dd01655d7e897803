"""Fast functions from a message to the plain floats of a sample, in FLU, ENU and SI units."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from operator import attrgetter
from typing import Any

from rovid_core.dofs import Quaternion
from rovid_core.rotation import from_yaw, product
from rovid_core.settings import Settings
from rovid_ros.field_paths import describe, field_names, FieldError, getter, Step, walk
from rovid_ros.field_values import resolve

Floats = tuple[float, ...]
Reader = Callable[[Any], Floats]

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
class Source:
    """Where an input's samples come from; one topic of several is a ``part``."""

    input: str
    topic: str
    type: str
    field: str
    stamp: str
    latency: int  # [ns]
    part: int

    @property
    def key(self) -> str:
        """Return the section of the parameter file."""
        return 'thrusters.sign' if self.input == 'sign' else self.input


def reader(source: Source, message: Any, settings: Settings, blank: bool = False) -> Reader:
    """
    Return the function that reads a source's value from messages like this one.

    A message that is ``blank`` holds default values only: an array in it that is not empty
    always has that length.

    Raises
    ------
    FieldError
        If the path does not lead to something that the input takes.
    MissingIndexError
        If the path indexes an array that is too short in this message.

    """
    key = f'{source.key}.field'
    steps, value, shape = resolve(source.input, source.field, message, key)
    get = getter(steps)
    if source.input in ('thrusters', 'sign'):
        return _commands(source, shape, get, _joint_names(source, steps, message, settings),
                         _expected(source, shape, value if blank else (), settings),
                         settings)
    if source.input == 'depth':
        scale, offset = settings.depth_scale, settings.depth_offset
        return lambda message: (scale * float(get(message)) + offset,)
    if source.input == 'attitude':
        read = _heading(settings) if shape == 'number' else _quaternion(settings)
        return lambda message: read(get(message))
    if source.input == 'position':
        return _vector(get, shape, _ned_to_enu if settings.frames == 'ned' else None)
    turn = _frd_to_flu if settings.frames == 'ned' else None
    if shape == 'twist':
        linear = _vector(getter([*steps, 'linear']), 'vector', turn)
        angular = _vector(getter([*steps, 'angular']), 'vector', turn)
        return lambda message: linear(message) + angular(message)
    if source.input == 'reference':
        linear = _vector(get, shape, turn)
        return lambda message: linear(message) + _NAN3
    return _vector(get, shape, turn)


def _vector(get: Reader, shape: str, turn: Callable[[Any, Any, Any], Floats] | None) -> Reader:
    xyz = attrgetter('x', 'y', 'z')

    def read(message: Any) -> Floats:
        value = get(message)
        if shape == 'vector':
            x, y, z = xyz(value)
        else:
            x, y, z = _numbers(value, 3)
        return (float(x), float(y), float(z)) if turn is None else turn(x, y, z)

    return read


def _ned_to_enu(x: float, y: float, z: float) -> Floats:
    return (float(y), float(x), -float(z))


def _frd_to_flu(x: float, y: float, z: float) -> Floats:
    return (float(x), -float(y), -float(z))


def _quaternion(settings: Settings) -> Callable[[Any], Quaternion]:
    """Return the conversion of body to world, both turned where the messages are in NED."""
    ned = settings.frames == 'ned'
    offset = from_yaw(settings.yaw_offset) if settings.yaw_offset else None
    xyzw = attrgetter('x', 'y', 'z', 'w')

    def read(value: Any) -> Quaternion:
        x, y, z, w = map(float, xyzw(value))
        q = (x, y, z, w)
        if ned:
            # (1, 1, 0, 0)/sqrt(2) takes NED to ENU, (1, 0, 0, 0) takes FLU to FRD
            s = _ROOT_HALF
            q = (s * (x + y), s * (x - y), s * (w - z), s * (w + z))
        return q if offset is None else product(offset, q)

    return read


def _heading(settings: Settings) -> Callable[[Any], Quaternion]:
    """Return the conversion of a heading; a NED one counts clockwise from north."""
    unit = math.pi / 180.0 if settings.heading_unit == 'deg' else 1.0
    sign, zero = (-1.0, 0.5 * math.pi) if settings.frames == 'ned' else (1.0, 0.0)
    zero += settings.yaw_offset

    def read(value: Any) -> Quaternion:
        yaw = zero + sign * unit * float(value)
        return from_yaw(yaw) if math.isfinite(yaw) else _NO_ATTITUDE

    return read


def _commands(source: Source, shape: str, get: Callable[[Any], Any],
              joint_names: Callable[[Any], Any] | None, count: int,
              settings: Settings) -> Reader:
    """Return the reader of thruster values: a wrench, one number, or an array of them."""
    if shape == 'wrench':
        turn = _frd_to_flu if settings.frames == 'ned' else None
        force = _vector(lambda message: get(message).force, 'vector', turn)
        torque = _vector(lambda message: get(message).torque, 'vector', turn)
        return lambda message: force(message) + torque(message)
    if shape == 'number':
        return lambda message: (float(get(message)),)
    if joint_names is None:
        return lambda message: _numbers(get(message), count)
    names = settings.thrusters.names

    def read(message: Any) -> Floats:
        there = joint_names(message)
        values = _numbers(get(message), len(there))
        try:
            return tuple([values[there.index(name)] for name in names])
        except ValueError:
            raise RefusedError('missing_name') from None

    return read


def _numbers(value: Any, count: int) -> Floats:
    try:
        if len(value) != count:
            raise RefusedError('wrong_length', f'got {len(value)} values, takes {count}')
        return tuple(map(float, value))
    except (TypeError, ValueError):
        raise RefusedError('not_numeric') from None


def _expected(source: Source, shape: str, value: Any, settings: Settings) -> int:
    """Return how many values one message has to give; refuse what never can."""
    thrusters = settings.thrusters
    count = 1 if len(thrusters.topics) > 1 and source.input == 'thrusters' else thrusters.count
    gives = {'number': 1, 'wrench': 6}.get(shape, count)
    if shape == 'array' and not thrusters.names:
        gives = len(value) or count
    if gives != count:
        hint = f'; pick with [0:{count}]' if gives > count and shape == 'array' else ''
        raise FieldError(
            f'{source.key}.field', f'{source.field!r} gives {gives} values for {count} '
                                   f'thrusters (the length of thrusters.gain){hint}')
    return count


def _joint_names(source: Source, steps: Sequence[Step], message: Any,
                 settings: Settings) -> Callable[[Any], Any] | None:
    """Return how to get the names beside an array, where entries are picked by name."""
    if not settings.thrusters.names:
        return None
    parent = walk(message, steps[:-1], source.field, f'{source.key}.field')
    if 'name' in field_names(parent):
        return getter([*steps[:-1], 'name'])
    if source.input == 'sign':
        return None
    raise FieldError(
        'thrusters.names', f'needs an array name beside {source.field!r}, but '
                           f'{describe(parent)} has {", ".join(field_names(parent))}')
