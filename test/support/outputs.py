"""Output messages decoded by rosbags, which knows nothing of the encoder under test."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from rovid_ros.messages.types import standard_types
from rovid_ros.results.outputs import Output


def message_of(output: Output) -> Any:
    """Return the message; its bytes have to be the ones that rosbags would write."""
    store = standard_types()
    message = store.deserialize_cdr(output.cdr, output.type)
    assert bytes(store.serialize_cdr(message, output.type)) == output.cdr
    return message


def fields_of(output: Output) -> dict[str, Any]:
    """Return the same as nested dicts and lists of plain values."""
    fields = _plain(message_of(output))
    assert isinstance(fields, dict)
    return fields


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name))
                for field in dataclasses.fields(value) if field.name != '__msgtype__'}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [_plain(entry) for entry in value] if isinstance(value, list) else value
