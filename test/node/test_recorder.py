"""The record of a node in parts: each whole, and all of them the run."""

from pathlib import Path
import random
import resource
import signal

import pytest
from rovid_core.model.samples import Event
from rovid_ros.logs.log import Log, RECORD
from rovid_ros.messages.types import build, standard_types
from rovid_ros.node.recorder import Received, Recorder

STRING = 'std_msgs/msg/String'
SECOND = 1_000_000_000


def feed(recorder: Recorder, seconds: list[float], size: int = 10) -> None:
    """Record a message of random letters for each time."""
    chance = random.Random(1)
    for number, second in enumerate(seconds):
        text = f'{number} ' + ''.join(chance.choices('abcdefghijklmnop', k=size))
        message = build(standard_types(), STRING, {'data': text})
        time = round(second * SECOND)
        recorder.released(Event(time, (), Received(
            '/a', STRING, bytes(standard_types().serialize_cdr(message, STRING)), time)))
        recorder.flush()


def recorder_of(path: Path, **limits: float) -> Recorder:
    states = iter(range(1, 100))
    return Recorder(path, lambda type: 'string data\n', pytest.fail,
                    lambda: {'number': next(states)}, **limits)


def numbers(*paths: Path) -> list[int]:
    with Log(paths) as log:
        assert log.recorded
        assert log.warnings == []
        return [int(message.data.data.split()[0]) for message in log.messages(['/a'])]


def parts(folder: Path) -> list[Path]:
    return sorted(folder.iterdir(), key=lambda path: (len(path.name), path.name))


def test_a_record_that_lasts_long_goes_on_in_another_file(tmp_path: Path) -> None:
    recorder = recorder_of(tmp_path / 'r.mcap', max_duration=2.0)
    recorder.open(None)
    feed(recorder, [100.0 + 0.5 * k for k in range(11)])
    recorder.close()
    assert [path.name for path in parts(tmp_path)] == ['r.mcap', 'r-1.mcap', 'r-2.mcap']
    assert [numbers(path) for path in parts(tmp_path)] == [
        [0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10]]
    assert numbers(tmp_path) == [*range(11)]
    assert numbers(*reversed(parts(tmp_path))) == [*range(11)]


def test_each_part_begins_with_the_state_of_its_time(tmp_path: Path) -> None:
    recorder = recorder_of(tmp_path / 'r.mcap', max_duration=1.0)
    recorder.open({'number': 0})
    feed(recorder, [0.0, 1.0, 2.0])
    recorder.close()
    for number, path in enumerate(parts(tmp_path)):
        with Log([path]) as log:
            assert log.metadata[RECORD]['state'] == f'{{"number": {number}}}'
    with Log(parts(tmp_path)) as log:
        assert log.metadata[RECORD]['state'] == '{"number": 0}'


def test_a_record_that_is_large_goes_on_in_another_file(tmp_path: Path) -> None:
    recorder = recorder_of(tmp_path / 'r.mcap', max_size=20_000.0)
    recorder.open(None)
    feed(recorder, [0.1 * k for k in range(30)], size=4000)
    recorder.close()
    sizes = [path.stat().st_size for path in parts(tmp_path)]
    assert len(sizes) > 2
    assert all(20_000 <= size < 26_000 for size in sizes[:-1])
    assert numbers(tmp_path) == [*range(30)]


def test_a_part_has_as_much_of_messages_as_of_its_state(tmp_path: Path) -> None:
    """Else each message would make a file where the state is larger than a part may be."""
    opened: list[str] = []
    recorder = Recorder(tmp_path / 'r.mcap', lambda type: 'string data\n', pytest.fail,
                        lambda: {'text': 'x' * 50_000}, opened=opened.append, max_size=20_000.0)
    recorder.open({'text': 'x' * 50_000})
    feed(recorder, [0.1 * k for k in range(60)], size=4000)
    recorder.close()
    sizes = [path.stat().st_size for path in parts(tmp_path)]
    assert len(sizes) > 2 and min(sizes[:-1]) > 100_000
    assert numbers(tmp_path) == [*range(60)]
    assert opened == [f'recording to {path}' for path in parts(tmp_path)]


def test_a_record_that_cannot_be_begun_is_no_reason_not_to_start(tmp_path: Path) -> None:
    failures: list[str] = []
    recorder = Recorder(tmp_path / 'r.mcap', lambda type: '', failures.append)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))  # as on a disk that is full
    try:
        recorder.open(None)
        recorder.flush()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, ignored)
    assert not recorder.is_open
    (line,) = failures
    assert line.startswith(f'recording to {tmp_path}/r.mcap ended: ')
    assert parts(tmp_path) == []


def test_parts_stay_in_order_when_the_clock_goes_back(tmp_path: Path) -> None:
    recorder = recorder_of(tmp_path / 'r.mcap', max_duration=1.0)
    recorder.open(None)
    feed(recorder, [50.0, 51.0, 10.0, 11.0, 52.0])
    recorder.close()
    assert len(parts(tmp_path)) == 3
    assert numbers(tmp_path) == [*range(5)]


def test_two_runs_that_are_joined_do_not_mix(tmp_path: Path) -> None:
    for begin in (0.0, 100.0):
        recorder = recorder_of(tmp_path / 'r.mcap', max_duration=1.0)
        recorder.open(None)
        feed(recorder, [begin, begin + 1.0])
        recorder.close()
    assert numbers(tmp_path) == [0, 1, 0, 1]


def test_a_part_that_cannot_be_begun_ends_the_record_alone(tmp_path: Path) -> None:
    failures: list[str] = []
    folder = tmp_path / 'folder'
    recorder = Recorder(folder / 'r.mcap', lambda type: '', failures.append, max_duration=1.0)
    recorder.open(None)
    feed(recorder, [0.0])
    folder.rename(tmp_path / 'gone')
    feed(recorder, [1.0, 2.0])
    recorder.close()
    assert not recorder.is_open
    (line,) = failures
    assert line.startswith(f'recording to {folder}/r.mcap ended: ')
    assert numbers(tmp_path / 'gone' / 'r.mcap') == [0]
