"""What comes from outside is bounded: hostile logs, messages, files, and what is printed."""

from collections.abc import Callable
import io
from pathlib import Path
import struct
import subprocess
from tempfile import TemporaryDirectory

import lz4.frame
import pytest
from rovid_core.model.samples import Event, Sample
from rovid_core.ordering.event_order import EventOrder, MAX_HELD
from rovid_ros.commands.running import LONGEST_LINE, printable
from rovid_ros.config.parameter_file import load, ParameterFileError
from rovid_ros.logs import log as logs, paths
from rovid_ros.logs.container import LogError
from rovid_ros.logs.log import Log
from rovid_ros.logs.mcap import MAGIC
from rovid_ros.logs.writer import LogWriter
from rovid_ros.messages.field_paths import FieldError, parse
from rovid_ros.messages.types import build, MAX_MESSAGE_SIZE, typestore, TypeUnknownError
import yaml
import zstandard

from test.support.limited import run_limited

REPOSITORY = Path(__file__).parents[2]
CONFIG = REPOSITORY / 'config/bluerov2_ardusub.yaml'
MEMORY = 1200 << 20  # [bytes] of addresses; the libraries alone take 500 MB
TYPES = {'/mavros/local_position/pose': 'geometry_msgs/msg/PoseStamped',
         '/mavros/imu/data': 'sensor_msgs/msg/Imu', '/mavros/rc/out': 'mavros_msgs/msg/RCOut'}
RULE = '=' * 80 + '\n'
ZEROS = b'\0' * (1 << 20)


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack('<BQ', opcode, len(body)) + body


def text(value: str | bytes) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return struct.pack('<I', len(data)) + data


def schema(number: int, name: str, definition: str) -> bytes:
    return record(3, struct.pack('<H', number) + text(name) + text('ros2msg') + text(definition))


def channel(number: int, schema_number: int, topic: str) -> bytes:
    return record(4, struct.pack('<HH', number, schema_number) + text(topic) + text('cdr')
                  + text(b''))


def message(number: int, data: bytes, time: int = 1) -> bytes:
    return record(5, struct.pack('<HIQQ', number, 0, time, time) + data)


def chunk(packed: bytes, size: int, compression: str, time: int = 1) -> bytes:
    return record(6, struct.pack('<QQQI', time, time, size, 0) + text(compression)
                  + struct.pack('<Q', len(packed)) + packed)


def zstd_bomb(gigabytes: int) -> bytes:
    """Return a frame of so many GB of zeros, without ever having them."""
    out = io.BytesIO()
    with zstandard.ZstdCompressor(level=1).stream_writer(out, closefd=False) as writer:
        for _ in range(gigabytes << 10):
            writer.write(ZEROS)
    return out.getvalue()


def lz4_bomb(gigabytes: int) -> bytes:
    with lz4.frame.LZ4FrameCompressor() as compressor:
        parts = [compressor.begin()]
        parts += [compressor.compress(ZEROS) for _ in range(gigabytes << 10)]
        return b''.join([*parts, compressor.flush()])


def three_types(definition: str) -> bytes:
    """Return the topics of the configuration, of types that are defined like this."""
    return b''.join(
        schema(i, name, definition) + channel(i, i, topic) + message(i, b'\0\1\0\0' + b'\xff' * 40)
        for i, (topic, name) in enumerate(TYPES.items(), 1))


def deep(levels: int) -> str:
    parts = ''.join(f'{RULE}MSG: a/L{i}\na/L{i + 1} x\n' for i in range(levels))
    return f'a/L0 x\n{parts}{RULE}MSG: a/L{levels}\nuint8 y\n'


def wide(levels: int) -> str:
    fields = [''.join(f'a/L{i} x{k}\n' for k in range(10)) for i in range(levels)]
    parts = ''.join(f'{RULE}MSG: a/L{i}\n{fields[i + 1]}' for i in range(levels - 1))
    return f'{fields[0]}{parts}{RULE}MSG: a/L{levels - 1}\nuint8 y\n'


