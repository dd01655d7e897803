"""The turns of a live node: inputs go straight to it, all else to an executor."""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Thread
import time
from typing import Any

import pytest

from test.support.live_node import changed, Peer, Raw, replayed, TYPES, WatchedStream

rclpy = pytest.importorskip('rclpy')

from rclpy.executors import SingleThreadedExecutor
from rclpy.publisher import Publisher
from rovid_ros.config.parameters import settings_from
from rovid_ros.node.node import IdentifierNode
from rovid_ros.node.process import WaitLoop
from rovid_ros.node.transport import inputs
from rovid_ros.node.transport.publishers import latched
from std_srvs.srv import SetBool


class Counting(SingleThreadedExecutor):
    """An executor that counts how often it is asked for work."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def wait_for_ready_callbacks(self, *arguments: Any, **named: Any) -> Any:
        self.count += 1
        return super().wait_for_ready_callbacks(*arguments, **named)


class Turning:
    """A node that has its turns in a thread, and its peer."""

    def __init__(self, changes: dict[str, Any]) -> None:
        self.node = IdentifierNode(changed(changes))
        self.peer = Peer()
        self.executor = Counting()
        self.executor.add_node(self.node)
        self.turns = 0
        self._ends = False
        self._guard = self.node.create_guard_condition(lambda: None)
        self._thread = Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        loop = WaitLoop(self.node, self.executor)
        while not self._ends:
            loop.wait_and_run()
            self.turns += 1

    def end(self) -> None:
        self._ends = True
        self._guard.trigger()
        self._thread.join()

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.peer.close()


@contextmanager
def turning(changes: dict[str, Any] | None = None) -> Iterator[Turning]:
    rclpy.init(args=[])
    run = Turning(changes or {})
    try:
        yield run
    finally:
        run.end()
        run.close()
        rclpy.shutdown()


def test_inputs_do_not_go_through_the_executor(
        messages: list[Raw], monkeypatch: pytest.MonkeyPatch) -> None:
    decoded: list[type[Any]] = []
    decode = inputs.deserialize_message

    def counted(cdr: bytes, cls: type[Any]) -> Any:
        decoded.append(cls)
        return decode(cdr, cls)

    monkeypatch.setattr(inputs, 'deserialize_message', counted)
    with turning() as run:
        received: list[Any] = []
        receive = run.node.stream.receive
        monkeypatch.setattr(run.node, 'stream', WatchedStream(
            run.node.stream, lambda event: (received.append(event), receive(event))[1]))
        run.peer.advertise(TYPES)
        before, turns = run.executor.count, run.turns
        for number in range(0, len(messages), 10):  # some at a time
            some = messages[:number + 10]
            run.peer.publish(some[number:])
            run.peer.until(lambda: len(received) == len(some))  # noqa: B023
        assert run.turns - turns > len(messages) / 20
        assert run.executor.count - before < len(messages) / 12  # timers
        run.end()
        run.node.finish()
        assert repr(run.node.stream.estimate) == repr(
            replayed(settings_from(changed({})), messages)[-1])
        # one of each, that its layout is learned from; the later ones are read without
        assert sorted(cls.__name__ for cls in decoded) == sorted(
            kind.rpartition('/')[2] for kind in TYPES.values())


def test_services_are_answered(messages: list[Raw]) -> None:
    with turning() as run:
        run.peer.advertise(TYPES)
        run.peer.publish(messages[:100])
        for adapt in (False, True):
            request = SetBool.Request(data=adapt)
            answer = run.peer.call(SetBool, '/identifier_node/enable', request)
            assert answer.success
            assert run.node.stream.adapting is adapt


def test_a_subscriber_that_does_not_fit_is_told(capfd: pytest.CaptureFixture[str]) -> None:
    with turning() as run:
        run.peer.listen('/rov/velocity', 'geometry_msgs/msg/TwistStamped', latched())
        told = ''

        def is_told() -> bool:
            nonlocal told
            told += capfd.readouterr().err
            return '/rov/velocity: a subscriber asks for' in told

        run.peer.until(is_told)


def test_nothing_is_polled() -> None:
    with turning({'autostart': False}) as run:  # no timer yet
        counts = []
        while len(counts) < 2 or (counts[-1] != counts[-2] and len(counts) < 10):
            time.sleep(0.5)
            counts.append(run.turns)
        assert counts[-1] == counts[-2] < 20  # something may come of the start


def test_subscriptions_come_and_go(messages: list[Raw]) -> None:
    with turning({'autostart': False}) as run:
        assert list(run.node.input_subscriptions) == []
        run.end()
        assert run.node.trigger_configure().name == run.node.trigger_activate().name == 'SUCCESS'
        assert {one.topic_name for one in run.node.input_subscriptions} == set(TYPES)
        run.node.trigger_deactivate()
        assert list(run.node.input_subscriptions) == []


def test_a_lost_subscriber_costs_nothing(
        messages: list[Raw], monkeypatch: pytest.MonkeyPatch) -> None:
    """Latched topics that nobody hears are sent once a second, not with every step."""
    with turning() as run:
        run.end()
        sent: list[str] = []
        publish = Publisher.publish

        def noted(publisher: Any, message: Any) -> None:
            if publisher.topic_name.startswith('/rov/'):
                sent.append(publisher.topic_name)
            publish(publisher, message)

        monkeypatch.setattr(Publisher, 'publish', noted)
        run.peer.advertise(TYPES)
        run.peer.publish(messages)
        run.peer.until(lambda: run.node.receive() or run.node.stream.inputs['position'].count > 50)
        assert sent == []
        for _ in range(2):
            for timer in run.node.timers:
                timer.callback()
        assert sent == ['/rov/model', '/rov/params', '/rov/params_std']
