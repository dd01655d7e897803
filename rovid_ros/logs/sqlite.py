"""
rosbag2's sqlite3 files, also when the recorder was killed or the file is cut off.

Messages come in blocks of rows. Without a usable index they go by row, which is the order
of recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
import sqlite3
from urllib.parse import quote

from rovid_ros.logs.container import Block, Channel, Container, LogError, MAX_BLOCK_SIZE, Raw
from rovid_ros.messages.types import normalised

MAGIC = b'SQLite format 3\x00'
_ROWS = 2000  # per block


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
        query = ('SELECT timestamp, id, topic_id, data FROM messages '
                 f'WHERE {by} BETWEEN ? AND ? AND topic_id IN ({places}) ORDER BY {by}, id')
        messages: list[Raw] = []
        left = MAX_BLOCK_SIZE
        try:
            with closing(self._connect()) as base:
                for time, row, number, data in base.execute(query, (first, last, *wanted)):
                    if isinstance(time, int) and isinstance(data, bytes) and len(data) <= left:
                        messages.append((time, self.order << 60 | row, wanted[number], data))
                        left -= len(data)
                    else:
                        self.note_damage()
        except sqlite3.DatabaseError:
            if not self.cut:
                self.note_damage()
        return messages

    def _connect(self) -> sqlite3.Connection:
        """Open the file without changing it."""
        base = None
        if any(Path(f'{self.path}{suffix}').exists() for suffix in ('-wal', '-journal')):
            base = self._try('')  # a killed recorder has left messages beside the file
        # a file that is whole by itself needs no lock: it can be on a read-only disk
        base = base or self._try('&immutable=1')
        if base is None:
            raise LogError(f'{self.name}: not a log of rosbag2, or cut off too early')
        return base

    def _try(self, options: str) -> sqlite3.Connection | None:
        base = sqlite3.connect(f'file:{quote(str(self.path))}?mode=ro{options}', uri=True)
        try:
            # without this, sqlite refuses a file that is shorter than it should be
            base.execute('PRAGMA writable_schema=ON')
            base.execute('SELECT name FROM sqlite_master').fetchall()
        except sqlite3.DatabaseError:
            base.close()
            return None
        return base

    def _read_topics(self, base: sqlite3.Connection) -> None:
        # a view could make up rows without end
        tables = {name for name, in base.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table' "
            "AND sql NOT LIKE 'CREATE VIRTUAL%'")}
        if not {'messages', 'topics'} <= tables:
            raise LogError(f'{self.name}: not a log of rosbag2 (no tables messages and topics), '
                           'or cut off too early')
        definitions = {}
        if 'message_definitions' in tables:
            definitions = {name: (encoding, text) for name, encoding, text in base.execute(
                'SELECT topic_type, encoding, encoded_message_definition '
                'FROM message_definitions')}
        for number, topic, type_name, encoding in base.execute(
                'SELECT id, name, type, serialization_format FROM topics ORDER BY id'):
            if not all(isinstance(value, str) for value in (topic, type_name, encoding)):
                self.note_damage()
                continue
            kind, text = definitions.get(type_name, ('', ''))
            self.channels[number] = Channel(number, '/' + topic.lstrip('/'), normalised(type_name),
                                            encoding, str(text), kind == 'ros2idl')

    def _read_index(self, base: sqlite3.Connection) -> None:
        """Make blocks of the rows in time order."""
        self.counts = dict(base.execute(
            'SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id'))
        edges = [time for time, in base.execute(
            'SELECT timestamp FROM (SELECT timestamp, row_number() OVER (ORDER BY timestamp) '
            'AS n FROM messages) WHERE n % ? = 1', (_ROWS,))]
        if not edges:
            return
        last, = base.execute('SELECT MAX(timestamp) FROM messages').fetchone()
        edges = [*dict.fromkeys(edges), last + 1]
        for start, stop in zip(edges, edges[1:]):
            self.add_block(start, stop - 1, None, ('timestamp', start, stop - 1))

    def _read_rows(self, base: sqlite3.Connection) -> None:
        """Make blocks of the rows that there are."""
        self.counts = {}
        messages: list[Raw] = []
        try:
            # the data too: it can lie behind the cut when the rest of the row does not
            for time, number, topic, _ in base.execute(
                    'SELECT timestamp, id, topic_id, data FROM messages ORDER BY id'):
                messages.append((time, number, self.channels[topic], b''))
                if len(messages) == _ROWS:
                    self.add_counted(messages, ('id', messages[0][1], number))
                    messages = []
        except (sqlite3.DatabaseError, KeyError, TypeError):
            pass
        if messages:
            self.add_counted(messages, ('id', messages[0][1], messages[-1][1]))
