"""
Field paths, such as ``pose.pose.position`` or ``channels[0:8]``, into messages of any type.

Several with commas between them, such as ``C1, C2``, are an array of the numbers there. They work
alike on rclpy's message objects and on the dataclasses that a log is decoded to.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
import dataclasses
import difflib
from numbers import Real
from operator import attrgetter, itemgetter
import re
from typing import Any

import numpy as np
from rovid_core.settings.inputs import SettingsError

Step = str | int | slice

GEOGRAPHIC = ('latitude', 'longitude', 'altitude')
"""Fields of a position on the earth, [deg] and [m]."""

_MOST_COMPARED = 1000
_LONGEST_NAME = 256

_STEP = re.compile(r'\.?([A-Za-z]\w*)|\[(\d{1,9})(:(\d{1,9}))?\]')


class FieldError(SettingsError):
    """A field path that the message type does not have, or that leads to something of no use."""


class MissingIndexError(LookupError):
    """The message at hand has fewer entries than the path asks for; another may have more."""


def parse(path: str, key: str) -> list[Step]:
    """Return the steps of a path; raises FieldError when it is not one."""
    steps: list[Step] = []
    position = 0
    while position < len(path):
        match = _STEP.match(path, position)
        if not match or (match[0].startswith('.') is (position == 0) and match[1]):
            raise FieldError(
                key, f'{path!r} is not a field path; one looks like a.b, a[0] or a[0:4]')
        if match[1]:
            steps.append(match[1])
        elif match[3]:
            steps.append(slice(int(match[2]), int(match[4])))
        else:
            steps.append(int(match[2]))
        position = match.end()
    return steps


def walk(message: Any, steps: Sequence[Step], path: str, key: str) -> Any:
    """
    Follow the steps into a message.

    Raises FieldError, which names the type and its fields, if a field is not there, and
    MissingIndexError if this message's array is too short.
    """
    value = message
    for step in steps:
        if isinstance(step, str):
            if step not in field_names(value):
                raise FieldError(key, _no_field(value, step, path))
            value = getattr(value, step)
        else:
            try:
                value = value[step]
            except IndexError:
                raise MissingIndexError(
                    f'{path!r} is beyond the end of {len(value)} entries') from None
            except TypeError:
                raise FieldError(
                    key, f'{path!r}: {describe(value)} has no entries to index') from None
    return value


def parse_all(path: str, key: str) -> list[list[Step]]:
    """Return the steps of each path of a list; a path alone is a list of one."""
    return [parse(part.strip(), key) for part in path.split(',')]


def getter(steps: Sequence[Step]) -> Callable[[Any], Any]:
    """Return a fast function from a message to the value at the end of the steps."""
    gets: list[Callable[[Any], Any]] = []
    names: list[str] = []
    for step in [*steps, None]:
        if isinstance(step, str):
            names.append(step)
            continue
        if names:
            gets.append(attrgetter('.'.join(names)))
            names = []
        if step is not None:
            gets.append(itemgetter(step))
    if len(gets) == 1:
        return gets[0]

    def get(value: Any) -> Any:
        for one in gets:
            value = one(value)
        return value

    return get


def field_names(message: Any) -> tuple[str, ...]:
    """Return the names of a message's fields; none for a number, a text or an array."""
    if hasattr(message, 'get_fields_and_field_types'):
        return tuple(message.get_fields_and_field_types())
    if dataclasses.is_dataclass(message):
        # a log's dataclasses have constants too; what has no default is a field
        return tuple(field.name for field in dataclasses.fields(message)
                     if field.default is dataclasses.MISSING)
    return ()


def describe(value: Any) -> str:
    """Return the type of a value, as ROS writes it where it is a message."""
    if hasattr(value, '__msgtype__'):
        return str(value.__msgtype__)
    if hasattr(value, 'get_fields_and_field_types'):
        cls = type(value)
        return f'{cls.__module__.partition(".")[0]}/msg/{cls.__name__}'
    if isinstance(value, str):
        return 'a text'
    if isinstance(value, (bool, np.bool_)):
        return 'true or false'
    if isinstance(value, Real):
        return 'a number'
    return 'an array' if hasattr(value, '__len__') else type(value).__name__


