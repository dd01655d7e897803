"""The node object: conversion of its inputs, parameters, and what it does when fed by hand."""

import math
import os
from pathlib import Path
import random
import resource
import time
from typing import Any

import pytest

rclpy = pytest.importorskip('rclpy')

from rcl_interfaces.msg import ParameterType
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from rosgraph_msgs.msg import Clock
from rovid_core.model.samples import Event
from rovid_core.settings.run import SettingsError
from rovid_ros.config.keys import KEYS
from rovid_ros.config.parameters import settings_from
from rovid_ros.files.whole_files import prepare_file
from rovid_ros.logs.log import Log
from rovid_ros.logs.player import CONTROL
from rovid_ros.messages.field_paths import FieldError
from rovid_ros.node.log_player import NodePlayer
from rovid_ros.node.node import IdentifierNode
from rovid_ros.node.process import read_files
from rovid_ros.node.recorder import Received, Recorder
from rovid_ros.node.transport.message_types import definition, import_type, MessageTypeError
from rovid_ros.node.transport.publishers import best_effort, latched
from rovid_ros.results.outputs import DIAGNOSTIC_TYPE, TOPICS
from std_msgs.msg import Float64MultiArray

from test.support.live_node import (
    changed,
    heard,
    Peer,
    Raw,
    replayed,
    told,
    TYPES,
    VALUES,
)
from test.support.ros_messages import fill


class Running:
    """A node that is spun by hand, and its peer."""

    def __init__(self, changes: dict[str, Any] | None = None, **arguments: Any) -> None:
        self.node = IdentifierNode(changed(changes or {}), **arguments)
        self.peer = Peer()
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)

    def spin(self, times: int = 20) -> None:
        for _ in range(times):
            self.executor.spin_once(timeout_sec=0.02)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.peer.close()


def test_a_burst_keeps_the_order_of_time(ros: None, messages: list[Raw]) -> None:
    """What has piled up during a stall is taken by its stamps, not a topic at a time."""
    run = Running({'max_wait': 0.1})
    run.peer.advertise(TYPES)
    run.peer.publish(messages)
    run.spin(1)
    run.node.finish()
    assert run.node.stream.rejected == {}
    settings = settings_from(changed({'max_wait': 0.1}))
    assert repr(run.node.stream.estimate) == repr(replayed(settings, messages)[-1])
    run.close()


def test_what_waits_when_it_is_deactivated_counts(ros: None, messages: list[Raw]) -> None:
    run = Running()
    run.peer.advertise(TYPES)
    run.peer.publish(messages)
    assert run.node.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    assert repr(run.node.stream.estimate) == repr(
        replayed(settings_from(changed({})), messages)[-1])
    run.close()


def test_an_inactive_node_has_no_velocity(ros: None, messages: list[Raw]) -> None:
    run = Running()
    twists = run.peer.listen('/rov/velocity', TOPICS['rov/velocity'])
    run.peer.advertise(TYPES)
    for raw in messages:
        run.peer.send(raw.topic, raw.cdr)
        run.spin(1)
        run.peer.spin(0.001)
        if twists and not math.isnan(twists[-1].twist.linear.x):
            break
    assert twists
    run.node.trigger_deactivate()
    run.peer.until(lambda: math.isnan(twists[-1].twist.linear.x))
    run.close()


def test_best_effort_publishers_are_heard_too(ros: None, messages: list[Raw]) -> None:
    run = Running({f'{name}.qos': 'sensor_data' for name in (
        'position', 'depth', 'attitude', 'thrusters')})
    run.peer.advertise(TYPES, best_effort(10))
    for raw in messages[:200]:
        run.peer.send(raw.topic, raw.cdr)
        run.spin(1)
    run.spin()
    assert run.node.stream.inputs['position'].count > 10
    run.close()


def test_one_subscription_for_all_inputs_of_a_topic(ros: None) -> None:
    odometry = {'topic': '/odom', 'type': 'nav_msgs/msg/Odometry'}
    run = Running({
        'dofs': ['surge', 'yaw'], 'depth.topic': None, 'depth.type': None, 'depth.field': None,
        'position.field': 'pose.pose', 'attitude.field': 'pose.pose',
        **{f'{name}.{key}': value for name in ('position', 'attitude')
           for key, value in odometry.items()}})
    topics = [subscription.topic_name for subscription in run.node.subscriptions]
    assert topics.count('/odom') == 1
    run.close()


