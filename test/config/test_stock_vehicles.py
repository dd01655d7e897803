"""The configurations of common vehicles: their thrust, and what is identified with them."""

from collections.abc import Iterable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

from mcap.reader import make_reader
import numpy as np
import pytest
from rovid_core.model.dofs import DOFS
from rovid_core.settings.run import Settings
from rovid_core.simulation.profiles import Sinusoid
from rovid_core.simulation.sensors import simulate
from rovid_core.thrust.thruster_curve import thruster_model, wrench
from rovid_ros.commands.replay import replay
from rovid_ros.commands.simulate import simulate_log
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.player import PipelinePlayer
from rovid_ros.logs.writer import LogWriter
from rovid_ros.messages.types import standard_types
from rovid_ros.results.documents import Result

REPOSITORY = Path(__file__).parents[2]
ARDUSUB = REPOSITORY / 'config/bluerov2_ardusub.yaml'
ODOMETRY = REPOSITORY / 'config/odometry_wrench.yaml'

# ArduSub's frame VECTORED_6DOF: what a demand of 1 adds to the motors 1 to 8. Forward, right,
# up; roll to the right, nose up, clockwise: forward, right, down axes, but up for throttle.
DEMANDS = {
    'surge': (+1, (-1, -1, 1, 1, 0, 0, 0, 0)),
    'sway': (-1, (1, -1, 1, -1, 0, 0, 0, 0)),
    'heave': (+1, (0, 0, 0, 0, -1, -1, -1, -1)),
    'roll': (+1, (0, 0, 0, 0, 1, -1, 1, -1)),
    'pitch': (-1, (0, 0, 0, 0, -1, -1, 1, 1)),
    'yaw': (-1, (1, -1, -1, 1, 0, 0, 0, 0)),
}

OTHER_DEFINITION = """\
std_msgs/Header header
uint32 port
uint16[] channels
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


@pytest.fixture(scope='module')
def bluerov2() -> Settings:
    """Return the settings of the BlueROV2 Heavy."""
    return settings_from(load(ARDUSUB))


@pytest.fixture(scope='module')
def dive(bluerov2: Settings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of a simulated dive of it."""
    path = tmp_path_factory.mktemp('dive') / 'dive.mcap'
    simulate_log(bluerov2, path, 60.0, seed=1)
    return path


def identified(log: Path, settings: Settings, duration: float | None = None) -> Result:
    return replay([log], settings, PipelinePlayer(settings), duration=duration)


def check_truth(result: Result, settings: Settings, within: float) -> None:
    """Compare mass and drag; each of the two drags by itself is known three times less well."""
    for dof, true in settings.simulation.dofs.items():
        found = result.dofs[dof]
        v = settings.dof[dof].typical_velocity
        drags = [d.quadratic_drag * v * v + d.linear_drag * v
                 for d in (true, SimpleNamespace(**found))]
        assert drags[1] == pytest.approx(drags[0], rel=within), dof
        assert found['mass'] == pytest.approx(true.mass, rel=within), dof
        for name in ('quadratic_drag', 'linear_drag'):
            assert found[name] == pytest.approx(getattr(true, name), rel=3.0 * within), (dof, name)


@pytest.mark.parametrize('dof', DOFS)
@pytest.mark.parametrize('demand', [0.3, 0.6, -0.9])
def test_what_ardusub_asks_for_is_what_the_allocation_gives(
        bluerov2: Settings, dof: str, demand: float) -> None:
    side, factors = DEMANDS[dof]
    pwm = [1500 + round(400 * demand * factor) for factor in factors]
    force = wrench(bluerov2.thrusters, pwm)
    i = DOFS.index(dof)
    assert force[i] * side * demand > 0.0
    # an arm of 0.3 m makes moments and forces comparable
    sizes = np.abs(force) / np.where(np.arange(6) < 3, 1.0, 0.3)
    assert sizes[i] > 3.0 * max(np.delete(sizes, i))


def test_a_reversed_motor_takes_a_negative_gain(bluerov2: Settings) -> None:
    t = bluerov2.thrusters
    reversed_third = replace(t, gain=(1.0, 1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0))
    usual = wrench(t, (1400, 1400, 1600, 1600, 1500, 1500, 1500, 1500))
    assert wrench(reversed_third, (1400, 1400, 1400, 1600, *[1500] * 4)) == pytest.approx(usual)


def test_the_thrust_curve_is_odd_and_rises_up_to_its_end(bluerov2: Settings) -> None:
    curve = thruster_model(bluerov2.thrusters)
    forces = np.array([curve(pwm) for pwm in range(1500, 1901)])
    assert [curve(3000 - pwm) for pwm in range(1500, 1901)] == pytest.approx(-forces)
    assert forces[:26] == pytest.approx(0.0)  # the controller's deadband
    assert forces[200] == pytest.approx(16.59, abs=0.005)
    assert forces[400] == pytest.approx(30.4)
    assert np.all(np.diff(forces[:389]) >= 0.0) and min(forces[388:]) > 30.3
    assert curve(2200) == forces[400]


@pytest.mark.long
def test_a_dive_of_the_bluerov2_is_identified(bluerov2: Settings, dive: Path) -> None:
    result = identified(dive, bluerov2)
    check_truth(result, bluerov2, within=0.03)
    assert sum(result.rejected.values()) < 10
    with dive.open('rb') as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    schemas = {schema.name: schema.data for schema in summary.schemas.values()}
    assert b'uint16[] channels' in schemas['mavros_msgs/msg/RCOut']


