"""The parameter files that come with the package."""

from collections import defaultdict
import math
from pathlib import Path
from typing import Any

import pytest
from rovid_core.model.dofs import DOFS, PHYSICAL
from rovid_core.settings.run import Settings
from rovid_core.simulation.sensors import simulate
from rovid_ros.config.keys import KEYS
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

CONFIG = Path(__file__).parents[2] / 'config'
FILES = sorted(CONFIG.glob('*.yaml'))


@pytest.fixture(scope='module')
def jhurov() -> Settings:
    """Return the settings of the paper's vehicle."""
    return settings_from(load(CONFIG / 'jhurov.yaml'))


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_is_read_alike_by_ros(path: Path) -> None:
    rclpy = pytest.importorskip('rclpy')
    mine = load(path)
    settings_from(mine)
    context = rclpy.Context()
    rclpy.init(context=context, args=['--ros-args', '--params-file', str(path)])
    node = rclpy.create_node(
        'identifier_node', context=context, start_parameter_services=False, enable_rosout=False,
        allow_undeclared_parameters=True, automatically_declare_parameters_from_overrides=True)
    try:
        for name, value in mine.items():
            theirs: Any = node.get_parameter(name).value
            assert (list(theirs) if isinstance(value, list) else theirs) == value, name
    finally:
        node.destroy_node()
        context.try_shutdown()


def test_the_manual_has_every_key() -> None:
    text = (CONFIG / 'jhurov.yaml').read_text()
    given = load(CONFIG / 'jhurov.yaml')
    of_inputs = {'.topic', '.type', '.field', '.stamp', '.latency', '.qos', '.timeout'}
    for key in KEYS:
        group, last = key.name.rpartition('.')[::2]
        if group.removeprefix('simulation.').partition('.')[0] in DOFS:
            like = {key.name.replace(dof, 'surge') for dof in DOFS if dof in key.name}
            assert like <= given.keys() or f'# {last}: ' in text, key.name
        elif f'.{last}' in of_inputs:
            assert f'#   {last} ' in text, key.name
        else:
            assert key.name in given or f'# {last}: ' in text, key.name


def test_guesses_of_the_paper_s_vehicle_are_wrong_both_ways(jhurov: Settings) -> None:
    ratios = defaultdict(list)
    for dof in jhurov.dofs:
        for name in PHYSICAL[:3]:
            truth = getattr(jhurov.simulation.dofs[dof], name)
            ratios[name].append(getattr(jhurov.dof[dof], name) / truth)
    for name, found in ratios.items():
        assert all(abs(math.log(ratio)) >= math.log(1.5) for ratio in found), name
        assert min(found) < 1.0 < max(found), name


def test_the_paper_s_vehicle_moves_as_it_should(jhurov: Settings) -> None:
    velocities, commands, positions, pressures = [], [], [], []
    with_reference = settings_from({**load(CONFIG / 'jhurov.yaml'), 'reference.topic': '/truth'})
    for _, name, value in simulate(with_reference, 300.0, seed=1):
        if name == 'reference':
            velocities.append(value)
        elif name == 'thrusters':
            commands.append(value)
        elif name == 'position':
            positions.append(value)
        elif name == 'depth':
            pressures.append((value[0] - jhurov.depth_offset) / jhurov.depth_scale)
    for dof in jhurov.dofs:
        speeds = [abs(v[DOFS.index(dof)]) for v in velocities]
        rms = math.sqrt(sum(v * v for v in speeds) / len(speeds))
        assert 0.2 < rms < 0.6 and max(speeds) < 1.0, dof
    for gain, column in zip(jhurov.thrusters.gain, zip(*commands, strict=True), strict=True):
        assert 20.0 < gain * max(map(abs, column)) < 600.0  # [N]
    assert max(max(map(abs, p)) for p in positions) < 20.0  # [m]
    assert pressures[0] == pytest.approx(101325.0, abs=100.0)


@pytest.mark.parametrize('log', ['surge_sway_heave.mcap', 'all_axes.mcap'])
def test_a_positive_command_accelerates_forwards_on_every_axis(log: str, data: Path) -> None:
    np = pytest.importorskip('numpy')
    from rosbags.highlevel import AnyReader
    settings = settings_from(load(CONFIG / 'bluerov2_tank.yaml'))
    rows: dict[str, list[Any]] = defaultdict(list)
    with AnyReader([data / 'bluerov2_tank' / log]) as reader:
        for connection, time, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            if connection.topic == settings.thrusters.topics[0]:
                tau = np.array(settings.thrusters.allocation) @ message.axes
                rows['command'].append((time * 1e-9, *tau))
            elif connection.topic == settings.reference.topic:
                v, w = message.twist.linear, message.twist.angular
                rows['velocity'].append((time * 1e-9, v.x, v.y, v.z, w.x, w.y, w.z))
    command, velocity = np.array(rows['command']), np.array(rows['velocity'])
    for dof in settings.dofs:
        i = DOFS.index(dof) + 1
        if not command[:, i].any():
            continue
        v = np.clip(velocity[:, i], -1.5, 1.5)
        speed_up = (v[4:] - v[:-4]) / (velocity[4:, 0] - velocity[:-4, 0])  # over 0.8 s
        regressors = np.column_stack([command[2:-2, i], v[2:-2]])
        (gain, drag), *_ = np.linalg.lstsq(regressors, speed_up, rcond=None)
        assert gain > 0.2 / settings.dof[dof].mass, dof
        assert drag < 0.0, dof
