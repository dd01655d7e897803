"""Logs with every message changed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from rovid_ros.logs.writer import LogWriter
from rovid_ros.messages.types import standard_types

Message = tuple[str, str, dict[str, Any], int]  # topic, type, fields, time [ns]


def rewritten(log: Path, path: Path, change: Callable[[Message], Message | None]) -> Path:
    """Write a log anew with every message changed; None leaves it out."""
    store = standard_types()
    with log.open('rb') as file, LogWriter(path) as writer:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            data = store.deserialize_cdr(message.data, schema.name)
            new = change((channel.topic, schema.name, plain(data), message.log_time))
            if new is not None:
                writer.write(*new, new[3])
    return path


def plain(value: Any) -> Any:
    """Return a decoded message as nested dicts."""
    if hasattr(value, '__msgtype__'):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__
                if not name.isupper() and name != '__msgtype__'}
    return value
