"""What the live tests share: the node started and stopped, a vehicle driven, a record replayed."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import math
from pathlib import Path
import subprocess
import sys
import time
from typing import Any

from geometry_msgs.msg import PointStamped
import rclpy
from rovid_ros.commands.main import main
from rovid_ros.logs.log import Log
from sensor_msgs.msg import Imu
from std_msgs.msg import Float64MultiArray

from test.support.live_node import (
    changed,
    heard,
    NodeProcess,
    Peer,
    Raw,
    Status,
    TYPES,
    write_parameters,
)
from test.support.processes import REPOSITORY

UNSTAMPED: dict[str, Any] = {
    'dofs': ['surge', 'yaw'], 'depth.topic': None, 'depth.type': None, 'depth.field': None,
    'max_wait': 0.2, 'thrusters.type': 'std_msgs/msg/Float64MultiArray',
    'thrusters.field': 'data', 'thrusters.names': None}
"""Changes for a vehicle whose commands have no stamp, which ``drive`` drives."""
UNSTAMPED_TYPES = {'/position': TYPES['/position'], '/imu': TYPES['/imu'],
                   '/current': UNSTAMPED['thrusters.type']}

Start = Callable[..., NodeProcess]


@contextmanager
def ros_peer() -> Iterator[Peer]:
    """Start ROS in this process, with a peer."""
    rclpy.init(args=[])
    peer = Peer()
    try:
        yield peer
    finally:
        peer.close()
        rclpy.shutdown()


@contextmanager
def starting(environment: dict[str, str], folder: Path, repository: Path) -> Iterator[Start]:
    """Give a function that starts the node with changed parameters."""
    started = []

    def begin(changes: dict[str, Any] | None = None, *arguments: str,
              name: str = 'parameters') -> NodeProcess:
        own = folder / name
        own.mkdir(exist_ok=True)
        file = write_parameters(own / 'parameters.yaml', changed(changes or {}))
        started.append(NodeProcess(
            ['--ros-args', '--params-file', file, *arguments], environment, own, repository))
        return started[-1]

    try:
        yield begin
    finally:
        for node in started:
            node.kill()
            print(node.output)  # for who reads why a test failed


def running(peer: Peer, start: Start, messages: Sequence[Raw], changes: dict[str, Any]
            ) -> tuple[NodeProcess, list[Any]]:
    """Start a node that takes messages; return it and what it says of its steps, some of them."""
    estimates = peer.listen_to_steps()
    node = start(changes)
    peer.advertise(TYPES)
    peer.publish(messages)
    peer.deliver()  # a node that has to wait for the computer is silent, too
    peer.settle(estimates, 50)
    return node, estimates


def assert_same(got: list[list[Status]], expected: list[list[Status]]) -> None:
    assert len(got) == len(expected)
    for number, (one, other) in enumerate(zip(got, expected)):
        assert one == other, f'message {number}'


def replayed_record(record: Path, values: dict[str, Any],
                    environment: dict[str, str] | None = None,
                    options: Sequence[str] = ()) -> list[list[Status]]:
    """Return what ``rovid replay`` makes of a record; with an environment, ``--ros`` in it."""
    file = write_parameters(record.with_suffix('.yaml'), values)
    output = record.with_suffix('.output.mcap')
    arguments = ['replay', str(record), '--params-file', str(file), '--output', str(output),
                 *options]
    if environment is None:
        assert main(arguments) == 0
    else:  # ROS begins only once in a process
        subprocess.run([sys.executable, '-m', 'rovid_ros.commands', *arguments, '--ros'],
                       env=environment, cwd=REPOSITORY, check=True)
    with Log([output]) as log:
        return heard(message.data for message in log.messages(['/rov/estimate']))


def drive(peer: Peer, duration: float) -> None:
    """
    Publish sensors 50 times a second at the true time, as many on a busy machine.

    Positions come 50 ms late, commands have no stamp.
    """
    for tick in range(1, round(50.0 * duration) + 1):
        now = time.time_ns()
        phase = 2e-9 * (now % 10**12)
        if tick % 5 == 0:
            fix = PointStamped()
            stamp(fix, now - 50_000_000)
            fix.point.x = 0.3 * math.sin(phase)
            peer.send('/position', fix)
        imu = Imu()
        stamp(imu, now)
        imu.orientation.z = math.sin(0.1 * math.cos(phase))
        imu.orientation.w = math.cos(0.1 * math.cos(phase))
        peer.send('/imu', imu)
        peer.send('/current', Float64MultiArray(data=[math.sin(phase), 0.5, 0.0]))
        peer.spin(0.02)


def stamp(message: Any, now: int) -> None:
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 10**9)
