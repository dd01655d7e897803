"""From plain values back into objects: the other half of a snapshot."""

from __future__ import annotations

from array import array
from base64 import b64decode
from collections import deque
from collections.abc import Callable
import re
import struct
from typing import Any, NamedTuple

import numpy as np
from rovid_core.snapshot_walk import class_name, Classes, kept, parts

NUMBERS = (bool, int, float)
DTYPE = re.compile(r'[<>|][biuf][1248]')
TYPECODES = 'bBhHiIlLqQfd'

SENSELESS = (AttributeError, IndexError, KeyError, OverflowError, RecursionError, TypeError,
             ValueError, struct.error)
"""What comes of content that no walk has made."""


class SnapshotError(ValueError):
    """A snapshot that does not fit; nothing was put back."""


class _Place(NamedTuple):
    """Where a value goes: what is there at first, and the number under which it is shared."""

    old: Any
    path: str
    number: int | None = None


_NEW = _Place(None, '')


class Build:
    """
    Makes values; what was there from the start is only filled by ``commit``.

    Parameters
    ----------
    classes : Classes
        What can be in a snapshot.

    """

    def __init__(self, classes: Classes) -> None:
        self._classes = classes
        self._fills: list[Callable[[], object]] = []
        self._shared: dict[int, Any] = {}
        self._claimed: set[int] = set()
        self._makers: dict[str, Callable[[Any, _Place], Any]] = {
            'float': _float, 'kept': _kept, 'same': self._same, 'value': self._value,
            'scalar': lambda body, place: _ndarray(body, place)[()], 'ndarray': _ndarray,
            'array': _array, 'list': self._list, 'deque': self._deque, 'dict': self._dict,
            'set': self._set, 'frozenset': self._frozenset, 'object': self._object}

    def into(self, root: object, node: object, path: str) -> None:
        """
        Make ready what a root is to become.

        Raises
        ------
        SnapshotError
            If the node was not made of an object that was made like it.

        """
        try:
            if self._make(node, _Place(root, path)) is not root:
                raise SnapshotError(f'{path} is another kind of thing')
        except SnapshotError:
            raise
        except SENSELESS as error:
            raise SnapshotError(
                f'{path} makes no sense: {type(error).__name__} {error}') from None

    def commit(self) -> None:
        """Fill what was there from the start; nothing of this can fail."""
        for fill in self._fills:
            fill()

    def _make(self, node: Any, place: _Place) -> Any:
        """Return the value that a node stands for."""
        if node is None or type(node) in (*NUMBERS, str):
            return node
        if type(node) is list:
            old = place.old if type(place.old) is tuple else ()
            return tuple(self._items(node, old, place.path))
        number = node.get('shared')
        (kind,) = node.keys() - {'shared'}
        made = self._makers[kind](node[kind], place._replace(number=number))
        if number is not None:
            self._shared.setdefault(number, made)
        return made

    def _items(self, nodes: list[Any], old: Any, path: str) -> list[Any]:
        olds = [*old, *[None] * len(nodes)]
        return [self._make(node, _Place(before, f'{path}[{i}]'))
                for i, (node, before) in enumerate(zip(nodes, olds))]

    def _target(self, kind: type, place: _Place, new: Callable[[], Any]) -> tuple[Any, bool]:
        """Return what is to be filled, and whether it was there from the start."""
        was_there = type(place.old) is kind and id(place.old) not in self._claimed
        target = place.old if was_there else new()
        if was_there:
            self._claimed.add(id(target))
        if place.number is not None:  # what is inside can lead back here
            self._shared[place.number] = target
        return target, was_there

    def _fill(self, was_there: bool, fill: Callable[[], object]) -> None:
        if was_there:
            self._fills.append(fill)
        else:
            fill()

    def _same(self, body: Any, place: _Place) -> Any:
        return self._shared[body]

    def _value(self, body: Any, place: _Place) -> Any:
        name, *values = body
        cls = self._classes[name][0]
        names = parts(cls)
        if not names or len(values) != len(names):
            raise SnapshotError(f'{place.path} is no {name}')
        return cls(*[self._make(x, _Place(getattr(place.old, part, None), place.path))
                     for x, part in zip(values, names)])

    def _list(self, body: Any, place: _Place) -> Any:
        target, was_there = self._target(list, place, list)
        items = self._items(body, target, place.path)
        self._fill(was_there, lambda: target.__setitem__(slice(None), items))
        return target

    def _deque(self, body: Any, place: _Place) -> Any:
        longest, content = body
        if type(place.old) is deque and place.old.maxlen != longest:
            place = place._replace(old=None)
        target, was_there = self._target(deque, place, lambda: deque(maxlen=longest))
        items = self._items(content, (), place.path)
        self._fill(was_there, lambda: (target.clear(), target.extend(items)))
        return target

    def _dict(self, body: Any, place: _Place) -> Any:
        target, was_there = self._target(dict, place, dict)
        items: dict[Any, Any] = {}
        for key_node, node in body:
            key = self._make(key_node, _NEW)
            items[key] = self._make(node, _Place(target.get(key), f'{place.path}[{key!r}]'))
        self._fill(was_there, lambda: (target.clear(), target.update(items)))
        return target

    def _set(self, body: Any, place: _Place) -> Any:
        target, was_there = self._target(set, place, set)
        items = set(self._items(body, (), place.path))
        self._fill(was_there, lambda: (target.clear(), target.update(items)))
        return target

    def _frozenset(self, body: Any, place: _Place) -> Any:
        return frozenset(self._items(body, (), place.path))

    def _object(self, body: Any, place: _Place) -> Any:
        name, content = body
        cls, known = self._classes[name]
        target, was_there = self._target(cls, place, lambda: object.__new__(cls))
        olds, new = dict(vars(target)), {}
        expected = [olds.keys()] if was_there else known
        if parts(cls) or expected and frozenset(content) not in expected:
            raise SnapshotError(f'{place.path} is no {name} of this version')
        for attribute, node in content.items():
            path, before = f'{place.path}.{attribute}', olds.get(attribute)
            new[attribute] = self._make(node, _Place(before, path))
            if not _alike(before, new[attribute]):
                raise SnapshotError(f'{path} is not {class_name(type(before))}')
        self._fill(was_there, lambda: (vars(target).clear(), vars(target).update(new)))
        return target


def _alike(before: Any, after: Any) -> bool:
    """Tell whether an attribute can have become one from the other."""
    return (before is None or after is None or type(before) is type(after)
            or type(before) in NUMBERS and type(after) in NUMBERS)


def _float(body: Any, place: _Place) -> float:
    value: float = struct.unpack('>d', bytes.fromhex(body))[0]
    return value


def _kept(body: Any, place: _Place) -> Any:
    if not body or kept(place.old) != body:
        raise SnapshotError(f'{place.path} is not {body}')
    return place.old


def _array(body: Any, place: _Place) -> Any:
    code, content = body
    if code not in TYPECODES:
        raise SnapshotError(f'{place.path} is an array of {code}')
    made = array(code)
    made.frombytes(b64decode(content, validate=True))
    return made


def _ndarray(body: Any, place: _Place) -> Any:
    dtype, shape, order, content = body
    if not DTYPE.fullmatch(dtype) or order not in ('C', 'F'):
        raise SnapshotError(f'{place.path} is an array of {dtype}')
    flat = np.frombuffer(b64decode(content, validate=True), dtype)
    return flat.reshape(tuple(shape), order=order).copy(order=order)
