"""What the tests of the node share: recorded messages, a peer, and a way to start the node."""

from collections.abc import Iterator
from pathlib import Path

import pytest

rclpy = pytest.importorskip('rclpy')

from test.support.live_drive import ros_peer, Start, starting
from test.support.live_node import Peer, Raw, simulated


@pytest.fixture(scope='session')
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a simulated log of 12 s."""
    path = tmp_path_factory.mktemp('log') / 'simulated.mcap'
    simulated(path)
    return path


@pytest.fixture(scope='session')
def messages(log: Path) -> list[Raw]:
    """Return the messages of the log, in order."""
    return simulated(log.with_name('again.mcap'))


@pytest.fixture
def ros() -> Iterator[None]:
    """Start ROS in this process, for nodes of its own."""
    rclpy.init(args=[])
    yield
    rclpy.shutdown()


@pytest.fixture
def peer() -> Iterator[Peer]:
    """Start ROS in this process, with a peer of the node."""
    with ros_peer() as peer:
        yield peer


@pytest.fixture
def start(environment: dict[str, str], tmp_path: Path, repository: Path) -> Iterator[Start]:
    """Return a function that starts the node as a process with changed parameters."""
    with starting(environment, tmp_path, repository) as start:
        yield start