@pytest.mark.long
def test_upright_thrusters_that_all_have_one_command_are_not_accused(
        bluerov2: Settings, tmp_path: Path) -> None:
    """If one were turned the force would be half as large, which no log can tell."""
    log, told = tmp_path / 'dive.mcap', []
    simulate_log(bluerov2, log, 135.0, seed=3)  # rounding all went one way
    replay([log], bluerov2, PipelinePlayer(bluerov2), warn=told.append)
    assert not told


def test_simulated_thrusters_hear_the_whole_numbers_that_are_sent(bluerov2: Settings) -> None:
    """Rounded, a small command is in the controller's dead-band, and the vehicle stays."""
    still = replace(bluerov2, simulation=replace(bluerov2.simulation, position_noise=0.0))
    small = {dof: (Sinusoid(1.2, 0.02),) if dof == 'surge' else () for dof in still.dofs}
    moved = []
    for whole in (False, True):
        found = [value[0] for _, name, value in simulate(still, 20.0, 1, small, whole)
                 if name == 'position']
        moved.append(max(map(abs, found)) > 0.01)
    assert moved == [True, False]


def rewritten(dive: Path, path: Path, rows: Iterable[tuple[Any, str, bytes, int]]) -> Path:
    with LogWriter(path) as writer:
        for topic, type_name, data, time in rows:
            definition = OTHER_DEFINITION if 'RCOut' in type_name else None
            writer.write_raw(topic, type_name, data, time, definition)
    return path


def messages(log: Path) -> list[tuple[str, str, bytes, int]]:
    with log.open('rb') as file:
        return [(c.topic, s.name, m.data, m.log_time)
                for s, c, m in make_reader(file).iter_messages() if s]


def with_port(data: bytes, channels: list[int]) -> bytes:
    """Return an RCOut of another definition, with these channels."""
    header = data[:12]  # encapsulation and stamp; then an empty frame
    rest = np.array([1, 0, 7, len(channels)], '<u4').tobytes()
    assert data[12:17] == np.array([1], '<u4').tobytes() + b'\0'
    return header + rest + np.array(channels, '<u2').tobytes()


@pytest.mark.long
def test_a_type_is_read_as_its_log_defines_it(
        bluerov2: Settings, dive: Path, tmp_path: Path) -> None:
    # a definition that no program knows: one more field, and all 16 outputs
    rows = []
    for topic, type_name, data, time in messages(dive):
        if 'RCOut' in type_name:
            decoded: Any = standard_types().deserialize_cdr(data, type_name)
            data = with_port(data, [*map(int, decoded.channels), *[0, 65535] * 4])
        rows.append((topic, type_name, data, time))
    path = rewritten(dive, tmp_path / 'other.mcap', rows)
    found = identified(path, bluerov2, 15.0)
    assert found.dofs['surge']['steps'] > 100
    assert found.dofs == identified(dive, bluerov2, 15.0).dofs


@pytest.mark.long
def test_outputs_that_are_off_are_no_commands(
        bluerov2: Settings, dive: Path, tmp_path: Path) -> None:
    rows = messages(dive)
    off = [i for i, row in enumerate(rows) if 'RCOut' in row[1]][400:460:2]
    for n, i in enumerate(off):
        topic, type_name, data, time = rows[i]
        rows[i] = (topic, type_name, with_port(data, [[0, 65535, 65000][n % 3]] * 8), time)
    for i, row in enumerate(rows):
        if 'RCOut' in row[1] and i not in off:
            decoded: Any = standard_types().deserialize_cdr(row[2], row[1])
            rows[i] = (row[0], row[1], with_port(row[2], [*map(int, decoded.channels)]), row[3])
    result = identified(rewritten(dive, tmp_path / 'off.mcap', rows), bluerov2)
    assert result.rejected['thrusters', 'not_a_command'] == len(off) == 30
    check_truth(result, bluerov2, within=0.03)


@pytest.mark.long
def test_odometry_and_a_wrench_are_enough(tmp_path: Path) -> None:
    settings = settings_from(load(ODOMETRY))
    simulate_log(settings, tmp_path / 'log.mcap', 60.0, seed=2)
    check_truth(identified(tmp_path / 'log.mcap', settings), settings, within=0.02)


@pytest.mark.long
def test_the_twist_of_an_odometry_is_a_body_velocity(tmp_path: Path) -> None:
    settings = settings_from({
        **load(ODOMETRY), 'velocity.topic': '/odometry', 'angular_velocity.topic': '/odometry'})
    simulate_log(settings, tmp_path / 'log.mcap', 60.0, seed=2)
    result = identified(tmp_path / 'log.mcap', settings)
    assert {settings.source(dof) for dof in DOFS} == {'velocity', 'angular_velocity'}
    check_truth(result, settings, within=0.03)


def test_live_a_missing_type_is_named_in_one_line(tmp_path: Path) -> None:
    pytest.importorskip('rclpy')
    if find_spec('mavros_msgs'):
        pytest.skip('mavros_msgs is installed here')
    run = subprocess.run(
        [sys.executable, '-m', 'rovid_ros.node', '--ros-args', '--params-file', str(ARDUSUB)],
        cwd=REPOSITORY, capture_output=True, text=True, timeout=60)
    assert run.returncode == 1
    (line,) = run.stderr.strip().splitlines()
    assert line.startswith(
        'identifier_node: thrusters.type: message type mavros_msgs/msg/RCOut is not installed')
    assert 'install the ROS package mavros_msgs' in line