def many_declarations() -> bytes:
    # 65,535 channels that each name a definition of 100 kB, in a few packed chunks
    packed = []
    for first in range(1, 65535, 8192):
        some = schema(first, 'a/msg/A', '#' * 100_000) + b''.join(
            channel(i, first, '/x' * 2000) for i in range(first, min(first + 8192, 65536)))
        packed.append(chunk(zstandard.compress(some), len(some), 'zstd'))
    return MAGIC + b''.join(packed)


def recorded(metadata: dict[str, str], control: str) -> bytes:
    """Return a log that says that a node recorded it."""
    with TemporaryDirectory() as directory:
        path = Path(directory) / 'log.mcap'
        with LogWriter(path) as writer:
            writer.metadata('rovid_record', metadata)
            writer.write('/rovid/control', 'std_msgs/msg/String', {'data': control}, 1)
            for topic, name in TYPES.items():
                writer.write(topic, name, {}, 2)
        return path.read_bytes()


def summary_of(metadata_length: int) -> bytes:
    """Return an index that sends its reader to a huge metadata record."""
    statistics = record(11, struct.pack('<QHIIIIQQ', 0, 0, 0, 0, 1, 0, 0, 0) + text(b''))
    index = record(13, struct.pack('<QQ', 8, metadata_length) + text('m'))
    footer = record(2, struct.pack('<QQI', 8, 0, 0))
    return statistics + index + footer + MAGIC


HOSTILE: dict[str, Callable[[], bytes]] = {
    'a chunk that claims 8 EB': lambda: MAGIC + chunk(zstd_bomb(0), 1 << 63, 'zstd'),
    'a chunk of 6 GB in 200 kB, zstd': lambda: MAGIC + chunk(zstd_bomb(6), 6 << 30, 'zstd'),
    'a chunk that hides 6 GB': lambda: MAGIC + chunk(zstd_bomb(6), 1000, 'zstd') * 3,
    'a chunk of 6 GB, lz4': lambda: MAGIC + chunk(lz4_bomb(6), 6 << 30, 'lz4'),
    'a record that claims 8 EB': lambda: MAGIC + struct.pack('<BQ', 6, 1 << 63) + ZEROS,
    'a schema that claims 16 EB': lambda: MAGIC + struct.pack('<BQ', 3, (1 << 64) - 1) + ZEROS,
    'metadata that claims 8 EB': lambda: MAGIC + summary_of(1 << 63),
    'metadata that claims 50 GB': lambda: MAGIC + summary_of(50 << 30),
    'declarations without end': many_declarations,
    'a type that is in itself': lambda: MAGIC + three_types('geometry_msgs/PoseStamped x\n'),
    'a type 500 deep': lambda: MAGIC + three_types(deep(500)),
    'a type of 10^9 fields': lambda: MAGIC + three_types(wide(9)),
    'an array of 4 G': lambda: MAGIC + three_types('uint8[4000000000] x\n'),
    'arrays of arrays': lambda: MAGIC + three_types(
        f'a/B[9999] x\n{RULE}MSG: a/B\nfloat64[9999] y\n'),
    'a sequence of nothing': lambda: MAGIC + three_types(f'a/B[] x\n{RULE}MSG: a/B\n'),
    'a definition that is no text': lambda: MAGIC + three_types('\x1b[2J\x00(((('),
    'control unknown': lambda: recorded({}, '{"control": "rm -rf", "value": "/"}'),
    'control that is a list': lambda: recorded({}, '[1, 2]'),
    'control that is nested': lambda: recorded({}, '[' * 100_000),
    'state that is a list': lambda: recorded({'state': '[]'}, '{}'),
    'state that is nested': lambda: recorded({'state': '[' * 100_000}, '{}'),
    'zeros': lambda: MAGIC + ZEROS,
}


def replay(log: Path) -> subprocess.CompletedProcess[str]:
    return run_limited(['replay', log, '--params-file', CONFIG], MEMORY, log.parent / 'stderr')


def check_refused(run: subprocess.CompletedProcess[str]) -> str:
    assert run.returncode == 1, run.stderr[-2000:]
    (line,) = run.stderr.splitlines()
    assert line.startswith('rovid replay: ') and line.isprintable()
    assert len(line) < LONGEST_LINE + 100
    return line


