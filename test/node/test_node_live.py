"""The node as a process of its own, over real DDS."""

from collections.abc import Callable, Iterator
import json
import math
from pathlib import Path
import random
import shutil
import signal

import pytest

rclpy = pytest.importorskip('rclpy')

from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
)
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import set_logger_level
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rovid_core.settings.run import SettingsError
from rovid_ros.config.keys import KEYS
from rovid_ros.config.parameters import settings_from
from rovid_ros.files.whole_files import FileLock
from rovid_ros.logs.log import Log
from rovid_ros.logs.writer import LogWriter
from rovid_ros.model import Model
from rovid_ros.node.__main__ import StopRequest
from rovid_ros.node.node import IdentifierNode
from rovid_ros.node.process import run
from rovid_ros.node.transport.publishers import latched
from rovid_ros.results.documents import dofs_document
from rovid_ros.results.outputs import DIAGNOSTIC_TYPE
from std_srvs.srv import SetBool, Trigger
import yaml

from test.support.live_drive import (
    assert_same,
    drive,
    replayed_record,
    running,
    Start,
    starting,
    UNSTAMPED,
    UNSTAMPED_TYPES,
)
from test.support.live_node import (
    changed,
    heard,
    NodeProcess,
    Peer,
    Raw,
    replayed,
    Status,
    told,
    TYPES,
    VALUES,
)
from test.support.processes import child_environment


def shuffled(messages: list[Raw]) -> list[Raw]:
    """Return another order of delivery: every topic late by up to 2 s, in order in itself."""
    generator = random.Random(2)
    latest = dict.fromkeys(TYPES, 0.0)
    due = []
    for raw in messages:
        latest[raw.topic] = max(latest[raw.topic], raw.time + generator.random() * 2e9)
        due.append((latest[raw.topic], raw))
    return [raw for _, raw in sorted(due, key=lambda pair: pair[0])]


@pytest.mark.parametrize('order', [list, shuffled])
def test_live_gives_the_bits_of_a_replay(
        order: Callable[[list[Raw]], list[Raw]], messages: list[Raw], peer: Peer,
        start: Start) -> None:
    settings = settings_from(VALUES)
    expected = told(settings, replayed(settings, messages))
    estimates = peer.listen_to_steps()
    node = start()
    peer.advertise(TYPES)
    peer.publish(order(messages))
    peer.settle(estimates, len(expected) - 50)  # some are held until the end
    assert node.stop() == 0, node.output
    peer.settle(estimates)
    assert len(expected) > 300
    assert_same(heard(estimates), expected)
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in estimates]
    assert stamps == [estimate.time for estimate in replayed(settings, messages)]
    # discovery may take so long that the inputs are missing at first, and all fall silent
    assert not [line for line in node.output.splitlines() if 'WARN' in line
                and 'missing: ' not in line and 'silent for ' not in line]
    assert 'ERROR' not in node.output


def test_all_outputs_of_a_step_agree(messages: list[Raw], peer: Peer, start: Start) -> None:
    topics = {
        '/rov/params': 'std_msgs/msg/Float64MultiArray',
        '/rov/params_std': 'std_msgs/msg/Float64MultiArray',
        '/rov/identifier_state': 'sensor_msgs/msg/JointState',
        '/rov/velocity': 'geometry_msgs/msg/TwistStamped',
        '/rov/model': 'std_msgs/msg/Float64MultiArray',
        '/rov/estimate': DIAGNOSTIC_TYPE}
    received = {topic: peer.listen(topic, name) for topic, name in topics.items()}
    # nothing becomes stale, which some of the outputs would tell and others not
    node = start({'max_gap': 60.0, 'thrusters.timeout': 0.0})
    peer.advertise(TYPES)
    peer.publish(messages[:300])
    peer.settle(received['/rov/estimate'], 100)
    peer.until(lambda: len({len(got) for got in received.values()}) == 1)
    values = {name: text for name, _, _, text in heard(received['/rov/estimate'][-1:])[0]}
    params = received['/rov/params'][-1]
    assert [dim.label for dim in params.layout.dim] == [
        'surge,heave,yaw', 'alpha,beta,gamma,delta']
    assert [float(values['heave'][name]) for name in ('alpha', 'beta', 'gamma', 'delta')] == list(
        params.data[4:8])
    state = received['/rov/identifier_state'][-1]
    assert state.velocity[2] == float(values['yaw']['v_hat'])
    assert state.effort[0] == float(values['surge']['force'])
    twist = received['/rov/velocity'][-1].twist
    assert twist.linear.x == float(values['surge']['velocity'])
    assert twist.angular.z == float(values['yaw']['velocity'])
    heave = Model.from_message(received['/rov/model'][-1])['heave']
    assert heave.status == values['heave']['status']
    for name in ('mass', 'velocity', 'force'):
        assert getattr(heave, name) == float(values['heave'][name])

    late = peer.listen('/rov/params', 'std_msgs/msg/Float64MultiArray', latched())
    peer.until(lambda: late)  # at once, without another step
    assert late == [params]
    assert node.stop() == 0


