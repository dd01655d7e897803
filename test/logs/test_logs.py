"""Logs: every format whole and cut off, joined, lazily, and written."""

from collections.abc import Callable
import contextlib
from io import BytesIO
import itertools
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import tracemalloc

from mcap.reader import make_reader
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader
from mcap.writer import IndexType, Writer
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores
from rovid_ros.logs.container import LogError
from rovid_ros.logs.log import Log, MAX_UNDECODED
from rovid_ros.logs.writer import LogWriter
from rovid_ros.messages.types import build, standard_types, typestore, TypeUnknownError
import yaml

from test.support import recorded_logs
from test.support.recorded_logs import ARRAY, messages, START, TOPICS

Recorded = list[recorded_logs.Message]
Make = Callable[[Path, Recorded], None]


def mcap(**options: object) -> Make:
    return lambda path, recorded: recorded_logs.write_mcap(path, recorded, **options)


FORMATS: dict[str, Make] = {
    'zstd.mcap': mcap(chunk=5000),
    'lz4.mcap': mcap(chunk=5000, compression='lz4'),
    'plain.mcap': mcap(chunk=5000, compression=''),
    'unchunked.mcap': mcap(chunked=False),
    'unindexed.mcap': mcap(chunk=5000, index=IndexType.NONE),
    'no_summary.mcap': mcap(chunk=5000, index=IndexType.NONE, summary=False),
    'unchunked_no_summary.mcap': mcap(chunked=False, index=IndexType.NONE, summary=False),
    'old.db3': lambda path, recorded: recorded_logs.write_old_sqlite(path, recorded).close(),
    'directory_sqlite3': lambda p, r: recorded_logs.write_rosbag2(p, r, 'SQLITE3'),
    'directory_mcap': lambda p, r: recorded_logs.write_rosbag2(p, r, 'MCAP'),
    'by_file_sqlite3': lambda p, r: recorded_logs.write_rosbag2(p, r, 'SQLITE3', 'file'),
    'by_file_mcap': lambda p, r: recorded_logs.write_rosbag2(p, r, 'MCAP', 'file'),
    'by_message_sqlite3': lambda p, r: recorded_logs.write_rosbag2(p, r, 'SQLITE3', 'message'),
    'none.bag': recorded_logs.write_bag,
    'bz2.bag': lambda p, r: recorded_logs.write_bag(p, r, 'bz2'),
    'lz4.bag': lambda p, r: recorded_logs.write_bag(p, r, 'lz4'),
}


def expected(recorded: Recorded, topics: list[str] | None = None) -> list[tuple[int, str, list]]:
    """Return time, topic and numbers of messages, in time order."""
    store = standard_types()
    return [
        (time, topic, numbers(store.deserialize_cdr(data, kind)))
        for time, topic, kind, data in sorted(recorded, key=lambda message: message[0])
        if topics is None or topic in topics]


def numbers(message: object) -> list[float]:
    if hasattr(message, 'point'):
        return [message.point.x, message.point.y, message.point.z]
    return message.data.tolist()


def read(log: Log, topics: object = TOPICS, **options: float) -> list[tuple[int, str, list]]:
    return [(m.time, m.topic, numbers(m.data)) for m in log.messages(topics, **options)]


def shuffled(recorded: Recorded, reach: int) -> Recorded:
    """Put the messages in another order, none further than about ``reach`` from its place."""
    keys = np.arange(len(recorded)) + np.random.default_rng(1).uniform(0, reach, len(recorded))
    return [recorded[index] for index in np.argsort(keys)]


# --- whole logs ---------------------------------------------------------------------------


@pytest.mark.parametrize('name', FORMATS)
def test_a_log_gives_what_was_recorded(name: str, tmp_path: Path) -> None:
    recorded = list(messages(300))
    FORMATS[name](tmp_path / name, shuffled(recorded, 30))
    with Log([tmp_path / name]) as log:
        assert log.warnings == []
        assert (log.start, log.end) == (START, recorded[-1][0])
        assert {topic: (info.type, info.count) for topic, info in log.topics.items()} == {
            topic: (kind, 150) for topic, kind in TOPICS.items()}
        assert read(log) == expected(recorded)
        assert log.progress == 1.0
        assert read(log, ['/point']) == expected(recorded, ['/point'])
        assert read(log, ['/absent']) == []
        part = read(log, start=2.0, duration=3.0)
        assert part == [m for m in expected(recorded) if 2e9 <= m[0] - START < 5e9]
        assert len(part) == 60


