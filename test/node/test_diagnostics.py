"""What the node says of itself: levels, the log's lines, the graph's faults."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
import time
from types import SimpleNamespace
from typing import Any

import pytest

rclpy = pytest.importorskip('rclpy')

from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rovid_core.inputs.refusals import REASONS
from rovid_core.pipeline.stream import Stream
from rovid_ros.config.parameters import settings_from
from rovid_ros.files.state_file import Checkpoint
from rovid_ros.messages.converter import Converter
from rovid_ros.node.health.console import (
    Events,
    HealthMonitor,
    MAX_WARNINGS,
    RefusalSummary,
    WarningLimiter,
)
from rovid_ros.node.health.diagnostics import diagnostics, NodeState
from rovid_ros.node.health.graph import graph_states, rivals, TopicState
from rovid_ros.node.health.levels import Arrivals, HealthData, input_level, RecentCounts
from rovid_ros.node.node import IdentifierNode
from rovid_ros.node.transport.message_types import import_type
from rovid_ros.node.transport.publishers import best_effort, reliable
from rovid_ros.results.outputs import ARRAY_TYPE, DIAGNOSTIC_TYPE, ERROR, OK, STALE, WARN

from test.support.live_node import (
    changed,
    heard,
    NodeProcess,
    Peer,
    Raw,
    Status,
    TYPES,
    VALUES,
    write_parameters,
)
from test.support.outputs import fields_of

NAME = '/rov1/identifier_node'
SETTINGS = settings_from(VALUES)
THRUSTERS = TYPES['/current']


class Watched:
    """A stream that is fed by hand, with the clocks in one's hands too."""

    def __init__(self, changes: dict[str, Any] | None = None) -> None:
        self.settings = settings_from(changed({'max_wait': 0.1, **(changes or {})}))
        self.stream = Stream(self.settings)
        self.converter = Converter(self.settings, self.stream.reject)
        self.arrivals = Arrivals()
        self.recent = RecentCounts(self.stream, 0.0)
        self.topics: dict[str, TopicState] = {
            topic: TopicState(topic, topic, (), name, 1) for topic, name in TYPES.items()}
        self.steps: dict[str, float] = {}
        self.now = 0
        self.steady = 0.0

    def feed(self, messages: list[Raw]) -> None:
        """Take the messages as they came, and let half a second pass."""
        for raw in messages:
            self.now = raw.time
            message = deserialize_message(raw.cdr, import_type(raw.type))
            events = self.converter.events(raw.topic, message, raw.time)
            self.arrivals.add(raw.topic, raw.time, events)
            for event in events:
                for estimate in self.stream.receive(event):
                    for index in estimate.stepped:
                        self.steps[self.settings.dofs[index]] = self.steady
        self.later(0.5)

    def hear_all_after(self, seconds: float) -> None:
        """Let each topic be heard once more, by a clock that is set forward."""
        self.now += round(seconds * 1e9)
        for topic in TYPES:
            self.arrivals.add(topic, self.now)

    def later(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)
        self.steady += seconds
        self.recent.update(self.steady)

    @property
    def health(self) -> HealthData:
        return HealthData(self.stream, self.arrivals, self.recent, self.topics, self.now,
                          self.steady, self.steps)

    def statuses(self, **state: Any) -> dict[str, Status]:
        """Return the statuses of a message by the part that they are about."""
        node = NodeState(NAME, **{'uptime': self.steady, **state})
        fields = fields_of(diagnostics(self.health, node))
        return {status['name'].removeprefix(f'{NAME}: '): (
                    status['hardware_id'], status['level'], status['message'],
                    {entry['key']: entry['value'] for entry in status['values']})
                for status in fields['status']}


def test_the_form_is_that_of_diagnostic_updater(messages: list[Raw]) -> None:
    run = Watched()
    run.feed(messages)
    statuses = run.statuses()
    assert list(statuses) == ['state', 'position', 'depth', 'attitude', 'thrusters', 'rejected',
                              'surge', 'heave', 'yaw', 'current']
    assert {hardware for hardware, _, _, _ in statuses.values()} == {NAME}
    assert {level for _, level, _, _ in statuses.values()} == {OK}
    position = statuses['position'][3]
    assert position['topic'] == '/position'
    assert position['type'] == 'geometry_msgs/msg/PointStamped'
    assert float(position['rate [Hz]']) == pytest.approx(10.0, rel=0.01)
    assert float(position['age [s]']) < 2.0
    assert position['publishers'] == '1'
    assert statuses['position'][2] == '10.0 Hz'
    state = statuses['state'][3]
    assert (state['state'], state['adaptation'], state['method']) == ('active', 'adapting', 'aid')
    assert state['level'] == 'OK'


