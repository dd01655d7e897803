"""The publishers of the node, each with the quality of service that its readers need."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
import time
from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    qos_policy_name_from_kind,
    QoSProfile,
    ReliabilityPolicy,
)
from rovid_core.identify.estimate import Estimate
from rovid_ros.node.transport.message_types import import_type
from rovid_ros.results.outputs import DIAGNOSTIC_TYPE, LATCHED, OF_STEPS, Output, Outputs

DEPTH = 1000  # messages that are kept for a slow peer, so that none of a burst is lost


def reliable(depth: int) -> QoSProfile:
    """Return a profile that keeps ``depth`` messages until they are acknowledged."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def latched(depth: int = 1) -> QoSProfile:
    """Return a profile that gives a late subscriber the last ``depth`` messages at once."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.TRANSIENT_LOCAL)


def best_effort(depth: int) -> QoSProfile:
    """Return a profile that fits every publisher, but asks for nothing to be sent again."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


class Publishers:
    """All that the node publishes: its outputs, and ``/diagnostics``."""

    def __init__(self, node: Node, outputs: Outputs) -> None:
        # by topic, one line about a subscriber that its quality of service does not suit
        self.incompatible: dict[str, str] = {}
        self._node = node
        self._outputs = outputs
        self._unsent: set[str] = set()
        self._publishers: dict[str, Publisher[Any]] = {}
        try:
            for topic, name in outputs.topics.items():
                profile = latched() if topic in LATCHED else reliable(DEPTH)
                self._add(topic, name, profile)
            self._add('/diagnostics', DIAGNOSTIC_TYPE, reliable(10))
        except BaseException:
            self.close()
            raise

    def publish(self, output: Output) -> None:
        """Send a message."""
        self._unsent.discard(output.topic)
        self._publishers[output.topic].publish(output.cdr)

    def publish_estimates(self, estimates: Sequence[Estimate]) -> None:
        """Send the topics of estimates that have subscribers."""
        if not estimates:
            return
        wanted = [topic for topic in self._outputs.topics
                  if self._publishers[topic].get_subscription_count()]
        for estimate in estimates:
            topics = wanted if estimate.stepped else [t for t in wanted if t not in OF_STEPS]
            for output in self._outputs.each(estimate, topics):
                self.publish(output)
        self._unsent.update(set(LATCHED).intersection(self._outputs.topics).difference(wanted))

    def publish_latched(self) -> None:
        """Send the latched topics that had no subscriber, for one that comes later."""
        for output in self._outputs.latched(sorted(self._unsent)):
            self.publish(output)

    def publish_initial(self) -> None:
        """Latch the initial parameters after a reset."""
        for output in self._outputs.reset():
            self.publish(output)

    def wait(self, timeout: float) -> None:
        """Wait until all subscribers have what was sent, at most ``timeout`` [s]."""
        end = time.monotonic() + timeout
        for publisher in self._publishers.values():
            left = max(0.0, end - time.monotonic())
            publisher.wait_for_all_acked(Duration(nanoseconds=round(left * 1e9)))

    def close(self) -> None:
        """Leave the graph."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)

    def _add(self, topic: str, name: str, profile: QoSProfile) -> None:
        events = PublisherEventCallbacks(incompatible_qos=partial(
            self._on_incompatible, self._node.resolve_topic_name(topic)))
        self._publishers[topic] = self._node.create_publisher(
            import_type(name), topic, profile, event_callbacks=events)

    def _on_incompatible(self, topic: str, event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
        text = (f'{topic}: a subscriber asks for a {policy} that is not offered and hears '
                f'nothing; it has to ask for less {policy}')
        if self.incompatible.get(topic) != text:
            self._node.get_logger().warning(text)
        self.incompatible[topic] = text