@pytest.mark.parametrize('name', FORMATS)
def test_a_copy_on_a_read_only_disk_is_read_and_left_alone(name: str, tmp_path: Path) -> None:
    path = tmp_path / 'disk' / name
    path.parent.mkdir()
    FORMATS[name](path, list(messages(40)))
    before = {file: file.read_bytes() for file in path.parent.rglob('*') if file.is_file()}
    for file in [*before, path.parent]:
        file.chmod(0o555)
    try:
        with Log([path]) as log:
            assert len(read(log)) == 40
        after = {file: file.read_bytes() for file in path.parent.rglob('*') if file.is_file()}
        assert after == before
    finally:
        path.parent.chmod(0o755)


def test_messages_at_one_time_come_in_the_order_of_the_file(tmp_path: Path) -> None:
    recorded = [(START, *message[1:]) for message in messages(200)]
    for name, make in FORMATS.items():
        make(tmp_path / name, recorded)
        with Log([tmp_path / name]) as log:
            assert read(log) == expected(recorded), name


def test_several_files_are_one_log_in_time_order(tmp_path: Path) -> None:
    recorded = list(messages(300))
    parts = {'a.mcap': recorded[::3], 'b.db3': recorded[1::3], 'c.bag': recorded[2::3]}
    for name, part in parts.items():
        FORMATS[{'a': 'zstd.mcap', 'b': 'old.db3', 'c': 'none.bag'}[name[0]]](
            tmp_path / name, part)
    for order in itertools.permutations(parts):
        with Log([tmp_path / name for name in order]) as log:
            assert read(log) == expected(recorded)
            assert log.topics['/point'].count == 150


@pytest.mark.parametrize('metadata', [True, False])
@pytest.mark.parametrize('storage', ['MCAP', 'SQLITE3'])
def test_a_split_directory(storage: str, metadata: bool, tmp_path: Path) -> None:
    recorded = list(messages(300))
    listed = split_directory(tmp_path, storage, recorded, 3)
    if metadata:
        (tmp_path / 'bag' / 'metadata.yaml').write_text(
            'rosbag2_bagfile_information:\n  relative_file_paths:\n'
            + ''.join(f'  - {name}\n' for name in listed))
        (tmp_path / 'bag' / 'copy.mcap').write_bytes(b'not in the list')
    with Log([tmp_path / 'bag']) as log:
        assert log.warnings == []
        assert read(log) == expected(recorded)


def test_a_split_directory_with_a_missing_and_an_empty_file(tmp_path: Path) -> None:
    recorded = list(messages(300))
    listed = split_directory(tmp_path, 'MCAP', recorded, 3)
    (tmp_path / 'bag' / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information:\n  relative_file_paths:\n'
        + ''.join(f'  - {name}\n' for name in listed))
    (tmp_path / 'bag' / listed[1]).unlink()
    (tmp_path / 'bag' / listed[2]).write_bytes(b'')
    with Log([tmp_path / 'bag']) as log:
        assert read(log) == expected(recorded[:100])
        assert log.warnings == [
            f'{tmp_path}/bag/{listed[1]}: is in metadata.yaml, but not there',
            f'{tmp_path}/bag/{listed[2]}: is empty']


def test_a_directory_that_has_lost_its_only_file(tmp_path: Path) -> None:
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information:\n  relative_file_paths: [bag_0.mcap]\n')
    with pytest.raises(LogError, match=r'bag/bag_0\.mcap: is in metadata\.yaml, but not there'):
        Log([tmp_path / 'bag'])


def test_the_same_file_twice_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'bag').mkdir()
    path, link = tmp_path / 'bag' / 'a.mcap', tmp_path / 'link.mcap'
    recorded_logs.write_mcap(path, list(messages(20)))
    link.symlink_to(path)
    for other in (path, link, path.parent, tmp_path / 'bag' / '..' / 'bag' / 'a.mcap'):
        with pytest.raises(LogError, match=r'\.mcap: is given twice'):
            Log([path, other])


def split_directory(folder: Path, storage: str, recorded: Recorded, parts: int) -> list[str]:
    (folder / 'bag').mkdir()
    size = len(recorded) // parts
    names = []
    for part in range(parts):
        whole = folder / f'bag_{part}'
        recorded_logs.write_rosbag2(whole, recorded[part * size:(part + 1) * size], storage)
        file = next(file for file in whole.iterdir() if file.suffix in ('.mcap', '.db3'))
        shutil.copy(file, folder / 'bag' / file.name)
        names.append(file.name)
    return names


# --- memory and laziness ------------------------------------------------------------------