def test_a_method_without_a_current_says_that_it_takes_the_water_to_be_still() -> None:
    assert Watched().statuses()['current'][1:3] == (
        OK, 'off: aid takes the water to be still; ekf estimates it')
    assert 'current' not in Watched({'current.prior': 0.0}).statuses()
    assert Watched({'identifier.method': 'ekf'}).statuses()['current'][2] == (
        'unobservable: turn by 45 degrees or more')


def test_the_hardware_id_is_the_operators() -> None:
    assert {status[0] for status in Watched({'hardware_id': 'JHUROV'}).statuses().values()} == {
        'JHUROV'}


def test_parameters_are_physical_with_unit_and_interval(messages: list[Raw]) -> None:
    run = Watched({'identifier.method': 'ekf'})
    run.feed(messages)
    values = run.statuses()['surge'][3]
    assert run.stream.estimate is not None
    dof = run.stream.estimate.dofs[0]
    assert float(values['mass [kg]']) == pytest.approx(1.0 / dof.parameters[0], rel=1e-3)
    low, high = map(float, values['mass, 95 % [kg]'].split(' to '))
    assert low < float(values['mass [kg]']) < high
    assert 'linear drag [N s/m]' in values
    assert 'mass [kg m²]' in run.statuses()['yaw'][3]
    assert int(values['steps']) == dof.steps


def test_before_anything_came() -> None:
    run = Watched()
    run.topics['/current'] = TopicState(
        '/current', '/current', ('thrusters',), THRUSTERS, 0, 'no_publisher',
        'no publisher on /current')
    run.now = 10**18
    statuses = run.statuses()
    assert statuses['position'][1:3] == (WARN, 'no messages on /position')
    assert statuses['thrusters'][1:3] == (WARN, 'no publisher on /current')
    assert statuses['surge'][1:3] == (WARN, 'no step yet: position: no messages on /position')
    assert statuses['state'][1] == WARN


def test_a_silent_input_and_its_dofs_are_stale(messages: list[Raw]) -> None:
    run = Watched()
    run.feed(messages)
    last = run.arrivals.last('/position')
    for _ in range(10):
        run.later(0.5)
        for topic in TYPES.keys() - {'/position'}:  # the others go on
            run.arrivals.add(topic, run.now)
    run.now = last + round(5.2e9)
    statuses = run.statuses()
    hardware, level, message, _ = statuses['position']
    assert (level, message) == (STALE, 'silent for 5.2 s')
    _, level, message, values = statuses['surge']
    assert level == STALE
    assert message == f'no step for {run.steady:.1f} s: position is silent'
    assert float(values['age of the last step [s]']) == run.steady
    assert statuses['state'][1] == WARN
    assert 'position' in statuses['state'][2]


def test_what_comes_and_goes_all_the_time_is_told_once(messages: list[Raw]) -> None:
    run, events = Watched(), Events()
    run.feed(messages)
    events.lines(run.health)
    told = []
    for k in range(60):  # gone for 3 s, back for 1 s
        run.later(0.5)
        for topic in TYPES:
            if topic != '/position' or k % 8 >= 6:
                run.arrivals.add(topic, run.now)
        told += [line.text for line in events.lines(run.health)
                 if line.text.startswith('position: ')]
    gone = [line for line in told if 'silent for' in line]
    assert len(gone) == 3  # in 30 s
    assert len(told) - len(gone) in (2, 3)


def test_what_goes_again_soon_and_stays_away_is_told(messages: list[Raw]) -> None:
    run, events = Watched(), Events()
    run.feed(messages)
    events.lines(run.health)
    told = []
    for k in range(40):  # gone for 3 s, back for 1 s, and gone for good
        run.later(0.5)
        for topic in TYPES:
            if topic != '/position' or k in (6, 7):
                run.arrivals.add(topic, run.now)
        told += [line.text for line in events.lines(run.health)
                 if line.text.startswith(('position: ', 'surge: '))]
    assert len([line for line in told if line.startswith('position: silent for')]) == 2
    assert len([line for line in told if line.startswith('position: back')]) == 1


