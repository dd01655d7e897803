"""Simulated logs: every message says what the simulator said, and the file is repeatable."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
import math
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
import pytest
from rovid_core.settings.run import (
    DofSettings,
    InputSettings,
    Settings,
    SimulatedDof,
    SimulationSettings,
    ThrusterSettings,
)
from rovid_core.simulation.profiles import Steps
from rovid_core.simulation.sensors import simulate
from rovid_core.velocity.attitude_history import from_yaw, product
from rovid_ros.commands.main import main
from rovid_ros.commands.simulate import EPOCH, simulate_log
from rovid_ros.messages.converter import Converter
from rovid_ros.messages.simulated_messages import SensorMessages, SimulationError
from rovid_ros.messages.types import build, standard_types

ATTITUDE = product(from_yaw(2.5), (0.1, 0.0, 0.0, math.sqrt(0.99)))
LEVEL = from_yaw(-2.0)
VALUES = {
    'position': (1.25, -2.5, 3.75), 'depth': (-12.5,), 'attitude': ATTITUDE,
    'angular_velocity': (0.25, -0.5, 0.75), 'velocity': (0.5, -0.25, 0.125),
    'reference': (0.5, -0.25, 0.125, 0.25, -0.5, 0.75), 'thrusters': (1.5, -2.5, 3.5),
}
EYE = tuple(tuple(float(i == j) for j in range(6)) for i in range(6))


def settings_of(frames: str = 'enu', thrusters: ThrusterSettings | None = None,
                **inputs: Any) -> Settings:
    """Return settings with these inputs, the rest as little as there can be."""
    rows = ((1.0, 1.0, 0.0), (0.0,) * 3, (0.0, 0.0, 1.0), (0.0,) * 3, (0.0,) * 3,
            (0.25, -0.25, 0.0))
    return Settings(
        dofs=('surge',), dof={'surge': DofSettings(100.0)}, frames=frames,
        simulation=SimulationSettings(dofs={'surge': SimulatedDof(120.0)}),
        thrusters=thrusters or ThrusterSettings(
            ('/thrust',), 'std_msgs/msg/Float64MultiArray', 'data', gain=(1.0,) * 3,
            allocation=rows),
        **{'velocity': InputSettings('/dvl', 'geometry_msgs/msg/TwistStamped', 'twist'),
           **inputs})


def round_trip(settings: Settings, values: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """Return what the node makes of the messages that are made for ``values``."""
    counted: list[tuple[str, str]] = []
    converter = Converter(settings, lambda name, reason: counted.append((name, reason)))
    back: dict[str, Any] = {}
    time = 1_234_567_890_123_456_789
    for message in SensorMessages(settings).messages(
            time, {name: tuple(value) for name, value in values.items()}):
        decoded = build(standard_types(), message.type, message.fields)
        cdr = standard_types().serialize_cdr(decoded, message.type)
        decoded = standard_types().deserialize_cdr(cdr, message.type)
        for event in converter.events(message.topic, decoded, message.time):
            assert event.time == time
            for sample in event.samples:
                back.setdefault(sample.input, {})[sample.part] = sample.value
    assert not counted
    return back


@pytest.mark.parametrize('frames', ['enu', 'ned'])
@pytest.mark.parametrize(('name', 'type_name', 'field'), [
    ('position', 'geometry_msgs/msg/PointStamped', 'point'),
    ('position', 'geometry_msgs/msg/Point', ''),
    ('position', 'geometry_msgs/msg/PoseStamped', 'pose.position'),
    ('position', 'nav_msgs/msg/Odometry', 'pose.pose'),
    ('position', 'tf2_msgs/msg/TFMessage', 'transforms[1].transform'),
    ('attitude', 'sensor_msgs/msg/Imu', 'orientation'),
    ('attitude', 'geometry_msgs/msg/QuaternionStamped', 'quaternion'),
    ('attitude', 'nav_msgs/msg/Odometry', 'pose'),
    ('angular_velocity', 'sensor_msgs/msg/Imu', 'angular_velocity'),
    ('velocity', 'geometry_msgs/msg/TwistWithCovarianceStamped', 'twist.twist'),
    ('velocity', 'nav_msgs/msg/Odometry', 'twist'),
    ('reference', 'geometry_msgs/msg/TwistStamped', 'twist'),
    ('position', 'geometry_msgs/msg/Point', 'y, z, x'),
    ('attitude', 'geometry_msgs/msg/Vector3', 'x, y, z'),
    ('attitude', 'geometry_msgs/msg/Quaternion', 'w, x, y, z'),
])
def test_messages_come_back_as_the_simulated_values(
        frames: str, name: str, type_name: str, field: str) -> None:
    inputs: dict[str, Any] = {name: InputSettings('/in', type_name, field, latency=0.125)}
    settings = settings_of(frames, **inputs)
    expected: Sequence[float] = VALUES[name]
    (back,) = round_trip(settings, {name: expected})[name].values()
    if name == 'attitude' and back[3] * expected[3] < 0.0:  # q and -q are the same attitude
        back = tuple(-x for x in back)
    assert back == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize('name, type_name, field', [
    ('attitude', 'sensor_msgs/msg/Imu', 'orientation'),
    ('attitude', 'geometry_msgs/msg/Vector3', 'x, y, z'),
    ('angular_velocity', 'sensor_msgs/msg/Imu', 'angular_velocity'),
    ('velocity', 'geometry_msgs/msg/TwistStamped', 'twist')])
def test_so_do_those_of_a_sensor_that_is_turned_in_the_body(
        name: str, type_name: str, field: str) -> None:
    given = InputSettings('/in', type_name, field, frames='ned', mounting=(0.3, -0.2, 1.9))
    (back,) = round_trip(settings_of(**{name: given}), {name: VALUES[name]})[name].values()
    if name == 'attitude' and back[3] * VALUES[name][3] < 0.0:
        back = tuple(-x for x in back)
    assert back == pytest.approx(VALUES[name], abs=1e-12)


@pytest.mark.parametrize('frames', ['enu', 'ned'])
@pytest.mark.parametrize('unit', ['rad', 'deg'])
@pytest.mark.parametrize('sense', ['', 'ned'])
@pytest.mark.parametrize('yaw_offset', [0.0, 1.25])
def test_a_scalar_heading_comes_back(
        frames: str, unit: str, sense: str, yaw_offset: float) -> None:
    settings = replace(
        settings_of(frames, attitude=InputSettings('/in', 'std_msgs/msg/Float64', 'data')),
        heading_unit=unit, heading_frames=sense, yaw_offset=yaw_offset)
    (back,) = round_trip(settings, {'attitude': LEVEL})['attitude'].values()
    assert abs(sum(a * b for a, b in zip(back, LEVEL))) == pytest.approx(1.0, abs=1e-12)


def test_the_yaw_offset_of_a_quaternion_is_taken_off_first() -> None:
    settings = replace(
        settings_of('ned', attitude=InputSettings('/in', 'sensor_msgs/msg/Imu', 'orientation')),
        yaw_offset=0.75)
    (back,) = round_trip(settings, {'attitude': ATTITUDE})['attitude'].values()
    assert abs(sum(a * b for a, b in zip(back, ATTITUDE))) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize('frames', ['enu', 'ned'])
def test_depth_is_scaled_backwards(frames: str) -> None:
    settings = replace(
        settings_of(frames, depth=InputSettings(
            '/in', 'sensor_msgs/msg/FluidPressure', 'fluid_pressure')),
        depth_scale=-1.02e-4, depth_offset=10.33)
    assert round_trip(settings, {'depth': (-12.5,)})['depth'] == {
        0: pytest.approx((-12.5,), abs=1e-12)}


@pytest.mark.parametrize(('type_name', 'field', 'names'), [
    ('sensor_msgs/msg/JointState', 'effort', ('a', 'b', 'c')),
    ('sensor_msgs/msg/JointState', 'velocity', ()),
    ('sensor_msgs/msg/Joy', 'axes', ()),
    ('sensor_msgs/msg/Joy', 'axes[2:5]', ()),
    ('std_msgs/msg/Float64MultiArray', 'data', ()),
])
def test_thruster_commands_come_back(
        type_name: str, field: str, names: tuple[str, ...]) -> None:
    settings = settings_of()
    settings = replace(settings, thrusters=replace(
        settings.thrusters, type=type_name, field=field, names=names, latency=-0.25))
    assert round_trip(settings, {'thrusters': VALUES['thrusters']})['thrusters'] == {
        0: VALUES['thrusters']}


def test_one_topic_per_thruster() -> None:
    settings = settings_of()
    settings = replace(settings, thrusters=replace(
        settings.thrusters, topics=('/a', '/b', '/c'), type='std_msgs/msg/Float64'))
    assert round_trip(settings, {'thrusters': VALUES['thrusters']})['thrusters'] == {
        0: (1.5,), 1: (-2.5,), 2: (3.5,)}


@pytest.mark.parametrize('frames', ['enu', 'ned'])
def test_a_wrench_comes_back(frames: str) -> None:
    settings = settings_of(frames, ThrusterSettings(
        ('/w',), 'geometry_msgs/msg/WrenchStamped', 'wrench', gain=(1.0,) * 6, allocation=EYE))
    wrench = (1.0, -2.0, 3.0, -4.0, 5.0, -6.0)
    assert round_trip(settings, {'thrusters': wrench})['thrusters'] == {0: wrench}


def commanded(settings: Settings, name: str = 'thrusters') -> list[tuple[float, ...]]:
    """Return what an input says of thrust ahead and astern."""
    profile = {'surge': (Steps((50.0, -50.0), 2.0),)}
    return [value for _, input, value in simulate(settings, 8.0, 1, profile) if input == name]


@pytest.mark.parametrize('topic', ['/direction', '/thrust'])
def test_magnitudes_and_their_directions_are_those_of_signed_commands(topic: str) -> None:
    thrusters = replace(settings_of().thrusters, offset=0.25)
    apart = settings_of(thrusters=thrusters, sign=InputSettings(
        topic, 'std_msgs/msg/Float64MultiArray', 'data'))
    told, signs = commanded(apart), commanded(apart, 'sign')
    assert min(map(min, told)) >= 0.25
    assert {sign for one in signs for sign in one} == {-1.0, 1.0}
    for one, magnitudes, directions in zip(
            commanded(settings_of(thrusters=thrusters)), told, signs, strict=True):
        assert one == pytest.approx(
            [0.25 + s * (u - 0.25) for u, s in zip(magnitudes, directions)])


def test_thrusters_that_push_one_way_only_get_no_command_for_the_other() -> None:
    settings = settings_of(thrusters=replace(settings_of().thrusters, reverse=0.0))
    assert {round(one[0], 9) for one in commanded(settings)} == {0.0, 25.0}


def test_whole_numbers_are_rounded() -> None:
    settings = settings_of()
    settings = replace(settings, thrusters=replace(
        settings.thrusters, type='std_msgs/msg/UInt16MultiArray'))
    assert round_trip(settings, {'thrusters': (1499.6, 1500.0, 1899.5001)})['thrusters'] == {
        0: (1500.0, 1500.0, 1900.0)}


def test_inputs_of_one_topic_share_its_messages(tmp_path: Path) -> None:
    odometry = InputSettings('/odom', 'nav_msgs/msg/Odometry', 'pose.pose')
    settings = settings_of(
        position=odometry, attitude=odometry, velocity=InputSettings(),
        reference=replace(odometry, field='twist.twist'))
    path = tmp_path / 'out.mcap'
    assert simulate_log(settings, path, 2.0, 1) == 41 + 20  # thrusters 20 Hz, odometry 10 Hz
    values = {name: VALUES[name] for name in ('position', 'attitude', 'reference')}
    back = round_trip(settings, values)
    assert back['position'][0] == pytest.approx(VALUES['position'])
    assert back['reference'][0] == pytest.approx(VALUES['reference'])
    assert abs(back['attitude'][0][3]) == pytest.approx(abs(ATTITUDE[3]))


def test_a_type_that_ros_does_not_come_with_is_refused() -> None:
    settings = settings_of(position=InputSettings('/p', 'my_msgs/msg/Fix', 'fix'))
    with pytest.raises(SimulationError, match=r'position.type: got my_msgs/msg/Fix, takes'):
        SensorMessages(settings)


def test_a_number_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    settings = settings_of()
    settings = replace(settings, thrusters=replace(
        settings.thrusters, type='std_msgs/msg/UInt8MultiArray', offset=500.0))
    with pytest.raises(SimulationError, match=r'/thrust: a value does not fit'):
        simulate_log(settings, tmp_path / 'out.mcap', 2.0, 1)


def test_the_same_seed_gives_the_same_file(repository: Path, tmp_path: Path) -> None:
    config = repository / 'config' / 'jhurov.yaml'
    logs = [tmp_path / f'{i}.mcap' for i in range(3)]
    for log, seed in zip(logs, ('5', '5', '6')):
        assert main(['simulate', '--params-file', str(config), '--output', str(log),
                     '--duration', '5', '--seed', seed]) == 0
    assert logs[0].read_bytes() == logs[1].read_bytes()
    assert logs[0].read_bytes() != logs[2].read_bytes()


def test_the_log_tells_the_truth(repository: Path, tmp_path: Path) -> None:
    log = tmp_path / 'out.mcap'
    assert main(['simulate', '--params-file', str(repository / 'config' / 'jhurov.yaml'),
                 '--output', str(log), '--duration', '2', '--profile', 'surge=99@0.1']) == 0
    with log.open('rb') as file:
        reader = make_reader(file)
        (record,) = reader.iter_metadata()
        times = [message.log_time for _, _, message in reader.iter_messages()]
    assert record.name == 'rovid_truth'
    assert float(record.metadata['surge.mass']) == 290.0
    assert record.metadata['profile'].startswith('surge=99@0.1,heave=350@0.03846+150@0.09091,')
    assert float(record.metadata['surge.alpha']) == 1.0 / 290.0
    assert float(record.metadata['heave.delta']) == -10.0 / 2400.0
    assert times[0] == EPOCH
    assert times == sorted(times)


def test_the_log_tells_the_current(repository: Path, tmp_path: Path) -> None:
    text = (repository / 'config' / 'jhurov.yaml').read_text()
    config, log = tmp_path / 'rov.yaml', tmp_path / 'out.mcap'
    config.write_text(text.replace('current: [0.0, 0.0]', 'current: [0.2, -0.1]')
                      .replace('current_turn: 0.0', 'current_turn: 600.0'))
    assert main(['simulate', '--params-file', str(config), '--output', str(log),
                 '--duration', '2']) == 0
    with log.open('rb') as file:
        (record,) = make_reader(file).iter_metadata()
    assert {name: float(text) for name, text in record.metadata.items()
            if name.startswith('current.')} == {
        'current.x': 0.2, 'current.y': -0.1, 'current.turn': 600.0, 'current.tide': 0.0}
