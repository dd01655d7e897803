"""A configuration against the live graph: who publishes, and what comes within some seconds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
import time
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rovid_core.settings.run import Settings, SettingsError
from rovid_ros.commands.check_data import check_data, Findings, Observation
from rovid_ros.config.parameters import inputs_of, section
from rovid_ros.node.health.graph import graph_states, TopicState
from rovid_ros.node.transport.inputs import look_up, message_class, qos

NAME = 'rovid_check'


class LiveCheck:
    """
    Listen to a vehicle for some seconds; nothing is published.

    ``complete`` returns the settings with what a function finds that it calls. The namespace is
    that of the node that is going to run; relative topics are in it.
    """

    def __init__(self, complete: Callable[[Callable[[Settings], Mapping[str, Any]]], Settings],
                 findings: Findings, namespace: str = '') -> None:
        self._findings = findings
        self._broken: set[str] = set()
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context)
        self._node = Node(NAME, namespace=namespace, context=self._context,
                          enable_rosout=False, start_parameter_services=False)
        self._complete = complete

    def run(self, timeout: float) -> Observation:
        """Listen for ``timeout`` [s] and say what was found."""
        self._settings = self._complete(partial(look_up, self._node))
        self._seen = Observation(self._settings)
        for topic in self._seen.converter.topics:
            self._subscribe(topic)
        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self._node)
        end = time.monotonic() + timeout
        while (left := end - time.monotonic()) > 0.0:
            executor.spin_once(timeout_sec=left)
        states = graph_states(self._settings, self._node)
        executor.shutdown()
        self._seen.finish()
        for state in states.values():
            self._judge(state, timeout)
        check_data(self._seen, self._findings)
        return self._seen

    def close(self) -> None:
        """Leave the graph."""
        self._node.destroy_node()
        self._context.try_shutdown()

    def _subscribe(self, topic: str) -> None:
        try:
            cls = message_class(self._settings, self._seen.converter, topic)
        except SettingsError as error:
            self._findings.error(error.key, str(error).partition(': ')[2])
            self._broken.add(topic)
            return
        self._node.create_subscription(cls, topic, partial(self._on_message, topic, cls),
                                       qos(self._settings, topic), raw=True)

    def _on_message(self, topic: str, cls: type[Any], cdr: bytes) -> None:
        try:
            message = deserialize_message(cdr, cls)
        except RuntimeError:  # a peer with another definition
            for name in inputs_of(self._settings, topic):
                self._seen.stream.reject(name, 'undecodable')
            return
        self._seen.add_message(topic, message, self._node.get_clock().now().nanoseconds)

    def _judge(self, state: TopicState, timeout: float) -> None:
        """Say of one topic whether somebody publishes and whether that is heard."""
        names = ' and '.join(state.inputs)
        report = (self._findings.warning if state.inputs == ('reference',)
                  else self._findings.error)
        if state.topic in self._broken:
            return
        if state.problem:
            report(f'{section(state.inputs[0])}.topic', state.text, {
                'no_publisher': 'start what publishes it, or correct the topic',
                'type': 'correct topic or type', 'qos': 'set qos: sensor_data, or change the '
                'publisher'}.get(state.problem, ''))
        elif not any(one.count for (name, _), one in self._seen.samples.items()
                     if name in state.inputs) and not any(
                         name in state.inputs for name, _ in self._seen.stream.rejected):
            report(names, f'no messages on {state.name} within {timeout:g} s, though there '
                   f'{"is a publisher" if state.publishers == 1 else "are publishers"}')
        else:
            self._findings.ok(names, f'{state.name} {state.type}')
        if state.text and not state.problem:
            self._findings.warning(names, state.text)
