"""ROS message types by name: import them, write their definition down."""

from __future__ import annotations

import difflib
from functools import cache
from importlib import import_module
import re
from typing import Any

from rovid_ros.messages.types import normalised, RULE

# Primitive types whose name in rclpy is not that in a .msg file.
DEFINITION_NAMES = {
    'boolean': 'bool', 'octet': 'byte', 'float': 'float32', 'double': 'float64'}


class MessageTypeError(ValueError):
    """A message type that cannot be imported; the text names it."""


@cache
def import_type(name: str) -> type[Any]:
    """
    Return the message class of ``package/msg/Name`` (or ``package/Name``).

    Raises MessageTypeError if it is not the name of a type, or not installed.
    """
    parts = normalised(name).split('/')
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
    texts: dict[str, str] = {}  # by type
    queue = [name]
    while queue:
        inner = queue.pop(0)
        if inner not in texts:
            cls = import_type(inner)
            texts[inner] = _fields_text(cls)
            queue += _nested(cls)
    own = texts.pop(name)
    return RULE.join([own, *(f'MSG: {inner}\n{text}' for inner, text in texts.items())])


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