def test_fed_from_a_log_it_publishes_what_the_pipe_says(
        ros: None, log: Path, messages: list[Raw], tmp_path: Path) -> None:
    record, checkpoint = tmp_path / 'record.mcap', tmp_path / 'checkpoint.json'
    run = Running({'record.path': str(record), 'checkpoint.path': str(checkpoint)}, live=False)
    estimates = run.peer.listen_to_steps()
    run.peer.until(lambda: all(publisher.get_subscription_count() for publisher in
                               run.node.publishers if publisher.topic_name == '/rov/estimate'))
    given = []
    with Log([log]) as source:
        for message in source.messages(list(TYPES)):
            given += run.node.add_message(message.topic, message.data, message.time)
    given += run.node.finish()
    run.peer.settle(estimates)
    settings = settings_from(VALUES)
    assert repr(given) == repr(replayed(settings, messages))  # a NaN is not equal to itself
    assert heard(estimates) == told(settings, given)
    # a replay leaves the vehicle's own files alone
    assert not record.exists()
    assert not checkpoint.exists()
    assert not any(s.topic_name in TYPES for s in run.node.subscriptions)
    run.close()


def test_a_replay_that_is_behind_tells_ages_in_its_own_time(log: Path) -> None:
    """Services and timers get their turn, and the node's clock is the log's."""
    with Log([log]) as source:
        messages = list(source.messages(list(TYPES)))
    player = NodePlayer(VALUES, settings_from(VALUES), rate=1e6)  # never caught up with
    peer = Peer()
    try:
        health = peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
        for message in messages:
            player.add_message(message)
            time.sleep(2.0 / len(messages))
        peer.settle(health, 1)
        player.add_message(messages[0])  # as of a log that is played again
        assert player.node.get_clock().now().nanoseconds == messages[0].time
    finally:
        peer.close()
        player.close()
    for status in health[-1].status[1:5]:
        values = {entry.key: entry.value for entry in status.values}
        assert int(values['count']) > 0
        assert abs(float(values['age [s]'])) < 1.0  # not the years since the log
    assert messages[0].time // 10**9 <= health[-1].header.stamp.sec <= messages[-1].time // 10**9


def test_a_late_subscriber_gets_the_last_parameters(ros: None, messages: list[Raw]) -> None:
    run = Running(live=False)
    for raw in messages[:300]:
        message = deserialize_message(raw.cdr, import_type(raw.type))
        run.node.add_message(raw.topic, message, raw.time)
    assert run.node.stream.estimate is not None
    expected = [value for dof in run.node.stream.estimate.dofs for value in dof.parameters]
    health = run.peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
    # nobody has heard them: they are out within a second, before the diagnostics
    run.peer.until(lambda: run.executor.spin_once(timeout_sec=0.02) or health)
    for topic in ('/rov/params', '/rov/params_std'):
        heard = run.peer.listen(topic, 'std_msgs/msg/Float64MultiArray', latched())
        run.peer.until(lambda: heard)  # noqa: B023
        run.peer.spin(0.2)
        (last,) = heard
        if topic == '/rov/params':
            assert list(last.data) == expected
    run.close()


def test_messages_of_another_definition_are_counted(ros: None, messages: list[Raw]) -> None:
    run = Running()
    run.peer.advertise(TYPES)
    run.peer.send('/position', b'\x00\x01\x00\x00\xff')
    run.peer.publish(messages[:50])
    run.spin()
    assert run.node.stream.rejected == {('position', 'undecodable'): 1}
    assert run.node.stream.inputs['position'].count > 0
    run.close()


def test_simulated_time_is_the_receive_time(ros: None) -> None:
    changes = {
        'use_sim_time': True, 'thrusters.type': 'std_msgs/msg/Float64MultiArray',
        'thrusters.field': 'data', 'thrusters.names': None}
    run = Running(changes)
    run.peer.advertise({'/clock': 'rosgraph_msgs/msg/Clock',
                        '/current': changes['thrusters.type']})
    command = Float64MultiArray(data=[1.0, 2.0, 3.0])
    run.peer.send('/current', command)
    run.spin()
    assert run.node.stream.rejected == {('thrusters', 'no_clock'): 1}
    clock = Clock()
    clock.clock.sec = 100
    run.peer.send('/clock', clock)
    run.spin()
    run.peer.send('/current', command)
    run.spin()
    run.node.finish()
    assert run.node.stream.inputs['thrusters'].last_time == 100 * 10**9
    run.close()


