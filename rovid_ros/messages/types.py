"""Message types without ROS: definitions, decoders, and messages built from plain values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
import re
import struct
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import (
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
    Stores,
    TypesysError,
)
from rosbags.typesys.store import Typestore
from rovid_ros.messages.field_paths import FieldError, nearest
import zstandard

Decoder = Callable[[bytes], Any]
# Types of common vehicles that do not come with ROS 2.
WELL_KNOWN = {
    'mavros_msgs/msg/RCOut': 'std_msgs/Header header\nuint16[] channels\n',
    'mavros_msgs/msg/OverrideRCIn': 'uint16[18] channels\n'}
# [bytes] What is larger is refused before it is decoded; what is of use has 1 kB
MAX_MESSAGE_SIZE = 1 << 20
MAX_DEFINITION = 1 << 17  # [characters] of a type with all that is in it; large ones have 20,000
MAX_VALUES = 100_000  # numbers and texts in a message whose sequences are empty
MAX_DEPTH = 32  # messages within messages
_NOTHING = 'structure_needs_at_least_one_member'  # in ROS 1 it does without
RULE = '=' * 80 + '\n'  # between the definitions of a type and of those in it
_ZERO = {'string': '', 'bool': False, 'float32': 0.0, 'float64': 0.0}  # others: 0


class WireType(NamedTuple):
    """How messages are written: their type, its definitions, and ``cdr`` or ``ros1``."""

    store: Typestore
    name: str
    encoding: str


class EndlessTypeError(ValueError):
    """A definition that no message needs; the text says why."""


class TypeUnknownError(ValueError):
    """A message type whose definition is not at hand or cannot be used."""


@cache
def standard_types() -> Typestore:
    """Return the types that come with ROS 2, and those that are well known."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, definition in WELL_KNOWN.items():
        store.register(get_types_from_msg(definition, name))
    return store


def normalised(name: str) -> str:
    """Return a type's name as ROS 2 writes it: ``std_msgs/String`` has no ``msg`` in ROS 1."""
    return name.replace('/', '/msg/', 1) if name.count('/') == 1 else name


@cache
def typestore(name: str, definition: str, idl: bool = False) -> Typestore:
    """
    Return a store that has the type, which is named as by ``normalised``.

    The definition has those of the types in it; '' takes what ROS 2 has. ``idl`` tells whether it
    is IDL. Raises TypeUnknownError if there is no definition or it makes no sense.
    """
    problem = ('no definition of it is at hand; where it is installed, ros2 bag convert to MCAP '
               'writes it into the log')
    if definition:
        try:
            return _defined(name, definition, idl)
        except (TypesysError, KeyError, ValueError, RecursionError) as error:
            reason = str(error).strip() or type(error).__name__
            problem = f'its definition is of no use ({reason.splitlines()[0]})'
    if name in standard_types().fielddefs:
        return standard_types()
    raise TypeUnknownError(f'type {name}: {problem}')


def _defined(name: str, definition: str, idl: bool) -> Typestore:
    """Return a store with what a log defines, which must not take all memory."""
    if len(definition) > MAX_DEFINITION:
        raise EndlessTypeError(f'it has {len(definition):,} characters')
    definition = definition.replace('\r\n', '\n').replace('\ufeff', '')  # as somebody's editor
    store = get_typestore(Stores.EMPTY)
    if not idl:
        store.register(get_types_from_msg(definition, name))
    else:
        for part in definition.split(RULE):  # rosbag2 also puts one in front
            text = re.sub(r'\AIDL: .*\n|^#include .*\n', '', part, flags=re.MULTILINE)
            if text.strip():
                store.register(get_types_from_idl(text))
    _count_values(store, name, (), {})
    store.get_msgdef(name)
    return store


def _count_values(store: Typestore, name: str, within: tuple[str, ...], known: dict[str, int]
                  ) -> int:
    """
    Return how many values a blank message holds, a sequence counted as one.

    ``within`` are the types around it, ``known`` what was counted before. Raises EndlessTypeError
    if it holds too many, or itself, or sequences of something that takes no bytes, and KeyError if
    the store lacks a type.
    """
    if name in within:
        raise EndlessTypeError(f'{name} is in itself')
    if len(within) >= MAX_DEPTH:
        raise EndlessTypeError(f'more than {MAX_DEPTH} messages within each other')
    if name not in known:
        total = 0
        for field, (node, detail) in store.fielddefs[name][1]:
            if field != _NOTHING:
                total += _count_field(store, node, detail, (*within, name), known)
        if total > MAX_VALUES:
            raise EndlessTypeError(f'more than {MAX_VALUES:,} values in {name}')
        known[name] = total
    return known[name]


