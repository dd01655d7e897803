"""
The table of a survey: a row per dive and DOF, one for a dive that failed.

Beside it stands a journal of what is finished, a line of JSON for each dive: an interrupted survey
goes on from there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import csv
from datetime import datetime, timezone
import hashlib
import io
import json
import os
from pathlib import Path
from typing import Any, TypeAlias

from rovid_core.model.dofs import PARAMETERS, PHYSICAL
from rovid_ros import __version__
from rovid_ros.files.whole_files import write_bytes, write_text
from rovid_ros.results.documents import Result
from rovid_ros.survey.dives import stamps

FAILED = 'failed'  # the status of a dive that gave nothing
TAG = 'tag_'  # what the columns of tags begin with
KAPPA = 'kappa_'  # and those of couplings
THRUSTERS = 'thrusters_'  # and of thrusters as they are found to work
COLUMNS = (
    'log', 'start', 'duration_s', 'method', 'dof', 'status', 'reasons', 'steps', 'fit', 'mae',
    *(f'{name}{end}' for name in PHYSICAL for end in ('', '_low', '_high')),
    *(f'{name}{end}' for name in PARAMETERS for end in ('', '_std')),
    'delay_s', 'delay_std_s', 'current_x', 'current_y', 'current_x_std', 'current_y_std',
    'current_status', 'warnings', 'error')
TEXTS = ('log', 'start', 'method', 'dof', 'status', 'reasons', 'current_status', 'error')
COUNTS = ('steps', 'warnings')

Row: TypeAlias = dict[str, Any]
Rows: TypeAlias = list[Row]


def rows_of(log: Path, result: Result, tags: Mapping[str, str], warnings: int) -> list[Row]:
    """Return the rows of a dive: the numbers of a replay as they are, None where there is none."""
    document = result.document()
    current = {f'current_{name}': value for name, value in (document['current'] or {}).items()}
    start = None if result.start is None else datetime.fromtimestamp(
        result.start // 1000 * 1e-6, timezone.utc).isoformat()
    shared = {'log': str(log), 'start': start, 'duration_s': result.duration,
              'method': document['method'], 'warnings': warnings, 'error': None,
              **{f'{TAG}{name}': value for name, value in tags.items()},
              **{key: value for key, value in current.items() if key in COLUMNS}}
    return [{**shared, 'dof': dof, **_numbers(values)}
            for dof, values in document['dofs'].items()]


def failed(log: Path, error: str) -> list[Row]:
    """Return the row of a dive that gave nothing."""
    return [{'log': str(log), 'status': FAILED, 'error': error}]


def _numbers(values: Mapping[str, Any]) -> Row:
    row = {key: values[key] for key in ('status', 'steps', 'fit', 'mae', *PHYSICAL, *PARAMETERS)}
    row['reasons'] = '; '.join(values['reasons'])
    for name, interval in (values['intervals'] or {}).items():
        if name in PHYSICAL:
            row[f'{name}_low'], row[f'{name}_high'] = interval or (None, None)
    for name, std in (values['std'] or {}).items():
        row[f'{name}_std'] = std
    if values['delay_s']:
        row['delay_s'], row['delay_std_s'] = values['delay_s']['value'], values['delay_s']['std']
    for begin, key in ((KAPPA, 'couplings'), (THRUSTERS, 'thrusters')):
        row.update({f'{begin}{name}': value for name, value in values.get(key, {}).items()})
    return row


def columns(rows: Sequence[Row]) -> list[str]:
    """Return the columns of a table: those of every survey, then further ones by name."""
    return [*COLUMNS, *sorted({name for row in rows for name in row} - set(COLUMNS))]


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Write CSV; a number is written so that its exact bits come back, what is missing is ''."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns(rows), restval='', lineterminator='\n')
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())


def write_parquet(path: Path, rows: Sequence[Row]) -> None:
    """Write parquet; a tag whose every value is a number is a column of numbers."""
    import pyarrow
    from pyarrow import parquet
    arrays = {}
    for name in columns(rows):
        values = [row.get(name) for row in rows]
        if name in COUNTS:
            type = pyarrow.int64()
        elif name in TEXTS:
            type = pyarrow.string()
        elif name.startswith(TAG):
            values, type = _typed(values)
        else:
            type = pyarrow.float64()
        arrays[name] = pyarrow.array(values, type)
    buffer = io.BytesIO()
    parquet.write_table(pyarrow.table(arrays), buffer)
    write_bytes(path, buffer.getvalue())


def _typed(values: list[Any]) -> tuple[list[Any], Any]:
    import pyarrow
    try:
        return [None if value is None else float(value) for value in values], pyarrow.float64()
    except ValueError:
        return values, pyarrow.string()


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
