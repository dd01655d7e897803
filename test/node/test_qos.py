"""Quality of service: chosen per input, and what does not fit is told in one line."""

from collections.abc import Iterator
from pathlib import Path
import signal
from typing import Any

import pytest

rclpy = pytest.importorskip('rclpy')

from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rovid_ros.node.node import IdentifierNode
from rovid_ros.node.transport.message_types import import_type
from rovid_ros.node.transport.publishers import best_effort, latched, reliable
from rovid_ros.results.outputs import DIAGNOSTIC_TYPE
from std_msgs.msg import Float64MultiArray

from test.support.live_drive import ros_peer, starting
from test.support.live_node import changed, Peer, Raw, TYPES

BULKY = {'thrusters.type': 'std_msgs/msg/Float64MultiArray', 'thrusters.field': 'data',
         'thrusters.names': None, 'thrusters.qos': 'sensor_data'}


class Vehicle:
    """The node in this process, spun together with its peer."""

    def __init__(self) -> None:
        rclpy.init(args=[])
        self.peer = Peer()
        self.executor = SingleThreadedExecutor()

    def start(self, changes: dict[str, Any]) -> None:
        self.node = IdentifierNode(changed(changes))
        self.executor.add_node(self.node)

    def advertise(self, topic: str, name: str, profile: QoSProfile) -> None:
        self.peer.publishers[topic] = self.peer.node.create_publisher(
            import_type(name), topic, profile)

    def until(self, condition: Any) -> None:
        self.peer.until(lambda: self.executor.spin_once(timeout_sec=0.01) or condition())

    def spin(self) -> None:
        for _ in range(50):
            self.executor.spin_once(timeout_sec=0.01)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.peer.close()
        rclpy.shutdown()


@pytest.fixture
def vehicle() -> Iterator[Vehicle]:
    vehicle = Vehicle()
    yield vehicle
    vehicle.close()


def qos_lines(capfd: pytest.CaptureFixture[str]) -> list[str]:
    return [line for line in capfd.readouterr().err.splitlines()
            if '[identifier_node]' in line and 'QoS' in line]


def incompatible(capfd: pytest.CaptureFixture[str]) -> list[str]:
    return [line for line in capfd.readouterr().err.splitlines() if 'a subscriber asks' in line]


@pytest.mark.parametrize('wanted, offered, missing', [
    ('sensor_data', best_effort(10), ''), ('sensor_data', reliable(10), ''),
    ('sensor_data', latched(), ''), ('reliable', reliable(10), ''), ('reliable', latched(), ''),
    ('transient_local', latched(), ''),
    ('reliable', best_effort(10), 'best effort'), ('transient_local', reliable(10), 'volatile'),
    ('transient_local', best_effort(10), ''),
])
def test_a_publisher_that_does_not_fit_is_told(
        wanted: str, offered: QoSProfile, missing: str, vehicle: Vehicle, messages: list[Raw],
        capfd: pytest.CaptureFixture[str]) -> None:
    vehicle.start({'position.qos': wanted})
    vehicle.advertise('/position', TYPES['/position'], offered)
    fits = not missing and not (wanted == 'transient_local' and offered.depth == 10)
    if fits:
        (raw, *_) = [raw for raw in messages if raw.topic == '/position']
        publisher = vehicle.peer.publishers['/position']
        vehicle.until(publisher.get_subscription_count)
        vehicle.spin()
        publisher.publish(raw.cdr)
        vehicle.spin()
        vehicle.node.finish()
        assert vehicle.node.stream.inputs['position'].count == 1
        assert not vehicle.node.stream.rejected
        assert 'QoS' not in capfd.readouterr().err
        return
    vehicle.until(lambda: vehicle.node.stream.rejected)
    assert vehicle.node.stream.rejected == {('position', 'incompatible_qos'): 1}
    told: list[str] = []
    vehicle.until(lambda: told.extend(qos_lines(capfd)) or told)
    (line,) = told
    assert 'position: the QoS of /peer does not fit' in line or 'on /position not heard' in line
    assert missing in line
    assert line.endswith('with qos: sensor_data every publisher is heard')

    vehicle.advertise('/position/again', TYPES['/position'], offered)  # of another topic
    vehicle.peer.publishers['/third'] = vehicle.peer.node.create_publisher(
        import_type(TYPES['/position']), '/position', offered)
    vehicle.until(lambda: vehicle.node.stream.rejected[('position', 'incompatible_qos')] == 2)
    vehicle.spin()
    assert not qos_lines(capfd)  # said once


def test_a_subscriber_that_does_not_fit_is_told(
        vehicle: Vehicle, capfd: pytest.CaptureFixture[str]) -> None:
    vehicle.start({})
    vehicle.peer.listen('/rov/estimate', DIAGNOSTIC_TYPE, latched())
    told: list[str] = []
    vehicle.until(lambda: told.extend(incompatible(capfd)) or told)
    (line,) = told
    assert '/rov/estimate: a subscriber asks for a durability' in line
    assert 'WARN' in line


def test_inputs_of_one_topic_are_told_together(vehicle: Vehicle) -> None:
    odometry = {'topic': '/odom', 'type': 'nav_msgs/msg/Odometry', 'field': 'pose.pose'}
    vehicle.start({
        'dofs': ['surge', 'yaw'], 'depth.topic': None, 'depth.type': None, 'depth.field': None,
        'attitude.qos': 'sensor_data', 'position.qos': 'transient_local',
        **{f'{name}.{key}': value for name in ('position', 'attitude')
           for key, value in odometry.items()}})
    vehicle.advertise('/odom', odometry['type'], best_effort(10))
    vehicle.until(lambda: len(vehicle.node.stream.rejected) == 2)
    assert vehicle.node.stream.rejected == {
        ('position', 'incompatible_qos'): 1, ('attitude', 'incompatible_qos'): 1}


def test_what_was_published_before_is_used_where_that_is_asked_for(vehicle: Vehicle) -> None:
    vehicle.advertise('/current', BULKY['thrusters.type'], latched())
    vehicle.peer.publishers['/current'].publish(Float64MultiArray(data=[1.0, 2.0, 3.0]))
    vehicle.start({**BULKY, 'thrusters.qos': 'transient_local'})
    vehicle.until(vehicle.peer.publishers['/current'].get_subscription_count)
    vehicle.spin()
    vehicle.node.finish()
    assert vehicle.node.stream.inputs['thrusters'].count == 1


def test_what_the_middleware_loses_is_counted(
        environment: dict[str, str], tmp_path: Path, repository: Path) -> None:
    """A flood without a guarantee, while the process is held up."""
    with ros_peer() as peer, starting(environment, tmp_path, repository) as start:
        health = peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
        node = start(BULKY)
        peer.advertise({'/current': BULKY['thrusters.type']}, best_effort(1))
        sent = 0

        def send(size: int) -> None:
            nonlocal sent
            peer.send('/current', Float64MultiArray(data=[0.0] * size))
            sent += 1

        send(3)  # a reader misses only what comes after its first
        peer.spin(0.5)
        node.process.send_signal(signal.SIGSTOP)
        for _ in range(200):
            send(50_000)
        node.process.send_signal(signal.SIGCONT)

        def lost() -> int:
            send(3)  # it may be lost as well
            return max((int(value.value) for message in health for status in message.status
                        for value in status.values if value.key.endswith('lost')), default=0)

        peer.until(lost)
        assert lost() < sent
