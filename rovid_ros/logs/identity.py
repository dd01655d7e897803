"""By what the files of a log are known again, wherever they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import hashlib
from pathlib import Path
from typing import Any

from rovid_ros.logs.log import Log

ENDS = 1 << 16
"""[bytes] at the beginning and at the end that are looked at."""

Identity = Sequence[Mapping[str, Any]]
"""One for each file, in the order of time."""


def identity(log: Log) -> list[dict[str, Any]]:
    """Return path, size and a digest of the beginning and the end of every file."""
    found = []
    for name, path in log.files:
        size = path.stat().st_size
        with path.open('rb') as file:
            both = file.read(ENDS)
            file.seek(max(size - ENDS, 0))
            both += file.read(ENDS)
        found.append({'path': name, 'bytes': size, 'ends': hashlib.sha256(both).hexdigest()})
    return found


def ends(logs: Identity) -> list[tuple[int, str]]:
    """Return what is the same for the same content."""
    return [(one['bytes'], one['ends']) for one in logs]


def names(logs: Identity) -> str:
    """Return the names of the files, without their folders."""
    return ', '.join(Path(one['path']).name for one in logs)