@pytest.fixture(scope='module')
def quiet(tmp_path_factory: pytest.TempPathFactory, own_dds_domain: None, repository: Path
          ) -> Iterator[NodeProcess]:
    """Start one node for the tests that change nothing, with names of its own."""
    folder = tmp_path_factory.mktemp('quiet')
    with starting(child_environment(), folder, repository) as start:
        yield start(
            {'position.qos': 'sensor_data'}, '-r', '__ns:=/rov1', '-r', 'rov/velocity:=speed',
            '-p', 'position.topic:=position')


def test_names_and_qos(quiet: NodeProcess, peer: Peer) -> None:
    diagnostics = peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
    peer.until(lambda: diagnostics)
    names = [status.name for status in diagnostics[-1].status]
    assert names == [f'/rov1/identifier_node: {name}' for name in (
        'state', 'position', 'depth', 'attitude', 'thrusters', 'rejected', 'surge', 'heave',
        'yaw', 'current')]
    topics = dict(peer.node.get_topic_names_and_types())
    assert {'/rov1/rov/params', '/rov1/rov/estimate', '/rov1/speed', '/rov1/position',
            '/depth'} <= topics.keys()
    services = dict(peer.node.get_service_names_and_types())
    assert {'/rov1/identifier_node/reset', '/rov1/identifier_node/enable',
            '/rov1/identifier_node/save'} <= services.keys()
    (params,) = peer.node.get_publishers_info_by_topic('/rov1/rov/params')
    assert params.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert params.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    (estimate,) = peer.node.get_publishers_info_by_topic('/rov1/rov/estimate')
    assert estimate.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    (position,) = peer.node.get_subscriptions_info_by_topic('/rov1/position')
    assert position.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    (depth,) = peer.node.get_subscriptions_info_by_topic('/depth')
    assert depth.qos_profile.reliability == ReliabilityPolicy.RELIABLE


def test_parameters_over_services(quiet: NodeProcess, peer: Peer) -> None:
    """``ros2 param list, get, describe, set``."""
    listed = peer.call(ListParameters, '/rov1/identifier_node/list_parameters').result.names
    assert {key.name for key in KEYS} <= set(listed)
    values = peer.call(GetParameters, '/rov1/identifier_node/get_parameters',
                       GetParameters.Request(names=listed)).values
    assert len(values) == len(listed)
    assert values[listed.index('position.topic')].string_value == 'position'
    described = peer.call(DescribeParameters, '/rov1/identifier_node/describe_parameters',
                          DescribeParameters.Request(names=['time_jump'])).descriptors[0]
    assert 'only while the node is unconfigured' in described.additional_constraints
    assert described.description
    request = SetParameters.Request(
        parameters=[Parameter('time_jump', value=2.0).to_parameter_msg()])
    (result,) = peer.call(
        SetParameters, '/rov1/identifier_node/set_parameters', request).results
    assert not result.successful


def test_diagnostics_come_each_second(quiet: NodeProcess, peer: Peer) -> None:
    diagnostics = peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
    peer.until(lambda: len(diagnostics) >= 3)
    stamps = [m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in diagnostics]
    assert stamps[2] - stamps[0] == pytest.approx(2.0, abs=0.5)


def test_save_without_a_path(quiet: NodeProcess, peer: Peer) -> None:
    answer = peer.call(Trigger, '/rov1/identifier_node/save')
    assert not answer.success
    assert 'checkpoint.path' in answer.message


