"""Static transforms of tf2 in place of lever arms and mountings in the YAML."""

from collections.abc import Sequence
import json
import math
from pathlib import Path
from typing import Any

from hypothesis import given, strategies as st
import pytest
from rovid_core.velocity.attitude_history import from_angles, rotate, rotation_between
from rovid_ros.commands.main import main
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.log import RECORD
from rovid_ros.logs.static_frames import FOUND, StaticFrames, TOPIC, TYPE, wanted_frames
from rovid_ros.logs.writer import LogWriter
from rovid_ros.messages.types import build, standard_types

Transform = tuple[str, str, Sequence[float], Sequence[float]]  # parent, child, xyz, rpy

LEVER_ARM, MOUNTING = (-0.5, 0.25, 0.75), (0.25, -0.5, 2.0)
# a body that hangs on its footprint, as many do, and sensors on a bracket that is turned
BODY: Transform = ('base_footprint', 'base_link', (0.0, 0.0, 0.5), (0.0, 0.0, 0.75))
BRACKET: Transform = ('base_link', 'bracket', (0.5, -0.25, 0.125), (0.0, 0.0, 0.5 * math.pi))
# (-0.5, 0.25, 0.75) from the bracket's place, in axes that are turned by 90 degrees to port
FIX: Transform = ('bracket', 'usbl', (0.5, 1.0, 0.625), (0.0, 0.0, 0.0))
IMU: Transform = ('base_link', 'imu', (3.0, 4.0, 5.0), MOUNTING)


def fields(transforms: Sequence[Transform]) -> dict[str, Any]:
    """Return the fields of a TFMessage."""
    return {'transforms': [
        {'header': {'stamp': {'sec': 0, 'nanosec': 0}, 'frame_id': parent},
         'child_frame_id': child, 'transform': {
             'translation': dict(zip('xyz', xyz)),
             'rotation': dict(zip('xyzw', from_angles(*rpy)))}}
        for parent, child, xyz, rpy in transforms]}


def frames_of(*transforms: Transform) -> StaticFrames:
    """Return the tree of frames of messages with one transform each."""
    frames = StaticFrames()
    for transform in transforms:
        frames.add(build(standard_types(), TYPE, fields([transform])))
    return frames