@pytest.mark.long
@pytest.mark.parametrize('name', HOSTILE)
def test_a_hostile_log_is_one_line_and_no_memory(name: str, tmp_path: Path) -> None:
    path = tmp_path / 'log.mcap'
    path.write_bytes(HOSTILE[name]())
    line = check_refused(replay(path))
    if name.startswith(('control', 'state')):
        assert name.partition(' ')[0] in line


def test_a_bag_with_a_bomb_is_one_line_and_no_memory(tmp_path: Path) -> None:
    def item(header: dict[str, bytes], data: bytes) -> bytes:
        fields = b''.join(text(name.encode() + b'=' + value) for name, value in header.items())
        return struct.pack('<I', len(fields)) + fields + struct.pack('<I', len(data)) + data

    bomb = {'op': b'\5', 'compression': b'lz4', 'size': struct.pack('<I', (1 << 32) - 1)}
    path = tmp_path / 'log.bag'
    path.write_bytes(b'#ROSBAG V2.0\n' + item(
        {'op': b'\3', 'index_pos': bytes(8), 'chunk_count': bytes(4), 'conn_count': bytes(4)},
        b'') + item(bomb, lz4_bomb(4)))
    check_refused(replay(path))


def test_a_packed_file_does_not_fill_the_disk(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paths, '_SURE', 4 << 20)
    path = tmp_path / 'log.mcap.zstd'
    path.write_bytes(zstd_bomb(1))
    with pytest.raises(LogError, match='unpacks to more than 100 times its size'):
        Log([path])


def test_a_list_of_files_that_grows_without_end_is_left_aside(tmp_path: Path) -> None:
    lines = ['a0: &a0 {x: 1, y: 2}']
    lines += [f'a{i}: &a{i} {{<<: [{", ".join([f"*a{i - 1}"] * 9)}]}}' for i in range(1, 20)]
    for content in ('\n'.join(lines), '[' * 100_000, 'a: ' * 10, 'x: &a [*a]'):
        (tmp_path / 'metadata.yaml').write_text(content)
        with pytest.raises(LogError, match='no log in this directory'):
            Log([tmp_path])


def test_a_list_of_files_names_none_elsewhere(tmp_path: Path) -> None:
    directory = tmp_path / 'bag'
    directory.mkdir()
    (tmp_path / 'secret.mcap').write_bytes(MAGIC)
    names = ['../secret.mcap', '/etc/passwd']
    (directory / 'metadata.yaml').write_text(yaml.safe_dump({
        'rosbag2_bagfile_information': {'relative_file_paths': names}}))
    with pytest.raises(LogError, match=str(directory)):
        Log([directory])


def test_messages_that_overlap_are_not_held_without_end(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logs, 'MAX_HELD', 1 << 20)
    one = schema(1, 'std_msgs/msg/String', 'string data\n') + channel(1, 1, '/a')
    rows = b''.join(message(1, bytes(1000), time) for time in (1, 1_000_000) for _ in range(300))
    path = tmp_path / 'log.mcap'
    path.write_bytes(MAGIC + chunk(one + rows, len(one + rows), '') * 9)
    with Log([path]) as log, pytest.raises(LogError, match='overlap in time'):
        for _ in log.raw(['/a']):
            pass


def test_a_large_message_of_a_log_is_left_out_and_told(tmp_path: Path) -> None:
    path = tmp_path / 'log.mcap'
    with LogWriter(path) as writer:
        for i, size in enumerate((10, MAX_MESSAGE_SIZE, 20)):
            writer.write('/a', 'std_msgs/msg/String', {'data': 'x' * size}, i)
    with Log([path]) as log:
        assert [len(message.data.data) for message in log.messages(['/a'])] == [10, 20]
        (line,) = log.warnings
        assert line.endswith('/a (std_msgs/msg/String) has messages of more than 1,048,576 bytes; '
                             'they are left out')


