"""What the inputs take at the end of a field path, and how a path goes on to it."""

from __future__ import annotations

from array import array
from numbers import Real
from typing import Any

import numpy as np
from rovid_ros.messages.field_paths import describe, field_names, FieldError, parse, Step, walk

_ACCEPTED = {
    'position': ('vector', 'array'),
    'depth': ('number',),
    'attitude': ('quaternion', 'number'),
    'angular_velocity': ('vector', 'array'),
    'velocity': ('vector', 'array'),
    'reference': ('twist', 'vector'),
    'thrusters': ('array', 'number', 'wrench'),
    'sign': ('array', 'number'),
}
_WANTED = {
    'vector': 'x, y and z', 'array': 'an array of numbers', 'number': 'a number',
    'quaternion': 'a quaternion', 'twist': 'a twist', 'wrench': 'a wrench',
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

    Returns
    -------
    steps : list
        The whole way.
    value : object
        What is there.
    shape : str
        vector, quaternion, twist, wrench, array or number.

    """
    steps = parse(path, key)
    value = walk(message, steps, path, key)
    while (shape := _shape(value)) not in _ACCEPTED[input]:
        there = field_names(value)
        name = next((name for name in _DESCENT[input] if name in there), None)
        if name is None:
            wanted = ' or '.join(_WANTED[kind] for kind in _ACCEPTED[input])
            has = f', which has {", ".join(there)}' if there else ''
            raise FieldError(
                key, f'{path!r} of {describe(message)} is {describe(value)}{has}; '
                     f'{input} takes {wanted}')
        steps.append(name)
        value = getattr(value, name)
    return steps, value, shape


def _shape(value: Any) -> str:
    names = field_names(value)
    if {'x', 'y', 'z'}.issubset(names):
        return 'quaternion' if 'w' in names else 'vector'
    if {'linear', 'angular'}.issubset(names):
        return 'twist'
    if {'force', 'torque'}.issubset(names):
        return 'wrench'
    if isinstance(value, np.ndarray):
        return 'array' if value.dtype.kind in 'iuf' else ''
    if isinstance(value, array):
        return 'array'
    if isinstance(value, (list, tuple)):
        return 'array' if value and all(_shape(entry) == 'number' for entry in value) else ''
    # numpy's scalars are registered as real numbers; a bool is one in Python
    return 'number' if isinstance(value, Real) and not isinstance(value, bool) else ''