@pytest.mark.parametrize('signals', [
    (signal.SIGINT, signal.SIGINT), (signal.SIGTERM,)])
def test_a_clean_end(signals: tuple[int, ...], messages: list[Raw], peer: Peer, start: Start,
                     tmp_path: Path) -> None:
    record = tmp_path / 'record.mcap'
    node, estimates = running(peer, start, messages[:300], {'record.path': str(record)})
    before = len(estimates)
    assert node.stop(*signals) == 0
    peer.settle(estimates)
    assert len(estimates) > before  # what was held has come out
    assert 'Traceback' not in node.output
    with Log([record]) as log:  # whole, with its index
        assert not log.warnings
        assert sum(info.count or 0 for info in log.topics.values()) == 300


def test_the_record_replays_to_the_same_bits(peer: Peer, start: Start, tmp_path: Path) -> None:
    """Also in parts, with commands that have no stamp, and services called in between."""
    record = tmp_path / 'record'
    estimates = peer.listen_to_steps()
    node = start({**UNSTAMPED, 'record.path': str(record / 'part.mcap'),
                  'record.max_duration': 1.0})
    peer.advertise(UNSTAMPED_TYPES)
    drive(peer, 1.5)
    assert peer.call(SetBool, '/identifier_node/enable', SetBool.Request(data=False)).success
    drive(peer, 0.7)
    assert peer.call(SetBool, '/identifier_node/enable', SetBool.Request(data=True)).success
    assert peer.call(Trigger, '/identifier_node/reset').success
    drive(peer, 1.0)
    assert node.stop() == 0
    peer.settle(estimates)
    got = heard(estimates)
    assert len(got) > 30
    texts = {text for statuses in got for _, _, text, _ in statuses}
    assert {'converging', 'frozen'} <= texts
    assert {'part.mcap', 'part-1.mcap', 'part-2.mcap'} <= {
        entry.name for entry in record.iterdir()}
    assert_same(got, replayed_record(record, changed(UNSTAMPED)))
    with Log([record.with_suffix('.output.mcap')]) as log:  # a reset is shown without a step
        assert log.topics['/rov/params'].count == len(got) + 1


def test_a_killed_node_leaves_a_record(messages: list[Raw], peer: Peer, start: Start,
                                       tmp_path: Path) -> None:
    record = tmp_path / 'record.mcap'
    record.write_bytes(b'older')
    diagnostics = peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
    node, estimates = running(peer, start, messages[:300], {'record.path': str(record)})
    seconds = len(diagnostics)
    # it is flushed behind each of them, and some that are counted now may be older
    peer.until(lambda: len(diagnostics) >= seconds + 4)
    node.kill()
    assert record.read_bytes() == b'older'
    got = replayed_record(tmp_path / 'record-1.mcap', VALUES)
    assert_same(heard(estimates), got[:len(estimates)])  # the replay has an end, the node not
    assert len(estimates) > 50


def test_save_and_go_on(messages: list[Raw], peer: Peer, start: Start, tmp_path: Path) -> None:
    path = tmp_path / 'state' / 'checkpoint.json'
    changes = {'checkpoint.path': str(path)}
    node, _ = running(peer, start, messages[:300], changes)
    answer = peer.call(Trigger, '/identifier_node/save')
    assert answer.success, answer.message
    first = json.loads(path.read_text())
    assert node.stop() == 0
    saved = json.loads(path.read_text())  # at the end, too
    assert saved['settings'] == first['settings']
    assert saved['state'] != first['state']

    node = start(changes)
    assert peer.call(Trigger, '/identifier_node/save').success
    assert json.loads(path.read_text()) == saved
    assert 'going on from' in node.output
    assert node.stop() == 0