def test_what_the_graph_forbids_is_an_error(messages: list[Raw]) -> None:
    run = Watched()
    run.topics['/current'] = TopicState(
        '/current', '/current', ('thrusters',), THRUSTERS, 0, 'qos', 'the QoS does not fit')
    run.feed([raw for raw in messages if raw.topic != '/current'])
    statuses = run.statuses()
    assert statuses['thrusters'][1:3] == (ERROR, 'the QoS does not fit')
    assert statuses['surge'][1:3] == (WARN, 'no step yet: thrusters: the QoS does not fit')
    assert statuses['state'][1] == ERROR


def test_messages_that_are_all_refused(messages: list[Raw]) -> None:
    run = Watched()
    run.feed(messages[:200])
    for _ in range(9):
        run.later(1.0)
    run.recent = RecentCounts(run.stream, run.steady)
    for raw in messages[200:]:
        run.arrivals.add(raw.topic, raw.time)
        run.now = max(run.now, raw.time)
    for _ in range(40):
        run.arrivals.add('/position', run.now)
        run.stream.reject('position', 'non_finite')
    run.later(0.5)
    _, level, message, values = run.statuses()['position']
    assert (level, message) == (
        ERROR, 'messages come, none is taken: position non_finite 40')
    assert values['refused non_finite'] == '40'
    assert values['refused non_finite, meaning'] == REASONS['non_finite']
    assert run.statuses()['rejected'][3] == {'position.non_finite': '40'}
    assert run.statuses()['rejected'][1] == WARN


def test_values_that_are_all_refused_are_not_taken(messages: list[Raw]) -> None:
    run = Watched()
    run.feed([replace(raw, cdr=raw.cdr[:4] + bytes(len(raw.cdr) - 4)) if raw.topic == '/imu'
              else raw for raw in messages])
    assert run.stream.rejected['attitude', 'not_a_rotation'] > 100
    assert run.stream.inputs['attitude'].count == 0
    _, level, message, _ = run.statuses()['attitude']
    assert (level, message[:35]) == (ERROR, 'messages come, none is taken: attit')


def test_a_command_that_holds_for_ever(messages: list[Raw]) -> None:
    run = Watched({'thrusters.timeout': 0.0})
    first = next(raw for raw in messages if raw.topic == '/current')
    run.feed([first, *(raw for raw in messages if raw.topic != '/current')])
    statuses = run.statuses()
    assert statuses['thrusters'][1:3] == (OK, 'the last command holds, 12 s old')
    assert 'thrusters' not in statuses['state'][2]


def test_the_inputs_are_waited_for_from_the_activation_on(
        ros_node: Node, capfd: pytest.CaptureFixture[str]) -> None:
    now = [0.0]
    stream = Stream(SETTINGS)
    monitor = HealthMonitor(ros_node, stream, None, Checkpoint(stream, ros_node.get_logger()),
                            steady=lambda: now[0])
    now[0] = 60.0
    monitor.expect_inputs()
    for seconds, is_told in ((60.5, False), (66.0, True)):
        now[0] = seconds
        monitor.update()
        assert ('inputs: none' in capfd.readouterr().err) is is_told


@pytest.fixture
def ros_node() -> Iterator[Node]:
    rclpy.init(args=[])
    node = rclpy.create_node('reporting')
    yield node
    node.destroy_node()
    rclpy.shutdown()


def test_refusals_of_long_ago_are_no_warning(messages: list[Raw]) -> None:
    run = Watched()
    for _ in range(100):
        run.stream.reject('position', 'too_fast')
    run.later(1.0)
    assert run.statuses()['rejected'][1] == WARN
    for _ in range(12):
        run.later(1.0)
    assert run.statuses()['rejected'][1] == OK
    assert run.statuses()['rejected'][3] == {'position.too_fast': '100'}  # still told


def test_stamps_of_another_clock(messages: list[Raw]) -> None:
    run = Watched()
    run.feed(messages)
    run.hear_all_after(100.0)
    _, level, message, _ = run.statuses()['position']
    assert level == WARN
    assert message.startswith('stamps are 10')
    assert message.endswith('s behind this clock')


def test_refused_messages_say_nothing_of_the_clock(messages: list[Raw]) -> None:
    """The last one that was used is older then."""
    run = Watched()
    run.feed(messages)
    run.hear_all_after(20.0)
    for _ in range(40):
        run.stream.reject('position', 'wrong_length')
    run.later(0.5)
    _, level, message, _ = run.statuses()['position']
    assert level == WARN
    assert 'refused of late: position wrong_length 40' in message


