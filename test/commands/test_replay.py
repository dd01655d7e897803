"""``rovid replay`` on real files: what it prints, what it writes, and what it refuses."""

from collections.abc import Iterator
import json
import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
import time
from typing import Any

from mcap.reader import make_reader
import pytest
from rovid_core.identify.status import STATUSES
from rovid_core.model.dofs import PARAMETERS, PHYSICAL
from rovid_ros import build
from rovid_ros.commands.demo import demo
from rovid_ros.commands.main import main
from rovid_ros.commands.running import Interrupt, Interrupted
from rovid_ros.logs.log import Log
from rovid_ros.logs.writer import LogWriter
from rovid_ros.messages.types import standard_types

DURATION = 20  # [s] of the log that most tests use


@pytest.fixture(scope='module')
def log(config: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a simulated log."""
    path = tmp_path_factory.mktemp('log') / 'log.mcap'
    assert main(['simulate', '--params-file', str(config), '--output', str(path),
                 '--duration', str(DURATION)]) == 0
    return path


@pytest.fixture(scope='module')
def written(config: Path, log: Path, tmp_path_factory: pytest.TempPathFactory
            ) -> tuple[Path, dict[str, Any]]:
    """Return what a replay of the log writes: the output topics and the JSON."""
    folder = tmp_path_factory.mktemp('written')
    assert main(['replay', str(log), '--params-file', str(config), '--output',
                 str(folder / 'out.mcap'), '--json', str(folder / 'out.json')]) == 0
    return folder / 'out.mcap', json.loads((folder / 'out.json').read_text())


def edited(config: Path, folder: Path, *changes: tuple[str, str]) -> Path:
    """Return a copy of the parameter file with some text replaced."""
    text = config.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / 'edited.yaml'
    path.write_text(text)
    return path


def command(*arguments: object) -> list[str]:
    """Return the command line of a child process."""
    return [sys.executable, '-m', 'rovid_ros.commands', *map(str, arguments)]


@pytest.fixture
def child(environment: dict[str, str], repository: Path) -> dict[str, str]:
    """Return the environment of a child process that imports this checkout."""
    return {**environment, 'PYTHONPATH': str(repository)}


def messages(path: Path, topic: str) -> Iterator[tuple[int, int, Any]]:
    """Yield log time, publish time and decoded message."""
    store = standard_types()
    with path.open('rb') as file:
        for schema, _, message in make_reader(file).iter_messages([topic]):
            assert schema is not None
            yield (message.log_time, message.publish_time,
                   store.deserialize_cdr(message.data, schema.name))


def test_the_json_is_as_specified(written: tuple[Path, dict[str, Any]]) -> None:
    document = written[1]
    assert list(document) == ['rovid', 'method', 'steps', 'duration_s', 'rejected', 'dofs',
                              'current']
    assert document['rovid'] == build()
    assert document['method'] == 'ekf'
    assert document['duration_s'] == pytest.approx(DURATION, abs=0.1)
    assert document['rejected'] == {}
    assert list(document['dofs']) == ['surge', 'heave', 'yaw']
    for dof in document['dofs'].values():
        assert set(dof) >= {*PARAMETERS, *PHYSICAL, 'std', 'mae', 'fit', 'steps', 'status'}
        assert set(dof['std']) == set(PARAMETERS)
        for name, (low, high) in dof['intervals'].items():
            assert low < dof[name] < high
        assert abs(dof['delay_s']['value']) < 5 * dof['delay_s']['std'] + 0.01
        assert dof['status'] in STATUSES
        assert isinstance(dof['verdict'], str)
        assert dof['mass'] == pytest.approx(1.0 / dof['alpha'])


def test_a_method_without_covariance_has_no_intervals(
        config: Path, log: Path, tmp_path: Path) -> None:
    path = tmp_path / 'aid.json'
    assert main(['replay', str(log), '--params-file', str(config), '--method', 'aid',
                 '--json', str(path), '--duration', '10']) == 0
    document = json.loads(path.read_text())
    assert document['method'] == 'aid'
    for dof in document['dofs'].values():
        assert dof['std'] is dof['intervals'] is dof['delay_s'] is None


def test_the_json_is_the_last_published_estimate(
        written: tuple[Path, dict[str, Any]]) -> None:
    estimates = list(messages(written[0], '/rov/estimate'))
    assert len(estimates) == written[1]['steps']
    last = estimates[-1][2]
    for status in last.status:
        values = {entry.key: entry.value for entry in status.values}
        found = written[1]['dofs'][status.name]
        assert {name: float(values[name]) for name in (*PARAMETERS, *PHYSICAL)} == {
            name: found[name] for name in (*PARAMETERS, *PHYSICAL)}
        assert int(values['steps']) == found['steps']


def test_topics_are_those_of_the_whole_output(
        config: Path, log: Path, written: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    output = tmp_path / 'some.mcap'
    assert main(['replay', str(log), '--params-file', str(config), '--output', str(output),
                 '--topics', '/rov/velocity,rov/params']) == 0

    def read(path: Path, *topics: str) -> list[tuple[str, int, bytes]]:
        with path.open('rb') as file:
            return [(channel.topic, message.log_time, message.data) for _, channel, message
                    in make_reader(file).iter_messages(topics=topics or None)]

    assert read(output) == read(written[0], '/rov/params', '/rov/velocity') != []


def test_topics_that_there_are_not_are_named(
        config: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = ['replay', str(log), '--params-file', str(config), '--topics']
    assert main([*run, 'rov/params']) == 2
    assert '--topics goes with --output' in capsys.readouterr().err
    assert main([*run, 'rov/parms', '--output', str(tmp_path / 'out.mcap')]) == 2
    assert "--topics: got 'rov/parms', takes rov/params, rov/params_std" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_output_holds_every_output_topic(written: tuple[Path, dict[str, Any]]) -> None:
    with written[0].open('rb') as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert {channel.topic for channel in summary.channels.values()} == {
        '/rov/params', '/rov/params_std', '/rov/model', '/rov/identifier_state', '/rov/velocity',
        '/rov/estimate'}
    for logged, published, estimate in messages(written[0], '/rov/estimate'):
        stamp = estimate.header.stamp
        assert stamp.sec * 1_000_000_000 + stamp.nanosec == published <= logged


def test_the_table_has_every_number_with_its_unit(
        config: Path, log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['replay', str(log), '--params-file', str(config)]) == 0
    out, err = capsys.readouterr()
    assert err == ''
    assert max(map(len, out.splitlines())) <= 100
    for text in ('surge', 'converging', ' kg ', 'N s²/m²', 'N s/m', ' N\n', 'kg m²',
                 'N m s²/rad²', 'm/s²', '1/(kg m²)', 'rad/s', ' %', 'refused   nothing'):
        assert text in out


def test_what_the_data_say_of_several_dofs_is_said_once(
        config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / 'log.mcap'
    assert main(['simulate', '--params-file', str(config), '--output', str(log),
                 '--duration', '40',
                 '--profile', 'surge=50@0.25,heave=50@0.25,yaw=3@0.25']) == 0
    capsys.readouterr()
    assert main(['replay', str(log), '--params-file', str(config)]) == 0
    said = capsys.readouterr().out
    assert said.count('thrust is too small to tell the mass') == 1
    assert 'heave, yaw, from all of the data: thrust is too small to tell the mass' in said
    assert 'yaw is converging: the mass is known to' in said


@pytest.mark.long
def test_a_model_worse_than_a_constant_says_so(
        config: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, said = tmp_path / 'out.json', []
    for gain in ('[40.0, 40.0, 55.0]', '[-40.0, -40.0, -55.0]'):
        assert main(['replay', str(log), '--params-file', str(config), '--json', str(path),
                     '-p', f'thrusters.gain:={gain}']) == 0
        dofs = json.loads(path.read_text())['dofs']
        poor = ', '.join(dof for dof, values in dofs.items() if values['fit'] < 0.0)
        said.append(f'{poor}: a fit below 0 is worse than' in capsys.readouterr().out)
        assert bool(poor) is said[-1]
    assert said == [False, True]


def test_masses_that_are_no_kilograms_are_told(
        config: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, said = tmp_path / 'out.json', []
    for newtons in ('true', 'false'):
        assert main(['replay', str(log), '--params-file', str(config), '--json', str(path),
                     '--duration', '10', '-p', f'thrusters.newtons:={newtons}']) == 0
        dofs = json.loads(path.read_text())['dofs'].values()
        assert {dof.get('newtons') for dof in dofs} == {None if newtons == 'true' else False}
        said.append(capsys.readouterr().out)
    assert ['cmd is what a command of 1 pushes' in out for out in said] == [False, True]
    assert [bool(re.search(r'\d (kg|N)\b', out)) for out in said] == [True, False]
    assert 'cmd s²/m²' in said[1] and 'm/s²/cmd' in said[1] and 'rad/s²/cmd' in said[1]


def test_a_part_of_the_log(config: Path, log: Path, tmp_path: Path) -> None:
    path = tmp_path / 'part.json'
    assert main(['replay', str(log), '--params-file', str(config), '--json', str(path),
                 '--start', '5', '--duration', '10']) == 0
    assert json.loads(path.read_text())['duration_s'] == pytest.approx(10.0, abs=0.1)


def test_a_log_in_two_pieces_is_one_log(
        config: Path, log: Path, tmp_path: Path, written: tuple[Path, dict[str, Any]],
        capsys: pytest.CaptureFixture[str]) -> None:
    pieces = [tmp_path / 'b.mcap', tmp_path / 'a.mcap']
    writers = [LogWriter(piece) for piece in pieces]
    with log.open('rb') as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            late = message.log_time > 1_700_000_012_000_000_000
            writers[late].write_raw(channel.topic, schema.name, message.data, message.log_time)
    for writer in writers:
        writer.close()
    path = tmp_path / 'joined.json'
    assert main(['replay', *map(str, reversed(pieces)), '--params-file', str(config), '--json',
                 str(path)]) == 0
    assert json.loads(path.read_text()) == written[1]
    said = capsys.readouterr().out.replace('b.mcap:', 'a.mcap:')
    assert f'a.mcap: spanning {DURATION:.1f} s' in said


def test_controls_of_a_recording_are_done_again(
        config: Path, log: Path, tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    record, path = tmp_path / 'record.mcap', tmp_path / 'out.json'
    with LogWriter(record) as writer, log.open('rb') as file:
        writer.metadata('rovid_record', {})
        control = {'data': json.dumps({'control': 'enable', 'value': 'false'})}
        writer.write('rovid/control', 'std_msgs/msg/String', control, 1_700_000_000 * 10**9)
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            writer.write_raw(channel.topic, schema.name, message.data, message.log_time)
    assert main(['replay', str(record), '--params-file', str(config), '--json', str(path)]) == 0
    surge = json.loads(path.read_text())['dofs']['surge']
    assert (surge['mass'], surge['status']) == (pytest.approx(180.0), 'frozen')


def test_what_follows_a_message_in_its_bytes_is_left_alone(
        config: Path, log: Path, tmp_path: Path, written: tuple[Path, dict[str, Any]]) -> None:
    """As ``rclpy.serialization.serialize_message`` gives them."""
    longer, path = tmp_path / 'longer.mcap', tmp_path / 'out.json'
    with LogWriter(longer) as writer, log.open('rb') as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            writer.write_raw(channel.topic, schema.name, message.data + b'\x7f' * 8,
                             message.log_time)
    assert main(['replay', str(longer), '--params-file', str(config), '--json', str(path)]) == 0
    assert json.loads(path.read_text()) == written[1]


def test_a_log_that_begins_at_0_with_a_latency(
        config: Path, log: Path, tmp_path: Path) -> None:
    early, output = tmp_path / 'early.mcap', tmp_path / 'output.mcap'
    late = edited(config, tmp_path, ('latency: 0.0', 'latency: 1.0'))
    store = standard_types()
    with LogWriter(early) as writer, log.open('rb') as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            data = store.deserialize_cdr(message.data, schema.name)
            data.header.stamp.sec -= 1_700_000_000
            writer.write_raw(channel.topic, schema.name,
                             bytes(store.serialize_cdr(data, schema.name)),
                             message.log_time - 1_700_000_000 * 10**9)
    assert main(['replay', str(early), '--params-file', str(late), '--output', str(output)]) == 0
    assert next(messages(output, '/rov/params'))[1] == 0


def test_a_log_with_the_name_of_an_unfinished_output_is_left_alone(
        config: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part = tmp_path / 'dive.part.mcap'
    shutil.copy(log, part)
    assert main(['replay', str(part), '--params-file', str(config), '--output',
                 str(tmp_path / 'dive.mcap')]) == 1
    assert f'{part}: is read by this command' in capsys.readouterr().err
    assert part.read_bytes() == log.read_bytes()


def test_refusals_are_counted_by_input_and_reason(
        config: Path, log: Path, tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    broken, path = tmp_path / 'broken.mcap', tmp_path / 'out.json'
    with LogWriter(broken) as writer, log.open('rb') as file:
        for count, (schema, channel, message) in enumerate(
                make_reader(file).iter_messages()):
            assert schema is not None
            for _ in range(2 if channel.topic == '/imu/data' and count % 100 < 9 else 1):
                writer.write_raw(
                    channel.topic, schema.name, message.data, message.log_time)
    assert main(['replay', str(broken), '--params-file', str(config), '--json',
                 str(path)]) == 0
    rejected = json.loads(path.read_text())['rejected']
    assert sum(rejected.values()) > 10
    (reason,) = rejected
    assert f'refused   attitude: {rejected[reason]} {reason}' in capsys.readouterr().out


def test_a_missing_topic_is_refused_with_the_nearest(
        config: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / 'out.mcap'
    wrong = edited(config, tmp_path, ('topic: /sharps/position', 'topic: /sharp/postion'))
    assert main(['replay', str(log), '--params-file', str(wrong), '--output',
                 str(output)]) == 1
    err = capsys.readouterr().err
    assert err.count('\n') == 1
    assert '/sharp/postion' in err
    assert "did you mean '/sharps/position'" in err
    assert '/imu/data' in err
    assert not output.exists()


def test_a_missing_reference_is_a_warning(
        config: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = edited(config, tmp_path, (
        "reference:                     # optional: a body velocity to score against, from a "
        "better\n      topic: ''", 'reference:\n      topic: /truth'))
    assert main(['replay', str(log), '--params-file', str(path)]) == 0
    err = capsys.readouterr().err
    assert err.count('\n') == 1
    assert 'warning: no messages on /truth (reference)' in err


def test_a_wrong_type_and_a_wrong_field_are_refused(
        config: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for change, says in (
            (('PointStamped', 'PoseStamped'), 'is geometry_msgs/msg/PointStamped, not'),
            (('field: point ', 'field: pint '), "did you mean 'point'")):
        path = edited(config, tmp_path, change)
        assert main(['replay', str(log), '--params-file', str(path)]) == 1
        err = capsys.readouterr().err
        assert err.count('\n') == 1
        assert says in err


def test_a_log_that_gives_no_step_says_why(
        config: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = edited(config, tmp_path, ('starboard, port, vertical]', 'starboard, port, up]'))
    assert main(['replay', str(log), '--params-file', str(path)]) == 1
    out, err = capsys.readouterr()
    assert out == ''
    assert err.count('\n') == 1
    assert 'no step' in err
    assert f'thrusters 0 taken, refused {20 * DURATION + 1} missing_name' in err


def test_errors_about_keys_name_file_and_line(
        config: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for (old, new), key in (
            (('field: point ', 'field: pint '), 'position.field'),
            (('field: effort', 'field: header.frame_id'), 'thrusters.field'),
            (('topic: /imu/data', 'topic: /sharps/position'), 'attitude.type')):
        path = edited(config, tmp_path, (old, new))
        assert main(['replay', str(log), '--params-file', str(path)]) == 1
        err = capsys.readouterr().err
        assert err.count('\n') == 1
        place, found, _ = err.removeprefix('rovid replay: ').partition(f': {key}: ')
        file, _, number = place.rpartition(':')
        assert (file, found) == (str(path), f': {key}: '), err
        line = path.read_text().splitlines()[int(number) - 1]
        assert line.strip().startswith(f'{key.partition(".")[2]}: ')


def test_too_few_values_for_the_thrusters_are_told(
        config: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for field, says in (('[0:2]', 'got 2 values, takes 3'),
                        ('[9]', "'effort[9]' is beyond the end of 3 entries")):
        path = edited(config, tmp_path, ('field: effort', f'field: effort{field}'),
                      ('names: [starboard, port, vertical]', ''))
        assert main(['replay', str(log), '--params-file', str(path)]) == 1
        err = capsys.readouterr().err
        assert err.count('\n') == 1
        assert f'no step: thrusters.field: {says}; position ' in err


def test_the_same_log_twice_is_refused(
        config: Path, log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['replay', str(log), str(log), '--params-file', str(config)]) == 1
    assert capsys.readouterr().err == f'rovid replay: {log}: is given twice\n'


def test_the_table_is_there_when_the_json_cannot_be_written(
        config: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / 'out.json'
    (tmp_path / f'.out.json.{os.getpid()}').mkdir()  # nothing can be written there
    assert main(['replay', str(log), '--params-file', str(config), '--json', str(path)]) == 1
    out, err = capsys.readouterr()
    assert 'effective mass' in out
    assert err == f'rovid replay: {path}: Is a directory\n'


def test_a_log_without_a_leading_slash_in_the_settings(
        config: Path, log: Path, tmp_path: Path, written: tuple[Path, dict[str, Any]]) -> None:
    path = edited(config, tmp_path, ('topic: /imu/data', 'topic: imu/data'))
    out = tmp_path / 'out.json'
    assert main(['replay', str(log), '--params-file', str(path), '--json', str(out)]) == 0
    assert json.loads(out.read_text()) == written[1]


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_a_whole_file(
        number: int, config: Path, log: Path, tmp_path: Path, child: dict[str, str]) -> None:
    output, part = tmp_path / 'out.mcap', tmp_path / 'out.part.mcap'
    output.write_text('of an earlier run')
    process = subprocess.Popen(
        command('replay', log, '--params-file', config, '--output', output),
        env=child, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60.0
    while (not (part.exists() and part.stat().st_size) and process.poll() is None
           and time.monotonic() < deadline):  # until the first chunk is in it
        time.sleep(0.01)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (128 + number, '')
    assert err.count('\n') == 1
    assert 'interrupted' in err
    assert f'{part} holds what came of it' in err
    assert output.read_text() == 'of an earlier run'
    with part.open('rb') as file:
        assert make_reader(file).get_summary() is not None


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_a_simulation_keeps_what_there_is(
        number: int, config: Path, tmp_path: Path, child: dict[str, str]) -> None:
    output, part = tmp_path / 'out.mcap', tmp_path / 'out.part.mcap'
    process = subprocess.Popen(
        command('simulate', '--params-file', config, '--output', output, '--duration', 1e6),
        env=child, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60.0
    while not part.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.5)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err.count('\n')) == (128 + number, '', 1)
    assert part.name in err
    with Log([part]) as log:
        assert log.warnings == []
        assert len(list(log.messages(['/imu/data']))) > 10


def test_a_second_signal_names_the_file() -> None:
    numbers = signal.SIGINT, signal.SIGTERM
    before = [signal.getsignal(number) for number in numbers]  # of whatever ran before
    with Interrupt(Path('out.mcap')) as interrupt:
        signal.raise_signal(signal.SIGINT)
        assert (interrupt.asked, interrupt.code) == (True, 130)
        with pytest.raises(Interrupted, match='interrupted twice; out.mcap is incomplete') as stop:
            signal.raise_signal(signal.SIGTERM)
    assert stop.value.code == 143
    assert [signal.getsignal(number) for number in numbers] == before


def test_a_reader_that_leaves_is_no_error_and_costs_no_file(
        config: Path, log: Path, tmp_path: Path, child: dict[str, str]) -> None:
    written = tmp_path / 'out.json'
    process = subprocess.Popen(
        command('replay', log, '--params-file', config, '--json', written),
        env={**child, 'PYTHONUNBUFFERED': '1'},  # as a longer text would be written at once
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert process.stderr.read() == ''
    process.stderr.close()
    assert process.wait(timeout=60) == 141
    assert 'surge' in json.loads(written.read_text())['dofs']


@pytest.mark.long
def test_a_recorded_dive_is_identified(
        repository: Path, data: Path, tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / 'out.json'
    assert main(['replay', str(data / 'bluerov2_tank' / 'all_axes.mcap'), '--params-file',
                 str(repository / 'config' / 'bluerov2_tank.yaml'), '--json', str(path)]) == 0
    dofs = json.loads(path.read_text())['dofs']
    assert list(dofs) == ['surge', 'sway', 'heave', 'yaw']
    for dof in dofs.values():
        assert dof['steps'] > 1000
        assert 0.2 < dof['fit'] < 0.9


def test_the_demonstration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                           capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    demo(Path('new') / 'folder', duration=20.0)
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 100
    assert (tmp_path / 'new' / 'folder' / 'jhurov.mcap').exists()
    for text in ('290.0 kg', 'initial guess', 'identified', 'rovid replay YOUR_LOG'):
        assert text in out


def ros(config: Path, log: Path, *more: object, child: dict[str, str]
        ) -> 'subprocess.Popen[str]':
    """Start a replay through the node."""
    return subprocess.Popen(
        command('replay', log, '--params-file', config, '--ros', *more), env=child,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_the_node_gives_the_same_bits(
        config: Path, log: Path, tmp_path: Path, child: dict[str, str],
        written: tuple[Path, dict[str, Any]]) -> None:
    pytest.importorskip('rclpy')
    output, path = tmp_path / 'out.mcap', tmp_path / 'out.json'
    process = ros(config, log, '--output', output, '--json', path, child=child)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert json.loads(path.read_text()) == written[1]
    assert output.read_bytes() == written[0].read_bytes()
    assert 'effective mass' in out


def test_the_node_publishes_and_tells_the_time(
        config: Path, log: Path, child: dict[str, str]) -> None:
    rclpy = pytest.importorskip('rclpy')
    from rclpy.executors import SingleThreadedExecutor
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import Float64MultiArray

    context = rclpy.Context()
    context.init(args=[])
    node = rclpy.create_node('listener', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    clocks: list[float] = []
    rows: list[int] = []
    node.create_subscription(
        Clock, '/clock', lambda m: clocks.append(m.clock.sec + 1e-9 * m.clock.nanosec), 1000)
    node.create_subscription(
        Float64MultiArray, '/rov/params', lambda m: rows.append(len(m.data)), 1000)
    began = time.monotonic()
    process = ros(config, log, '--rate', '5', child=child)
    try:
        while process.poll() is None and time.monotonic() < began + 120.0:
            executor.spin_once(timeout_sec=0.05)
        assert process.wait(timeout=1) == 0
        assert time.monotonic() - began > DURATION / 5
    finally:
        process.kill()
        process.communicate()
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
    assert clocks == sorted(clocks)
    assert clocks[-1] == pytest.approx(1_700_000_000 + DURATION, abs=0.2)
    assert rows and set(rows) == {12}


def test_without_ros_one_line_says_so(
        config: Path, log: Path, tmp_path: Path, child: dict[str, str]) -> None:
    (tmp_path / 'rclpy.py').write_text("raise ModuleNotFoundError(\"No module named 'rclpy'\")")
    child['PYTHONPATH'] = os.pathsep.join([str(tmp_path), child['PYTHONPATH']])
    process = ros(config, log, child=child)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (1, '')
    assert err == ("rovid replay: --ros needs ROS 2, which is not installed here: "
                   "No module named 'rclpy'\n")


def test_a_guess_that_nothing_tried_has_no_fit(
        config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, given = tmp_path / 'dive.mcap', ['--params-file', str(config)]
    assert main(['simulate', *given, '--duration', '20', '--output', str(log), '--profile',
                 'surge=100@0.1,heave=0,yaw=0']) == 0
    assert main(['replay', str(log), *given]) == 0
    out = capsys.readouterr().out
    assert re.search(r'^surge .* %$', out, re.M)
    assert re.search(r'^heave +unexcited .* -$', out, re.M)