def test_dives_live_and_replayed_go_on_from_each_other(
        messages: list[Raw], peer: Peer, start: Start, tmp_path: Path) -> None:
    def dive(name: str, part: list[Raw], state: Path) -> list[list[Status]]:
        """Return what a replay of some messages says of them, from a state that it replaces."""
        log = tmp_path / f'{name}.mcap'
        with LogWriter(log) as writer:
            for raw in part:
                writer.write_raw(raw.topic, raw.type, raw.cdr, raw.time)
        return replayed_record(log, VALUES, options=['--state', str(state)])

    live, same = tmp_path / 'live.json', tmp_path / 'same.json'
    dive('first', messages[:300], live)
    shutil.copy(live, same)

    estimates = peer.listen_to_steps()
    node = start({'checkpoint.path': str(live)})
    peer.advertise(TYPES)
    peer.publish(messages[300:600])
    peer.settle(estimates, 50)
    assert node.stop() == 0
    peer.settle(estimates)
    assert_same(heard(estimates), dive('second', messages[300:600], same))
    assert json.loads(live.read_text()) == json.loads(same.read_text())

    assert_same(dive('third', messages[600:], live), dive('again', messages[600:], same))
    assert live.read_bytes() == same.read_bytes()


def test_a_replay_through_the_node_leaves_the_same_state(
        messages: list[Raw], environment: dict[str, str], tmp_path: Path) -> None:
    log = tmp_path / 'log.mcap'
    with LogWriter(log) as writer:
        for raw in messages[:300]:
            writer.write_raw(raw.topic, raw.type, raw.cdr, raw.time)
    states = [tmp_path / 'alone.json', tmp_path / 'ros.json']
    for _ in range(2):
        alone, ros = (replayed_record(log, VALUES, chosen, ['--state', str(state)])
                      for state, chosen in zip(states, (None, environment)))
        assert_same(alone, ros)
        assert states[0].read_bytes() == states[1].read_bytes()


def test_a_failed_save_is_not_the_end(peer: Peer, start: Start, tmp_path: Path) -> None:
    folder = tmp_path / 'state'
    node = start({'checkpoint.path': str(folder / 'checkpoint.json'), 'checkpoint.period': 1.0})
    assert peer.call(Trigger, '/identifier_node/save').success
    shutil.rmtree(folder)
    folder.write_text('in the way')
    answer = peer.call(Trigger, '/identifier_node/save')
    assert not answer.success
    assert 'state' in answer.message
    peer.until(lambda: node.output.count('[ERROR]') >= 2)  # the periodic save, too
    assert peer.call(Trigger, '/identifier_node/reset').success
    assert node.stop() == 1  # the last one, too
    assert 'Traceback' not in node.output


def test_a_reset_shows_at_once(messages: list[Raw], peer: Peer, start: Start) -> None:
    array = 'std_msgs/msg/Float64MultiArray'
    params = peer.listen('/rov/params', array)
    node = start()
    peer.advertise(TYPES)
    peer.publish(messages[:300])
    peer.settle(params, 100)
    initial = [dof[name] for dof in dofs_document(settings_from(VALUES), None).values()
               for name in ('alpha', 'beta', 'gamma', 'delta')]
    assert list(params[-1].data) != initial
    assert peer.call(Trigger, '/identifier_node/reset').success
    late = peer.listen('/rov/params', array, latched())
    late_std = peer.listen('/rov/params_std', array, latched())
    peer.until(lambda: late and late_std)
    assert list(late[-1].data) == initial
    assert all(map(math.isnan, late_std[-1].data))
    assert node.stop() == 0
    assert '~/reset: back at the initial values' in node.output


WRONG = {
    'key': ({'thrusters.gian': [1.0]}, 'thrusters.gain'),
    'type': ({'position.topic': 3}, 'position.topic'),
    'message': ({'position.type': 'vehicle_msgs/msg/Fix'}, 'vehicle_msgs'),
    'field': ({'position.field': 'pont'}, 'pont'),
    'topic': ({'position.topic': 'a b'}, 'position.topic'),
    'shape': ({'thrusters.gain': [1.0, 1.0]}, 'thrusters'),
    'record': ({'record.path': '/dev/null/record.mcap'}, 'record.path: /dev/null/record.mcap'),
    'folder': ({'record.path': '/proc/none/record.mcap'}, 'record.path: /proc/none/record.mcap'),
    'directory': ({'record.path': '/proc'}, 'record.path: /proc is a directory'),
    'checkpoint': ({'checkpoint.path': '/proc/none/c.json'}, 'checkpoint.path: /proc/none/c.json'),
}


