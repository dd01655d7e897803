"""Small logs of every format, for the tests of what reads them."""

from collections.abc import Iterator
from pathlib import Path
import sqlite3

from mcap.writer import CompressionType, IndexType, Writer
import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import get_typestore, Stores
from rovid_ros.messages.types import build, standard_types

START = 1_700_000_000_000_000_000  # [ns]
POINT = 'geometry_msgs/msg/PointStamped'
ARRAY = 'std_msgs/msg/Float64MultiArray'
TOPICS = {'/point': POINT, '/array': ARRAY}

Message = tuple[int, str, str, bytes]  # time [ns], topic, type, CDR


def messages(count: int, seed: int = 0, size: int = 40) -> Iterator[Message]:
    """Yield points at 10 Hz and, between them, arrays that do not compress."""
    random = np.random.default_rng(seed)
    store = standard_types()
    for index in range(count):
        if index % 2:
            topic, fields = '/array', {'data': random.normal(size=size)}
        else:
            topic, fields = '/point', {'point': dict(zip('xyz', random.normal(size=3)))}
        message = build(store, TOPICS[topic], fields)
        data = bytes(store.serialize_cdr(message, TOPICS[topic]))
        yield START + index * 50_000_000, topic, TOPICS[topic], data


def write_mcap(path: Path, recorded: list[Message], *, compression: str = 'zstd',
               chunk: int = 1 << 20, chunked: bool = True,
               index: IndexType = IndexType.ALL, summary: bool = True,
               repeat_schemas: bool = True) -> None:
    """Write an MCAP file by the format's own package."""
    kinds = {'zstd': CompressionType.ZSTD, 'lz4': CompressionType.LZ4, '': CompressionType.NONE}
    store = standard_types()
    with path.open('wb') as file:
        writer = Writer(
            file, chunk_size=chunk, compression=kinds[compression], use_chunking=chunked,
            index_types=index, use_statistics=summary,
            repeat_schemas=summary and repeat_schemas, repeat_channels=summary,
            use_summary_offsets=summary)
        writer.start(profile='ros2')
        channels = {}
        for time, topic, kind, data in recorded:
            if topic not in channels:
                text = store.generate_msgdef(kind, ros_version=2)[0]
                schema = writer.register_schema(kind, 'ros2msg', text.encode())
                channels[topic] = writer.register_channel(topic, 'cdr', schema)
            writer.add_message(channels[topic], time, data, time)
        writer.finish()


def write_rosbag2(path: Path, recorded: list[Message], storage: str,
                  compression: str = 'none') -> None:
    """Write a rosbag2 directory."""
    store = standard_types()
    writer = rosbag2.Writer(path, version=9, storage_plugin=StoragePlugin[storage])
    writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for time, topic, kind, data in recorded:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], time, data)


def write_bag(path: Path, recorded: list[Message], compression: str = '') -> None:
    """Write a ROS 1 bag."""
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = rosbag1.Writer(path)
    writer.chunk_threshold = 100_000
    if compression:
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression.upper()])
    with writer:
        connections = {}
        for time, topic, kind, data in recorded:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            message = standard_types().deserialize_cdr(data, kind)
            if kind == POINT:  # the header counts in ROS 1
                message = store.types[kind](
                    store.types['std_msgs/msg/Header'](0, message.header.stamp, ''),
                    message.point)
            writer.write(connections[topic], time, store.serialize_ros1(message, kind))


def write_old_sqlite(path: Path, recorded: list[Message], *, journal: str = 'delete',
                     finish: bool = True) -> sqlite3.Connection:
    """Write a sqlite3 file as rosbag2 did up to Humble: no definitions of types."""
    base = sqlite3.connect(path)
    base.execute(f'PRAGMA journal_mode={journal}')
    base.executescript(
        'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,'
        ' serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);'
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,'
        ' timestamp INTEGER NOT NULL, data BLOB NOT NULL);'
        'CREATE INDEX timestamp_idx ON messages (timestamp ASC);')
    numbers = {topic: number for number, topic in enumerate(TOPICS, start=1)}
    for topic, number in numbers.items():
        base.execute('INSERT INTO topics VALUES(?, ?, ?, "cdr", "")',
                     (number, topic, TOPICS[topic]))
    base.executemany('INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)',
                     [(numbers[topic], time, data) for time, topic, _, data in recorded])
    base.commit()
    if finish:
        base.close()
    return base
