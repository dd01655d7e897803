"""Each input of a live node stops and starts again: what it feeds is told, all else untouched."""

from collections.abc import Iterator
from dataclasses import dataclass
import math
from pathlib import Path
import time
from typing import Any

import pytest

pytest.importorskip('rclpy')

from mcap.reader import make_reader
from rovid_ros.commands.main import main
from rovid_ros.model import Model
from rovid_ros.results.outputs import TOPICS

from test.support.live import write_parameters
from test.support.live_drive import Start
from test.support.live_node import changed, NodeProcess, Peer, Raw

LEARNING = 75.0  # [s] that a replay learns the vehicle from
CHANGES: dict[str, Any] = {
    'max_wait': 0.1, 'identifier.method': 'ekf', 'current.prior': 0.0,
    'angular_velocity.topic': '/gyro', 'angular_velocity.type': 'sensor_msgs/msg/Imu',
    'angular_velocity.field': 'angular_velocity',
    'simulation.angular_velocity_rate': 20.0}
INPUTS = {  # topic -> input, and the DOFs that it feeds
    '/position': ('position', {'surge'}), '/depth': ('depth', {'heave'}),
    '/gyro': ('angular_velocity', {'yaw'}), '/imu': ('attitude', {'surge', 'heave'}),
    '/current': ('thrusters', {'surge', 'heave', 'yaw'})}
DOFS = ('surge', 'heave', 'yaw')
TIMEOUT = 1.0  # max_gap and thrusters.timeout, as by default
SILENCE, PAUSE = 1.9, 0.7  # [s]


@dataclass
class Heard:
    """What a controller heard at one moment."""

    model: dict[str, tuple[bool, str, float, float]]  # valid, status, age, velocity

    @staticmethod
    def of(message: Any) -> 'Heard':
        return Heard({name: (dof.valid, dof.status, dof.age, dof.velocity)
                      for name, dof in Model.from_message(message).dofs.items()})


@pytest.fixture(scope='module')
def dive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Raw]]:
    """Return a state that was learned from a log, and how the log goes on."""
    folder = tmp_path_factory.mktemp('dive')
    file, log = write_parameters(folder / 'p.yaml', changed(CHANGES)), folder / 'log.mcap'
    length = LEARNING + 5.0 + len(INPUTS) * (SILENCE + PAUSE)
    assert main(['simulate', '--params-file', str(file), '--output', str(log),
                 '--duration', str(length), '--seed', '1']) == 0
    assert main(['replay', str(log), '--params-file', str(file), '--duration', str(LEARNING),
                 '--state', str(folder / 'state.json')]) == 0
    with log.open('rb') as opened:
        messages = [Raw(channel.topic, schema.name, message.data, message.log_time)
                    for schema, channel, message in make_reader(opened).iter_messages() if schema]
    begin = messages[0].time + round(LEARNING * 1e9)
    return folder / 'state.json', [one for one in messages if one.time >= begin]


class Vehicle:
    """Publishes how the log goes on, at the pace of the log; some topics can be switched off."""

    def __init__(self, peer: Peer, messages: list[Raw]) -> None:
        self._peer = peer
        self._messages = iter(messages)
        self._next = next(self._messages)
        self._began, self._first = time.monotonic(), messages[0].time
        self.silent = ''

    def drive(self, duration: float) -> None:
        end = time.monotonic() + duration
        while time.monotonic() < end:
            now = self._first + round((time.monotonic() - self._began) * 1e9)
            while self._next.time <= now:
                if self._next.topic != self.silent:
                    self._peer.send(self._next.topic, self._next.cdr)
                self._next = next(self._messages)
            self._peer.spin(0.01)


@pytest.fixture
def node(dive: tuple[Path, list[Raw]], start: Start) -> Iterator[NodeProcess]:
    yield start({**CHANGES, 'checkpoint.path': str(dive[0]), 'checkpoint.period': 86400.0})


def test_each_input_stops_and_starts_again(
        dive: tuple[Path, list[Raw]], peer: Peer, node: NodeProcess) -> None:
    heard: list[Heard] = []
    peer.tap('/rov/model', TOPICS['rov/model'], lambda one: heard.append(Heard.of(one)),
             raw=False)
    twists = peer.listen('/rov/velocity', TOPICS['rov/velocity'])
    peer.advertise({one.topic: one.type for one in dive[1][:100]})
    vehicle = Vehicle(peer, dive[1])
    vehicle.drive(3.0)
    assert all(valid for valid, *_ in heard[-1].model.values()), heard[-1]

    for topic, (name, fed) in INPUTS.items():
        before, vehicle.silent = len(heard), topic
        vehicle.drive(SILENCE)
        told = heard[before:]
        for dof in DOFS:
            states = [one.model[dof] for one in told]
            if dof not in fed:
                assert all(valid for valid, *_ in states), (topic, dof)
                assert not any(math.isnan(velocity) for *_, velocity in states)
                continue
            stale = [one for one in states if one[1] == 'stale']
            assert states[-1] == stale[-1], (topic, dof)
            assert stale[0][2] < TIMEOUT + 1.0, (topic, dof)  # by the age that it tells
            assert not any(valid for valid, *_ in stale)
            assert all(math.isnan(velocity) for *_, velocity in stale)
        linear, angular = twists[-1].twist.linear, twists[-1].twist.angular
        assert [math.isnan(x) for x in (linear.x, linear.z, angular.z)] == [
            dof in fed for dof in DOFS]
        vehicle.silent = ''
        vehicle.drive(PAUSE)
        assert all(valid for valid, *_ in heard[-1].model.values()), (topic, heard[-1])
        assert node.output.count(f'{name}: silent for ') == 1
    vehicle.drive(0.6)  # the console is written once a second
    for name, _ in INPUTS.values():
        assert node.output.count(f'{name}: silent for ') == 1
        assert node.output.count(f'{name}: back after ') == 1

    assert node.stop() == 0
    peer.until(lambda: not any(valid for valid, *_ in heard[-1].model.values()))  # the last word
    assert 'result: surge ' in node.output
    assert 'Traceback' not in node.output