def test_parameters_are_described_and_fixed(ros: None) -> None:
    run = Running(live=False)
    node = run.node
    names = node.list_parameters([], 0).names
    assert {key.name for key in KEYS} <= set(names)
    assert node.get_parameter('surge.initial.mass').value == 290.0
    assert node.get_parameter('time_jump').value == settings_from(VALUES).time_jump  # a default
    assert list(node.get_parameter('thrusters.gain').value) == [40.0, 40.0, 55.0]
    described = node.describe_parameter('time_jump')
    assert described.type == ParameterType.PARAMETER_DOUBLE
    assert 'only while the node is unconfigured' in described.additional_constraints
    assert '[s]' in described.description
    assert described.floating_point_range[0].from_value > 0.0
    assert node.describe_parameter('thrusters.polynomial').type == (
        ParameterType.PARAMETER_DOUBLE_ARRAY)
    (result,) = node.set_parameters([Parameter('time_jump', value=2.0)])
    assert not result.successful
    assert 'only while the node is unconfigured' in result.reason
    run.close()


def test_parameter_files_on_the_command_line(tmp_path: Path) -> None:
    first, second = tmp_path / 'first.yaml', tmp_path / 'second.yaml'
    first.write_text('/**: {ros__parameters: {max_gap: 1.0, max_wait: 1.0}}')
    second.write_text('{/**: {ros__parameters: {max_wait: 2.0}},'
                      ' /rov1/other: {ros__parameters: {max_gap: 3.0}}}')
    rest, values = read_files([
        'node', '--params-file', 'mine', '--ros-args', '-r', '__ns:=/rov1', '--params-file',
        str(first), '-r', 'identifier_node:__node:=other', '--params-file', str(second),
        '-p', 'a:=1'])
    assert values == {'max_gap': 3.0, 'max_wait': 2.0}
    assert rest == ['node', '--params-file', 'mine', '--ros-args', '-r', '__ns:=/rov1',
                    '-r', 'identifier_node:__node:=other', '-p', 'a:=1']


@pytest.mark.parametrize(('arguments', 'taken'), [
    ((), True), (('-p', 'use_sim_time:=false'), False)])
def test_the_command_line_wins_over_what_a_file_has_for_rclpy(
        arguments: tuple[str, ...], taken: bool, tmp_path: Path) -> None:
    file = tmp_path / 'own.yaml'
    file.write_text('/**: {ros__parameters: {use_sim_time: true, max_wait: 2.0}}')
    rest, values = read_files(['node', '--ros-args', '--params-file', str(file), *arguments])
    assert values == {'max_wait': 2.0}
    context = rclpy.Context()
    context.init(args=rest)
    node = rclpy.create_node('node', context=context)
    try:
        assert node.get_parameter('use_sim_time').value is taken
    finally:
        node.destroy_node()
        context.try_shutdown()


def record(path: Path) -> tuple[Recorder, list[str]]:
    failures: list[str] = []
    recorder = Recorder(path, definition, failures.append)
    recorder.open(None)
    return recorder, failures


def test_a_message_of_two_events_is_recorded_once(tmp_path: Path, messages: list[Raw]) -> None:
    recorder, failures = record(tmp_path / 'record.mcap')
    for raw in messages[:2]:
        received = Received(raw.topic, raw.type, raw.cdr, raw.time)
        recorder.released(Event(raw.time - 5, (), received))
        recorder.released(Event(raw.time, (), received))
    recorder.close()
    with Log([tmp_path / 'record.mcap']) as log:
        times = [message.time for message in log.messages(list(log.topics))]
    assert times == [raw.time for raw in messages[:2]]
    assert not failures


def test_what_is_done_before_the_first_message_has_its_time(
        tmp_path: Path, messages: list[Raw]) -> None:
    recorder, _ = record(tmp_path / 'record.mcap')
    recorder.controlled('enable', 'false')
    for raw in messages[:2]:
        recorder.released(Event(raw.time, (), Received(raw.topic, raw.type, raw.cdr, raw.time)))
    recorder.close()
    with Log([tmp_path / 'record.mcap']) as log:
        assert log.start == messages[0].time
        assert [message.topic for message in log.messages(list(log.topics))] == [
            CONTROL, *(raw.topic for raw in messages[:2])]


def test_an_event_before_1970_is_recorded(tmp_path: Path, messages: list[Raw]) -> None:
    """Simulated time begins at 0, and an input with a latency before it."""
    recorder, failures = record(tmp_path / 'record.mcap')
    raw = messages[0]
    recorder.released(Event(-10**8, (), Received(raw.topic, raw.type, raw.cdr, 0)))
    recorder.close()
    with Log([tmp_path / 'record.mcap']) as log:
        assert [message.time for message in log.messages([raw.topic])] == [0]
    assert not failures


