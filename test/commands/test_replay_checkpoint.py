"""``rovid replay --checkpoint``: interrupted, gone on from, appended to, refused."""

from collections.abc import Callable, Iterator
import json
from pathlib import Path
import random
import signal
from typing import Any

from mcap.reader import make_reader
import pytest
from rovid_ros.commands.feeder import PipeFeeder
from rovid_ros.commands.main import main
from rovid_ros.commands.replay_checkpoint import read_state
from rovid_ros.files.output_log import OutputFile
from rovid_ros.logs.log import LogMessage
from rovid_ros.logs.writer import LogWriter

DURATION = 20  # [s]


@pytest.fixture(scope='module')
def config(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a parameter file that saves as often as it can."""
    text = (repository / 'config' / 'jhurov.yaml').read_text()
    path = tmp_path_factory.mktemp('config') / 'vehicle.yaml'
    assert text.count('period: 60.0') == 1
    path.write_text(text.replace('period: 60.0', 'period: 0.1'))
    return path


@pytest.fixture(scope='module')
def log(config: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('log') / 'log.mcap'
    assert main(['simulate', '--params-file', str(config), '--output', str(path),
                 '--duration', str(DURATION)]) == 0
    return path


@pytest.fixture(scope='module')
def halves(log: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return the log in two files."""
    paths = [tmp_path_factory.mktemp('halves') / f'{name}.mcap' for name in ('first', 'second')]
    writers = [LogWriter(path) for path in paths]
    with log.open('rb') as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            writers[message.log_time > 1_700_000_009_000_000_000].write_raw(
                channel.topic, schema.name, message.data, message.log_time)
    for writer in writers:
        writer.close()
    return paths


class Call:
    """A replay that writes everything."""

    def __init__(self, config: Path, folder: Path) -> None:
        self.config, self.folder = config, folder
        self.state, self.json, self.output = (
            folder / name for name in ('state.json', 'out.json', 'out.mcap'))
        folder.mkdir(exist_ok=True)

    def __call__(self, *arguments: object, output: bool = True) -> int:
        more = ['--output', self.output] if output else []
        return main(['replay', *map(str, [
            *arguments, '--params-file', self.config, '--json', self.json, *more])])

    def go_on(self, *arguments: object, **options: bool) -> int:
        return self(*arguments, '--checkpoint', self.state, **options)


@pytest.fixture
def call(config: Path, tmp_path: Path) -> Call:
    return Call(config, tmp_path / 'cut')


@pytest.fixture(scope='module')
def straight(config: Path, log: Path, tmp_path_factory: pytest.TempPathFactory) -> Call:
    """Return a replay that ran through."""
    made = Call(config, tmp_path_factory.mktemp('straight'))
    assert made(log) == 0
    return made


@pytest.fixture
def interrupt(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Return what makes the next replay get a signal at its n-th message."""
    feed = PipeFeeder.feed

    def after(count: int) -> None:
        left = [count]

        def cut(self: PipeFeeder, message: LogMessage) -> Any:
            left[0] -= 1
            if not left[0]:
                signal.raise_signal(signal.SIGTERM)
            return feed(self, message)

        monkeypatch.setattr(PipeFeeder, 'feed', cut)

    return after


def messages(path: Path) -> Iterator[tuple[str, int, int, bytes]]:
    with path.open('rb') as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            yield channel.topic, message.log_time, message.publish_time, message.data


def report(text: str) -> list[str]:
    """Return what was printed, but for where things are."""
    return [line for line in text.splitlines() if 'written' not in line]


def test_an_interrupted_replay_goes_on(
        call: Call, straight: Call, log: Path, interrupt: Callable[[int], None],
        capsys: pytest.CaptureFixture[str]) -> None:
    assert straight(log) == 0
    expected = report(capsys.readouterr().out)
    for count in (1, 300, 2, 500):
        interrupt(count)
        assert call.go_on(log) == 143
        out, err = capsys.readouterr()
        assert out == ''
        assert err.count('\n') == 1
        if count > 2:
            assert f'{call.folder / "out.part.mcap"} holds what came of it' in err
        assert f'{call.state} is where it goes on' in err
        assert not call.output.exists()
        assert not call.json.exists()
    interrupt(0)
    for _ in range(2):  # and once more, when there is nothing left to do
        assert call.go_on(log) == 0
        assert report(capsys.readouterr().out) == expected
        assert call.json.read_bytes() == straight.json.read_bytes()
        assert list(messages(call.output)) == list(messages(straight.output))
        assert {path.name for path in call.folder.iterdir()} == {
            'out.json', 'out.mcap', 'state.json'}


def test_a_second_log_goes_on_from_the_first(
        call: Call, straight: Call, halves: list[Path], interrupt: Callable[[int], None],
        capsys: pytest.CaptureFixture[str]) -> None:
    assert straight(*halves) == 0
    expected = report(capsys.readouterr().out)
    assert call.go_on(halves[0]) == 0
    before = list(messages(call.output))
    interrupt(100)
    assert call.go_on(halves[1], '--append') == 143
    interrupt(0)
    capsys.readouterr()
    assert call.go_on(halves[1], '--append') == 0
    assert report(capsys.readouterr().out) == expected
    assert call.json.read_bytes() == straight.json.read_bytes()
    whole = [message[2:] for message in messages(straight.output)]
    after = [message[2:] for message in messages(call.output)]
    # the last steps of the first part were released by its end, and come again in their place
    again = len(before) + len(after) - len(whole)
    assert 0 <= again < 100
    assert whole == [message[2:] for message in before[:len(before) - again]] + after


def refused(call: Call, *arguments: object, says: str, capsys: pytest.CaptureFixture[str],
            output: bool = True) -> None:
    before = call.state.read_bytes()
    capsys.readouterr()
    assert call.go_on(*arguments, output=output) == 1
    out, err = capsys.readouterr()
    assert out == ''
    assert err.count('\n') == 1
    assert err.startswith(f'rovid replay: {call.state}: ')
    assert says in err
    assert call.state.read_bytes() == before


@pytest.fixture
def half_way(call: Call, log: Path, interrupt: Callable[[int], None]) -> Call:
    """Return a replay that was interrupted."""
    interrupt(400)
    assert call.go_on(log) == 143
    interrupt(0)
    return call


def test_a_state_that_does_not_fit_is_refused(
        half_way: Call, log: Path, halves: list[Path], tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    call, config = half_way, half_way.config
    part = call.folder / 'out.part.mcap'
    written = part.read_bytes()
    refused(call, halves[0], capsys=capsys, says='is of log.mcap, not of first.mcap')
    refused(call, log, '--start', 3, capsys=capsys, says='is of start and duration [0.0, None]')
    refused(call, halves[1], '--append', capsys=capsys,
            says='log.mcap has not been read to its end')
    refused(call, log, '--method', 'rls', capsys=capsys,
            says='was made with identifier.method ekf, configured is rls')
    for old, new, says in (
            ('gain: [40.0, 40.0, 55.0]', 'gain: [40.0, 41.0, 55.0]', 'thrusters.gain [40.0, 40.0'),
            ('max_wait: 0.1', 'max_wait: 0.2', 'max_wait 0.1, configured is 0.2')):
        call.config = tmp_path / 'other.yaml'
        assert old in config.read_text()
        call.config.write_text(config.read_text().replace(old, new))
        refused(call, log, capsys=capsys, says=says)
    call.config.write_text(config.read_text().replace('period: 0.1', 'period: 50.0'))
    assert part.read_bytes() == written
    assert call.go_on(log) == 0  # when to save is free


def test_a_state_goes_with_its_output(
        half_way: Call, log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (half_way.folder / 'out.part.mcap').unlink()
    capsys.readouterr()
    assert half_way.go_on(log) == 1
    assert 'neither it nor out.part.mcap holds the' in capsys.readouterr().err
    assert half_way.go_on(log, output=False) == 0
    refused(half_way, log, capsys=capsys, says='was made without --output')


def test_an_earlier_log_cannot_follow(
        call: Call, halves: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert call.go_on(halves[1]) == 0
    refused(call, halves[0], '--append', capsys=capsys,
            says='first.mcap begins before the end of second.mcap')


@pytest.mark.parametrize('content, says', [
    ('', 'Expecting value'), ('[]', 'is not the state of a replay'),
    ('{"rovid_checkpoint": 2}', 'is not the state of a replay'),
    ('{"rovid_replay": 0, "version": "0.0.1"}', 'was written by version 0.0.1 (0)'),
    ('[' * 100_000, 'makes no sense')])
def test_another_file_is_refused(
        content: str, says: str, call: Call, log: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    call.state.write_text(content)
    refused(call, log, capsys=capsys, says=says)


def test_a_damaged_file_is_refused(
        half_way: Call, log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = half_way.state.read_bytes()
    content = read_state(half_way.state)
    chance = random.Random(7)
    for _ in range(40):
        damaged = bytearray(good)
        damaged[chance.randrange(len(good))] = chance.randrange(256)
        if chance.random() < 0.3:
            del damaged[chance.randrange(len(good)):]
        half_way.state.write_bytes(damaged)
        try:
            assert read_state(half_way.state) == content
        except ValueError:
            pass
    changed = json.loads(good)
    changed['state']['read']['object'][1]['steps'] += 1
    half_way.state.write_text(json.dumps(changed))
    refused(half_way, log, capsys=capsys, says='is damaged')


@pytest.mark.parametrize('arguments, says', [
    (['--append'], '--append goes with --checkpoint'),
    (['--ros', '--checkpoint', 'x.json'], '--checkpoint does not go with --ros')])
def test_wrong_usage(arguments: list[str], says: str, config: Path, log: Path,
                     capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['replay', str(log), '--params-file', str(config), *arguments]) == 2
    assert says in capsys.readouterr().err


def test_nothing_to_append_to_is_told(
        call: Call, log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call.go_on(log, '--append') == 1
    assert 'is not there; --append goes on from a state' in capsys.readouterr().err


def test_an_output_gets_its_name_when_it_is_whole(tmp_path: Path) -> None:
    path, part = tmp_path / 'out.mcap', tmp_path / 'out.part.mcap'
    path.write_text('good')
    with OutputFile(path) as file:
        pass
    assert not part.exists()
    with pytest.raises(RuntimeError), OutputFile(path) as file:
        file.write('/a', 'std_msgs/msg/String', {'data': 'x'}, 1)
        raise RuntimeError
    assert path.read_text() == 'good'
    earlier = file.count, file.checksum
    (tmp_path / '.out.part.mcap.99999999').write_text('of a process that was killed')
    with OutputFile(path, earlier) as file:
        file.write('/a', 'std_msgs/msg/String', {'data': 'y'}, 2)
    file.finish()
    assert [time for _, time, _, _ in messages(path)] == [1, 2]
    assert [entry.name for entry in tmp_path.iterdir()] == ['out.mcap']


@pytest.mark.parametrize('changes', [
    {'identifier.adaptation_time': 9.0, 'max_gap': 2.0, 'enable': False},
    {'identifier.adaptation_gains': [1e-5, 5.0, 1.0, 0.1], 'identifier.feedback_gain': -3.0}])
def test_settings_that_a_control_changed_go_with_the_state(
        changes: dict[str, Any], call: Call, straight: Call, log: Path, tmp_path: Path,
        interrupt: Callable[[int], None]) -> None:
    pytest.importorskip('rovid_ros.commands.controls')
    record = tmp_path / 'record.mcap'
    with LogWriter(record) as writer, log.open('rb') as file:
        writer.metadata('rovid_record', {})
        for number, (schema, channel, message) in enumerate(make_reader(file).iter_messages()):
            assert schema is not None
            if number == 200:
                control = {'control': 'parameters', 'value': json.dumps(changes)}
                writer.write('rovid/control', 'std_msgs/msg/String',
                             {'data': json.dumps(control)}, message.log_time)
            writer.write_raw(channel.topic, schema.name, message.data, message.log_time)
    assert straight(record, '--method', 'aid') == 0
    for count in (150, 100, 200):
        interrupt(count)
        assert call.go_on(record, '--method', 'aid') == 143
    assert json.loads(call.state.read_text())['changes'].keys() == changes.keys()
    interrupt(0)
    assert call.go_on(record, '--method', 'aid') == 0
    assert call.json.read_bytes() == straight.json.read_bytes()
    assert list(messages(call.output)) == list(messages(straight.output))
