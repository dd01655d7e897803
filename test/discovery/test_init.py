"""``rovid init``: the configuration of a log that nobody has described."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
import math
from pathlib import Path
import re
from typing import Any

from mcap.writer import Writer
import numpy as np
import pytest
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from rovid_core.model.dofs import DOFS
from rovid_core.settings.run import Settings
from rovid_core.velocity.attitude_history import from_yaw, product
from rovid_ros.commands.examples import example_truth
from rovid_ros.commands.init import discover
from rovid_ros.commands.main import main
from rovid_ros.commands.simulate import simulate_log
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.discovery.ardupilot import allocation, dataflash_candidates, FRAMES, motors
from rovid_ros.discovery.candidates import candidates
from rovid_ros.discovery.configuration import configuration
from rovid_ros.discovery.decisions import decide, Discovery
from rovid_ros.discovery.motion import motion
from rovid_ros.discovery.signals import read_signals, Signal
from rovid_ros.discovery.thrusters import explained_by, with_delay
from rovid_ros.logs.log import Log
from rovid_ros.logs.writer import LogWriter
from rovid_ros.messages.simulated_messages import FRD_TO_FLU, NED_TO_ENU

from test.support.dataflash_logs import dive, heavy, PARAMETERS
from test.support.rewritten_logs import Message, rewritten
from test.support.six_axes import Dive, dive as six_axes_dive

pytestmark = pytest.mark.long


@pytest.fixture
def initialised(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[[Path], Settings]:
    """Return what writes a configuration, replays the log with it, and returns it."""
    def run(log: Path) -> Settings:
        yaml = tmp_path / 'init.yaml'
        assert main(['init', str(log), '--output', str(yaml)]) == 0, capsys.readouterr().err
        said = capsys.readouterr().out
        assert f'written   {yaml}' in said
        assert f'rovid replay {log} --params-file {yaml}' in said
        assert main(['replay', str(log), '--params-file', str(yaml), '--duration', '8']) == 0
        return settings_from(load(yaml))
    return run


def inputs(settings: Settings) -> dict[str, str]:
    """Return topic and field of each input."""
    found = {name: f'{settings.input(name).topic} {settings.input(name).field}'
             for name in settings.used_inputs() if name != 'thrusters'}
    thrusters = settings.thrusters
    return {**found, 'thrusters': f'{thrusters.topics[0]} {thrusters.field}'}


@pytest.fixture(scope='module')
def logs(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return 45 s of each shipped vehicle that can be simulated."""
    folder = tmp_path_factory.mktemp('init')
    found = {}
    for name in ('bluerov2_ardusub', 'odometry_wrench', 'jhurov'):
        found[name] = folder / f'{name}.mcap'
        settings = settings_from(load(repository / 'config' / f'{name}.yaml'))
        simulate_log(settings, found[name], 45.0, 1)
    return found


# --- simulated vehicles -------------------------------------------------------------------


def test_an_odometry_and_a_wrench(logs: dict[str, Path],
                                  initialised: Callable[[Path], Settings]) -> None:
    found = initialised(logs['odometry_wrench'])
    assert inputs(found) == {
        'position': '/odometry pose.pose.position', 'attitude': '/odometry pose.pose.orientation',
        'thrusters': '/wrench wrench'}
    assert found.dofs == ('surge', 'sway', 'heave', 'yaw')
    assert found.yaw_offset == 0.0
    for dof, mass in (('surge', 90.0), ('sway', 110.0), ('heave', 120.0), ('yaw', 7.0)):
        assert found.dof[dof].mass == pytest.approx(mass, rel=0.2), dof


def test_a_bluerov2_with_mavros_is_recognised(logs: dict[str, Path], repository: Path,
                                              initialised: Callable[[Path], Settings]) -> None:
    found = initialised(logs['bluerov2_ardusub'])
    assert inputs(found) == {
        'position': '/mavros/local_position/pose pose.position',
        'attitude': '/mavros/imu/data orientation', 'thrusters': '/mavros/rc/out channels'}
    known = settings_from(load(repository / 'config' / 'bluerov2_ardusub.yaml')).thrusters
    for dof in found.dofs:
        row = DOFS.index(dof)
        assert found.thrusters.allocation[row] == known.allocation[row]
    assert (found.thrusters.offset, found.thrusters.scale) == (1500.0, 0.0025)


@pytest.mark.parametrize('turned, said', [
    ((3,), 'with motor 3 reversed, as in ArduSub'),
    ((1, 4), 'with motors 1, 4 reversed, as in ArduSub'),
    ((5, 8), 'with motors 5, 8 reversed, as in ArduSub'),  # surge and sway are right as they are
    (tuple(range(1, 9)), 'with motors 1, 2, 3, 4, 5, 6, 7, 8 reversed, as in ArduSub')])
def test_a_frame_with_reversed_motors_is_recognised(
        turned: tuple[int, ...], said: str, logs: dict[str, Path]) -> None:
    with Log([logs['bluerov2_ardusub']]) as opened:
        signals = read_signals(opened, 0.0, None)
    other = []
    for one in signals:
        if one.topic == '/mavros/rc/out' and one.path == 'channels':
            values = one.values.copy()
            for motor in turned:
                values[:, motor - 1] = 3000.0 - values[:, motor - 1]
            one = replace(one, values=values)
        other.append(one)
    made, as_sent = [decide(candidates(one), one, lambda name, found: found[0])
                     for one in (other, signals)]
    assert made.thrusters.chain.gain == tuple(
        [-1.0 if k in turned else 1.0 for k in range(1, 9)])
    assert made.thrusters.rows == as_sent.thrusters.rows
    assert f'frame vectored_6dof {said}' in ' '.join(made.guesses)
    for dof, known in as_sent.dofs.items():  # what a motor has backwards it has forwards now
        assert made.dofs[dof].mass == pytest.approx(known.mass, rel=0.2), dof


def test_an_allocation_is_estimated(logs: dict[str, Path], repository: Path,
                                    initialised: Callable[[Path], Settings]) -> None:
    found = initialised(logs['jhurov'])
    assert inputs(found) == {
        'position': '/sharps/position point', 'depth': '/depth/pressure fluid_pressure',
        'attitude': '/imu/data orientation', 'thrusters': '/thrusters/current effort'}
    known = settings_from(load(repository / 'config' / 'jhurov.yaml'))
    assert found.thrusters.names == known.thrusters.names
    assert found.thrusters.model == 'linear'
    assert not found.thrusters.newtons
    assert found.depth_scale == pytest.approx(known.depth_scale, rel=1e-3)
    assert_rows(found, known)


def test_speeds_of_propellers_are_told_from_forces(
        repository: Path, tmp_path: Path, initialised: Callable[[Path], Settings]) -> None:
    """Here they are the efforts of joints, as a driver of motors publishes them."""
    known = settings_from(load(repository / 'config' / 'jhurov.yaml'))
    simulate_log(replace(known, thrusters=replace(
        known.thrusters, topics=('/joint_states',), model='quadratic',
        names=('thruster_left', 'thruster_right', 'thruster_top'))),
        tmp_path / 'dive.mcap', 45.0, 1)
    found = initialised(tmp_path / 'dive.mcap')
    assert found.thrusters.topics == ('/joint_states',)
    assert found.thrusters.model == 'quadratic'
    assert_rows(found, known)
    said = (tmp_path / 'init.yaml').read_text()
    assert 'thrusters.model quadratic: as speeds of propellers' in said
    assert 'sway: left out, for the commands explain next to nothing' in said