BIG = {**FORMATS, 'zstd.mcap': mcap(), 'no_summary.mcap': mcap(
    index=IndexType.NONE, summary=False)}


@pytest.mark.long
@pytest.mark.parametrize(
    'name', ['zstd.mcap', 'no_summary.mcap', 'unchunked.mcap', 'old.db3', 'none.bag'])
def test_memory_does_not_grow_with_the_log(name: str, tmp_path: Path) -> None:
    few = list(messages(200, size=500))  # half of them of 4 kB
    for rounds in (5, 50):
        recorded = [(time + index * 10_000_000_000, *rest)
                    for index in range(rounds) for time, *rest in few]
        path = tmp_path / f'{rounds}-{name}'
        BIG[name](path, recorded)
        tracemalloc.start()
        with Log([path]) as log:
            assert sum(1 for _ in log.raw(TOPICS)) == len(recorded)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 10_000_000
    assert sum(len(message[3]) for message in recorded) > 20_000_000


def test_only_the_topics_asked_for_are_decoded(tmp_path: Path) -> None:
    recorded = list(messages(20))
    with (tmp_path / 'log.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start(profile='ros2')
        good = writer.register_channel('/point', 'cdr', writer.register_schema(
            TOPICS['/point'], 'ros2msg', definition(TOPICS['/point'])))
        bad = {
            '/text': ('cdr', writer.register_schema('a/msg/B', 'ros2msg', b'no such thing')),
            '/json': ('json', writer.register_schema('a/msg/C', 'jsonschema', b'{}')),
            '/short': ('cdr', writer.register_schema('a/msg/D', 'ros2msg', b'float64[99] x')),
            '/unknown': ('cdr', writer.register_schema('a/msg/E', '', b'')),
        }
        for topic, (encoding, schema) in bad.items():
            channel = writer.register_channel(topic, encoding, schema)
            writer.add_message(channel, START, b'\x00\x01\x00\x00garbage', START)
        for time, topic, _, data in recorded:
            if topic == '/point':
                writer.add_message(good, time, data, time)
        writer.finish()
    with Log([tmp_path / 'log.mcap']) as log:
        assert read(log, ['/point']) == expected(recorded, ['/point'])
        for topic, says in [
                ('/text', 'type a/msg/B: its definition is of no use'),
                ('/json', "is encoded as 'json'"),
                ('/short', '(a/msg/D) cannot be decoded: '),
                ('/unknown', 'type a/msg/E: no definition of it is at hand; where it is')]:
            with pytest.raises(LogError) as refused:
                read(log, [topic])
            assert f'log.mcap: {topic}' in str(refused.value)
            assert says in str(refused.value)
            assert '\n' not in str(refused.value)


RULE = '=' * 80
NESTED = {
    'msg': f'float64 value\nG inner\n{RULE}\nMSG: a/G\nint32 number\n',
    'crlf': f'float64 value\r\nG inner\r\n{RULE}\r\nMSG: a/G\r\nint32 number\r\n',
    'mixed': f'\ufefffloat64 value\nG inner\n{RULE}\nMSG: a/G\nint32 number\r\n',
    'idl': f"""\
{RULE}
IDL: a/msg/F
// generated from rosidl_adapter/resource/msg.idl.em
#include "a/msg/G.idl"

module a {{
  module msg {{
    struct F {{
      double value;
      a::msg::G inner;
    }};
  }};
}};

{RULE}
IDL: a/msg/G

module a {{
  module msg {{
    struct G {{
      int32 number;
    }};
  }};
}};
"""}
"""Definitions as rosbag2 writes them, of one type."""


@pytest.mark.parametrize('text', NESTED.values(), ids=NESTED)
def test_definitions_as_they_come(text: str) -> None:
    store = typestore('a/msg/F', text, text.startswith(RULE))
    made = store.serialize_cdr(build(store, 'a/msg/F', {
        'value': 0.5, 'inner': {'number': 7}}), 'a/msg/F')
    assert store.deserialize_cdr(made, 'a/msg/F').inner.number == 7


def test_schemas_that_the_index_leaves_out(tmp_path: Path) -> None:
    recorded = list(messages(50))
    path = tmp_path / 'log.mcap'
    recorded_logs.write_mcap(path, recorded, repeat_schemas=False)
    with Log([path]) as log:
        assert read(log) == expected(recorded)
        assert not log.warnings


def test_what_was_announced_and_never_published_is_left_alone(tmp_path: Path) -> None:
    recorded = list(messages(50))
    path = tmp_path / 'log.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start(profile='ros2')
        kind = TOPICS['/point']
        writer.register_channel('/point', 'json', writer.register_schema(
            'a/msg/B', 'jsonschema', b'{}'))
        good = writer.register_channel('/point', 'cdr', writer.register_schema(
            kind, 'ros2msg', definition(kind)))
        for time, topic, _, data in recorded:
            if topic == '/point':
                writer.add_message(good, time, data, time)
        writer.finish()
    with Log([path]) as log:
        log.require({'/point': kind})
        assert read(log, ['/point']) == expected(recorded, ['/point'])


def test_first_messages_that_cannot_be_decoded(tmp_path: Path) -> None:
    recorded = [message for message in messages(200) if message[1] == '/point']
    path = tmp_path / 'log.mcap'
    for bad in (1, MAX_UNDECODED):
        with LogWriter(path) as writer:
            for index, (time, topic, kind, data) in enumerate(recorded):
                writer.write_raw(topic, kind, b'' if index < bad else data, time)
        with Log([path]) as log:
            if bad == 1:
                assert read(log) == expected(recorded[1:])
                assert 'cannot be decoded everywhere' in log.warnings[0]
            else:
                with pytest.raises(LogError, match='cannot be decoded: '):
                    read(log)


def definition(kind: str) -> bytes:
    return standard_types().generate_msgdef(kind, ros_version=2)[0].encode()


# --- what cannot be read ------------------------------------------------------------------


def test_what_is_no_log_is_refused_in_one_line(tmp_path: Path) -> None:
    recorded = list(messages(30))
    recorded_logs.write_mcap(tmp_path / 'good.mcap', recorded)
    start = (tmp_path / 'good.mcap').read_bytes()
    (tmp_path / 'nothing').mkdir()
    (tmp_path / 'empty.mcap').write_bytes(b'')
    (tmp_path / 'text.mcap').write_bytes(b'no log at all, but long enough to be one')
    (tmp_path / 'large.mcap').write_text(
        'version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 4\n')
    (tmp_path / 'magic.mcap').write_bytes(start[:5])
    (tmp_path / 'head.mcap').write_bytes(start[:40])
    (tmp_path / 'old.bag').write_bytes(b'#ROSBAG V1.2\n' + bytes(4000))
    (tmp_path / 'zip.mcap.zstd').write_bytes(b'no zstd')
    recorded_logs.write_mcap(tmp_path / 'none.mcap', [])
    recorded_logs.write_old_sqlite(tmp_path / 'none.db3', [])
    for name, says in {
            'absent.mcap': 'no such file or directory',
            'nothing': 'no log in this directory (.mcap, .db3, .bag)',
            'empty.mcap': 'is empty',
            'text.mcap': 'is not a log (MCAP, sqlite3 of rosbag2, ROS 1 bag 2.0, or '
                         'ArduPilot .BIN)',
            'large.mcap': 'only points to the log, which git lfs pull brings',
            'magic.mcap': 'cut off before its first message',
            'head.mcap': 'cut off before its first message',
            'old.bag': 'is not a log',
            'zip.mcap.zstd': 'cannot be decompressed',
            'none.mcap': 'holds no messages',
            'none.db3': 'holds no messages'}.items():
        with pytest.raises(LogError) as refused:
            Log([tmp_path / 'good.mcap', tmp_path / name] if 'none' not in name
                and name != 'head.mcap' else [tmp_path / name])
        assert str(refused.value).startswith(f'{tmp_path}/{name}: {says}')
        assert '\n' not in str(refused.value)


def test_a_database_that_is_no_log(tmp_path: Path) -> None:
    base = recorded_logs.write_old_sqlite(tmp_path / 'base.db3', [], finish=False)
    base.execute('DROP TABLE topics')
    base.close()
    with pytest.raises(LogError, match=r'base.db3: not a log of rosbag2 \(no tables'):
        Log([tmp_path / 'base.db3'])


def test_missing_topics_and_other_types_are_named(tmp_path: Path) -> None:
    recorded_logs.write_mcap(tmp_path / 'log.mcap', list(messages(10)))
    with Log([tmp_path / 'log.mcap']) as log:
        log.require({'/point': TOPICS['/point'], '/array': ''})
        with pytest.raises(LogError) as refused:
            log.require({'/array': '', '/points': ''})
        assert str(refused.value) == (
            f'{tmp_path}/log.mcap: no messages on /points; it has /array, /point; '
            "did you mean '/point'?")
        with pytest.raises(LogError) as refused:
            log.require({'/array': 'std_msgs/msg/Float32MultiArray'})
        assert str(refused.value) == (
            f'{tmp_path}/log.mcap: /array is {ARRAY}, not std_msgs/msg/Float32MultiArray')
        with pytest.raises(LogError, match=r'log.mcap: is 0.5 s long; nothing is left from 60 s'):
            list(log.messages(['/point'], start=60.0))


# --- cut off ------------------------------------------------------------------------------


def test_the_cut_is_reported(tmp_path: Path) -> None:
    whole = tmp_path / 'whole.mcap'
    recorded_logs.write_mcap(whole, list(messages(300)), chunk=5000)
    (tmp_path / 'cut.mcap').write_bytes(whole.read_bytes()[:-3000])
    with Log([tmp_path / 'cut.mcap']) as log:
        count = len(read(log))
        assert log.warnings == [
            f'{tmp_path}/cut.mcap: cut off after {(count - 1) * 0.05:.1f} s (no end of file); '
            f'{count} messages before the cut are used']


@pytest.mark.long
@pytest.mark.parametrize('tail', ['nothing', 'zeros'])
@pytest.mark.parametrize('name', [name for name in FORMATS if name.endswith('.mcap')])
def test_a_cut_mcap_gives_all_before_the_cut(name: str, tail: str, tmp_path: Path) -> None:
    recorded = list(messages(120))
    FORMATS[name](tmp_path / 'whole.mcap', recorded)
    everything = expected(recorded)
    data = (tmp_path / 'whole.mcap').read_bytes()
    path = tmp_path / 'cut.mcap'
    more = 0
    for cut in [*range(9, len(data), 331), *range(len(data) - 60, len(data))]:
        path.write_bytes(data[:cut] + bytes(700 if tail == 'zeros' else 0))
        got = read_or_nothing(path)
        assert got == everything[:len(got)]
        recovered = len(stream_reader(data[:cut]))
        assert len(got) >= recovered
        more += len(got) > recovered
    assert len(got) == len(everything)
    if name == 'plain.mcap':
        assert more > 20  # cuts inside a chunk still give the messages before them


@pytest.mark.parametrize('compression', ['zstd', 'lz4', ''])
def test_a_cut_inside_a_big_chunk_gives_nearly_all_of_it(
        compression: str, tmp_path: Path) -> None:
    recorded = list(messages(6000))
    recorded_logs.write_mcap(tmp_path / 'whole.mcap', recorded, compression=compression,
                             chunk=10_000_000)
    data = (tmp_path / 'whole.mcap').read_bytes()
    everything = expected(recorded)
    path = tmp_path / 'cut.mcap'
    for fraction in (0.3, 0.5, 0.7, 0.9):
        cut = int(len(data) * fraction)
        path.write_bytes(data[:cut])
        got = read_or_nothing(path)
        assert stream_reader(data[:cut]) == []
        assert got == everything[:len(got)]
        assert len(got) > 6000 * (fraction - 0.15)  # a block of zstd is 10 % of this


def test_a_cut_plain_mcap_gives_every_whole_message(tmp_path: Path) -> None:
    recorded = list(messages(120))
    recorded_logs.write_mcap(tmp_path / 'whole.mcap', recorded, compression='', chunk=9000)
    data = (tmp_path / 'whole.mcap').read_bytes()
    ends = [data.index(message[3]) + len(message[3]) for message in recorded]
    path = tmp_path / 'cut.mcap'
    for cut in [end + by for end in ends[::5] for by in (-1, 0, 1)]:
        path.write_bytes(data[:cut])
        assert len(read_or_nothing(path)) == sum(end <= cut for end in ends)


@pytest.mark.long
@pytest.mark.parametrize('name, tail', [
    ('old.db3', 0), ('none.bag', 0), ('none.bag', 3000), ('bz2.bag', 0), ('lz4.bag', 3000)])
def test_other_cut_logs(name: str, tail: int, tmp_path: Path) -> None:
    recorded = list(messages(2000))
    FORMATS[name](tmp_path / 'whole', recorded)
    everything = expected(recorded)
    data = (tmp_path / 'whole').read_bytes()
    counts = []
    for cut in np.linspace(20, len(data) - 1, 40).astype(int):
        (tmp_path / 'cut').write_bytes(data[:cut] + bytes(tail))
        got = read_or_nothing(tmp_path / 'cut')
        assert got == everything[:len(got)]
        counts.append(len(got))
    assert counts == sorted(counts)
    # a whole chunk is lost where the codec cannot do with less
    lost = {'old.db3': 80, 'none.bag': 30}.get(name, 550)
    assert all(count >= 2000 * index / 40 - lost for index, count in enumerate(counts))


def test_a_damaged_chunk_is_left_out_and_reported(tmp_path: Path) -> None:
    recorded = list(messages(200))
    everything = expected(recorded)
    for compression, index in itertools.product(
            ['', 'zstd', 'lz4'], [IndexType.ALL, IndexType.NONE]):
        path = tmp_path / f'{compression}{index}.mcap'
        recorded_logs.write_mcap(path, recorded, compression=compression, chunk=5000, index=index)
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 0x55
        path.write_bytes(data)
        with Log([path]) as log:
            got = read(log)
            assert log.warnings == [f'{path}: damaged; some of its messages are left out, '
                                    f'{len(got)} were read']
        assert 150 < len(got) < 200
        assert all(message in everything for message in got)


@pytest.mark.parametrize('name', [name for name in FORMATS if '.' in name])
def test_random_damage_is_never_a_traceback(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    FORMATS[name](path, list(messages(60)))
    whole = path.read_bytes()
    random = np.random.default_rng(2)
    for _ in range(25):
        data = bytearray(whole)
        reach = random.choice([200, len(data)])  # what is in the beginning counts most
        for place in random.integers(0, reach, random.choice([1, 3, 20])):
            data[place] = random.integers(256)
        if random.random() < 0.3:
            start = random.integers(len(data))
            del data[start:start + random.integers(100)]
        path.write_bytes(data)
        try:
            with Log([path]) as log:
                got = len(read(log))
                if 'chunked' not in name and name.endswith('.mcap'):  # the others have no sums
                    assert got == 60 or log.warnings
        except LogError as error:
            assert '\n' not in str(error)


def stream_reader(data: bytes) -> list[McapMessage]:
    """Return what the format's own package gets out of a cut file."""
    found = []
    # it raises what comes: McapError, RuntimeError of lz4, ZstdError, struct.error
    with contextlib.suppress(Exception):
        for record in StreamReader(BytesIO(data)).records:
            if isinstance(record, McapMessage):
                found.append(record)
    return found


def read_or_nothing(path: Path) -> list[tuple[int, str, list]]:
    try:
        with Log([path]) as log:
            assert len(log.warnings) == 1, 'a cut has to be reported'
            assert 'cut off' in log.warnings[0]
            return read(log)
    except LogError as error:
        assert 'cut off' in str(error)
        return []


RECORDER = """
import os, signal, sys
sys.path[:0] = {path!r}
from test.support import recorded_logs
from pathlib import Path
base = recorded_logs.write_old_sqlite(
    Path({file!r}), list(recorded_logs.messages(500)), journal={journal!r}, finish=False)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize('journal', ['wal', 'delete', 'memory'])
def test_a_killed_sqlite_recorder(journal: str, tmp_path: Path) -> None:
    (tmp_path / 'bag').mkdir()
    file = tmp_path / 'bag' / 'bag_0.db3'
    code = RECORDER.format(path=sys.path, file=str(file), journal=journal)
    killed = subprocess.run([sys.executable, '-c', code], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert (file.with_name('bag_0.db3-wal')).exists() is (journal == 'wal')
    with Log([tmp_path / 'bag']) as log:
        assert read(log) == expected(list(messages(500)))


# --- the node's own record ----------------------------------------------------------------


def test_a_record_of_the_node_comes_in_the_order_of_the_file(tmp_path: Path) -> None:
    recorded = list(messages(200))
    order = shuffled(recorded, 40)
    write(tmp_path / 'record.mcap', order, record=True)
    with Log([tmp_path / 'record.mcap']) as log:
        assert log.recorded
        assert log.metadata['rovid_record'] == {'version': '1'}
        assert [time for time, _, _ in read(log)] == [message[0] for message in order]
        assert [time for time, _, _ in read(log, start=2.0, duration=3.0)] == [
            message[0] for message in order if 2e9 <= message[0] - START < 5e9]


def test_two_records_come_one_after_the_other_and_others_are_not_mixed_in(
        tmp_path: Path) -> None:
    recorded = list(messages(200))
    first, second = shuffled(recorded[:100], 9), shuffled(recorded[100:], 9)
    write(tmp_path / 'first.mcap', first, record=True)
    write(tmp_path / 'second.mcap', second, record=True)
    write(tmp_path / 'other.mcap', second)
    with Log([tmp_path / 'second.mcap', tmp_path / 'first.mcap']) as log:
        assert log.recorded
        assert [m[0] for m in read(log)] == [m[0] for m in first + second]
    with Log([tmp_path / 'first.mcap', tmp_path / 'other.mcap']) as log:
        assert not log.recorded
        assert 'joined with other logs' in log.warnings[0]
        assert read(log) == expected(recorded)


def test_joined_records_begin_where_the_first_did(tmp_path: Path) -> None:
    recorded = list(messages(200))
    for name, part in (('b', recorded[:100]), ('a', recorded[100:])):
        write(tmp_path / f'{name}.mcap', part, record=True, state=name)
    with Log([tmp_path / 'a.mcap', tmp_path / 'b.mcap']) as log:
        assert log.metadata['rovid_record']['state'] == 'b'


def write(path: Path, recorded: Recorded, record: bool = False, **more: str) -> None:
    with LogWriter(path) as writer:
        if record:
            writer.metadata('rovid_record', {'version': '1', **more})
        for index, (time, topic, kind, data) in enumerate(recorded):
            writer.write_raw(topic, kind, data, time)
            if index % 50 == 49:
                writer.flush()


# --- writing ------------------------------------------------------------------------------


def test_what_is_written_opens_everywhere(tmp_path: Path) -> None:
    path = tmp_path / 'out.mcap'
    fields = {
        'header': {'stamp': {'sec': 3, 'nanosec': 4}, 'frame_id': 'base_link'},
        'name': ['surge', 'yaw'], 'velocity': [0.5, 0.25], 'effort': (1.0, 2.0)}
    with LogWriter(path) as writer:
        writer.metadata('rovid_truth', {'surge': '{"mass": 305.0}'})
        writer.write('/rov/identifier_state', 'sensor_msgs/msg/JointState', fields, 5, 4)
        writer.write('/rov/identifier_state', 'sensor_msgs/msg/JointState', {}, 6)
        writer.write('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', {
            'status': [{'level': 2, 'name': 'surge', 'values': [{'key': 'a', 'value': 'é'}]}]}, 7)
        writer.write('/empty', 'std_msgs/msg/Empty', {}, 7)
        writer.write_raw('/own', 'own_msgs/msg/Thrust', b'\x00\x01\x00\x00\x02\x00\x00\x00', 8,
                         'Pair pair\n' + '=' * 80 + '\nMSG: own_msgs/Pair\nint16 a\nint16 b\n')

    with AnyReader([path]) as reader:
        got = {connection.topic: (time, reader.deserialize(data, connection.msgtype))
               for connection, time, data in reader.messages()}
    assert got['/rov/identifier_state'][0] == 6
    assert got['/rov/identifier_state'][1].velocity.size == 0
    assert got['/diagnostics'][1].status[0].values[0].value == 'é'
    assert got['/own'][1].pair.a == 2

    with path.open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        assert [record.metadata for record in reader.iter_metadata()] == [
            {'surge': '{"mass": 305.0}'}]
        schema, channel, message = next(iter(reader.iter_messages()))
    assert (schema.name, schema.encoding) == ('sensor_msgs/msg/JointState', 'ros2msg')
    assert (channel.message_encoding, message.log_time, message.publish_time) == ('cdr', 5, 4)

    with Log([path]) as log:
        assert log.metadata == {'rovid_truth': {'surge': '{"mass": 305.0}'}}
        first = next(log.messages(['/rov/identifier_state']))
        assert first.type == 'sensor_msgs/msg/JointState'
        assert first.data.header.frame_id == 'base_link'
        assert first.data.name == ['surge', 'yaw']
        assert first.data.effort.tolist() == [1.0, 2.0]
        assert log.blank('/own').pair.b == 0


def test_rosbag2_knows_what_to_latch(tmp_path: Path) -> None:
    path = tmp_path / 'out.mcap'
    with LogWriter(path) as writer:
        for topic in ('/rov/params', '/rov/velocity'):
            writer.write(topic, 'std_msgs/msg/Empty', {}, 1, latched=topic == '/rov/params')
    with AnyReader([path]) as reader:
        offered = {connection.topic: connection.ext.offered_qos_profiles
                   for connection in reader.connections}
    for topic, durability in (('/rov/params', 'TRANSIENT_LOCAL'), ('/rov/velocity', 'VOLATILE')):
        profile, = offered[topic]
        assert (profile.reliability.name, profile.durability.name, profile.history.name) == (
            'RELIABLE', durability, 'KEEP_LAST')
    with path.open('rb') as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    for channel in summary.channels.values():  # numbers: what every version of rosbag2 reads
        profile, = yaml.safe_load(channel.metadata['offered_qos_profiles'])
        assert list(profile) == [
            'history', 'depth', 'reliability', 'durability', 'deadline', 'lifespan',
            'liveliness', 'liveliness_lease_duration', 'avoid_ros_namespace_conventions']
        assert profile['reliability'] == 1
        assert profile['lifespan'] == {'sec': 9223372036, 'nsec': 854775807}


FULL = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
from pathlib import Path
from rovid_ros.logs.writer import LogWriter
try:
    with LogWriter(Path({file!r})) as writer:
        for time in range(100_000):
            writer.write('/a', 'std_msgs/msg/Empty', {{}}, time)
except OSError as error:
    print(error.filename)
"""


def test_a_full_disk_is_told_with_the_file(
        tmp_path: Path, repository: Path, environment: dict[str, str]) -> None:
    path = str(tmp_path / 'out.mcap')
    run = subprocess.run(
        [sys.executable, '-c', FULL.format(file=path)], cwd=repository, env=environment,
        capture_output=True, text=True)
    assert (run.stdout, run.stderr) == (f'{path}\n', '')


WRITER = """
import os, signal, sys
sys.path[:0] = {path!r}
from test.support import recorded_logs
from pathlib import Path
from rovid_ros.logs.writer import LogWriter
writer = LogWriter(Path({file!r}))
for time, topic, kind, data in recorded_logs.messages(500):
    writer.write_raw(topic, kind, data, time)
    if time == recorded_logs.START + 399 * 50_000_000:
        writer.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_flush_survives_kill(tmp_path: Path) -> None:
    file = tmp_path / 'out.mcap'
    code = WRITER.format(path=sys.path, file=str(file))
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == -9
    with Log([file]) as log:
        got = read(log)
    assert len(got) >= 400
    assert got == expected(list(messages(500)))[:len(got)]


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match='absent/out.mcap: cannot be written: No such file'):
        LogWriter(tmp_path / 'absent' / 'out.mcap')
    with LogWriter(tmp_path / 'out.mcap') as writer:
        with pytest.raises(TypeUnknownError, match='type own_msgs/msg/A: ROS 2 comes with no'):
            writer.write('/a', 'own_msgs/msg/A', {}, 1)
        with pytest.raises(TypeUnknownError, match='no definition'):
            writer.write_raw('/a', 'own_msgs/msg/A', b'', 1)
        with pytest.raises(ValueError, match=r"geometry_msgs/msg/Point: has no field 'xx', "
                                             r"it has x, y, z; did you mean 'x'\?"):
            writer.write('/a', 'geometry_msgs/msg/PointStamped', {'point': {'xx': 1.0}}, 1)


def test_messages_that_are_written_together_are_in_the_log_as_one_by_one(tmp_path: Path) -> None:
    for together in (False, True):
        with LogWriter(tmp_path / f'{together}.mcap') as writer:
            channels = [writer.write_raw(topic, 'std_msgs/msg/String', data, 5, publish_time=-1)
                        for topic, data in (('/a', b'1'), ('/b', b'22'))]
            for time in (6, -3):
                if together:
                    writer.write_together(channels, [b'333', b''], time, 7)
                else:
                    writer.write_raw('/a', 'std_msgs/msg/String', b'333', time, publish_time=7)
                    writer.write_raw('/b', 'std_msgs/msg/String', b'', time, publish_time=7)
    assert (tmp_path / 'True.mcap').read_bytes() == (tmp_path / 'False.mcap').read_bytes()


def test_build_fills_every_kind_of_field() -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    imu = build(store, 'sensor_msgs/msg/Imu', {'orientation_covariance': {2: 5.0}})
    assert imu.orientation.w == 1.0
    assert imu.orientation_covariance.tolist() == [0.0, 0.0, 5.0] + 6 * [0.0]
    assert imu.orientation_covariance.dtype == np.float64
    joy = build(store, 'sensor_msgs/msg/Joy', {'axes': {3: 0.5}, 'buttons': [1, 0]})
    assert joy.axes.tolist() == [0.0, 0.0, 0.0, 0.5]
    assert (joy.axes.dtype, joy.buttons.dtype) == (np.float32, np.int32)
    joints = build(store, 'sensor_msgs/msg/MultiDOFJointState', {
        'joint_names': {1: 'b'}, 'twist': {1: {'linear': {'x': 2.0}}}})
    assert joints.joint_names == ['', 'b']
    assert [twist.linear.x for twist in joints.twist] == [0.0, 2.0]
    for name in store.fielddefs:
        message = build(store, name, {})
        store.deserialize_cdr(store.serialize_cdr(message, name), name)
