"""Two vehicles on one network, one process each: neither hears of the other."""

from pathlib import Path
from typing import Any

from mcap.reader import make_reader
import pytest

rclpy = pytest.importorskip('rclpy')

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from rovid_ros.commands.simulate import simulate_log
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.log import Log
from rovid_ros.results.outputs import DIAGNOSTIC_TYPE
from std_srvs.srv import Trigger
import yaml

from test.support.live_drive import assert_same, replayed_record
from test.support.live_node import changed, heard, NodeProcess, Peer, Raw, replayed, told

RELATIVE = {f'{name}.topic': topic for name, topic in (
    ('position', 'position'), ('depth', 'depth'), ('attitude', 'imu'), ('thrusters', 'current'))}
MASSES = {'a': 305.0, 'b': 180.0}


@pytest.fixture(scope='module')
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Raw]]:
    """Return what the sensors of two different vehicles say at the same time."""
    found = {}
    for seed, (name, mass) in enumerate(MASSES.items()):
        path = tmp_path_factory.mktemp('log') / f'{name}.mcap'
        settings = settings_from(changed({**RELATIVE, 'simulation.surge.mass': mass}))
        simulate_log(settings, path, 6.0, seed=seed)
        with path.open('rb') as file:
            found[name] = [
                Raw(channel.topic.lstrip('/'), schema.name, message.data, message.log_time)
                for schema, channel, message in make_reader(file).iter_messages() if schema]
    return found


def one_file(folder: Path) -> Path:
    """Write one parameter file for both, as a user with two vehicles would."""
    sections: dict[str, Any] = {'/**': {'ros__parameters': changed(RELATIVE)}}
    for name in MASSES:
        paths = {'record.path': str(folder / f'{name}.mcap'),
                 'checkpoint.path': str(folder / f'{name}.json')}
        sections[f'/{name}/identifier_node'] = {'ros__parameters': paths}
    file = folder / 'vehicles.yaml'
    file.write_text(yaml.safe_dump(sections, sort_keys=False))
    return file


def test_crossing_traffic(logs: dict[str, list[Raw]], peer: Peer, environment: dict[str, str],
                          tmp_path: Path, repository: Path) -> None:
    file, settings = one_file(tmp_path), settings_from(changed(RELATIVE))
    alone = {name: told(settings, replayed(settings, messages))
             for name, messages in logs.items()}
    assert alone['a'] != alone['b']
    estimates = {name: peer.listen_to_steps(f'/{name}/rov/estimate') for name in logs}
    health = peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
    nodes = {}
    for name in logs:
        folder = tmp_path / name
        folder.mkdir()
        nodes[name] = NodeProcess(
            ['--ros-args', '-r', f'__ns:=/{name}', '--params-file', file], environment, folder,
            repository)
    try:
        peer.advertise({f'/{name}/{raw.topic}': raw.type
                        for name, messages in logs.items() for raw in messages})
        for pair in zip(*logs.values()):
            for name, raw in zip(logs, pair):
                peer.send(f'/{name}/{raw.topic}', raw.cdr)
        for name, messages in logs.items():  # what the longer one has left
            for raw in messages[min(map(len, logs.values())):]:
                peer.send(f'/{name}/{raw.topic}', raw.cdr)
        for name, got in estimates.items():
            peer.settle(got, len(alone[name]) - 50)
        set_gap = SetParameters.Request(
            parameters=[Parameter('max_gap', value=7.0).to_parameter_msg()])
        (result,) = peer.call(
            SetParameters, '/a/identifier_node/set_parameters', set_gap).results
        assert result.successful
        other = peer.call(GetParameters, '/b/identifier_node/get_parameters',
                          GetParameters.Request(names=['max_gap'])).values[0]
        assert other.double_value == settings.max_gap
        assert all(node.stop() == 0 for node in nodes.values())
        for name, got in estimates.items():
            peer.settle(got)
            assert_same(heard(got), alone[name])
            assert_same(replayed_record(tmp_path / f'{name}.mcap', changed(RELATIVE)),
                        alone[name])
            with Log([tmp_path / f'{name}.mcap']) as log:
                assert sum(log.topics[f'/{raw}'].count or 0 for raw in RELATIVE.values()) == len(
                    logs[name])
            assert (tmp_path / f'{name}.json').exists()
        names = {status.name.partition(':')[0] for message in health for status in message.status}
        assert names == {'/a/identifier_node', '/b/identifier_node'}
    finally:
        for node in nodes.values():
            node.kill()


def test_a_reset_of_one_is_not_one_of_the_other(
        logs: dict[str, list[Raw]], peer: Peer, environment: dict[str, str], tmp_path: Path,
        repository: Path) -> None:
    """Two of one name in one namespace would be; in two they are not."""
    file = one_file(tmp_path)
    nodes = [NodeProcess(['--ros-args', '-r', f'__ns:=/{name}', '--params-file', file],
                         environment, tmp_path, repository) for name in logs]
    try:
        params = {name: peer.listen(f'/{name}/rov/params', 'std_msgs/msg/Float64MultiArray')
                  for name in logs}
        for name in logs:
            peer.until(lambda name=name: peer.node.count_publishers(f'/{name}/rov/params'))
        assert peer.call(Trigger, '/a/identifier_node/reset').success
        peer.until(lambda: params['a'])
        for name in logs:  # an answer comes behind all that was published before
            assert peer.call(Trigger, f'/{name}/identifier_node/save').success
        assert len(params['a']) == 1
        assert params['b'] == []
    finally:
        for node in nodes:
            node.kill()
