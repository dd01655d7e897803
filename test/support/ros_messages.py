"""Objects of rclpy's message classes, made of plain values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rovid_ros.node.transport.message_types import import_type, split_array


def fill(cls: Any, fields: Mapping[str, Any]) -> Any:
    """Return a message of ``cls`` with nested plain ``fields``; missing ones stay default."""
    message = cls()
    kinds = cls.get_fields_and_field_types()
    for name, value in fields.items():
        base, brackets = split_array(kinds[name])
        if '/' in base:
            inner = import_type(base)
            value = [fill(inner, one) for one in value] if brackets else fill(inner, value)
        elif base == 'octet' and not brackets:
            value = bytes([value])
        setattr(message, name, value)
    return message