def _count_field(store: Typestore, node: Nodetype, detail: Any, within: tuple[str, ...],
                 known: dict[str, int]) -> int:
    if node == Nodetype.NAME:
        return _count_values(store, detail, within, known)
    if node == Nodetype.BASE:
        return 1
    (inner, inner_detail), size = detail
    each = _count_field(store, inner, inner_detail, within, known)
    if node == Nodetype.ARRAY:
        return each * int(size)
    if each == 0:
        raise EndlessTypeError('a sequence of nothing')
    return 1


def decoder(store: Typestore, name: str, encoding: str) -> Decoder:
    """Return the function from the bytes of a ``cdr`` or ``ros1`` message to a dataclass."""
    if encoding == 'ros1':
        return lambda data: store.deserialize_ros1(data, name)

    def decode(data: bytes) -> Any:
        if data[:1] == b'\x28':  # zstd: rosbag2 can compress each message by itself
            data = zstandard.ZstdDecompressor().stream_reader(data).read(MAX_MESSAGE_SIZE + 1)
            if len(data) > MAX_MESSAGE_SIZE:
                raise ValueError(f'more than {MAX_MESSAGE_SIZE:,} bytes')
        return _deserialized(store, name, data)

    return decode


def _deserialized(store: Typestore, name: str, data: bytes) -> Any:
    """Decode a message, whatever follows it: rclpy hands out all that ROS made room for."""
    if data[:2] not in (b'\0\0', b'\0\1') or len(data) < 4:
        raise SerdeError('invalid or unsupported CDR encapsulation')
    message = store.get_msgdef(name)
    read = message.deserialize_cdr_le if data[1] else message.deserialize_cdr_be
    try:
        return read(data[4:], 0, message.cls, store)[0]
    except (struct.error, UnicodeDecodeError, ValueError) as error:
        raise SerdeError(str(error)) from None


def build(store: Typestore, name: str, fields: Mapping[str, Any]) -> Any:
    """
    Return a message made from plain values; raises FieldError if the type has no such field.

    Values are by field name, mappings for messages in it; those left out get their default. A
    mapping from index to value stands for an array with defaults in between.
    """
    return _builder(store, name)(fields)


Maker = Callable[[Any], Any]  # plain value, None for the default, to the value in a message


@cache
def _builder(store: Typestore, name: str) -> Maker:
    """Return the function that makes a message; it is kept, as looking up fields is slow."""
    makers = {field: _maker(store, kind) for field, kind in store.fielddefs[name][1]}
    if name == 'geometry_msgs/msg/Quaternion':  # by default, as in ROS 2, it turns nothing
        makers['w'] = lambda value: 1.0 if value is None else value
    message: type[Any] = store.types[name]

    def make(fields: Mapping[str, Any] | None) -> Any:
        given = fields or {}
        if not given.keys() <= makers.keys():
            field = next(field for field in given if field not in makers)
            raise FieldError(name, f'has no field {field!r}, it has {", ".join(makers)}'
                                   f'{nearest(field, list(makers))}')
        return message(*[maker(given.get(field)) for field, maker in makers.items()])

    return make


def _maker(store: Typestore, kind: Any) -> Maker:
    node, detail = kind
    if node == Nodetype.NAME:
        return _builder(store, detail)
    if node == Nodetype.BASE:
        zero = _ZERO.get(detail[0], 0)
        return lambda value: zero if value is None else value
    entry, size = detail
    make = _maker(store, entry)
    dtype = None
    if entry[0] == Nodetype.BASE and entry[1][0] != 'string':
        dtype = {'byte': 'uint8', 'octet': 'uint8', 'char': 'uint8'}.get(entry[1][0], entry[1][0])

    def make_array(value: Any) -> Any:
        length = 0 if node == Nodetype.SEQUENCE else size
        if isinstance(value, Mapping):
            length = max(length, *(index + 1 for index in value))
            value = [value.get(index) for index in range(length)]
        values = [make(one) for one in ([None] * length if value is None else value)]
        return values if dtype is None else np.array(values, dtype=dtype)

    return make_array