def test_commands_that_are_missing_are_the_cause_of_what_is_refused(messages: list[Raw]) -> None:
    run = Watched()
    run.feed(messages)
    for _ in range(40):
        run.stream.reject('thrusters', 'missing_name')
        run.stream.reject('position', 'stale_thrust')
    run.hear_all_after(20.0)
    run.steady += 20.0
    run.later(0.5)
    assert ': thrusters: ' in run.statuses()['surge'][2]


def test_a_node_that_is_not_active_says_so(messages: list[Raw]) -> None:
    run = Watched()
    run.feed(messages)
    statuses = run.statuses(state='inactive')
    assert statuses['state'][1:3] == (OK, 'inactive')
    assert {status[1] for name, status in statuses.items() if name != 'state'} == {STALE}


def test_files_that_are_not_written(messages: list[Raw], tmp_path: Path) -> None:
    # what a clock that went back has reset is saved beside what was learned
    path, written = tmp_path / 'c.json', str(tmp_path / 'c-reset.json')
    run = Watched({'checkpoint.path': str(path), 'checkpoint.period': 1.0})
    run.feed(messages)
    path.touch()
    assert run.statuses(uptime=2.0, checkpoint=written)['state'][1] == OK
    assert run.statuses(uptime=4.0, checkpoint=written)['state'][1] == WARN
    Path(written).touch()
    _, level, _, values = run.statuses(uptime=4.0, checkpoint=written)['state']
    assert (level, values['checkpoint path']) == (OK, written)
    _, level, message, values = run.statuses(uptime=2.0, record='r.mcap', recording=False)['state']
    assert level == ERROR
    assert 'recording has ended' in message
    assert values['recording path'] == 'r.mcap'


def test_simulated_time_has_to_begin() -> None:
    assert input_level(Watched().health, 'position')[1].endswith('/clock')


# --- the lines of the log


def test_what_was_refused_is_one_line_in_ten_seconds() -> None:
    stream = Stream(SETTINGS)
    lines = RefusalSummary(stream, 0.0)
    told = []
    for second in range(1, 61):
        if 10 < second <= 40:
            for _ in range(1000):
                stream.reject('position', 'too_fast')
            stream.reject('thrusters', 'late')
        told.append(lines.due(float(second)))
    assert [line for line in told if line] == [
        'refused in the last 10 s: position too_fast 10000, thrusters late 10'] * 3
    assert [index + 1 for index, line in enumerate(told) if line] == [20, 30, 40]
    stream.reject('depth', 'gap')
    assert lines.due(61.0) == ''
    assert lines.due(61.0, end=True) == 'refused in the last 1 s: depth gap 1'


def test_a_line_of_many_reasons_stays_short() -> None:
    stream = Stream(SETTINGS)
    lines = RefusalSummary(stream, 0.0)
    for name in stream.inputs:
        for reason in REASONS:
            stream.reject(name, reason)
    line = lines.due(10.0)
    assert len(line) < 400
    assert line.endswith('other reasons')


def test_warnings_are_never_a_flood() -> None:
    warnings = WarningLimiter()
    told = []
    for tick in range(10_000):  # a hundred seconds
        told += warnings.allowed([f'stamp {tick}', 'time jumped back'], tick / 100.0)
    assert len(told) <= 11 * 10
    assert told.count('time jumped back') == 10  # once a period
    assert '1990 more lines were not logged' not in told
    assert f'{2000 - 1000 - (MAX_WARNINGS - 1)} more lines were not logged' in told
    assert warnings.allowed(['another'], 1000.0)[-1] == 'another'


def test_a_hostile_stream_is_not_a_flood_in_the_log(
        messages: list[Raw], capfd: pytest.CaptureFixture[str]) -> None:
    """Time jumps back and forth with every few messages."""
    rclpy.init(args=[])
    try:
        node = IdentifierNode(changed({'max_wait': 0.1, 'reset_on_time_jump': True}), live=False)
        first, last = messages[:40], messages[-40:]
        for _ in range(60):
            for raw in (*last, *first):
                message = deserialize_message(raw.cdr, import_type(raw.type))
                node.add_message(raw.topic, message, raw.time)
        node.finish()
        node.destroy_node()
    finally:
        rclpy.shutdown()
    lines = [line for line in capfd.readouterr().err.splitlines() if 'WARN' in line]
    assert any('time jumped back' in line for line in lines)
    assert len(lines) <= MAX_WARNINGS + 2
    assert any('refused in the last' in line for line in lines)


# --- the graph


