"""Messages from plain fields straight to the bytes of the wire, as rclpy would write them."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
import struct
import sys
from typing import Any

from rovid_ros.node.transport.message_classes import import_type, split_array

Put = Callable[[bytearray, Any], None]
"""Appends a value."""

_LITTLE = sys.byteorder == 'little'
_ENCAPSULATION = bytes((0, int(_LITTLE), 0, 0))  # of CDR; alignment counts from behind it
_FORMATS = {
    'boolean': '?', 'octet': 'B', 'char': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h',
    'uint16': 'H', 'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float': 'f',
    'double': 'd'}
_PADDING = tuple(bytes(count) for count in range(8))
_COUNT = struct.Struct('=I').pack


def encoded(name: str, fields: Mapping[str, Any]) -> bytes:
    """Return a message of a type, of nested plain fields, all of which have to be there."""
    out = bytearray(_ENCAPSULATION)
    _message(name)(out, fields)
    return bytes(out)


@cache
def _message(name: str) -> Put:
    """Return what appends a message of a type; looking its fields up takes the time."""
    puts = [(field, _field(text))
            for field, text in import_type(name).get_fields_and_field_types().items()]

    def put(out: bytearray, fields: Mapping[str, Any]) -> None:
        for field, put_one in puts:
            put_one(out, fields[field])

    return put


def _field(text: str) -> Put:
    base, brackets = split_array(text)
    put = _value(base)
    if not brackets:
        return put
    names = _texts(base)
    if names and brackets == '[]':
        return _many_texts(names)
    counted = not brackets[1:-1].isdigit()
    form = _FORMATS.get(base)

    def put_array(out: bytearray, values: Any) -> None:
        if counted:
            _put_count(out, len(values))
        if form is None:
            for value in values:
                put(out, value)
        elif len(values):
            out += _PADDING[(4 - len(out)) % struct.calcsize(form)]
            out += array(form, values).tobytes()

    return put_array


def _texts(base: str) -> list[str]:
    """Return the fields of a type that has only texts, otherwise none."""
    if '/' not in base:
        return []
    kinds = import_type(base).get_fields_and_field_types()
    return list(kinds) if set(kinds.values()) == {'string'} else []


def _many_texts(names: Sequence[str]) -> Put:
    """Return what appends messages that have only texts, such as the values of a status."""
    def put(out: bytearray, values: Sequence[Mapping[str, str]]) -> None:
        _put_count(out, len(values))
        texts = [value[name] for value in values for name in names]
        if texts:
            out += b''.join(map(_padded, texts[:-1]))
            out += _text(texts[-1])

    return put


def _value(base: str) -> Put:
    if '/' in base:
        return _message(base)
    if base not in _FORMATS:
        return _put_text
    pack, size = struct.Struct(f'={_FORMATS[base]}').pack, struct.calcsize(_FORMATS[base])

    def put(out: bytearray, value: float) -> None:
        out += _PADDING[(4 - len(out)) % size]
        out += pack(value)

    return put


def _put_count(out: bytearray, count: int) -> None:
    out += _PADDING[-len(out) % 4]
    out += _COUNT(count)


def _put_text(out: bytearray, text: str) -> None:
    out += _PADDING[-len(out) % 4]
    out += _text(text)


@lru_cache(maxsize=4096)
def _text(text: str) -> bytes:
    """Return a text with its length; most are those of the message before."""
    raw = text.encode()
    return _COUNT(len(raw) + 1) + raw + b'\0'  # the zero at the end counts


@lru_cache(maxsize=4096)
def _padded(text: str) -> bytes:
    """Return the same when another text follows."""
    raw = _text(text)
    return raw + _PADDING[-len(raw) % 4]
