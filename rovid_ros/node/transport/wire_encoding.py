"""ROS message types by name: import them, write their definition down, encode messages."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping, Sequence
import difflib
from functools import cache, lru_cache
from importlib import import_module
import re
import struct
import sys
from typing import Any

# Primitive types whose name in rclpy is not that in a .msg file.
DEFINITION_NAMES = {
    'boolean': 'bool', 'octet': 'byte', 'float': 'float32', 'double': 'float64'}

Append = Callable[[bytearray, Any], None]  # appends a value to the bytes of a message
_LITTLE = sys.byteorder == 'little'
_ENCAPSULATION = bytes((0, int(_LITTLE), 0, 0))  # of CDR; alignment counts from behind it
_FORMATS = {
    'boolean': '?', 'octet': 'B', 'char': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h',
    'uint16': 'H', 'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float': 'f',
    'double': 'd'}
_PADDING = tuple(bytes(count) for count in range(8))
_COUNT = struct.Struct('=I').pack


class MessageTypeError(ValueError):
    """A message type that cannot be imported; the text names it."""


@cache
def import_type(name: str) -> type[Any]:
    """
    Return the message class of ``package/msg/Name`` (or ``package/Name``).

    Raises MessageTypeError if it is not the name of a type, or not installed.
    """
    parts = name.split('/')
    if len(parts) == 2:
        parts.insert(1, 'msg')
    if len(parts) != 3 or not all(part.isidentifier() for part in parts):
        raise MessageTypeError(f'got {name!r}, takes a message type such as sensor_msgs/msg/Imu')
    package, folder, short = parts
    try:
        module = import_module(f'{package}.{folder}')
    except ImportError as error:
        raise MessageTypeError(
            f'message type {name} is not installed here ({error}); install the ROS package '
            f'{package} and source its workspace') from None
    found = getattr(module, short, None)
    if found is None:
        near = difflib.get_close_matches(short, [n for n in dir(module) if n[0].isupper()], 1)
        hint = f'; did you mean {package}/{folder}/{near[0]}?' if near else ''
        raise MessageTypeError(f'package {package} has no message type {name}{hint}')
    assert isinstance(found, type)
    return found


@cache
def definition(name: str) -> str:
    """Return the definition of a type and all that it contains, as a log carries it."""
    sections = [_fields_text(import_type(name))]
    seen: list[str] = []
    queue = _nested(import_type(name))
    while queue:
        inner = queue.pop(0)
        if inner in seen:
            continue
        seen.append(inner)
        sections.append(f'MSG: {inner}\n{_fields_text(import_type(inner))}')
        queue += _nested(import_type(inner))
    return ('=' * 80 + '\n').join(sections)


def _fields_text(cls: type[Any]) -> str:
    lines = []
    for name, text in cls.get_fields_and_field_types().items():
        base, array = split_array(text)
        base = re.sub(r'<(\d+)>', r'<=\1', DEFINITION_NAMES.get(base, base))
        lines.append(f'{base}{array} {name}\n')
    return ''.join(lines)


def _nested(cls: type[Any]) -> list[str]:
    types = [split_array(text)[0] for text in cls.get_fields_and_field_types().values()]
    return [name for name in types if '/' in name]


def split_array(text: str) -> tuple[str, str]:
    """Split ``sequence<double, 3>`` into the element and what a .msg file puts behind it."""
    if found := re.fullmatch(r'sequence<(.+?)(?:, (\d+))?>', text):
        element, bound = found.groups()
        return element, f'[<={bound}]' if bound else '[]'
    if found := re.fullmatch(r'(.+)(\[\d+\])', text):
        return found.group(1), found.group(2)
    return text, ''


def encoded(name: str, fields: Mapping[str, Any]) -> bytes:
    """
    Encode a message to the bytes that rclpy would send.

    ``fields`` are its nested fields, every one of the type.
    """
    out = bytearray(_ENCAPSULATION)
    _message(name)(out, fields)
    return bytes(out)


@cache
def _message(name: str) -> Append:
    """Return what appends a message of a type; cached, as looking its fields up is slow."""
    appends = [(field, _field(text))
            for field, text in import_type(name).get_fields_and_field_types().items()]

    def append(out: bytearray, fields: Mapping[str, Any]) -> None:
        for field, append_field in appends:
            append_field(out, fields[field])

    return append


def _field(text: str) -> Append:
    base, brackets = split_array(text)
    append = _value(base)
    if not brackets:
        return append
    names = _string_fields(base)
    if names and brackets == '[]':
        return _append_strings(names)
    counted = not brackets[1:-1].isdigit()
    form = _FORMATS.get(base)

    def append_array(out: bytearray, values: Any) -> None:
        if counted:
            _append_count(out, len(values))
        if form is None:
            for value in values:
                append(out, value)
        elif len(values):
            out += _PADDING[(4 - len(out)) % struct.calcsize(form)]
            out += array(form, values).tobytes()

    return append_array


def _string_fields(base: str) -> list[str]:
    """Return the fields of a type that consists of strings, otherwise none."""
    if '/' not in base:
        return []
    kinds = import_type(base).get_fields_and_field_types()
    return list(kinds) if set(kinds.values()) == {'string'} else []


def _append_strings(names: Sequence[str]) -> Append:
    """Return what appends messages of strings, such as the values of a status."""
    def append(out: bytearray, values: Sequence[Mapping[str, str]]) -> None:
        _append_count(out, len(values))
        texts = [value[name] for value in values for name in names]
        if texts:
            out += b''.join(map(_padded, texts[:-1]))
            out += _string(texts[-1])

    return append


def _value(base: str) -> Append:
    if '/' in base:
        return _message(base)
    if base not in _FORMATS:
        return _append_string
    pack, size = struct.Struct(f'={_FORMATS[base]}').pack, struct.calcsize(_FORMATS[base])

    def append(out: bytearray, value: float) -> None:
        out += _PADDING[(4 - len(out)) % size]
        out += pack(value)

    return append


def _append_count(out: bytearray, count: int) -> None:
    out += _PADDING[-len(out) % 4]
    out += _COUNT(count)


def _append_string(out: bytearray, text: str) -> None:
    out += _PADDING[-len(out) % 4]
    out += _string(text)


@lru_cache(maxsize=4096)
def _string(text: str) -> bytes:
    """Return a string with its length; cached, as most stay from message to message."""
    raw = text.encode()
    return _COUNT(len(raw) + 1) + raw + b'\0'  # the zero at the end counts


@lru_cache(maxsize=4096)
def _padded(text: str) -> bytes:
    """Return a string with its length, padded for another string to follow."""
    raw = _string(text)
    return raw + _PADDING[-len(raw) % 4]