class OtherVehicle:
    """A peer with a DDS participant of its own, which can have other types for a topic."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(args=[], context=self.context)
        self.node = Node('other', namespace='/there', context=self.context)

    def advertise(self, topic: str, type_name: str, qos: QoSProfile | None = None) -> Any:
        return self.node.create_publisher(import_type(type_name), topic, qos or reliable(10))

    def close(self) -> None:
        self.node.destroy_node()
        self.context.shutdown()


@pytest.fixture
def other() -> Iterator[OtherVehicle]:
    rclpy.init(args=[])
    vehicle = OtherVehicle()
    yield vehicle
    vehicle.close()
    rclpy.shutdown()


def until(node: Any, topic: str, condition: Callable[[TopicState], Any]) -> TopicState:
    """Ask the graph until it says so."""
    end = time.monotonic() + 20.0
    while True:
        state = graph_states(node.settings, node)[topic]
        if condition(state):
            return state
        assert time.monotonic() < end, state
        time.sleep(0.05)


def test_what_the_graph_knows(other: OtherVehicle) -> None:
    node = IdentifierNode(changed({'position.qos': 'sensor_data'}))
    other.advertise('/imu', 'sensor_msgs/msg/JointState')
    other.advertise('/thrusters/current', THRUSTERS)
    other.advertise('/depth', TYPES['/depth'], best_effort(5))
    other.advertise('/position', TYPES['/position'], best_effort(5))
    wrong = until(node, '/imu', lambda state: state.problem == 'type')
    assert wrong.text == '/imu carries sensor_msgs/msg/JointState, not sensor_msgs/msg/Imu'
    assert (wrong.inputs, wrong.publishers, wrong.is_wrong) == (('attitude',), 0, True)
    missing = until(node, '/current', lambda state: 'did you mean' in state.text)
    assert (missing.problem, missing.is_wrong) == ('no_publisher', False)
    assert missing.text == ('no publisher on /current; did you mean /thrusters/current, which '
                            'has that type?')
    qos = until(node, '/depth', lambda state: '/there/other' in state.text)
    assert qos.problem == 'qos'
    assert qos.text == ('the QoS of /there/other does not fit: best effort publisher and '
                        'reliable subscription; with qos: sensor_data every publisher is heard')
    good = until(node, '/position', lambda state: state.publishers == 1)
    assert (good.problem, good.text) == ('', '')
    other.advertise('/depth', TYPES['/depth'], reliable(5))
    both = until(node, '/depth', lambda state: state.publishers == 1)
    assert both.problem == ''
    assert both.text.startswith('1 of 2 publishers on /depth not heard: the QoS of')
    other.advertise('/position', TYPES['/position'], reliable(5))
    two = until(node, '/position', lambda state: state.text.endswith('/other, /there/other'))
    assert (two.problem, two.publishers, two.text) == (
        '', 2, '2 publishers on /position are taken for one: /there/other, /there/other')
    node.destroy_node()


def test_who_else_publishes_the_model_is_told(other: OtherVehicle) -> None:
    """A controller would hear two vehicles in turn."""
    node = Node('reporting')
    node.create_publisher(import_type(ARRAY_TYPE), 'rov/model', reliable(1))
    assert rivals(node) == ''
    other.advertise('/rov/model', ARRAY_TYPE)
    end = time.monotonic() + 20.0
    while not rivals(node):
        assert time.monotonic() < end
        time.sleep(0.05)
    assert rivals(node) == ('2 publishers on /rov/model, whose listeners take them for one: '
                            '/reporting, /there/other')
    node.destroy_node()


def test_names_of_the_graph_are_resolved(other: OtherVehicle) -> None:
    node = Node('rovid_check', namespace='/rov1', cli_args=[
        '--ros-args', '-r', '/imu:=/sensors/imu'])
    settings = settings_from(changed({'position.topic': 'position'}))
    states = graph_states(settings, node)
    assert states['position'].name == '/rov1/position'
    assert states['/imu'].name == '/sensors/imu'
    node.destroy_node()


class Graph:
    """A graph of any size and shape."""

    def __init__(self, publishers: list[Any], topics: list[tuple[str, list[str]]]) -> None:
        self._publishers, self._topics = publishers, topics

    def get_name(self) -> str:
        return 'me'

    def get_namespace(self) -> str:
        return '/'

    def resolve_topic_name(self, topic: str) -> str:
        return topic

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        return self._topics

    def count_publishers(self, name: str) -> int:
        return 1

    def get_publishers_info_by_topic(self, name: str) -> list[Any]:
        return self._publishers

    def get_subscriptions_info_by_topic(self, name: str) -> list[Any]:
        return [endpoint(TYPES[name], 'me', 1)]


def endpoint(type_name: str, node: str = 'you', content: int = 1) -> Any:
    value = bytes([content] * 32)
    return SimpleNamespace(
        node_name=node, node_namespace='/', topic_type=type_name, qos_profile=reliable(1),
        topic_type_hash=SimpleNamespace(version=1, value=value))


def test_another_definition_of_a_type_is_told() -> None:
    state = graph_states(SETTINGS, Graph([endpoint(THRUSTERS, content=2)], []))['/current']
    assert state.problem == 'definition'
    assert state.text.startswith(f'/you publishes {THRUSTERS} of another definition')
    state = graph_states(SETTINGS, Graph([endpoint(THRUSTERS)], []))['/current']
    assert (state.problem, state.publishers) == ('', 1)


def test_a_crowded_graph_stays_one_short_line() -> None:
    types = [f'crowd_msgs/msg/T{number}' for number in range(500)]
    graph = Graph([endpoint(name) for name in types], [(f'/t{i}', types) for i in range(500)])
    state = graph_states(SETTINGS, graph)['/current']
    assert state.problem == 'type'
    assert len(state.text) < 200
    assert '497 more' in state.text


# --- the whole node over DDS


def test_a_start_without_thrusters(messages: list[Raw], peer: Peer, environment: dict[str, str],
                                   tmp_path: Path, repository: Path) -> None:
    """What is missing is told, and when it has come; silence and a second publisher too."""
    file = write_parameters(tmp_path / 'parameters.yaml', VALUES)
    health = peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
    other = peer.node.create_publisher(import_type(THRUSTERS), '/thrusters/current', 10)
    node = NodeProcess(['--ros-args', '--params-file', file], environment, tmp_path, repository)
    try:
        peer.advertise({topic: name for topic, name in TYPES.items() if topic != '/current'})
        peer.publish(raw for raw in messages if raw.topic != '/current')
        peer.until(lambda: 'missing: thrusters' in node.output)  # a slow start says more
        line = inputs_lines(node)[-1]
        assert '[WARN]' in line
        assert 'position 10.0 Hz (PointStamped)' in line
        assert line.endswith('missing: thrusters (no publisher on /current; did you mean '
                             '/thrusters/current, which has that type?)')
        assert statuses_of(health)['thrusters'][1] == WARN

        peer.advertise({'/current': THRUSTERS})
        for raw in messages:  # anew, and later: now all inputs are there
            message = deserialize_message(raw.cdr, import_type(raw.type))
            message.header.stamp.sec += 20
            peer.send(raw.topic, message)
        peer.until(lambda: 'missing' not in inputs_lines(node)[-1])
        line = inputs_lines(node)[-1]
        assert '[INFO]' in line
        assert 'thrusters 20.0 Hz (JointState)' in line

        # so far no order of delivery was too late; from now on silence is soon too long
        request = SetParameters.Request(
            parameters=[Parameter('max_wait', value=0.1).to_parameter_msg()])
        (answer,) = peer.call(SetParameters, '/identifier_node/set_parameters', request).results
        assert answer.successful, answer.reason
        peer.until(lambda: statuses_of(health)['surge'][1] == STALE)
        _, level, message, _ = statuses_of(health)['surge']
        assert message.startswith('no step for ')
        assert message.endswith('position and attitude and thrusters are silent')
        assert statuses_of(health)['position'][1] == STALE
        assert statuses_of(health)['state'][1] == WARN

        second = peer.node.create_publisher(import_type(TYPES['/depth']), '/depth', 10)
        peer.until(lambda: 'depth: 2 publishers on /depth are taken for one' in node.output)
        peer.node.destroy_publisher(second)
        assert node.stop() == 0, node.output
        assert inputs_lines(node)[-1] == line
    finally:
        node.kill()
        peer.node.destroy_publisher(other)


def inputs_lines(node: NodeProcess) -> list[str]:
    return [line for line in node.output.splitlines() if 'inputs: ' in line]


def statuses_of(health: list[Any]) -> dict[str, Status]:
    """Return the newest statuses by part; empty ones before the first."""
    missing: Status = ('', -1, '', {})
    found = {status[0].partition(': ')[2]: status for status in heard(health[-1:])[0]} \
        if health else {}
    return {name: found.get(name, missing) for name in (
        'state', 'position', 'thrusters', 'surge', *found)}