def nearest(name: str, there: Sequence[str]) -> str:
    """Return '' or '; did you mean ...?' for a name that is not there."""
    # in a foreign log there can be any number of names of any length, and this takes its time
    few = [one for one in there[:_MOST_COMPARED] if len(one) <= _LONGEST_NAME]
    near = difflib.get_close_matches(name[:_LONGEST_NAME], few, 1, 0.5)
    return f'; did you mean {near[0]!r}?' if near else ''


def _no_field(value: Any, name: str, path: str) -> str:
    there = field_names(value)
    if not there:
        return f'{path!r}: {describe(value)} has no field {name!r}'
    return (f'{path!r}: {describe(value)} has no field {name!r}, it has {", ".join(there)}'
            f'{nearest(name, there)}')


_ACCEPTED = {
    'position': ('vector', 'array', 'geographic'),
    'depth': ('number',),
    'attitude': ('quaternion', 'number', 'array'),
    'angular_velocity': ('vector', 'array'),
    'velocity': ('vector', 'array'),
    'reference': ('twist', 'vector'),
    'thrusters': ('array', 'number', 'wrench'),
    'sign': ('array', 'number'),
}
_WANTED = {
    'vector': 'x, y and z', 'array': 'an array of numbers', 'number': 'a number',
    'quaternion': 'a quaternion', 'geographic': 'latitude, longitude and altitude',
    'twist': 'a twist', 'wrench': 'a wrench',
}
# Where a path ends above what the input takes, it goes on by the first of these that is there.
_DESCENT = {
    'position': ('position', 'point', 'pose', 'transform', 'translation', 'vector'),
    'depth': ('data',),
    'attitude': ('orientation', 'quaternion', 'pose', 'transform', 'rotation', 'data'),
    'angular_velocity': ('angular', 'angular_velocity', 'twist', 'vector'),
    'velocity': ('linear', 'velocity', 'twist', 'vector'),
    'reference': ('twist', 'velocity', 'vector'),
    'thrusters': ('wrench', 'data'),
    'sign': ('data',),
}


def resolve(input: str, path: str, message: Any, key: str) -> tuple[list[Step], Any, str]:
    """
    Follow a path, and on from there to the next thing that the input takes.

    Return the whole way, the value there and its shape: vector, quaternion, geographic, twist,
    wrench, array or number.
    """
    steps = parse(path, key)
    value = walk(message, steps, path, key)
    while (shape := shape_of(value)) not in _ACCEPTED[input]:
        there = field_names(value)
        name = next((name for name in _DESCENT[input] if name in there), None)
        if name is None:
            has = f', which has {", ".join(there)}' if there else ''
            raise FieldError(
                key, f'{path!r} of {describe(message)} is {describe(value)}{has}; '
                     f'{_takes(input)}')
        steps.append(name)
        value = getattr(value, name)
    return steps, value, shape


def resolve_all(input: str, path: str, message: Any, key: str) -> list[list[Step]]:
    """Return the ways to the numbers of a list of paths, which together are an array."""
    if 'array' not in _ACCEPTED[input]:
        raise FieldError(key, f'{path!r} is a list; {_takes(input)}')
    ways = parse_all(path, key)
    for steps in ways:
        value = walk(message, steps, path, key)
        if shape_of(value) != 'number':
            raise FieldError(key, f'{path!r}: a list of paths takes a number at each, '
                                  f'got {describe(value)}')
    return ways


def _takes(input: str) -> str:
    return f'{input} takes {" or ".join(_WANTED[kind] for kind in _ACCEPTED[input])}'


def shape_of(value: Any) -> str:
    """Return vector, quaternion, geographic, twist, wrench, array or number; '' for others."""
    names = field_names(value)
    if {'x', 'y', 'z'}.issubset(names):
        return 'quaternion' if 'w' in names else 'vector'
    if {*GEOGRAPHIC}.issubset(names):
        return 'geographic'
    if {'linear', 'angular'}.issubset(names):
        return 'twist'
    if {'force', 'torque'}.issubset(names):
        return 'wrench'
    if isinstance(value, np.ndarray):
        return 'array' if value.dtype.kind in 'iuf' else ''
    if isinstance(value, array):
        return 'array'
    if isinstance(value, (list, tuple)):
        return 'array' if value and all(shape_of(entry) == 'number' for entry in value) else ''
    # numpy's scalars are registered as real numbers; a bool is one in Python
    return 'number' if isinstance(value, Real) and not isinstance(value, bool) else ''
