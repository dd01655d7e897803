"""Whatever is asked of the node's parameters, and whatever bytes come, it goes on."""

from collections.abc import Iterator
import os
import random
from typing import Any

from hypothesis import given, HealthCheck, settings, strategies as st
import pytest

rclpy = pytest.importorskip('rclpy')

from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rovid_ros.config.keys import KEYS
from rovid_ros.node.node import IdentifierNode

from test.support.live_node import changed, Peer, Raw, simulated, TYPES

EXAMPLES = int(os.environ.get('ROVID_EXAMPLES', '100'))

many = settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=[
    HealthCheck.too_slow, HealthCheck.function_scoped_fixture])

numbers = st.one_of(st.floats(0.0, 10.0), st.floats(), st.sampled_from([1e308, -1e308, 5e-324]))
whole = st.integers(-2**63, 2**63 - 1)
values = st.one_of(
    numbers, whole, st.booleans(), st.text(max_size=10), st.lists(numbers, max_size=12),
    st.lists(st.booleans(), max_size=3), st.lists(whole, max_size=12),
    st.lists(st.text(max_size=5), max_size=4),
    st.sampled_from(['aid', 'ekf', 'heun', 'surge', '/position', 'point']))
parameters = st.lists(st.tuples(st.sampled_from([key.name for key in KEYS]), values),
                      min_size=1, max_size=5)


class Running:
    """A node that hears over DDS, and its peer."""

    def __init__(self, messages: list[Raw]) -> None:
        self.node = IdentifierNode(changed({'max_wait': 0.1, 'max_gap': 1.0}))
        self.peer = Peer()
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.peer.advertise(TYPES)
        self._messages = iter(messages)
        self.steps = self.peer.listen('/rov/params', 'std_msgs/msg/Float64MultiArray')

    def go_on(self, count: int) -> None:
        """Send the next messages and let the node take them."""
        for raw, _ in zip(self._messages, range(count)):
            self.peer.send(raw.topic, raw.cdr)
        for _ in range(5):
            self.executor.spin_once(timeout_sec=0.0)

    def close(self) -> None:
        """Leave the graph."""
        self.executor.shutdown()
        self.node.destroy_node()
        self.peer.close()


@pytest.fixture(scope='module')
def messages(tmp_path_factory: pytest.TempPathFactory) -> list[Raw]:
    return simulated(tmp_path_factory.mktemp('log') / 'simulated.mcap', 60.0)


@pytest.fixture
def running(messages: list[Raw]) -> Iterator[Running]:
    rclpy.init(args=[])
    run = Running(messages)
    yield run
    run.close()
    rclpy.shutdown()


def assert_it_steps(run: Running) -> None:
    """Expect steps of good messages."""
    run.node.stream.reset()
    before = run.node.stream.estimate
    for _ in range(20):
        run.go_on(10)
    run.peer.until(lambda: run.executor.spin_once(timeout_sec=0.0)
                   or run.node.stream.estimate is not before)


@many
@given(changes=st.lists(parameters, min_size=1, max_size=3), atomically=st.booleans())
def _ask(changes: list[list[tuple[str, Any]]], atomically: bool, run: Running) -> None:
    for asked in changes:
        made = [Parameter(name, value=value) for name, value in asked]
        results = [run.node.set_parameters_atomically(made)] if atomically \
            else run.node.set_parameters(made)
        assert all(result.successful or result.reason for result in results)
        run.go_on(2)


def test_any_parameters(running: Running, messages: list[Raw]) -> None:
    running.go_on(100)
    _ask(run=running)
    assert 'surge' in running.node.settings.dofs
    assert_it_steps(running)


def test_any_bytes_on_the_topics(running: Running, messages: list[Raw]) -> None:
    generator = random.Random(1)
    examples = {raw.topic: raw.cdr for raw in messages[:100]}
    for count in range(EXAMPLES):
        topic = generator.choice(sorted(examples))
        cdr = bytearray(examples[topic])
        if count % 2:
            cdr = bytearray(generator.randbytes(generator.randrange(1, 200)))
        for _ in range(generator.randrange(1, 5)):
            place = generator.randrange(len(cdr))
            cdr[place:place + 4] = generator.choice(
                [4 * b'\xff', b'\xff\xff\xff\x7f', bytes(4), generator.randbytes(4), b''])
            cdr = cdr or bytearray(b'\0')
        running.peer.send(topic, bytes(cdr))
        running.go_on(1)
    assert_it_steps(running)
    assert running.node.stream.rejected
