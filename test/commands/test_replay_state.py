"""``rovid replay --state``: a dive goes on from the one before, or the state is refused."""

from collections.abc import Callable
import json
from pathlib import Path
import random
import signal
import subprocess
import sys
from typing import Any

from mcap.reader import make_reader
import pytest
from rovid_core.settings.run import Settings
from rovid_ros.commands.main import main
from rovid_ros.config.parameter_file import load as load_parameters
from rovid_ros.config.parameters import settings_from
from rovid_ros.files.state_file import load, save, StateError, VERSION
from rovid_ros.files.whole_files import FileLock
from rovid_ros.logs.log import Log, LogMessage, RECORD
from rovid_ros.logs.player import PipelinePlayer
from rovid_ros.logs.writer import LogWriter
from rovid_ros.messages.converter import Converter

from test.support.processes import child_environment, REPOSITORY

METHODS = ('aid', 'ekf')

MIDDLE = 1_700_000_009_000_000_000
"""[ns] When the first dive ends and the second one begins."""


@pytest.fixture(scope='module')
def dives(config: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return the logs of two dives, one after the other."""
    folder = tmp_path_factory.mktemp('dives')
    whole, paths = folder / 'log.mcap', [folder / 'first.mcap', folder / 'second.mcap']
    assert main(['simulate', '--params-file', str(config), '--output', str(whole),
                 '--duration', '20']) == 0
    writers = [LogWriter(path) for path in paths]
    with whole.open('rb') as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            writers[message.log_time > MIDDLE].write_raw(
                channel.topic, schema.name, message.data, message.log_time)
    for writer in writers:
        writer.close()
    return paths


def recorded(path: Path, log: Path, state: dict[str, Any]) -> Path:
    """Write a log as a node does that begins from a state; return its path."""
    with LogWriter(path) as writer, log.open('rb') as file:
        writer.metadata(RECORD, {'run': '1', 'part': '0', 'state': json.dumps(state)})
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            writer.write_raw(channel.topic, schema.name, message.data, message.log_time)
    return path


@pytest.mark.long
def test_a_record_that_began_from_a_state_of_another_method_is_replayed_and_compared(
        dives: list[Path], config: Path, tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    call = Call(config, tmp_path)
    assert call(dives[0], '--method', 'ekf') == 0
    record = recorded(tmp_path / dives[1].name, dives[1], json.loads(
        call.state.read_text())['state'])
    results, out = {}, tmp_path / 'out.json'
    for log in (record, dives[1]):
        for method in METHODS:
            assert main(['replay', str(log), '--params-file', str(config), '--method', method,
                         '--json', str(out)]) == 0
            results[log, method] = json.loads(out.read_text())['dofs']
    assert capsys.readouterr().err.count(
        'the node began this recording with a state of ekf; aid begins anew') == 1
    assert results[record, 'aid'] == results[dives[1], 'aid']
    assert results[record, 'ekf'] != results[dives[1], 'ekf']  # it goes on from the state
    compared = []
    for log in (record, dives[1]):
        assert main(['compare', str(log), '--params-file', str(config), '--json', str(out)]) == 0
        compared.append(json.loads(out.read_text()))
    assert compared[0] == compared[1]
    assert 'begins anew' not in capsys.readouterr().err


class Call:
    """A replay that begins from a state and leaves one behind."""

    def __init__(self, config: Path, folder: Path) -> None:
        self.config, self.folder = config, folder
        self.state, self.json, self.output = (
            folder / name for name in ('state.json', 'out.json', 'out.mcap'))

    def __call__(self, *arguments: object) -> int:
        return main(['replay', *map(str, [
            *arguments, '--params-file', self.config, '--json', self.json, '--output',
            self.output, '--state', self.state])])

    def dofs(self) -> dict[str, Any]:
        """Return what the last replay found."""
        found: dict[str, Any] = json.loads(self.json.read_text())['dofs']
        return found

    def content(self) -> dict[str, bytes]:
        """Return every file with its content."""
        return {path.name: path.read_bytes() for path in self.folder.iterdir()}


@pytest.fixture
def call(config: Path, tmp_path: Path) -> Call:
    folder = tmp_path / 'files'
    folder.mkdir()
    return Call(config, folder)


def settings_of(config: Path, method: str) -> Settings:
    return settings_from({**load_parameters(config), 'identifier.method': method})


def restored(settings: Settings, state: dict[str, Any], log: Path) -> PipelinePlayer:
    """Return a pipeline that was restored, as the node restores its own, after a log."""
    player = PipelinePlayer(settings)
    player.stream.restore(state)
    converter = Converter(settings, player.stream.reject)
    with Log([log]) as opened:
        for message in opened.messages(list(converter.topics)):
            for event in converter.events(message.topic, message.data, message.time):
                player.stream.receive(event)
    player.finish()
    return player


@pytest.mark.long
@pytest.mark.parametrize('method', METHODS)
def test_a_dive_goes_on_from_the_one_before(
        method: str, call: Call, dives: list[Path], tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    assert call(dives[0], '--method', method) == 0
    assert f'the initial values, as {call.state} was not there' in capsys.readouterr().out
    settings = settings_of(call.config, method)
    between = load(call.state, settings)
    assert call(dives[1], '--method', method) == 0
    out = capsys.readouterr().out
    assert f'begins from {call.state}\n' in out
    assert f'written   {call.state}\n' in out

    expected = restored(settings, between, dives[1])
    for dof, found in call.dofs().items():
        assert [found[name] for name in ('alpha', 'beta', 'gamma', 'delta')] == list(
            expected.stream.identifier(dof).parameters)
    assert load(call.state, settings) == json.loads(json.dumps(expected.stream.state()))

    (tmp_path / 'alone').mkdir()
    alone = Call(call.config, tmp_path / 'alone')
    assert alone(dives[1], '--method', method) == 0
    assert alone.dofs() != call.dofs()
    for dof, found in call.dofs().items():
        if found['std']:  # two dives tell more than one
            assert found['std']['alpha'] < alone.dofs()[dof]['std']['alpha']


def test_a_replay_is_the_same_with_a_state_to_leave_behind(
        call: Call, dives: list[Path], tmp_path: Path) -> None:
    assert call(dives[0]) == 0
    document, output = tmp_path / 'plain.json', tmp_path / 'plain.mcap'
    assert main(['replay', str(dives[0]), '--params-file', str(call.config), '--json',
                 str(document), '--output', str(output)]) == 0
    assert document.read_bytes() == call.json.read_bytes()
    assert output.read_bytes() == call.output.read_bytes()


def test_a_frozen_state_stays_frozen(
        call: Call, dives: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert call(dives[0]) == 0
    settings = settings_of(call.config, 'ekf')
    state = load(call.state, settings)
    save(call.state, settings, {**state, 'adapt': False})
    before = call.dofs()
    assert call(dives[1]) == 0
    assert {found['status'] for found in call.dofs().values()} == {'frozen'}
    assert all(call.dofs()[dof]['alpha'] == found['alpha'] for dof, found in before.items())
    assert load(call.state, settings)['adapt'] is False


def test_settings_that_freeze_win(call: Call, dives: list[Path], tmp_path: Path) -> None:
    assert call(dives[0]) == 0
    text = call.config.read_text()
    call.config = tmp_path / 'frozen.yaml'
    call.config.write_text(text.replace('    enable: true', '    enable: false'))
    assert call(dives[1]) == 0
    assert {found['status'] for found in call.dofs().values()} == {'frozen'}


@pytest.mark.long
def test_the_state_wins_over_that_of_a_record(
        call: Call, dives: list[Path], tmp_path: Path) -> None:
    """A node's own log says where that node began; who names a state wants that one."""
    assert call(dives[0]) == 0
    learned = call.state.read_bytes()
    initial = PipelinePlayer(settings_of(call.config, 'ekf')).stream.state()
    record = tmp_path / 'record.mcap'
    with LogWriter(record) as writer, dives[1].open('rb') as file:
        writer.metadata('rovid_record', {'state': json.dumps(initial)})
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            writer.write_raw(channel.topic, schema.name, message.data, message.log_time)
    assert call(record) == 0
    with_record = call.dofs()
    call.state.write_bytes(learned)
    assert call(dives[1]) == 0
    assert call.dofs() == with_record


def refused(call: Call, *arguments: object, says: str,
            capsys: pytest.CaptureFixture[str]) -> None:
    before = call.content()
    capsys.readouterr()
    assert call(*arguments) == 1
    out, err = capsys.readouterr()
    assert out == ''
    assert err.count('\n') == 1
    assert err.startswith(f'rovid replay: {call.state}: ')
    assert says in err
    assert call.content() == before


def test_another_configuration_is_refused(
        call: Call, dives: list[Path], tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    assert call(dives[0]) == 0
    refused(call, dives[1], '--method', 'aid', capsys=capsys,
            says='was made with identifier.method ekf, configured is aid')
    text = call.config.read_text()
    call.config = tmp_path / 'other.yaml'
    assert text.count('gain: [40.0, 40.0, 55.0]') == 1
    call.config.write_text(text.replace('gain: [40.0, 40.0, 55.0]', 'gain: [40.0, 41.0, 55.0]'))
    refused(call, dives[1], capsys=capsys, says='was made with thrusters.gain [40.0, 40.0, 55.0]')
    call.config.write_text(text.replace('max_wait: -1.0', 'max_wait: 0.2'))
    assert call(dives[1]) == 0  # what gives the parameters no other meaning is free


@pytest.mark.parametrize('content, says', [
    ('', 'is damaged: Expecting value'), ('[]', 'is not a saved state'),
    ('{"rovid_replay": 1}', 'is not a saved state'),
    ('{"rovid_checkpoint": 1}', f'has version 1, this program reads {VERSION}'),
    ('[' * 100_000, 'is damaged')])
def test_another_file_is_refused(content: str, says: str, call: Call, dives: list[Path],
                                 capsys: pytest.CaptureFixture[str]) -> None:
    call.state.write_text(content)
    refused(call, dives[0], says=says, capsys=capsys)


def test_a_damaged_state_is_refused(
        call: Call, dives: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert call(dives[0]) == 0
    settings = settings_of(call.config, 'ekf')
    good, state = call.state.read_bytes(), load(call.state, settings)
    chance = random.Random(7)
    for _ in range(100):
        damaged = bytearray(good)
        damaged[chance.randrange(len(good))] = chance.randrange(256)
        if chance.random() < 0.3:
            del damaged[chance.randrange(len(good)):]
        call.state.write_bytes(damaged)
        try:
            assert load(call.state, settings) == state
        except StateError:
            pass
    changed = json.loads(good)
    changed['state']['dofs']['surge']['v_hat'] += 1.0
    call.state.write_text(json.dumps(changed))
    refused(call, dives[1], capsys=capsys, says='is damaged: its content does not fit its digest')
    del changed['sha256']  # an earlier release wrote none
    changed['state']['dofs']['surge']['v_hat'] = 'fast'
    call.state.write_text(json.dumps(changed))
    refused(call, dives[1], capsys=capsys, says='surge: ')
    call.state.write_text(json.dumps({
        key: value for key, value in json.loads(good).items() if key != 'sha256'}))
    assert call(dives[1]) == 0


@pytest.fixture
def interrupted(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Return what makes the next replay get a signal at its n-th message."""
    add_message = PipelinePlayer.add_message

    def after(count: int) -> None:
        left = [count]

        def cut(self: PipelinePlayer, message: LogMessage) -> Any:
            left[0] -= 1
            if not left[0]:
                signal.raise_signal(signal.SIGTERM)
            return add_message(self, message)

        monkeypatch.setattr(PipelinePlayer, 'add_message', cut)

    return after


def test_an_interrupted_replay_leaves_the_state_as_it_was(
        call: Call, dives: list[Path], interrupted: Callable[[int], None],
        capsys: pytest.CaptureFixture[str]) -> None:
    assert call(dives[0]) == 0
    before = call.content()
    interrupted(300)
    assert call(dives[1]) == 143
    part = call.folder / 'out.part.mcap'
    assert f'{part} holds what came of it' in capsys.readouterr().err
    part.unlink()
    assert call.content() == before


def test_a_result_that_cannot_be_printed_leaves_the_state_as_it_was(
        call: Call, dives: list[Path]) -> None:
    """Run again from the same state, it tells what the full disk has swallowed."""
    assert call(dives[0]) == 0
    before = call.state.read_bytes()
    environment = child_environment()
    environment.pop('PYTHONUNBUFFERED', None)  # it would fail at the first line
    with open('/dev/full', 'w') as full:
        ended = subprocess.run(
            [sys.executable, '-m', 'rovid_ros.commands', 'replay', str(dives[1]), '--params-file',
             str(call.config), '--state', str(call.state)],
            cwd=REPOSITORY, env=environment, stdout=full, stderr=subprocess.PIPE, text=True)
    assert (ended.returncode, ended.stderr) == (
        1, 'rovid replay: No space left on device\n')
    assert call.state.read_bytes() == before


def test_a_state_that_a_node_uses_is_refused(
        call: Call, dives: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    lock = FileLock(call.state)
    assert call(dives[0]) == 1
    assert capsys.readouterr().err == (
        f'rovid replay: {call.state}: is in use by another process\n')
    lock.release()
    assert call.content() == {}


def test_a_clock_that_goes_back_in_a_log_leaves_what_was_learned(
        call: Call, dives: list[Path], capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch) -> None:
    assert call(dives[0]) == 0
    before = call.state.read_bytes()
    finish = PipelinePlayer.finish

    def jump(self: PipelinePlayer) -> Any:
        estimates = finish(self)
        self.stream.control('time_jump', '')
        return estimates

    monkeypatch.setattr(PipelinePlayer, 'finish', jump)
    assert call(dives[1]) == 0
    assert f'written   {call.folder / "state-reset.json"}\n' in capsys.readouterr().out
    assert call.state.read_bytes() == before
    assert load(call.folder / 'state-reset.json', settings_of(call.config, 'ekf'))


def test_a_replay_without_a_step_leaves_no_state(
        call: Call, dives: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert call(dives[0], '--duration', '0.01') == 1
    assert 'no step' in capsys.readouterr().err
    assert not call.state.exists()


@pytest.mark.long
@pytest.mark.parametrize('moment', ['fsync', 'replace'])
def test_a_kill_during_writing_leaves_the_old_state(
        moment: str, call: Call, dives: list[Path]) -> None:
    assert call(dives[0]) == 0
    before = call.content()
    code = ('import os\n'
            'from rovid_ros.commands.main import main\n'
            'def kill(*_): os.kill(os.getpid(), 9)\n'
            f'os.{moment} = kill\n'
            f'main(["replay", {str(dives[1])!r}, "--params-file", {str(call.config)!r}, '
            f'"--state", {str(call.state)!r}])\n')
    ended = subprocess.run([sys.executable, '-c', code], cwd=REPOSITORY, env=child_environment(),
                           stdout=subprocess.DEVNULL)
    assert ended.returncode == -signal.SIGKILL
    left = call.content()
    assert {name: left[name] for name in before} == before
    assert [name for name in left if name not in before and not name.startswith('.')] == []
    assert call(dives[1]) == 0  # and what the killed one left is cleared away
    assert call.content().keys() - before.keys() == {'state.json.1'}


@pytest.mark.parametrize('option', [['--checkpoint', 'x.json'], ['--append']])
def test_the_former_options_are_no_more(
        option: list[str], config: Path, dives: list[Path],
        capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['replay', str(dives[0]), '--params-file', str(config), *option]) == 2
    assert f'unrecognized arguments: {" ".join(option)}' in capsys.readouterr().err


def test_the_state_is_no_other_file_of_the_command(
        config: Path, dives: list[Path], tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    document = str(tmp_path / 'out.json')
    assert main(['replay', str(dives[0]), '--params-file', str(config), '--json', document,
                 '--state', document]) == 1
    assert 'would be written twice' in capsys.readouterr().err
