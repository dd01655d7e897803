"""SQLite files that call themselves logs, and make up what is read from them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import sqlite3
import struct

TOPICS = ('CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
          'serialization_format TEXT);')
MESSAGES = ('CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
            'data BLOB);')
TYPES = {'/mavros/local_position/pose': 'geometry_msgs/msg/PoseStamped',
         '/mavros/imu/data': 'sensor_msgs/msg/Imu', '/mavros/rc/out': 'mavros_msgs/msg/RCOut'}
PAGE = 512
LEVELS = 12


def _made(path: Path, messages: str, rows: str = '', page: int = 4096) -> None:
    base = sqlite3.connect(path)
    base.executescript(f'PRAGMA page_size={page}; {TOPICS} {messages}')
    base.executemany("INSERT INTO topics VALUES (?, ?, ?, 'cdr')", [
        (i, name, kind) for i, (name, kind) in enumerate(TYPES.items(), 1)])
    base.executescript(rows)
    base.commit()
    base.close()


def _numbers(count: int, values: str) -> str:
    return (f'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < {count}) '
            f'INSERT INTO messages SELECT {values} FROM n;')


def view(path: Path) -> None:
    """Write one whose messages are a view without end."""
    _made(path, 'CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT '
          'id + 1 FROM n) SELECT id, 1 AS topic_id, id AS timestamp, zeroblob(99999) AS data '
          'FROM n;')


def forged_view(path: Path) -> None:
    """Write one that says that this view is a table."""
    view(path)
    base = sqlite3.connect(path)
    base.executescript("PRAGMA writable_schema=ON; UPDATE sqlite_master SET type = 'table', "
                       "rootpage = 2 WHERE name = 'messages';")
    base.close()


def computed(path: Path) -> None:
    """Write one whose data are computed: half a GB for each of 5000 rows."""
    _made(path, 'CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp '
          'INTEGER, data BLOB GENERATED ALWAYS AS (zeroblob(500000000)) VIRTUAL);',
          _numbers(5000, 'i, i % 3 + 1, i').replace(
              'messages', 'messages (id, topic_id, timestamp)'))


def defaults(path: Path) -> None:
    """Write one with 50,000 rows that lack their data, for which it has a default of 900 kB."""
    _made(path, MESSAGES.replace(', data BLOB', ''), _numbers(50_000, 'i, i % 3 + 1, i'))
    base = sqlite3.connect(path)
    base.execute(f'ALTER TABLE messages ADD COLUMN data BLOB DEFAULT x\'{"00" * 900_000}\'')
    base.commit()
    base.close()


def one_time(path: Path) -> None:
    """Write one whose 60,000 messages have one time, so that they belong together."""
    _made(path, MESSAGES, _numbers(60_000, 'i, i % 3 + 1, 7, zeroblob(100)'))


def large_messages(path: Path) -> None:
    """Write one with messages of 9 MB."""
    _made(path, MESSAGES, _numbers(3, 'i, i, i, zeroblob(9000000)'))


def repeated_pages(path: Path) -> None:
    """Write one whose pages point to each other: 100 ** 12 rows in 10 kB."""
    _made(path, MESSAGES, _numbers(3, 'i, i, i, zeroblob(100)'), page=PAGE)
    base = sqlite3.connect(path)
    leaf, = base.execute(
        "SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchone()
    base.close()
    content = bytearray(path.read_bytes())
    pages = len(content) // PAGE
    content += content[(leaf - 1) * PAGE:leaf * PAGE]  # the rows, in a page of their own
    child = pages + 1
    for level in range(LEVELS):
        place = leaf if level == LEVELS - 1 else child + 1
        cells = [struct.pack('>I', child) + b'\1'] * 60
        start = PAGE - 5 * len(cells)
        header = struct.pack('>BHHHBI', 5, 0, len(cells), start, 0, child)
        pointers = b''.join(struct.pack('>H', start + 5 * i) for i in range(len(cells)))
        page = (header + pointers).ljust(start, b'\0') + b''.join(cells)
        content[(place - 1) * PAGE:place * PAGE] = page
        child = place
    content[28:32] = struct.pack('>I', len(content) // PAGE)
    path.write_bytes(content)


HOSTILE_DATABASES: dict[str, Callable[[Path], None]] = {
    'view': view, 'forged view': forged_view, 'computed': computed,
    'defaults': defaults, 'one time': one_time, 'large messages': large_messages,
    'repeated pages': repeated_pages,
}