@pytest.mark.parametrize(('topic', 'model'), [
    ('/motor/rpm', 'quadratic'), ('/azipull/rpm', 'quadratic'), ('/motor/cmd', 'linear')])
def test_a_name_decides_what_the_motion_leaves_open(topic: str, model: str) -> None:
    """Here the force is neither that of a speed nor the command: it goes with the power of 1.4."""
    draw, step, count = np.random.default_rng(1), 0.1, 1500
    commands, velocity, velocities = np.repeat(draw.uniform(0.0, 1.0, count // 50), 50), 0.0, []
    for command in commands:
        velocity += step * (command**1.4 - velocity * abs(velocity)) / 5.0
        velocities.append(velocity)
    times, zero = step * np.arange(count), np.zeros(count)
    signals = [
        Signal('/dvl', 'geometry_msgs/msg/TwistStamped', 'twist.linear', 'vector', times,
               np.column_stack([velocities, zero, zero]), rate=10.0),
        Signal(topic, 'std_msgs/msg/Float64', 'data', 'number', times,
               300.0 * commands[:, np.newaxis], rate=10.0)]
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    assert made.thrusters.chain.model == model


def assert_rows(found: Settings, known: Settings) -> None:
    """Compare what each command does."""
    for dof in ('surge', 'heave', 'yaw'):
        row = DOFS.index(dof)
        forces = [a * k for a, k in zip(known.thrusters.allocation[row], known.thrusters.gain)]
        largest = max(map(abs, forces))
        assert found.thrusters.allocation[row] == pytest.approx(
            [force / largest for force in forces], abs=0.15), dof


@pytest.mark.parametrize('topics', [
    tuple([f'/model/rov/joint/thruster{k}_joint/cmd_thrust' for k in (9, 10, 11)]),
    ('/left_thrust_cmd', '/right_thrust_cmd', '/vertical_thrust_cmd')])
def test_thrusters_may_have_a_topic_each(topics: tuple[str, ...], repository: Path, tmp_path: Path,
                                         initialised: Callable[[Path], Settings],
                                         capsys: pytest.CaptureFixture[str]) -> None:
    known = settings_from(load(repository / 'config' / 'jhurov.yaml'))
    log, other = tmp_path / 'dive.mcap', tmp_path / 'other.mcap'
    settings = replace(known, thrusters=replace(
        known.thrusters, topics=topics, type='std_msgs/msg/Float64', field='data', names=(),
        stamp=''))
    simulate_log(settings, log, 45.0, 1)
    simulate_log(settings, other, 10.0, 2)
    discover([log, other])
    assert not capsys.readouterr().err  # neither lacks what the other has
    found = initialised(log)
    assert found.thrusters.topics == topics
    assert_rows(found, known)


@pytest.mark.parametrize('stamped', [False, True])
def test_a_simulators_stamps_and_the_recorders_time_are_two_clocks(
        stamped: bool, repository: Path, tmp_path: Path,
        initialised: Callable[[Path], Settings]) -> None:
    """Commands that are ``stamped``, too, have the simulator's time as all else."""
    known = settings_from(load(repository / 'config' / 'odometry_wrench.yaml'))
    log = tmp_path / 'dive.mcap'
    simulate_log(known, log, 45.0, 1)

    def recorded(message: Message) -> Message:
        topic, kind, fields, time = message
        if not stamped and topic in known.thrusters.topics:
            kind, fields = 'geometry_msgs/msg/Wrench', fields['wrench']
        return topic, kind, fields, time + 50_000_000 * 10**9

    found = initialised(rewritten(log, tmp_path / 'recorded.mcap', recorded))
    assert {found.position.stamp, found.attitude.stamp} == ({''} if stamped else {'receive'})
    for dof, mass in (('surge', 90.0), ('sway', 110.0), ('heave', 120.0)):
        assert found.dof[dof].mass == pytest.approx(mass, rel=0.2), dof


def test_of_two_vehicles_one_is_taken(repository: Path, tmp_path: Path,
                                      capsys: pytest.CaptureFixture[str]) -> None:
    """Also where the other one is measured more often."""
    known = settings_from(load(repository / 'config' / 'odometry_wrench.yaml'))
    log = tmp_path / 'both.mcap'
    messages: list[Message] = []

    def keep(name: str, message: Message) -> None:
        topic, kind, fields, time = message
        if name == 'one' and topic == '/odometry' and time // 10**8 % 2:
            return
        messages.append((f'/fleet/{name}{topic}', kind, fields, time))

    for seed, name in enumerate(('one', 'two')):
        simulate_log(known, tmp_path / 'dive.mcap', 45.0, seed)
        rewritten(tmp_path / 'dive.mcap', tmp_path / 'nothing.mcap', partial(keep, name))
    with LogWriter(log) as writer:
        for message in sorted(messages, key=lambda one: one[3]):
            writer.write(*message, message[3])
    for given, name in (([], 'one'), (['--namespace', 'fleet/two'], 'two')):
        yaml = tmp_path / f'{name}.yaml'
        assert main(['init', str(log), '--output', str(yaml), *given]) == 0
        found = settings_from(load(yaml))
        topics = (found.position.topic, found.attitude.topic, *found.thrusters.topics)
        assert {topic.split('/')[2] for topic in topics} == {name}
        assert ('another vehicle' in capsys.readouterr().out) == (not given)
    assert main(['init', str(log), '--output', str(yaml), '--namespace', 'fleet/three']) == 1
    assert '--namespace: no numbers below /fleet/three/' in capsys.readouterr().err


def test_poses_that_are_only_transforms_are_said_not_to_be_read(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / 'dive.mcap'
    with LogWriter(log) as writer:
        for k in range(50):
            writer.write('/tf', 'tf2_msgs/msg/TFMessage', {'transforms': []}, k * 10**8)
            writer.write('/thruster1/cmd', 'std_msgs/msg/Float64', {'data': math.sin(k)},
                         k * 10**8)
    assert main(['init', str(log), '--output', str(tmp_path / 'rov.yaml')]) == 1
    assert 'transforms (/tf) are not read' in capsys.readouterr().err


def test_what_is_measured_of_a_motor_is_no_command() -> None:
    times = np.arange(0.0, 30.0, 0.2)
    for topic, is_one in (('/motor1/cmd', True), ('/motor1/temperature', False),
                          ('/thruster1_joint/cmd_vel', True), ('/thruster1/vel', False)):
        signal = Signal(topic, 'std_msgs/msg/Float64', 'data', 'number', times,
                        np.sin(times)[:, np.newaxis], rate=5.0)
        assert ('thrusters' in candidates([signal])) is is_one


@pytest.mark.parametrize('topic', ['/rov/thrusts', '/rov/thruster_forces', '/rov/rpm'])
def test_an_array_of_thrusters_is_known_by_its_topic(topic: str) -> None:
    times = np.arange(0.0, 30.0, 0.2)
    assert 'thrusters' in candidates([Signal(
        topic, 'std_msgs/msg/Float64MultiArray', 'data', 'array', times,
        np.column_stack([np.sin(times), np.cos(times)]), rate=5.0)])


@pytest.mark.parametrize(('topic', 'path', 'names', 'is_one'), [
    ('/thrusters/joint_states', 'effort', ('port_main', 'fore_lateral'), True),
    ('/thruster_states', 'velocity', ('port_main', 'fore_lateral'), True),
    ('/thruster_states', 'temperatures', ('port_main', 'fore_lateral'), False),
    ('/joint_states', 'effort', ('port_main', 'fore_lateral'), False),
    ('/propulsion/state', 'velocity', ('thruster_0', 'thruster_1'), True),
    ('/propulsion/state', 'velocity', ('port_main', 'fore_lateral'), False)])
def test_joints_may_be_thrusters_by_their_topic_or_names(
        topic: str, path: str, names: tuple[str, ...], is_one: bool) -> None:
    times = np.arange(0.0, 30.0, 0.2)
    values = np.column_stack([np.sin(times), np.cos(times)])
    found = candidates([Signal(topic, 'sensor_msgs/msg/JointState', path, 'array', times, values,
                               names, rate=5.0)])
    assert ('thrusters' in found) is is_one


def test_a_propeller_beside_a_rudder_is_a_thruster() -> None:
    times = np.arange(0.0, 30.0, 0.2)
    values = np.column_stack([np.sin(times), np.cos(times)])
    assert 'thrusters' in candidates([Signal(
        '/actuators/joint_states', 'sensor_msgs/msg/JointState', 'velocity', 'array', times,
        values, ('prop', 'rudder'), rate=5.0)])


@pytest.mark.parametrize('frames', ['enu', 'ned'])
def test_a_gps_will_do(frames: str, repository: Path, tmp_path: Path,
                       initialised: Callable[[Path], Settings]) -> None:
    settings = settings_from(load(repository / 'config' / 'odometry_wrench.yaml'))
    kind, log = 'sensor_msgs/msg/NavSatFix', tmp_path / 'dive.mcap'
    simulate_log(replace(settings, frames=frames, position=replace(
        settings.position, topic='/fix', type=kind, field='')), log, 45.0, 1)
    found = initialised(log)  # the attitude has to agree with how the fixes move
    assert found.frames == frames
    assert inputs(found)['position'] == '/fix '
    for dof, mass in (('surge', 90.0), ('sway', 110.0), ('heave', 120.0)):
        assert found.dof[dof].mass == pytest.approx(mass, rel=0.2), dof


def test_what_is_no_fix_is_left_out(tmp_path: Path) -> None:
    log = tmp_path / 'fixes.mcap'
    with LogWriter(log) as writer:
        for k, (status, latitude) in enumerate([(-1, 0.0), *[(0, 39.3)] * 4, (-1, 50.0)]):
            writer.write('/fix', 'sensor_msgs/msg/NavSatFix', {
                'status': {'status': status}, 'latitude': latitude}, 10**9 * (k + 1))
    with Log([log]) as opened:
        [fixes] = [one for one in read_signals(opened, 0.0, None) if one.shape == 'geographic']
    assert fixes.values.shape == (4, 3)
    assert not np.ptp(fixes.values)


@pytest.mark.parametrize(('topic', 'path', 'shape'), [
    ('/gps/fix', '', 'geographic'), ('/usbl/fix', 'point', 'vector')])
def test_a_dvl_goes_before_a_gps_and_before_slow_fixes(
        topic: str, path: str, shape: str, repository: Path, tmp_path: Path) -> None:
    """What a GPS says is seldom right under water; its velocity is never that of the body."""
    settings = settings_from(load(repository / 'config' / 'odometry_wrench.yaml'))
    log = tmp_path / 'dvl.mcap'
    velocity = replace(settings.velocity, topic='/dvl')
    simulate_log(replace(settings, velocity=velocity), log, 30.0, 1)
    with Log([log]) as opened:
        signals = [signal for signal in read_signals(opened, 0.0, None)
                   if signal.path != 'pose.pose.position']
    times = np.arange(0.0, 30.0, 0.2)
    places = np.column_stack([times, np.sin(times), 0.0 * times])
    signals += [Signal(topic, 'a/msg/Fix', path, shape, times, places, rate=1.0),
                Signal('/gps/vel', 'geometry_msgs/msg/TwistStamped', 'twist.linear', 'vector',
                       times, places, rate=100.0)]
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    assert made.inputs['velocity'].signal.topic == '/dvl'
    assert 'position' not in made.inputs
    assert f'{topic} {path}'.strip() + ' is not used' in ' '.join(made.guesses)


@pytest.mark.parametrize('offset', [math.pi / 2, -2.0, 3.0])
def test_a_heading_offset_shows(offset: float, logs: dict[str, Path], tmp_path: Path) -> None:
    turned = tmp_path / 'turned.mcap'
    with Log([logs['odometry_wrench']]) as log, LogWriter(turned) as writer:
        for message in log.messages(list(log.topics)):
            writer.write(message.topic, message.type, fields_of(message.data, -offset),
                         message.time)
    assert discover([turned]).yaw_offset == pytest.approx(offset, abs=0.1)


def fields_of(message: Any, yaw: float) -> dict[str, Any]:
    """Return an odometry with another heading, or a wrench as it is."""
    def vector(of: Any) -> dict[str, float]:
        return {'x': of.x, 'y': of.y, 'z': of.z}

    stamp = message.header.stamp
    header = {'stamp': {'sec': stamp.sec, 'nanosec': stamp.nanosec}}
    if hasattr(message, 'wrench'):
        return {'header': header, 'wrench': {
            'force': vector(message.wrench.force), 'torque': vector(message.wrench.torque)}}
    pose = message.pose.pose
    q = pose.orientation
    turned = product(from_yaw(yaw), (q.x, q.y, q.z, q.w))
    return {'header': header, 'pose': {'pose': {
        'position': vector(pose.position), 'orientation': dict(zip('xyzw', turned))}}}


# --- logs of ArduSub ----------------------------------------------------------------------


def test_the_autopilots_parameters_tell_the_motors(
        tmp_path: Path, initialised: Callable[[Path], Settings]) -> None:
    settings = heavy(['surge', 'sway', 'heave', 'yaw'], ['depth', 'velocity'])
    outputs = (2, 3, 4, 5, 8, 9, 10, 11)
    parameters = {
        **PARAMETERS, **{f'SERVO{n}_FUNCTION': 0.0 for n in range(1, 9)},
        **{f'SERVO{output + 1}_FUNCTION': 33.0 + k for k, output in enumerate(outputs)},
        'MOT_2_DIRECTION': -1.0, 'MOT_7_DIRECTION': -1.0}
    path = tmp_path / 'DIVE.BIN'
    path.write_bytes(dive(settings, 40.0, parameters=parameters, outputs=outputs,
                          reversed_motors=(2, 7)).data)
    found = initialised(path)
    assert inputs(found) == {
        'depth': '/CTUN BAlt', 'attitude': '/ATT Roll, Pitch, Yaw',
        'velocity': '/VISO VelX, VelY, VelZ',
        'thrusters': '/RCOU C3, C4, C5, C6, C9, C10, C11, C12'}
    assert found.thrusters.gain == (1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0, 1.0)
    assert (found.frames, found.heading_unit) == ('ned', 'deg')
    for dof in found.dofs:
        assert found.dof[dof].mass == pytest.approx(
            settings.simulation.dofs[dof].mass, rel=0.25), dof


def test_every_log_of_ardusub_gives_heave_and_yaw(
        tmp_path: Path, initialised: Callable[[Path], Settings]) -> None:
    settings = heavy(['heave', 'yaw'])
    path = tmp_path / 'DIVE.BIN'
    path.write_bytes(dive(settings, 30.0).data)
    assert initialised(path).dofs == ('heave', 'yaw')
    unknown = '\n'.join(discover([path]).unknown)
    assert 'surge and sway: no DVL (VISO), external position (VISP) or GPS is in' in unknown
    assert 'the battery had 15.2 V' in unknown


def test_a_position_from_outside_goes_before_a_gps() -> None:
    times = np.arange(0.0, 30.0, 0.1)
    place = np.column_stack([np.sin(times), times, np.cos(times)])
    found = dataflash_candidates([
        Signal(f'/{kind}', f'ardupilot/msg/{kind}', path, 'array', times, place, rate=10.0)
        for kind, path in (('GPS', 'North, East, Down'), ('VISP', 'PX, PY, PZ'))])
    assert [one.signal.topic for one in found['position']] == ['/VISP', '/GPS']


@pytest.mark.parametrize('number', FRAMES)
def test_a_frame_drives_what_its_motors_can(number: int) -> None:
    frame = FRAMES[number]
    rows = allocation(frame)
    for dof in ('surge', 'heave', 'yaw'):
        assert any(rows[dof]), dof
    for k, factors in enumerate(frame.factors):
        length = math.hypot(rows['surge'][k], rows['sway'][k], rows['heave'][k])
        assert length == pytest.approx(1.0, abs=1e-3) if any(factors[3:]) else length == 0.0


def test_a_frame_that_nobody_knows_has_no_motors() -> None:
    assert motors({'FRAME_CONFIG': '7'}) is None
    assert motors({}) is None


# --- recorded logs ------------------------------------------------------------------------


@pytest.mark.parametrize(('log', 'dofs', 'expected'), [
    ('bluerov2_tank/short_all_axes.mcap', ('surge', 'sway', 'heave', 'yaw'), {
        'position': '/mocap/pose pose.position', 'attitude': '/mocap/pose pose.orientation',
        'thrusters': '/rc/command axes'}),
    ('bluerov_pool/yaw_2.bag', ('yaw',), {
        'depth': '/rovio/water_pressure/data data',
        'angular_velocity': '/rovio/imu/data data[1:4]',
        'thrusters': '/rovio/thrusters data[2:4]'}),
    ('subjugator/forward4.bag', ('surge', 'sway', 'heave', 'yaw'), {
        'position': '/odom pose.pose.position', 'attitude': '/odom pose.pose.orientation',
        'thrusters': '/wrench wrench'}),
    ('blueboat/bb235.mcap', ('surge', 'yaw'), {
        'position': '/gps/point point', 'attitude': '/attitude quaternion',
        'thrusters': '/forces axes'}),
])
def test_the_topics_of_recorded_logs(log: str, dofs: tuple[str, ...], expected: dict[str, str],
                                     data: Path) -> None:
    made = discover([data / log])
    assert {name: one.signal.place for name, one in made.inputs.items()} == expected
    assert tuple(made.dofs) == dofs


@pytest.mark.parametrize('log', ['backward4', 'left2', 'right3'])
def test_one_axis_that_is_driven_is_no_heading_offset(log: str, data: Path) -> None:
    assert discover([data / 'subjugator' / f'{log}.bag']).yaw_offset == 0.0


def test_a_vehicle_that_lies_aside_has_the_sizes_that_check_sees(
        data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, yaml = data / 'bluerov2_tank' / 'short_all_axes.mcap', tmp_path / 'aside.yaml'
    assert main(['init', str(log), '--output', str(yaml)]) == 0
    assert main(['check', str(yaml), str(log)]) == 0
    assert 'typical sizes' not in capsys.readouterr().out


def test_thrusters_that_do_nothing_are_left_out(
        data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, yaml = data / 'bluerov_pool' / 'yaw_2.bag', tmp_path / 'rov.yaml'
    assert main(['init', str(log), '--output', str(yaml)]) == 0
    assert re.search(r'thrusters: left out, .*: number 1, number 2, of 4 in all$',
                     capsys.readouterr().out, re.M)
    assert main(['check', str(yaml)]) == 0
    assert 'WARNING' not in capsys.readouterr().out


# --- vehicles whose axes move together ----------------------------------------------------


def test_the_rough_model_counts_with_couplings_and_fixes_in_time_are_not_late(
        tmp_path: Path) -> None:
    made = discover([example(tmp_path, 'auv', 120, 3)])
    assert 'latency' not in configuration(made, 'dive.mcap')
    assert not any('how late the fixes are stamped' in one for one in made.unknown)
    assert made.dofs['surge'].couplings == ('vr',)
    assert 'uv' in made.dofs['yaw'].couplings
    # without couplings they come out 1.7 to 4 times as large
    truth = example_truth('auv').simulation.dofs
    for dof, known in made.dofs.items():
        assert 0.5 < known.mass / truth[dof].mass < 1.6, dof


def example(folder: Path, name: str, seconds: int, seed: int) -> Path:
    """Return a log of an example."""
    log = folder / 'dive.mcap'
    assert main(['simulate', '--example', name, '--duration', str(seconds), '--seed', str(seed),
                 '--output', str(log)]) == 0
    return log


@pytest.mark.parametrize('name, seconds, late', [('lbl_rov', 120, 1.5), ('bluerov2', 60, None)])
def test_fixes_that_are_stamped_late_show(
        name: str, seconds: int, late: float | None, tmp_path: Path) -> None:
    made = discover([example(tmp_path, name, seconds, 5)])
    # in steps of 0.25 s, and roughly
    assert made.inputs['position'].keys.get('latency') == (late and pytest.approx(late, abs=0.3))
    untold = [one for one in made.unknown if 'how late the fixes are stamped' in one]
    assert len(untold) == (1 if late else 0)
    written = configuration(made, 'dive.mcap')
    if late:
        assert 'Measure it: masses may be wrong' in untold[0]
        assert min(made.latencies) <= late <= max(made.latencies)
        assert re.search(r'latency: .* # \[s\] a guess, .* explains this log alike: measure it',
                         written)
    else:
        assert 'latency' not in written


def test_fixes_that_are_noisy_are_not_late(noisy: Path) -> None:
    """Least squares take half a second and less drag for noise in the velocity."""
    assert 'latency' not in discover([noisy]).inputs['position'].keys


@pytest.mark.parametrize('seed', [0, 1, 2])
def test_yaw_that_hardly_moves_does_not_make_fixes_late(seed: int) -> None:
    """The thrust of surge and sway lags by 0.3 s, which yaw, the only DOF without fixes, lacks."""
    draw = np.random.default_rng(seed)
    step, count = 0.05, 4000

    def driven(size: float, lag: float) -> tuple[np.ndarray, np.ndarray]:
        force = np.repeat(draw.choice([-1.0, 0.0, 1.0], count // 50), 50) * size
        thrust, velocity, velocities = 0.0, 0.0, []
        for told in force:
            thrust += (told - thrust) * min(step / lag, 1.0)
            velocity += step * (thrust - velocity - velocity * abs(velocity))
            velocities.append(velocity)
        return force, np.array(velocities)

    (x, u), (y, v), (n, r) = driven(0.5, 0.3), driven(0.5, 0.3), driven(0.06, step)
    times, zero, yaw = step * np.arange(count), np.zeros(count), step * np.cumsum(r)
    way = step * np.cumsum((u + 1j * v) * np.exp(1j * yaw))
    half = 0.5 * (yaw + draw.normal(0.0, 0.01, count))
    fixes = np.column_stack([way.real, way.imag, zero])[::2]
    fixes += draw.normal(0.0, 0.002, fixes.shape)
    signals = [
        Signal('/pose', 'geometry_msgs/msg/PoseStamped', 'pose.position', 'vector', times[::2],
               fixes, rate=10.0),
        Signal('/imu', 'sensor_msgs/msg/Imu', 'orientation', 'quaternion', times,
               np.column_stack([zero, zero, np.sin(half), np.cos(half)]), rate=20.0),
        Signal('/wrench', 'geometry_msgs/msg/WrenchStamped', 'wrench', 'wrench', times,
               np.column_stack([x, y, zero, zero, zero, n]), rate=20.0)]
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    assert 'latency' not in made.inputs['position'].keys


@pytest.fixture(scope='module')
def noisy(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a log with ten fixes a second, each off by 2 cm, and a depth sensor."""
    settings = settings_from(load(repository / 'config' / 'lbl_slow.yaml'))
    log = tmp_path_factory.mktemp('noisy') / 'dive.mcap'
    simulate_log(replace(
        settings, position=replace(settings.position, latency=0.0),
        simulation=replace(settings.simulation, position_rate=10.0, position_noise=0.02)),
        log, 100.0, 1)
    return log


def turns(late: float = 0.0, sign: float = 1.0) -> list[Signal]:
    """Return heading and wrench, where ``sign`` is 1 of a controller that turns to and fro."""
    draw, step, count = np.random.default_rng(3), 0.01, 6000
    asked = np.repeat(draw.normal(0.0, 0.8, count // 400), 400) if sign > 0.0 else np.zeros(count)
    open_loop = np.repeat(draw.choice([-1.0, 0.0, 1.0], count // 200), 200)
    yaw, rate, angles, moments = 0.0, 0.0, [], []
    for wanted, moment in zip(asked, open_loop):
        if sign > 0.0:
            moment = np.clip(40.0 * (wanted - yaw) - 2.0 * rate, -4.0, 4.0)
        rate += step * (moment - rate - rate * abs(rate)) / 0.3
        yaw += step * rate
        angles.append(yaw)
        moments.append(sign * moment)
    half, times, zero = 0.5 * np.array(angles)[::5], step * np.arange(0, count, 5), np.zeros(1200)
    half += draw.normal(0.0, 0.0005, len(half))
    return [
        Signal('/imu', 'sensor_msgs/msg/Imu', 'orientation', 'quaternion', times,
               np.column_stack([zero, zero, np.sin(half), np.cos(half)]), rate=20.0),
        Signal('/wrench', 'geometry_msgs/msg/WrenchStamped', 'wrench', 'wrench', times + late,
               np.column_stack([zero] * 5 + [np.array(moments)[::5]]), rate=20.0)]


@pytest.mark.parametrize(('late', 'sign', 'accused'), [
    (0.0, 1.0, False), (0.15, 1.0, False), (0.0, -1.0, True)])
def test_a_controller_whose_commands_are_stamped_late_pushes_along(
        late: float, sign: float, accused: bool) -> None:
    """What it brakes seems to go against the thrust a moment later."""
    signals = turns(late, sign)
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    assert any('against its command' in one for one in made.guesses) is accused


@pytest.mark.parametrize(('logged', 'held', 'latency'), [
    (16, False, 0.4), (8, False, 0.2), (16, True, 0.0), (2, False, 0.0)])
def test_commands_that_are_samples_of_faster_ones_hold_from_halfway_since_the_last(
        logged: int, held: bool, latency: float) -> None:
    """The vehicle follows each command, or ``held`` ones that are all in the log."""
    draw, step, count = np.random.default_rng(4), 0.05, 4000
    times, zero = step * np.arange(count), np.zeros(count)
    moments = sum(np.sin(2.0 * np.pi * hz * times + draw.uniform(0.0, 6.0))
                  for hz in (0.05, 0.11, 0.17, 0.29))
    if held:
        moments = np.repeat(moments[::logged], logged)
    rate, rates = 0.0, []
    for moment in np.concatenate([[0.0, 0.0], moments[:-2]]):  # 0.1 s later
        rate += 0.5 * step * (moment - rate - rate * abs(rate))
        rates.append(rate)
    half = 0.5 * (step * np.cumsum(rates) + draw.normal(0.0, 0.001, count))
    signals = [
        Signal('/imu', 'sensor_msgs/msg/Imu', 'orientation', 'quaternion', times,
               np.column_stack([zero, zero, np.sin(half), np.cos(half)]), rate=20.0),
        Signal('/wrench', 'geometry_msgs/msg/WrenchStamped', 'wrench', 'wrench', times[::logged],
               np.column_stack([zero] * 5 + [moments])[::logged], rate=20.0 / logged)]
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    assert made.thrusters.latency == pytest.approx(latency)
    assert made.thrusters.delay <= 0.15
    said = [one for one in made.guesses if f'thrusters.latency {latency:g} s' in one]
    written = re.findall(r'latency: (\S+)', configuration(made, 'dive.mcap'))
    assert (len(said), written) == ((1, [f'{latency}']) if latency else (0, []))


@pytest.mark.parametrize('seed', [0, 1, 2])
@pytest.mark.parametrize(('tilt', 'own', 'noise'), [(0.02, 0.1, 0.2), (0.08, 0.2, 0.05)])
def test_a_thruster_that_holds_the_depth_does_not_drive_ahead(
        tilt: float, own: float, noise: float, seed: int) -> None:
    """It pushes all the time, and a little more where those ahead push, which tilt the vehicle."""
    draw, step, count = np.random.default_rng(seed), 0.1, 3000
    ahead = np.repeat(draw.uniform(0.0, 20.0, count // 100), 100)
    sides = ahead[:, np.newaxis] + 3.0 * draw.normal(size=(count, 2)) * [1.0, -1.0]
    down = -3.0 + tilt * (ahead - 10.0) + own * np.repeat(draw.normal(size=count // 20), 20)
    velocity, velocities = 0.0, []
    for force in sides.sum(axis=1):
        velocity += step * (force - 40.0 * velocity * abs(velocity)) / 60.0
        velocities.append(velocity)
    times, zero = step * np.arange(count), np.zeros(count)
    measured = np.array(velocities) + draw.normal(0.0, noise, count)
    signals = [
        Signal('/dvl', 'geometry_msgs/msg/TwistStamped', 'twist.linear', 'vector', times,
               np.column_stack([measured, zero, zero]), rate=10.0),
        Signal('/thruster_forces', 'std_msgs/msg/Float64MultiArray', 'data', 'array', times,
               np.column_stack([sides, down]), rate=10.0)]
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    assert made.thrusters.rows['surge'][:2] == (
        pytest.approx(1.0, abs=0.15), pytest.approx(1.0, abs=0.15))
    assert not any(made.thrusters.rows['surge'][2:])


def test_motors_that_are_known_push_the_way_they_point() -> None:
    """At the delay at which a controller seems to push against the motion it explains more."""
    heading, wrench = turns(0.15)
    made = decide(candidates([heading, wrench]), [heading, wrench],
                  lambda name, found: found[0]).thrusters
    moved = motion({'attitude': heading, 'thrusters': wrench})
    known = with_delay(replace(made, sure_frame=True), moved)
    assert explained_by(known, moved) > explained_by(with_delay(made, moved), moved)


@pytest.mark.parametrize('seed', [1, 2])
def test_coarse_fixes_are_looked_at_over_longer_spans_and_their_outliers_are_no_speed(
        seed: int, repository: Path, tmp_path: Path) -> None:
    """Here one in a second, off by 30 cm: from one to the next the commands explain a tenth."""
    settings = settings_from(load(repository / 'config' / 'lbl_slow.yaml'))
    simulate_log(replace(
        settings, position=replace(settings.position, latency=0.0),
        simulation=replace(settings.simulation, position_noise=0.3)),
        tmp_path / 'dive.mcap', 300.0, seed)
    with Log([tmp_path / 'dive.mcap']) as opened:
        signals = read_signals(opened, 0.0, None)
    off = np.random.default_rng(0)
    worse = [replace(one, values=one.values + 10.0 * off.normal(size=one.values.shape) * (
        off.random((len(one.values), 1)) < 0.02)) if one.topic == '/usbl/fix' else one
        for one in signals]
    clean, made = [decide(candidates(one), one, lambda name, found: found[0])
                   for one in (signals, worse)]
    # with 0.4 of the rate every second step would be clamped, for fixes do not come that evenly
    assert 'cutoff: 0.36 ' in configuration(clean, 'dive.mcap')
    assert made.fastest == pytest.approx(clean.fastest, rel=0.1)
    for dof in ('surge', 'sway'):
        assert clean.dofs[dof].sign == 1
        assert clean.dofs[dof].explained > 0.4
        assert clean.dofs[dof].mass < 2.0 * settings.simulation.dofs[dof].mass
        assert made.dofs[dof].velocity == pytest.approx(clean.dofs[dof].velocity, rel=0.1)


def test_what_coarse_fixes_do_not_tell_is_left_out_for_that(
        repository: Path, tmp_path: Path) -> None:
    settings = settings_from(load(repository / 'config' / 'jhurov.yaml'))
    simulate_log(replace(settings, simulation=replace(
        settings.simulation, position_rate=1.0, position_noise=8.0)),
        tmp_path / 'dive.mcap', 120.0, 1)
    made = discover([tmp_path / 'dive.mcap'])
    assert 'surge' not in made.dofs
    [line] = [one for one in made.guesses if 'little but noise' in one]
    assert line.startswith('surge, sway: left out, for the fixes show little but noise')


def test_fixes_that_are_mostly_noise_in_z_do_not_replace_a_depth(noisy: Path) -> None:
    with Log([noisy]) as opened:
        signals = read_signals(opened, 0.0, None)
    noise = np.random.default_rng(0).normal(0.0, 0.4, 10000)
    worse = [replace(one, values=one.values + np.outer(noise[:len(one.values)], (0.0, 0.0, 1.0)))
             if one.topic == '/usbl/fix' else one for one in signals]
    made = decide(candidates(worse), worse, lambda name, found: found[0])
    assert {'position', 'depth'} <= made.inputs.keys()
    assert made.inputs['depth'].keys['scale'] == -1.0
    assert made.dofs['heave'].sign == 1


@pytest.mark.parametrize('sideways, places', [
    (0.0, {'depth': '/depth point.z'}), (1.0, {'position': '/depth point'})])
def test_a_point_that_never_moves_sideways_is_a_depth(
        sideways: float, places: dict[str, str]) -> None:
    times = np.arange(0.0, 60.0, 0.1)
    place = np.column_stack([sideways * np.sin(times), sideways * times, -2.0 + np.cos(times)])
    found = candidates([Signal(
        '/depth', 'geometry_msgs/msg/PointStamped', 'point', 'vector', times, place, rate=10.0)])
    assert {name: ones[0].signal.place for name, ones in found.items()} == places


@pytest.mark.parametrize(('topic', 'size', 'scale'), [
    ('/depth', 1.0, -1.0), ('/depth_cm', 100.0, -0.01), ('/depth/mm', 1000.0, -0.001),
    ('/dvl/altitude', 1.0, None)])
def test_a_depth_is_in_the_unit_of_its_name(topic: str, size: float, scale: float | None) -> None:
    times = np.arange(0.0, 60.0, 0.1)
    values = size * (2.0 + np.cos(times))[:, np.newaxis]
    found = candidates([Signal(topic, 'std_msgs/msg/Float64', 'data', 'number', times, values)])
    assert [one.keys['scale'] for one in found.get('depth', [])] == (
        [] if scale is None else [scale])


@pytest.mark.parametrize(('unit', 'surface'), [(1.0, 0.0), (100.0, 1013.25), (1.0, 101325.0)])
def test_a_pressure_is_in_the_unit_that_a_vehicle_can_dive_in(
        unit: float, surface: float) -> None:
    """3,000 to 10,000 are a metre in Pa above the atmosphere, or 70 m in hPa: not in 20 s."""
    times = np.arange(0.0, 60.0, 0.1)
    depth = 0.65 + 0.35 * np.cos(0.3 * times)
    pressure = surface + 1000.0 * 9.80665 * depth[:, np.newaxis] / unit
    [depth_input] = candidates([Signal(
        '/pressure', 'std_msgs/msg/Float32', 'data', 'number', times, pressure)])['depth']
    assert depth_input.keys['scale'] == pytest.approx(-unit / 9806.65)


def test_of_a_pose_and_what_lags_behind_it_the_pose_is_taken() -> None:
    times = np.arange(0.0, 60.0, 0.02)
    place = np.column_stack([np.sin(times), times, -2.0 + np.cos(times)])
    kind, path = 'nav_msgs/msg/Odometry', 'pose.pose.position'
    signals = [Signal('/odometry/filtered', kind, path, 'vector', times, place, rate=50.0),
               Signal('/lbl/pose', kind, path, 'vector', times[::5], place[::5], rate=10.0)]
    assert [one.signal.topic for one in candidates(signals)['position']] == [
        '/lbl/pose', '/odometry/filtered']
    # its velocity is none
    assert 'position' not in candidates([Signal(
        '/local_position/velocity', kind, 'twist.linear', 'vector', times, place)])


def with_signals(log: Path, change: Callable[[Signal], Signal | None]) -> Discovery:
    """Return what is made of a log whose signals are others; None leaves one out."""
    with Log([log]) as opened:
        read = [change(signal) for signal in read_signals(opened, 0.0, None)]
    signals = [signal for signal in read if signal is not None]
    return decide(candidates(signals), signals, lambda name, found: found[0])


PX4 = {'px4_msgs/msg/VehicleOdometry': """
uint64 timestamp
uint8 pose_frame
float32[3] position
float32[4] q
float32[3] velocity
float32[3] angular_velocity
float32[3] position_variance
""", 'px4_msgs/msg/ActuatorMotors': """
uint64 timestamp
uint16 reversible_flags
float32[12] control
"""}


def as_px4(log: Path, path: Path) -> None:
    """Write the poses and the motors of a log as PX4 does: in NED, w first, NaN for no motor."""
    store = get_typestore(Stores.EMPTY)
    for name, text in PX4.items():
        store.register(get_types_from_msg(text, name))
    odometry, motors = [store.types[name] for name in PX4]
    three, turn = np.zeros(3, np.float32), (0.0, 0.0, 0.0, 1.0)
    with Log([log]) as source, path.open('wb') as file:
        writer = Writer(file)
        writer.start(profile='ros2')
        channels = {name: writer.register_channel(topic, 'cdr', writer.register_schema(
            name, 'ros2msg', PX4[name].encode())) for name, topic in zip(PX4, (
                '/fmu/out/vehicle_odometry', '/fmu/out/actuator_motors'))}
        for message in source.messages([
                '/mavros/local_position/pose', '/mavros/imu/data', '/mavros/rc/out']):
            data, stamp = message.data, message.time // 1000
            if message.topic.endswith('data'):
                q = data.orientation
                turn = product(product(NED_TO_ENU, (q.x, q.y, q.z, q.w)), FRD_TO_FLU)
                continue
            if message.topic.endswith('pose'):
                p, (x, y, z, w) = data.pose.position, turn
                made = odometry(stamp, 1, np.array([p.y, p.x, -p.z], np.float32), np.array(
                    [w, x, y, z], np.float32), three, three, three)
            else:
                made = motors(stamp, 0, np.array(
                    [*((np.array(data.channels[:8]) - 1500.0) / 400.0), *[math.nan] * 4],
                    np.float32))
            name = type(made).__msgtype__
            writer.add_message(channels[name], message.time, bytes(
                store.serialize_cdr(made, name)), message.time)
        writer.finish()


def test_what_px4_says_is_known(logs: dict[str, Path], tmp_path: Path,
                                initialised: Callable[[Path], Settings]) -> None:
    log = tmp_path / 'px4.mcap'
    as_px4(logs['bluerov2_ardusub'], log)
    found = initialised(log)
    assert inputs(found) == {
        'position': '/fmu/out/vehicle_odometry position',
        'attitude': '/fmu/out/vehicle_odometry q[1], q[2], q[3], q[0]',
        'thrusters': '/fmu/out/actuator_motors control[0:8]'}
    assert found.frames == 'ned'
    assert found.dofs == ('surge', 'sway', 'heave', 'yaw')


def test_an_array_of_four_is_a_rotation_whichever_end_its_real_part_stands_at() -> None:
    times = np.arange(0.0, 30.0, 0.1)
    level = np.column_stack([0.02 * np.sin(times), 0.02 * np.cos(times),
                             np.sin(0.1 * times), np.cos(0.1 * times)])
    level /= np.linalg.norm(level, axis=1)[:, None]
    for values, path in ((level, 'q'), (level[:, [3, 0, 1, 2]], 'q[1], q[2], q[3], q[0]')):
        one, = candidates([Signal('/pose', 'a/msg/B', 'q', 'array', times, values)])['attitude']
        assert one.signal.path == path
        assert one.signal.values == pytest.approx(level)


def test_a_frame_that_is_named_ned_is_ned(logs: dict[str, Path]) -> None:
    made = with_signals(logs['odometry_wrench'], lambda one: replace(one, frame='world_ned'))
    assert made.frames == 'ned'
    assert 'frames: ned, by the name of world_ned' in made.guesses


def test_a_boat_has_a_planar_pose(repository: Path, tmp_path: Path,
                                  initialised: Callable[[Path], Settings]) -> None:
    known = settings_from(load(repository / 'config' / 'odometry_wrench.yaml'))
    log, pose = tmp_path / 'boat.mcap', {
        'topic': '/NED_pose', 'type': 'geometry_msgs/msg/Pose2D'}
    simulate_log(replace(
        known, frames='ned', dofs=('surge', 'sway', 'yaw'),
        position=replace(known.position, **pose, field='x, y'),
        attitude=replace(known.attitude, **pose, field='theta')), log, 45.0, 1)
    found = initialised(log)
    assert inputs(found) == {'position': '/NED_pose x, y', 'attitude': '/NED_pose theta',
                             'thrusters': '/wrench wrench'}
    assert found.frames == 'ned' and found.dofs == ('surge', 'sway', 'yaw')
    for dof, mass in (('surge', 90.0), ('sway', 110.0)):
        assert found.dof[dof].mass == pytest.approx(mass, rel=0.2), dof


@pytest.mark.parametrize('topic', [
    '/desired_heading', '/controller/heading_error', '/asmc/heading_sigma', '/heading_gain'])
def test_what_a_controller_wants_is_no_attitude(topic: str) -> None:
    times = np.arange(0.0, 60.0, 0.1)
    for name, is_one in (('/heading', True), (topic, False)):
        found = candidates([Signal(name, 'std_msgs/msg/Float64', 'data', 'number', times,
                                   np.sin(0.1 * times)[:, np.newaxis])])
        assert ('attitude' in found) is is_one


@pytest.mark.parametrize('is_turned_over', [False, True])
def test_an_accelerometer_is_turned_over_as_its_attitude_says(
        is_turned_over: bool, logs: dict[str, Path]) -> None:
    with Log([logs['odometry_wrench']]) as opened:
        signals = read_signals(opened, 0.0, None)
    attitude = next(one for one in signals if one.shape == 'quaternion')
    values = np.array([product(tuple(q), FRD_TO_FLU) for q in attitude.values]) if (
        is_turned_over) else attitude.values
    kind, up = 'sensor_msgs/msg/Imu', np.zeros((len(attitude.times), 3)) + [0.0, 0.0, 9.8]
    signals += [replace(attitude, topic='/imu', type=kind, path='orientation', values=values,
                        rate=100.0),
                replace(attitude, topic='/imu', type=kind, path='linear_acceleration',
                        shape='vector', values=up)]
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    assert made.frames == ('ned' if is_turned_over else 'enu')
    # a vehicle is level most of the time
    assert made.inputs['attitude'].signal.topic == '/odometry' or not is_turned_over


def test_how_fast_a_boat_turns_is_no_heave(repository: Path, tmp_path: Path) -> None:
    known, log = settings_from(load(repository / 'config/odometry_wrench.yaml')), tmp_path / 'log'
    simulate_log(replace(
        known, velocity=replace(known.velocity, topic='/ins'),
        angular_velocity=replace(known.angular_velocity, topic='/ins')), log, 45.0, 1)
    with Log([log]) as opened:
        read = {(one.topic, one.path): one for one in read_signals(opened, 0.0, None)}
    signals = [read['/odometry', 'pose.pose.orientation'], read['/wrench', 'wrench']]
    linear, angular = [read['/ins', f'twist.twist.{name}'] for name in ('linear', 'angular')]
    velocity = replace(linear, topic='/local_vel', path='', shape='vector',
                       values=np.column_stack([linear.values[:, :2], angular.values[:, 2]]))
    made = decide(candidates([*signals, velocity]), signals, lambda name, found: found[0])
    assert 'heave' not in made.dofs and {'surge', 'sway', 'yaw'} <= made.dofs.keys()
    assert any('is how fast the vehicle turns' in one for one in made.guesses)


def test_the_depth_and_the_stick_of_mavros_will_do(tmp_path: Path) -> None:
    log, kind = tmp_path / 'mavros.mcap', 'mavros_msgs/msg/OverrideRCIn'
    force = velocity = depth = 0.0
    with LogWriter(log) as writer:
        for k in range(1200):
            pulse = 1500 + round(200.0 * math.sin(0.03 * k) * math.cos(0.0071 * k))
            force = 0.2 * (pulse - 1500)
            velocity += 0.05 * (force - 60.0 * velocity * abs(velocity)) / 30.0
            depth += 0.05 * velocity
            writer.write('/mavros/rc/override', kind, {
                'channels': [1500, 1500, pulse, *[1500] * 5, *[0] * 10]}, 50_000_000 * (k + 1))
            writer.write('/mavros/global_position/rel_alt', 'std_msgs/msg/Float64',
                         {'data': depth}, 50_000_000 * (k + 1) + 1000)
    made = discover([log])
    assert {name: one.signal.topic for name, one in made.inputs.items()} == {
        'depth': '/mavros/global_position/rel_alt', 'thrusters': '/mavros/rc/override'}
    assert made.dofs['heave'].explained > 0.7


def test_what_moves_too_fast_for_metres_is_named(logs: dict[str, Path]) -> None:
    log = logs['jhurov']
    place = with_signals(log, lambda one: replace(one, values=1000.0 * one.values)
                         if one.topic == '/sharps/position' else one)
    assert 'position' not in place.inputs
    assert any('/sharps/position point left out, for in metres it moves at' in one
               for one in place.guesses)
    depth = with_signals(log, lambda one: replace(one, values=100.0 * one.values)
                         if one.topic == '/depth/pressure' else one)
    assert any(one.startswith('heave moves at ') and one.endswith('in metres?')
               for one in depth.guesses)


def test_fixes_are_not_late_because_the_thrust_then_opposes_the_motion(tmp_path: Path) -> None:
    log = tmp_path / 'dive.mcap'
    six_axes_dive(log, Dive(current=(0.2, -0.1)), seed=2, duration=90.0)
    assert 'latency' not in discover([log]).inputs['position'].keys


# --- asking, and what cannot be done ------------------------------------------------------


def test_what_no_command_drives_apart_is_left_out(
        data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = data / 'bluerov2_tank' / 'surge_sway_heave.mcap'  # without a command of yaw
    yaml = tmp_path / 'rov.yaml'
    assert main(['init', str(log), '--output', str(yaml)]) == 0
    assert 'yaw: left out, for no command drives it apart' in capsys.readouterr().out
    assert settings_from(load(yaml)).dofs == ('surge', 'sway', 'heave')


def test_a_log_of_another_vehicle_is_named(
        logs: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, other = logs['odometry_wrench'], logs['bluerov2_ardusub']
    assert main(['init', str(one), str(other), '--output', str(tmp_path / 'rov.yaml')]) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if 'same vehicle' in line]
    assert len(told) == 1
    assert told[0].startswith('rovid init: ')
    assert (str(one) in told[0]) != (str(other) in told[0])


def test_another_choice_is_taken(data: Path) -> None:
    with Log([data / 'blueboat' / 'bb235.mcap']) as log:
        signals = read_signals(log, 0.0, None)
    made = decide(candidates(signals), signals, lambda name, found: found[-1])
    assert made.thrusters.signal.place == '/pwm axes'
    assert made.thrusters.chain.offset == 1500.0


def test_what_no_configuration_can_be_made_of(
        tmp_path: Path, logs: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    alone = tmp_path / 'alone.mcap'
    with Log([logs['odometry_wrench']]) as log, LogWriter(alone) as writer:
        for message in log.messages(['/odometry'], duration=5.0):
            writer.write(message.topic, message.type, fields_of(message.data, 0.0), message.time)
    there = tmp_path / 'there.yaml'
    for given, code, says in [
            ([str(alone), '--output', str(there)], 1,
             'nothing in it that changes is named as thruster commands or a wrench; it has '
             '/odometry (nav_msgs/msg/Odometry)'),
            ([str(alone), '--output', str(there), '--ask'], 1, 'there is no terminal to ask on'),
            ([str(tmp_path / 'none.mcap'), '--output', str(there)], 1, 'no such file'),
            ([str(alone), '--output', str(alone)], 1, 'is read by this command'),
            ([], 2, 'the following arguments are required: LOG')]:
        assert main(['init', *given]) == code
        error = capsys.readouterr().err
        assert says in error and error.count('\n') == 1
        assert not there.exists()


@pytest.mark.parametrize('given, dry, unknown', [
    ([], {}, 'dry mass, which'), (['--dry-mass', '60'], {
        'surge': 60.0, 'sway': 60.0, 'heave': 60.0}, 'dry mass of yaw, which'),
    (['--dry-mass', '60', '--dry-inertia', '4.5'], {
        'surge': 60.0, 'sway': 60.0, 'heave': 60.0, 'yaw': 4.5}, '')])
def test_what_the_vehicle_weighs_can_be_told(
        given: list[str], dry: dict[str, float], unknown: str, logs: dict[str, Path],
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    yaml = tmp_path / 'rov.yaml'
    assert main(['init', str(logs['odometry_wrench']), '--output', str(yaml), *given]) == 0
    found = settings_from(load(yaml)).dof
    assert {dof: known.dry_mass for dof, known in found.items() if known.dry_mass} == dry
    told = [line for line in capsys.readouterr().out.splitlines() if 'dry mass' in line]
    assert len(told) == bool(unknown)
    assert unknown in ' '.join(told)


def test_a_configuration_is_not_written_over_another(
        logs: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, yaml = logs['odometry_wrench'], tmp_path / 'mine.yaml'
    command = ['init', str(log), '--output', str(yaml)]
    assert main(command) == 0
    made = yaml.read_text()
    assert main(command) == 0  # it is the same
    yaml.write_text(made.replace('method: ekf', 'method: aid'))
    capsys.readouterr()
    assert main(command) == 1
    error, = capsys.readouterr().err.splitlines()
    assert error.startswith(f'rovid init: {yaml}: is there, and is another configuration')
    assert 'method: aid' in yaml.read_text()