@pytest.fixture(scope='module')
def log(config: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a log of a vehicle whose sensors are neither in the middle nor straight."""
    path = tmp_path_factory.mktemp('log') / 'log.mcap'
    assert main(['simulate', '--params-file', str(config), *in_yaml(), '--output', str(path),
                 '--duration', '12']) == 0
    return path


@pytest.fixture
def static(log: Path, tmp_path: Path) -> Path:
    """Return a log of /tf_static alone."""
    return written(tmp_path / 'static.mcap', [BODY, BRACKET, FIX, IMU])


def written(path: Path, transforms: Sequence[Transform]) -> Path:
    with LogWriter(path) as writer:
        writer.write(TOPIC, TYPE, fields(transforms), 10**9)
    return path


def in_yaml() -> list[str]:
    return ['-p', f'position.lever_arm:={list(LEVER_ARM)}',
            '-p', f'attitude.mounting:={list(MOUNTING)}']


IN_TF = ['-p', 'position.sensor_frame:=usbl', '-p', 'attitude.sensor_frame:=imu']


def replayed(folder: Path, config: Path, *arguments: object) -> dict[str, Any]:
    """Return the degrees of freedom of a replay."""
    out = folder / 'out.json'
    assert main(['replay', '--params-file', str(config), *map(str, arguments),
                 '--json', str(out)]) == 0
    found: dict[str, Any] = json.loads(out.read_text())['dofs']
    return found


def test_a_replay_takes_lever_arm_and_mounting_from_tf_static(
        config: Path, log: Path, static: Path, tmp_path: Path) -> None:
    given_in_yaml = replayed(tmp_path, config, log, *in_yaml())
    looked_up = replayed(tmp_path, config, log, static, *IN_TF)
    without = replayed(tmp_path, config, log)
    for dof, expected in given_in_yaml.items():
        for name in ('mass', 'quadratic_drag', 'fit'):
            assert looked_up[dof][name] == pytest.approx(expected[name], rel=1e-6), (dof, name)
    assert without['surge']['mass'] != pytest.approx(given_in_yaml['surge']['mass'], rel=0.01)


def test_what_was_given_wins(config: Path, log: Path, tmp_path: Path) -> None:
    other = written(tmp_path / 'other.mcap', [
        ('base_link', 'usbl', (9.0, 9.0, 9.0), (0.0, 0.0, 0.0)),
        ('base_link', 'imu', (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))])
    assert replayed(tmp_path, config, log, other, *in_yaml(), *IN_TF) == replayed(
        tmp_path, config, log, *in_yaml())


def test_a_record_of_the_node_has_what_the_node_found(
        config: Path, log: Path, tmp_path: Path) -> None:
    noted = tmp_path / 'noted.mcap'
    with LogWriter(noted) as writer:
        writer.metadata(RECORD, {FOUND: json.dumps({
            'position.lever_arm': LEVER_ARM, 'attitude.mounting': MOUNTING})})
        writer.write('/other', 'std_msgs/msg/String', {'data': ''}, 10**9)
    assert replayed(tmp_path, config, log, noted, *IN_TF) == replayed(
        tmp_path, config, log, *in_yaml())


def test_a_log_without_the_frame_is_refused(
        config: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    static = written(tmp_path / 'static.mcap', [BODY, ('odom', 'usbl', (1, 2, 3), (0, 0, 0))])
    assert main(['replay', str(log), str(static), '--params-file', str(config),
                 '-p', 'position.sensor_frame:=usbl']) == 1
    error = capsys.readouterr().err
    assert 'position.sensor_frame: ' in error
    assert ('no static transform from base_link (base_frame) to usbl; /tf_static has '
            'base_footprint, base_link, odom, usbl; publish it, or give position.lever_arm'
            ) in error
    assert error.count('\n') == 1


def test_check_tells_what_it_found(config: Path, log: Path, static: Path,
                                   capsys: pytest.CaptureFixture[str]) -> None:
    main(['check', str(config), str(log), str(static), *IN_TF])
    out = capsys.readouterr().out
    assert 'position.lever_arm' in out
    assert '-0.5000, 0.2500, 0.7500 from /tf_static' in out
    main(['check', str(config), str(log), *IN_TF])
    assert 'no static transform from base_link' in capsys.readouterr().out


def test_frames_hang_together_over_a_parent() -> None:
    wanted = {'position.lever_arm': 'usbl', 'attitude.mounting': 'imu'}
    frames = frames_of(FIX, IMU)
    assert not frames.knows(wanted.values(), 'base_link')
    frames = frames_of(FIX, IMU, BRACKET, BODY)
    assert frames.knows(wanted.values(), 'base_link')
    values = frames.values(wanted, 'base_link', '')
    assert values['position.lever_arm'] == pytest.approx(LEVER_ARM)
    assert values['attitude.mounting'] == pytest.approx(MOUNTING)
    # seen from another branch of the tree: the body of a twin that stands beside, turned
    twin = frames_of(FIX, BRACKET, BODY, ('base_footprint', 'twin', (0, 0, 0), (0, 0, 0.75)))
    x, y, z = rotate(from_angles(0, 0, -0.75), (0.0, 0.0, 0.5))
    assert twin.values({'position.lever_arm': 'usbl'}, 'twin', '')['position.lever_arm'] == (
        pytest.approx((LEVER_ARM[0] + x, LEVER_ARM[1] + y, LEVER_ARM[2] + z)))


@pytest.mark.parametrize('gyro', ['', '/gyro'])
def test_a_dvl_with_a_gyro_takes_both_from_its_frame(gyro: str, config: Path) -> None:
    settings = settings_from({
        **load(config), 'velocity.topic': '/dvl', 'velocity.sensor_frame': 'usbl',
        'angular_velocity.topic': gyro})
    wanted = wanted_frames(settings)
    assert sorted(wanted) == [*(['velocity.lever_arm'] if gyro else []), 'velocity.mounting']
    values = frames_of(FIX, BRACKET).values(wanted, 'base_link', '')
    assert values['velocity.mounting'] == pytest.approx((0.0, 0.0, 0.5 * math.pi))
    if gyro:
        assert values['velocity.lever_arm'] == pytest.approx(LEVER_ARM)


def test_frames_in_a_circle_are_none() -> None:
    circle = frames_of(('a', 'b', (1, 0, 0), (0, 0, 0)), ('b', 'a', (1, 0, 0), (0, 0, 0)))
    assert not circle.knows(['b'], 'a')
    assert not circle.knows(['a'], 'a')


def test_a_rotation_of_length_zero_is_left_out() -> None:
    frames, message = StaticFrames(), fields([FIX])
    message['transforms'][0]['transform']['rotation'] = dict.fromkeys('xyzw', 0.0)
    frames.add(build(standard_types(), TYPE, message))
    assert not frames.knows(['usbl'], 'bracket')


def test_frames_of_ros_1_begin_with_a_slash() -> None:
    frames = frames_of(('/base_link', '/usbl', LEVER_ARM, (0, 0, 0)))
    assert frames.values({'position.lever_arm': 'usbl'}, 'base_link', '') == {
        'position.lever_arm': list(LEVER_ARM)}


ANGLES = st.floats(-math.pi, math.pi) | st.sampled_from([0.5 * math.pi, -0.5 * math.pi])


@given(roll=ANGLES, pitch=ANGLES, yaw=ANGLES)
def test_angles_say_the_same_turn(roll: float, pitch: float, yaw: float) -> None:
    frames = frames_of(('body', 'sensor', (0, 0, 0), (roll, pitch, yaw)))
    angles = frames.values({'velocity.mounting': 'sensor'}, 'body', '')['velocity.mounting']
    left = rotation_between(from_angles(*angles), from_angles(roll, pitch, yaw))
    assert left == pytest.approx((0.0, 0.0, 0.0), abs=3e-6)  # near straight up, of 1e-12 of a sine