class Refused:
    """Runs the program in this process, and reads the one line that it ends with."""

    def __init__(self, capfd: pytest.CaptureFixture[str], folder: Path) -> None:
        self._capfd = capfd
        self._folder = folder

    def __call__(self, *arguments: str | Path) -> tuple[int, str]:
        """Return the exit code and the line."""
        code = run(IdentifierNode, ['node', *map(str, arguments)], StopRequest())
        (line,) = self._capfd.readouterr().err.splitlines()
        return code, line

    def with_file(self, text: str) -> tuple[int, str]:
        """Do it with a parameter file."""
        file = self._folder / 'parameters.yaml'
        file.write_text(text)
        return self('--ros-args', '--params-file', file)


@pytest.fixture
def refused(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Iterator[Refused]:
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield Refused(capfd, tmp_path)
    for number, handler in handlers.items():
        signal.signal(number, handler)
    set_logger_level('rcl', LoggingSeverity.UNSET)


@pytest.mark.parametrize('case', WRONG)
def test_wrong_parameters_are_one_line(case: str, refused: Refused) -> None:
    changes, expected = WRONG[case]
    code, line = refused.with_file(
        yaml.safe_dump({'/**': {'ros__parameters': changed(changes)}}))
    assert code == 1
    assert expected in line


def test_a_second_node_on_a_checkpoint_is_one_line(refused: Refused, tmp_path: Path) -> None:
    path = tmp_path / 'checkpoint.json'
    lock = FileLock(path)
    code, line = refused.with_file(yaml.safe_dump(
        {'/**': {'ros__parameters': changed({'checkpoint.path': str(path)})}}))
    lock.release()
    assert code == 1
    assert f'checkpoint.path: {path} is in use by another process' in line


@pytest.mark.parametrize('text, expected', [
    ('/**: {ros__parameters: {dofs: [surge}', 'parameters.yaml'),
    ('/other: {ros__parameters: {dofs: [surge]}}', 'identifier_node'),
    (yaml.safe_dump({'/**': {'ros__parameters': changed({'dofs': []})}}), 'dofs'),
])
def test_a_wrong_file_is_one_line(text: str, expected: str, refused: Refused) -> None:
    code, line = refused.with_file(text)
    assert code == 1
    assert expected in line


WRONG_COMMAND_LINES: list[tuple[list[str], int, str]] = [
    ([], 1, '--params-file'),
    (['--ros-args', '-p', 'dofs:=[surge, 1]'], 2, 'dofs:=[surge, 1]'),
    (['--ros-args', '--params-file'], 2, '--params-file'),
    (['--ros-args', '-r', 'foo'], 2, 'foo'),
    (['--ros-args', '--foo'], 2, '--foo'),
    (['--foo'], 2, '--foo'),
    (['parameters.yaml'], 2, 'parameters.yaml'),
]


@pytest.mark.parametrize('arguments, code, expected', WRONG_COMMAND_LINES)
def test_a_wrong_command_line(
        arguments: list[str], code: int, expected: str, refused: Refused) -> None:
    found, line = refused(*arguments)
    assert found == code
    assert expected in line


@pytest.mark.parametrize('arguments, code, expected', WRONG_COMMAND_LINES[:2])
def test_a_process_that_is_refused_prints_one_line(
        arguments: list[str], code: int, expected: str, environment: dict[str, str],
        tmp_path: Path, repository: Path) -> None:
    node = NodeProcess(arguments, environment, tmp_path, repository)
    assert node.wait() == code
    assert expected in node.output
    assert len(node.output.splitlines()) == 1


@pytest.mark.usefixtures('refused')
def test_a_signal_while_something_is_looked_up(capfd: pytest.CaptureFixture[str]) -> None:
    def look_up(values: dict[str, object], is_stopped: Callable[[], bool]) -> None:
        signal.raise_signal(signal.SIGINT)
        assert is_stopped()
        raise SettingsError('position.lever_arm', 'has not come')

    assert run(look_up, ['node'], StopRequest()) == 0
    assert capfd.readouterr().err == ''


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_during_the_imports(number: int, start: Start) -> None:
    node = start()
    process = Path('/proc', str(node.process.pid))
    caught = 0
    while not caught >> (signal.SIGTERM - 1) & 1:  # until the node minds it
        assert node.process.poll() is None
        caught = int((process / 'status').read_text().partition('SigCgt:')[2].split()[0], 16)
    assert 'numpy' not in (process / 'maps').read_text()
    assert node.stop(number) == 0, node.output
    assert not node.output
