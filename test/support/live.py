"""What talks to the node over DDS; for the live benchmarks and tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
import re
import time
from typing import Any

from rcl_interfaces.srv import ListParameters
import rclpy
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rovid_ros.node.transport.message_types import import_type
from rovid_ros.node.transport.publishers import reliable
import yaml

from test.support.processes import PATIENCE

Status = tuple[str, int, str, dict[str, str]]

PARTICIPANT = 12
"""[bytes] How much of the identifier of a publisher or subscription names its process."""

CLIENTS = 6
"""Clients that a call may take: once in thousands of times, one does not find its service."""


@dataclass(frozen=True)
class Raw:
    """A message as it is on the wire."""

    topic: str
    type: str
    cdr: bytes
    time: int


def write_parameters(path: Path, values: dict[str, Any]) -> Path:
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}))
    return path


def heard(messages: Iterable[Any]) -> list[list[Status]]:
    """Return the statuses of messages, of rclpy or out of a log."""
    return [[(status.name, level(status.level), status.message,
              {entry.key: entry.value for entry in status.values})
             for status in message.status] for message in messages]


def made_step(values: Mapping[str, str]) -> bool:
    """Tell whether the values of a status say that its DOF has made a step."""
    return values['updated'] == 'true'


def level(value: Any) -> int:
    return value[0] if isinstance(value, bytes) else value


def rejected_in(message: Any) -> dict[str, int]:
    """Return the counts of refused samples and steps in a message of ``/diagnostics``."""
    return {entry.key: int(entry.value) for status in message.status for entry in status.values
            if re.fullmatch(r'[a-z_]+\.[a-z_]+', entry.key) and entry.value.isdigit()}


class Peer:
    """The rest of the vehicle: publishes sensors, listens to the node, calls services."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('peer')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.publishers: dict[str, Any] = {}
        self._tapped: set[str] = set()

    def listen(self, topic: str, type_name: str, qos: QoSProfile | None = None, *,
               raw: bool = False) -> list[Any]:
        """Subscribe; the list grows with what comes, as it was on the wire if ``raw``."""
        messages: list[Any] = []
        self.tap(topic, type_name, messages.append, qos, raw=raw)
        return messages

    def listen_to_steps(self, topic: str = '/rov/estimate') -> list[Any]:
        """Subscribe to the estimates of steps, which alone are in a replay too."""
        messages: list[Any] = []

        def take(message: Any) -> None:
            if any(made_step(values) for _, _, _, values in heard([message])[0]):
                messages.append(message)

        self.tap(topic, 'diagnostic_msgs/msg/DiagnosticArray', take, raw=False)
        return messages

    def tap(self, topic: str, type_name: str, take: Callable[[Any], object],
            qos: QoSProfile | None = None, *, raw: bool = True) -> None:
        """Subscribe; ``take`` gets each message as it comes."""
        self._tapped.add(topic)
        self.node.create_subscription(
            import_type(type_name), topic, take, qos or reliable(10_000), raw=raw)

    def advertise(self, types: Mapping[str, str], qos: QoSProfile | None = None) -> None:
        """
        Make the publishers and wait until each has found the node.

        What a node publishes is found apart from what it listens to, and may be found after it:
        then its first estimates would be lost.
        """
        self.until(lambda: all(map(self.node.count_subscribers, types)))  # as _is_there says
        self.until(lambda: all(map(self.node.count_publishers, self._tapped)))
        for topic, type_name in types.items():
            self.publishers[topic] = self.node.create_publisher(
                import_type(type_name), topic, qos or reliable(10_000))
        self.until(lambda: all(
            p.get_subscription_count() for p in self.publishers.values()))
        # an endpoint may be found before its node has a name, and one of a node that has just
        # ended be known a little longer, at last without its name
        hearers: set[str] = set()

        def named() -> bool:
            hearers.clear()
            hearers.update(self._others(types))
            return all(map(self._is_there, hearers))

        self.until(named)
        for name in hearers:
            self._greet(name)

    def publish(self, messages: Iterable[Raw]) -> None:
        for raw in messages:
            self.send(raw.topic, raw.cdr)

    def deliver(self) -> None:
        """Wait until all that was published has arrived, if it was not yet looked at."""
        for publisher in self.publishers.values():
            assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE))

    def send(self, topic: str, message: Any) -> None:
        """Publish one message, an object or its bytes."""
        self.publishers[topic].publish(message)

    def call(self, service: type[Any], name: str, request: Any = None) -> Any:
        owner = name.rpartition('/')[0]
        self.until(lambda: self._is_there(owner))
        for _ in range(CLIENTS):
            client = self.node.create_client(service, name)
            self._greet(owner)  # which then has found this client, too
            if self._waited(client.service_is_ready, PATIENCE / CLIENTS):
                break
            self.node.destroy_client(client)
        else:
            raise AssertionError(f'{name} was not found')
        future = client.call_async(request or service.Request())
        self.until(future.done)
        self.node.destroy_client(client)
        return future.result()

    def _greet(self, name: str) -> None:
        """
        Wait until a node that was found has found all that this one has, or is gone.

        A node may find a client seconds after the client found the node, and until then it throws
        its answers away. What a process has is told in the order in which it was made: who
        answers a client has found all that is older. The question can be asked again. The client
        stays, because a late answer that reaches nobody is a warning in the output of the node.
        """
        client = self.node.create_client(ListParameters, f'{name}/list_parameters')
        self.until(lambda: client.service_is_ready() or not self._is_there(name))
        answers: list[Any] = []
        end = time.monotonic() + PATIENCE
        while self._is_there(name) and not any(answer.done() for answer in answers):
            assert time.monotonic() < end, f'{name} is silent'
            answers.append(client.call_async(ListParameters.Request()))
            again = time.monotonic() + 0.1
            while time.monotonic() < again and not any(answer.done() for answer in answers):
                self.executor.spin_once(timeout_sec=0.02)

    def _is_there(self, name: str) -> bool:
        """
        Tell whether this node has found another one.

        What is made before two processes have found each other is told to the other one with
        the next heartbeat only, up to 3 s later; what is made after that, at once.
        """
        return tuple(name.rpartition('/')[::-2]) in (
            (other, space.rstrip('/'))
            for other, space in self.node.get_node_names_and_namespaces())

    def _others(self, topics: Iterable[str]) -> set[str]:
        """Return the nodes of other processes that hear topics of this one."""
        graph = self.node
        hearers = [one for topic in topics for one in graph.get_subscriptions_info_by_topic(topic)]
        own = next(one for one in graph.get_publishers_info_by_topic(next(iter(topics)))
                   if one.node_name == graph.get_name())
        return {f'{one.node_namespace.rstrip("/")}/{one.node_name}' for one in hearers
                if one.endpoint_gid[:PARTICIPANT] != own.endpoint_gid[:PARTICIPANT]}

    def until(self, condition: Callable[[], Any], timeout: float = PATIENCE) -> None:
        """Spin until the condition holds."""
        assert self._waited(condition, timeout), 'waited in vain'

    def _waited(self, condition: Callable[[], Any], timeout: float) -> bool:
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            self.executor.spin_once(timeout_sec=0.02)
        return True

    def spin(self, duration: float) -> None:
        end = time.monotonic() + duration
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def settle(self, messages: list[Any], least: int = 0) -> None:
        """Spin until there are ``least`` messages and nothing more comes."""
        self.until(lambda: len(messages) >= least)
        count = -1
        while count != len(messages):
            count = len(messages)
            self.spin(0.3)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
