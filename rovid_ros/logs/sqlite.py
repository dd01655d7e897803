"""
rosbag2's sqlite3 files, also when the recorder was killed or the file is cut off.

Messages come in blocks of rows. Without a usable index they go by row, which is the order
of recording. A database can also make up what is read from it, in any amount: only tables that
store their columns are read, no value that is longer than the file, and no more rows than fit in.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
import sqlite3
from typing import Any
from urllib.parse import quote

from rovid_ros.logs.container import (
    Block,
    Channel,
    Container,
    LogError,
    MAX_BLOCK_SIZE,
    MESSAGE_OVERHEAD,
    Raw,
)
from rovid_ros.messages.types import MAX_MESSAGE_SIZE, normalised

MAGIC = b'SQLite format 3\x00'
_ROWS = 2000  # per block
_LARGEST_BLOCK = 1 << 26  # [bytes]
_TABLES = ('topics', 'messages', 'message_definitions')
_STEPS = 10_000  # of the database's machine between two looks at whether it has to stop
_STEPS_PER_BYTE = 50  # that a query may take; those of a file that is sound take up to 5
_DATA = f'CASE WHEN length(data) <= {MAX_MESSAGE_SIZE} THEN data END'
_TOO_LARGE = bytes(MAX_MESSAGE_SIZE + 1)  # stands for a message that is not worth its memory


def part_of_page(head: bytes, size: int) -> int:
    """Return the size [bytes] of the broken page at the end of a cut file, 0 if it is whole."""
    page = int.from_bytes(head[16:18], 'big')
    return size % (65536 if page == 1 else page or 512)


class SqliteFile(Container):
    """A rosbag2 sqlite3 file."""

    def read_structure(self) -> None:
        """Read the tables."""
        try:
            with closing(self._connect()) as base:
                self._read_topics(base)
                try:
                    self._read_index(base)
                except (sqlite3.DatabaseError, TypeError):  # cut, or no numbers in it
                    self.cut = True
                    self.blocks.clear()
                    self._read_rows(base)
        except (sqlite3.Error, UnicodeDecodeError) as error:
            raise LogError(
                f'{self.name}: not a log of rosbag2, or cut off too early ({error})') from None

    def load(self, block: Block, wanted: Mapping[int, Channel]) -> list[Raw]:
        """Return the messages of these channels in a block, in time order."""
        by, first, last = block.where
        places = ','.join('?' * len(wanted))
        query = (f'SELECT timestamp, id, topic_id, typeof(data), {_DATA} FROM messages '
                 f'WHERE {by} BETWEEN ? AND ? AND topic_id IN ({places})')
        messages: list[Raw] = []
        left = _LARGEST_BLOCK
        try:
            with closing(self._connect()) as base:
                for time, row, number, kind, data in self._rows(
                        base, query, first, last, *wanted):
                    if not isinstance(time, int) or kind != 'blob':
                        self.note_damage()
                        continue
                    left -= len(data or b'') + MESSAGE_OVERHEAD
                    if left < 0:
                        self.note_damage()
                        break
                    messages.append((time, self.order << 60 | row, wanted[number],
                                     _TOO_LARGE if data is None else data))
        except sqlite3.DatabaseError:
            if not self.cut:
                self.note_damage()
        if by == 'timestamp':
            messages.sort()  # sqlite would sort the data with the times
        return messages

    def _connect(self) -> sqlite3.Connection:
        """Open the file without changing it."""
        base = None
        beside = [Path(f'{self.path}{suffix}') for suffix in ('-wal', '-journal', '-shm')]
        there = [path for path in beside if path.exists()]
        size = sum(path.stat().st_size for path in [self.path, *there])
        if there and all(path.is_file() for path in there):
            base = self._try('', size)  # a killed recorder has left messages beside the file
        # a file that is whole by itself needs no lock: it can be on a read-only disk
        base = base or self._try('&immutable=1', size)
        if base is None:
            raise LogError(f'{self.name}: not a log of rosbag2, or cut off too early')
        return base

    def _try(self, options: str, size: int) -> sqlite3.Connection | None:
        base = sqlite3.connect(f'file:{quote(str(self.path))}?mode=ro{options}', uri=True)
        if hasattr(base, 'setlimit'):  # Python 3.11
            base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(max(size, _ROWS), MAX_BLOCK_SIZE))
        self._allowed = _STEPS_PER_BYTE * size // _STEPS + 10
        base.set_progress_handler(self._look, _STEPS)
        try:
            # without this, sqlite refuses a file that is shorter than it should be
            base.execute('PRAGMA writable_schema=ON')
            list(self._rows(base, 'SELECT rootpage FROM sqlite_master'))
        except sqlite3.DatabaseError:
            base.close()
            return None
        return base

    def _look(self) -> bool:
        """Tell whether a query has taken too long; a signal is handled when this is called."""
        self._left -= 1
        return self._left < 0

    def _rows(self, base: sqlite3.Connection, query: str, *given: Any) -> Iterator[Any]:
        """
        Yield the rows of a query.

        Raises sqlite3.DatabaseError also if there are more than the file can hold: pages that
        point to each other repeat them without end.
        """
        self._left = self._allowed
        try:
            yield from base.execute(query, given)
        except sqlite3.OperationalError as error:
            if str(error) != 'interrupted':
                raise
            if self._left >= 0:
                raise KeyboardInterrupt from None
            raise sqlite3.DatabaseError('has more rows than its size allows') from None

    def _read_topics(self, base: sqlite3.Connection) -> None:
        tables = {name for _, name, kind, *_ in self._rows(base, 'PRAGMA table_list')
                  if kind == 'table' and name in _TABLES}
        if not {'messages', 'topics'} <= tables:
            raise LogError(f'{self.name}: not a log of rosbag2 (no tables messages and topics), '
                           'or cut off too early')
        for table in tables:
            if any(hidden for *_, hidden in self._rows(base, f'PRAGMA table_xinfo({table})')):
                raise LogError(f'{self.name}: not a log of rosbag2 ({table} has columns that are '
                               'computed)')
        definitions = {}
        if 'message_definitions' in tables:
            definitions = {name: (encoding, text) for name, encoding, text in self._rows(
                base, 'SELECT topic_type, encoding, encoded_message_definition '
                'FROM message_definitions')}
        for number, topic, type_name, encoding in self._rows(
                base, 'SELECT id, name, type, serialization_format FROM topics ORDER BY id'):
            if not all(isinstance(value, str) for value in (topic, type_name, encoding)):
                self.note_damage()
                continue
            kind, text = definitions.get(type_name, ('', ''))
            self.channels[number] = Channel(number, '/' + topic.lstrip('/'), normalised(type_name),
                                            encoding, str(text), kind == 'ros2idl')

    def _read_index(self, base: sqlite3.Connection) -> None:
        """Make blocks of the rows in time order."""
        self.counts = dict(self._rows(
            base, 'SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id'))
        edges = [time for time, in self._rows(
            base, 'SELECT timestamp FROM (SELECT timestamp, row_number() OVER '
            '(ORDER BY timestamp) AS n FROM messages) WHERE n % ? = 1', _ROWS)]
        if not edges:
            return
        (last,), = self._rows(base, 'SELECT MAX(timestamp) FROM messages')
        edges = [*dict.fromkeys(edges), last + 1]
        for start, stop in zip(edges, edges[1:]):
            self.add_block(start, stop - 1, None, ('timestamp', start, stop - 1))

    def _read_rows(self, base: sqlite3.Connection) -> None:
        """Make blocks of the rows that there are."""
        self.counts = {}
        messages: list[Raw] = []
        try:
            # the data too: it can lie behind the cut when the rest of the row does not
            for time, number, topic, _ in self._rows(
                    base, f'SELECT timestamp, id, topic_id, {_DATA} FROM messages ORDER BY id'):
                messages.append((time, number, self.channels[topic], b''))
                if len(messages) == _ROWS:
                    self.add_counted(messages, ('id', messages[0][1], number))
                    messages = []
        except (sqlite3.DatabaseError, KeyError, TypeError):
            pass
        if messages:
            self.add_counted(messages, ('id', messages[0][1], messages[-1][1]))
