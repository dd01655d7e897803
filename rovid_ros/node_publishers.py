"""The publishers of the node, each with the quality of service that its readers need."""

from __future__ import annotations

import time
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rovid_ros.node_messages import fill, import_type
from rovid_ros.outputs import DIAGNOSTIC_TYPE, LATCHED, Output, TOPICS

DEPTH = 1000
"""Messages that are kept for a slow peer, so that none of a burst is lost."""


def reliable(depth: int) -> QoSProfile:
    """Return a profile that keeps ``depth`` messages until they are acknowledged."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth,
                      reliability=ReliabilityPolicy.RELIABLE)


def latched() -> QoSProfile:
    """Return a profile that gives a late subscriber the last message at once."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1,
                      reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.TRANSIENT_LOCAL)


def best_effort(depth: int) -> QoSProfile:
    """Return a profile that takes every publisher, but nothing twice."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth,
                      reliability=ReliabilityPolicy.BEST_EFFORT)


class Publishers:
    """
    All that the node publishes.

    Parameters
    ----------
    node : Node
        Owns the publishers.

    """

    def __init__(self, node: Node) -> None:
        self._publishers: dict[str, tuple[type[Any], Publisher[Any]]] = {}
        for topic, name in TOPICS.items():
            profile = latched() if topic in LATCHED else reliable(DEPTH)
            self._add(node, topic, name, profile)
        self._add(node, '/diagnostics', DIAGNOSTIC_TYPE, reliable(10))

    def publish(self, output: Output) -> None:
        """Send a message."""
        cls, publisher = self._publishers[output.topic]
        publisher.publish(fill(cls, output.fields))

    def wait(self, timeout: float) -> None:
        """Wait until all subscribers have what was sent, at most ``timeout`` [s]."""
        end = time.monotonic() + timeout
        for _, publisher in self._publishers.values():
            left = max(0.0, end - time.monotonic())
            publisher.wait_for_all_acked(Duration(nanoseconds=round(left * 1e9)))

    def _add(self, node: Node, topic: str, name: str, profile: QoSProfile) -> None:
        cls = import_type(name)
        self._publishers[topic] = (cls, node.create_publisher(cls, topic, profile))