@pytest.mark.parametrize(('definition', 'reason'), [
    ('a/msg/A x\n', 'a/msg/A is in itself'), ('a/A[] x\n', 'a/msg/A is in itself'),
    (deep(40), 'more than 32 messages'), (wide(8), 'more than 100,000 values'),
    ('uint8[100001] x\n', 'more than 100,000 values'),
    (f'a/B[] x\n{RULE}MSG: a/B\n', 'a sequence of nothing'), ('#' * 140_000, '140,000 characters'),
])
def test_a_type_without_end_is_refused(definition: str, reason: str) -> None:
    with pytest.raises(TypeUnknownError, match=reason):
        typestore('a/msg/A', definition)


def test_a_type_within_bounds_is_taken() -> None:
    assert typestore('a/msg/D', deep(25))
    store = typestore('a/msg/A', f'uint8[99999] x\na/B[] y\n{RULE}MSG: a/B\nbool z\n')
    assert len(build(store, 'a/msg/A', {}).x) == 99_999


@pytest.mark.parametrize(('given', 'line'), [
    ('a\nb\t c', 'a b c'), ('\x1b[2J\x07x', r'\x1b[2J\x07x'), ('a\u202eb', r'a\u202eb'),
    ('pipe\ud800', r'pipe\ud800'), ('m/s² °', 'm/s² °'),
    ('y' * 5000, 'y' * LONGEST_LINE + ' ...'),
])
def test_a_line_does_nothing_to_a_terminal(given: str, line: str) -> None:
    assert printable(given) == line


def test_names_of_a_log_do_nothing_to_a_terminal(tmp_path: Path) -> None:
    path = tmp_path / 'log.mcap'
    names = ['/\x1b]0;owned\x07\n/b', '/' + 'z' * 100_000, *(f'/t{i}' for i in range(2000))]
    path.write_bytes(MAGIC + schema(1, 'std_msgs/msg/String', 'string data\n') + b''.join(
        channel(i, 1, name) + message(i, b'\0\1\0\0\1\0\0\0\0')
        for i, name in enumerate(names, 1)))
    line = check_refused(replay(path))
    assert r'\x1b]0;owned\x07 /b' in line


@pytest.mark.parametrize(('content', 'reason'), [
    ('x: ' + 'y' * (1 << 20), 'has more than 1,048,576 bytes'),
    ('/**: {ros__parameters: ' + '{a: ' * 5000, 'misreads'),
    ('/**: {ros__parameters: {a: ' + '[' * 5000, 'takes a flat list'),
    ('{a: ' * 5000, 'takes ros__parameters'),
    ('/**: &a {ros__parameters: *a}', 'got the alias'),
    ('a: !!python/object/apply:os.system [id]', 'tag'),
])
def test_a_hostile_parameter_file_is_refused(content: str, reason: str, tmp_path: Path) -> None:
    path = tmp_path / 'p.yaml'
    path.write_text(content)
    with pytest.raises(ParameterFileError, match=reason):
        load(path)


def test_a_parameter_file_without_end_is_refused() -> None:
    with pytest.raises(ParameterFileError, match='more than'):
        load(Path('/dev/zero'))


@pytest.mark.parametrize('path', ['a[99999999999]', 'a[0:99999999999]', f'a[{"9" * 9999}]'])
def test_an_index_of_a_field_path_is_bounded(path: str) -> None:
    with pytest.raises(FieldError, match='is not a field path'):
        parse(path, 'position.field')


def test_events_are_not_held_without_end() -> None:
    counts: dict[tuple[str, str], int] = {}

    def reject(name: str, reason: str) -> None:
        counts[name, reason] = counts.get((name, reason), 0) + 1

    order = EventOrder([('position', 0), ('thrusters', 0)], 1.0, 1.0, reject, print)
    flood = 1000
    for time in range(2):  # both are there
        for name in ('thrusters', 'position'):
            order.push(Event(time, (Sample(name, (0.0,)),)))
    for time in range(2, MAX_HELD + flood):  # a nanosecond each, and the other stays silent
        order.push(Event(time, (Sample('position', (0.0,)),)))
    assert len(order.flush()) == MAX_HELD
    assert set(counts) == {('position', 'overload')} and counts['position', 'overload'] > 900
