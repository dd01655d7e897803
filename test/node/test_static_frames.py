"""Static transforms that a node looks up once."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import TransformStamped
import rclpy
from rovid_ros.logs.log import Log, RECORD
from rovid_ros.logs.static_frames import StaticFrames, TYPE
from rovid_ros.node.transport.inputs import take_latched
from rovid_ros.node.transport.message_types import import_type, MessageTypeError
from rovid_ros.node.transport.publishers import latched

from test.support.live_drive import Start
from test.support.live_node import Peer, Raw, TYPES
from test.support.processes import PATIENCE

CHANGES = {'position.sensor_frame': 'usbl', 'attitude.sensor_frame': 'imu'}
KEY = 'position.lever_arm'


def transform(parent: str, child: str, x: float) -> Any:
    message = TransformStamped()
    message.header.frame_id, message.child_frame_id = parent, child
    message.transform.translation.x = x
    return message


def is_installed() -> bool:
    try:
        import_type(TYPE)
    except MessageTypeError:
        return False
    return True


def test_what_was_published_before_and_what_comes_later_is_taken(peer: Peer) -> None:
    """Several publishers have each a message that is kept, as those of /tf_static have."""
    node = rclpy.create_node('late')
    publishers = [peer.node.create_publisher(TransformStamped, '/kept', latched())
                  for _ in range(2)]
    own = list(node.subscriptions)
    frames = StaticFrames()

    def add(message: Any) -> None:
        frames.add(SimpleNamespace(transforms=[message]))
        if message.child_frame_id == 'bracket':  # the other one begins only now
            publishers[1].publish(transform('bracket', 'usbl', 0.5))

    try:
        publishers[0].publish(transform('base_link', 'bracket', 0.25))
        take_latched(node, TransformStamped, '/kept', add,
                     lambda: frames.knows(['usbl'], 'base_link'), PATIENCE, lambda: False)
        assert frames.values({KEY: 'usbl'}, 'base_link', '') == {KEY: [0.75, 0.0, 0.0]}
        # what never comes is not waited for without end, and nothing is left behind
        take_latched(node, TransformStamped, '/kept', str, lambda: False, 0.1, lambda: False)
        # nor once the node is asked to end
        take_latched(node, TransformStamped, '/kept', str, lambda: False, math.inf, lambda: True)
        assert list(node.subscriptions) == own
    finally:
        node.destroy_node()


@pytest.mark.skipif(is_installed(), reason='tf2_msgs is installed')
def test_where_tf2_is_not_installed_it_is_said(start: Start) -> None:
    node = start(CHANGES)
    assert node.wait() == 1
    line = node.output.strip()
    assert '\n' not in line
    assert 'position.sensor_frame: message type tf2_msgs/msg/TFMessage is not installed' in line


@pytest.mark.skipif(not is_installed(), reason='tf2_msgs is not installed')
def test_a_node_takes_lever_arm_and_mounting_from_tf_static(
        messages: list[Raw], peer: Peer, start: Start, tmp_path: Path) -> None:
    publisher = peer.node.create_publisher(import_type(TYPE), '/tf_static', latched())
    record = tmp_path / 'record.mcap'
    node = start({**CHANGES, 'record.path': str(record)})
    publisher.publish(import_type(TYPE)(transforms=[
        transform('base_link', 'usbl', 0.75), transform('base_link', 'imu', 0.0)]))
    estimates = peer.listen_to_steps()
    peer.advertise(TYPES)
    peer.publish(messages[:300])
    peer.settle(estimates, 100)
    assert node.stop() == 0
    assert f'{KEY}: [0.75, 0.0, 0.0] from /tf_static' in node.output
    with Log([record]) as log:
        assert '0.75' in log.metadata[RECORD]['found']


def test_a_node_that_is_given_all_looks_nothing_up(peer: Peer, start: Start) -> None:
    node = start({**CHANGES, KEY: [0.1, 0.0, 0.0], 'attitude.mounting': [0.0, 0.0, 0.1]})
    peer.until(lambda: 'activated' in node.output)
    assert node.stop() == 0
