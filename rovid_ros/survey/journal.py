"""What a survey has finished, a line of JSON each: an interrupted one goes on from there."""

from __future__ import annotations

from collections.abc import Mapping
import hashlib
import json
import os
from pathlib import Path
from typing import Any, TypeAlias

from rovid_ros import __version__
from rovid_ros.survey.dives import stamps
from rovid_ros.survey.table import Row

Rows: TypeAlias = list[Row]


def journal_of(table: Path) -> Path:
    """Return where the finished dives of a table are kept."""
    return table.with_name(f'{table.name}.dives.jsonl')


class Journal:
    """
    The finished dives beside a table, by log, configuration and version of rovid.

    It stays there: a survey of more dives computes only the new ones. Without a path nothing is
    kept. Who has one keeps other surveys from the file.

    Parameters
    ----------
    path : Path or None
        The file.
    run : mapping
        All that decides the result beside the log: parameters, method, part.

    """

    def __init__(self, path: Path | None, run: Mapping[str, Any]) -> None:
        self._path = path
        self._run = json.dumps([__version__, dict(run)], sort_keys=True, default=str)
        self._known: dict[str, Rows] = {}
        if path and path.exists():
            self._read(path)

    def rows(self, log: Path) -> Rows | None:
        """Return the rows of a dive that was finished before and is still the same."""
        key = self._key(log)
        return self._known.get(key) if key else None

    def add(self, log: Path, rows: Rows) -> None:
        """Note a finished dive; it outlasts a loss of power."""
        key = self._key(log)
        if self._path and key:
            with self._path.open('a', encoding='utf-8') as file:
                file.write(json.dumps({'key': key, 'rows': rows}, allow_nan=False) + '\n')
                file.flush()
                os.fsync(file.fileno())

    def _read(self, path: Path) -> None:
        """Read it, and cut off a last line that was not finished."""
        whole = 0
        with path.open('rb') as file:
            for line in file:
                if not line.endswith(b'\n'):
                    break
                whole += len(line)
                try:
                    entry = json.loads(line)
                    self._known[entry['key']] = list(entry['rows'])
                except (ValueError, LookupError, TypeError, RecursionError):
                    continue  # a damaged line costs its dive only
        if whole < path.stat().st_size:
            os.truncate(path, whole)

    def _key(self, log: Path) -> str:
        """Return what names a dive as it is now; '' for one that is not there."""
        try:
            found = [os.path.realpath(log), str(log), stamps(log), self._run]
        except OSError:
            return ''
        return hashlib.sha256(json.dumps(found).encode()).hexdigest()