def test_two_nodes_with_one_path_record_into_two_files(
        tmp_path: Path, messages: list[Raw]) -> None:
    path = tmp_path / 'record.mcap'
    both = [Recorder(path, definition, pytest.fail) for _ in range(2)]
    for number, recorder in enumerate(both):
        recorder.open(None)
        raw = messages[number]
        recorder.released(Event(raw.time, (), Received(raw.topic, raw.type, raw.cdr, raw.time)))
    for recorder in both:
        recorder.close()
    assert [recorder.path.name for recorder in both] == ['record.mcap', 'record-1.mcap']
    for recorder, raw in zip(both, messages):
        with Log([recorder.path]) as log:
            assert [message.time for message in log.messages([raw.topic])] == [raw.time]


def test_a_full_disk_ends_the_record_alone(tmp_path: Path, messages: list[Raw]) -> None:
    recorder, failures = record(tmp_path / 'record.mcap')
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, before[1]))
    try:
        for number in range(5):
            cdr = messages[0].cdr + random.Random(number).randbytes(5000)
            received = Received('/position', messages[0].type, cdr, number)
            recorder.released(Event(number, (), received))
            recorder.flush()
        recorder.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    (line,) = failures
    assert 'record.mcap ended' in line


def test_only_a_regular_file_is_replaced(tmp_path: Path) -> None:
    """A checkpoint is put in the place of what is there: never of a device."""
    os.mkfifo(tmp_path / 'pipe')
    for path in (tmp_path, tmp_path / 'pipe', tmp_path / 'pipe' / 'file', Path('/proc/x/y')):
        with pytest.raises(SettingsError, match=rf'^checkpoint\.path: {path} '):
            prepare_file('checkpoint.path', path)
    prepare_file('checkpoint.path', tmp_path / 'new' / 'file')
    assert [*(tmp_path / 'new').iterdir()] == []


def test_whole_numbers_are_taken_where_numbers_are_meant(ros: None) -> None:
    run = Running({'max_gap': 2, 'thrusters.gain': [40, 40, 55]}, live=False)
    assert run.node.get_parameter('max_gap').value == 2.0
    assert list(run.node.get_parameter('thrusters.gain').value) == [40.0, 40.0, 55.0]
    run.close()


@pytest.mark.parametrize('changes, error, text', [
    ({'position.type': None}, SettingsError, 'position.type'),
    ({'position.type': 'geometry_msgs/msg/PointStampd'}, SettingsError, 'PointStamped'),
    ({'attitude.field': 'orientatoin'}, FieldError, 'orientation'),
    ({'record.path': '/tmp/./one', 'checkpoint.path': '/tmp/one'}, SettingsError, 'record.path'),
])
def test_what_is_wrong_is_named(ros: None, changes: dict[str, Any], error: type[Exception],
                                text: str) -> None:
    with pytest.raises(error, match=text):
        IdentifierNode(changed(changes))


def test_a_message_type_is_found_in_both_spellings() -> None:
    assert import_type('sensor_msgs/Imu') is import_type('sensor_msgs/msg/Imu')
    for name in ('Imu', 'sensor_msgs/msg/../Imu', 'no_such_msgs/msg/Thing'):
        with pytest.raises(MessageTypeError, match=name.split('/')[0]):
            import_type(name)


@pytest.mark.parametrize('name', [
    'sensor_msgs/msg/Imu', 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/JointState',
    'sensor_msgs/msg/BatteryState', 'std_msgs/msg/Float64MultiArray', 'sensor_msgs/msg/Joy',
    'diagnostic_msgs/msg/DiagnosticArray', 'geometry_msgs/msg/PolygonInstanceStamped',
    'rcl_interfaces/msg/ParameterDescriptor', 'sensor_msgs/msg/CameraInfo'])
def test_definitions_say_what_rosbags_knows(name: str) -> None:
    """Compared without constants, which a definition from a class cannot have."""
    known = get_typestore(Stores.ROS2_KILTED).fielddefs
    for inner, (_, fields) in get_types_from_msg(definition(name), name).items():
        assert [(field, kind) for field, kind in fields] == [
            (field, kind) for field, kind in known[inner][1]], inner


def test_fill_and_back() -> None:
    message = fill(import_type(DIAGNOSTIC_TYPE), {
        'header': {'stamp': {'sec': 3, 'nanosec': 4}},
        'status': [{'level': 2, 'name': 'surge', 'values': [{'key': 'a', 'value': 'b'}]}]})
    assert message.header.stamp.nanosec == 4
    assert heard([message]) == [[('surge', 2, '', {'a': 'b'})]]
