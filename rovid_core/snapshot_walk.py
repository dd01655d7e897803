"""From objects to plain values: the one half of a snapshot."""

from __future__ import annotations

from array import array
from base64 import b64encode
from collections import deque
from dataclasses import fields, is_dataclass
import math
import struct
from typing import Any

import numpy as np

OWN = 'rovid_'
"""What the packages begin with whose objects are walked."""

Classes = dict[str, tuple[type, set[frozenset[str]]]]
"""What can be in a snapshot, by name: a class and its sets of attributes; none: any."""


def class_name(cls: type) -> str:
    """Return the name of a class in a snapshot."""
    return f'{cls.__module__}.{cls.__qualname__}'


def is_own(cls: type) -> bool:
    """Tell whether a class is of this project."""
    return cls.__module__.startswith(OWN)


def is_state(cls: type) -> bool:
    """Tell whether a class is of this project and not of settings, which stay as they are."""
    return is_own(cls) and not cls.__module__.endswith('settings')


def parts(cls: type) -> tuple[str, ...]:
    """Return the attributes of a frozen value: a dataclass or a named tuple; else nothing."""
    is_mutable = is_dataclass(cls) and not getattr(cls, '__dataclass_params__').frozen  # noqa: B009
    return () if is_mutable else attributes(cls)


def attributes(cls: type) -> tuple[str, ...]:
    """Return the attributes that a dataclass or a named tuple says it has; else nothing."""
    if is_dataclass(cls):
        return tuple([field.name for field in fields(cls)])
    return tuple(getattr(cls, '_fields', ())) if issubclass(cls, tuple) else ()


def kept(value: object) -> str:
    """Return what stays as it is: the class of settings, 'code', or '' for state."""
    if is_own(type(value)):
        return '' if is_state(type(value)) else class_name(type(value))
    return 'code' if callable(value) else ''


class Walk:
    """
    Goes through objects by their attributes.

    Parameters
    ----------
    classes : Classes
        What can be in a snapshot.
    learning : bool
        Whether to add to them what is met, not to refuse it.

    """

    def __init__(self, classes: Classes, learning: bool = False) -> None:
        self._classes = classes
        self._learning = learning
        self._met: dict[int, tuple[dict[str, Any], object]] = {}  # by id; keeps them alive
        self._owners: dict[int, int] = {}
        self._shared = 0

    def plain(self, value: Any, path: str) -> Any:
        """
        Return a value as JSON can have it.

        Raises
        ------
        TypeError
            If it could not come back.

        """
        kind = type(value)
        if value is None or kind in (bool, int, str):
            return value
        if kind is float:  # a NaN has bits too
            return value if math.isfinite(value) else {'float': struct.pack('>d', value).hex()}
        if kind is tuple:
            return [self.plain(x, f'{path}[{i}]') for i, x in enumerate(value)]
        if kept(value):
            return {'kept': kept(value)}
        if isinstance(value, np.generic):
            return {'scalar': _bits(np.asarray(value), path)}
        if is_own(kind) and (names := parts(kind)):
            self._note(kind, frozenset(names), path)
            return {'value': [class_name(kind), *(
                self.plain(getattr(value, name), f'{path}.{name}') for name in names)]}
        if id(value) in self._met:
            return self._again(self._met[id(value)][0])
        node: dict[str, Any] = {}
        self._met[id(value)] = node, value
        node.update(self._mutable(value, path))
        return node

    def _again(self, node: dict[str, Any]) -> dict[str, Any]:
        if 'shared' not in node:
            self._shared += 1
            node['shared'] = self._shared
        return {'same': node['shared']}

    def _mutable(self, value: Any, path: str) -> dict[str, Any]:
        kind = type(value)
        if kind is list:
            return {'list': self.plain(tuple(value), path)}
        if kind is deque:
            return {'deque': [value.maxlen, self.plain(tuple(value), path)]}
        if kind is dict:
            return {'dict': [
                [self.plain(key, f'a key of {path}'), self.plain(x, f'{path}[{key!r}]')]
                for key, x in value.items()]}
        if kind in (set, frozenset):  # their own order differs from process to process
            return {kind.__name__: sorted((self.plain(x, path) for x in value), key=repr)}
        if kind is array:
            return {'array': [value.typecode, b64encode(value.tobytes()).decode()]}
        if kind is np.ndarray:
            self._check_owner(value, path)
            return {'ndarray': _bits(value, path)}
        if not is_own(kind) or not hasattr(value, '__dict__'):
            raise TypeError(f'{path} is {class_name(kind)}, which a snapshot cannot hold')
        self._note(kind, frozenset(vars(value)), path)
        return {'object': [class_name(kind), {
            name: self.plain(x, f'{path}.{name}') for name, x in vars(value).items()}]}

    def _note(self, kind: type, attributes: frozenset[str], path: str) -> None:
        name = class_name(kind)
        if self._learning:
            self._classes.setdefault(name, (kind, set()))[1].add(attributes)
        if name not in self._classes:
            raise TypeError(f'{path} is {name}, which nothing at first could have made: it '
                            'would not come back')
        known = self._classes[name][1]
        if known and attributes not in known:
            odd = attributes ^ min(known, key=lambda x: len(x ^ attributes))
            raise TypeError(f'{path} has not always had the same attributes: '
                            f'{", ".join(sorted(odd))}')

    def _check_owner(self, value: Any, path: str) -> None:
        """Refuse two arrays in one memory: they would come back in two."""
        owner = value
        while isinstance(owner.base, np.ndarray):
            owner = owner.base
        if self._owners.setdefault(id(owner), id(value)) != id(value):
            raise TypeError(f'{path} is a view of another array')


def _bits(value: Any, path: str) -> list[Any]:
    """Return type, shape, order in memory, on which later results depend, and bytes."""
    if not value.flags.forc or value.dtype.kind not in 'biuf':
        raise TypeError(f'{path} is an array that a snapshot cannot hold')
    order = 'C' if value.flags.c_contiguous else 'F'
    return [value.dtype.str, list(value.shape), order, b64encode(value.tobytes(order)).decode()]
