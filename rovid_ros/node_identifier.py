"""The live node: subscriptions in, the pipe, publishers out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
import heapq
from pathlib import Path
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rovid_core.pipe import Scorer
from rovid_core.settings import Settings, SettingsError
from rovid_core.stream import Stream
from rovid_core.values import Estimate, Event
from rovid_ros.convert import Converter, FieldError
from rovid_ros.message_types import LARGEST_MESSAGE
from rovid_ros.node_checkpoint import Checkpoint
from rovid_ros.node_diagnostics import diagnostics
from rovid_ros.node_inputs import inputs_of, message_classes, Subscriptions
from rovid_ros.node_messages import definition
from rovid_ros.node_parameters import declare, NODE_NAME, ros_own
from rovid_ros.node_publishers import Publishers
from rovid_ros.node_recorder import Received, Recorder
from rovid_ros.outputs import Outputs
from rovid_ros.parameters import check, settings_from
from std_srvs.srv import SetBool, Trigger


class IdentifierNode(Node):
    """
    The identifier as a ROS 2 node.

    Parameters
    ----------
    values : mapping, optional
        Parameters by dotted key, as a parameter file gives them; ``-p`` overrides win.
    live : bool
        False: no subscriptions, no recording and no checkpoint; the owner feeds it.
    scorer : Scorer, optional
        Told every step.

    Attributes
    ----------
    settings, stream, converter
        What the node runs.

    Raises
    ------
    ValueError
        If a parameter, a message type or a field path is wrong, or a file cannot be
        written; one line.

    """

    def __init__(self, values: Mapping[str, Any] | None = None, *, live: bool = True,
                 scorer: Scorer | None = None) -> None:
        given = dict(values or {})
        super().__init__(NODE_NAME, parameter_overrides=ros_own(given))
        try:
            given.update((name, p.value) for name, p in self._parameter_overrides.items())
            if not given:
                raise SettingsError(
                    'dofs', 'no parameters at all; give --ros-args --params-file FILE')
            settings = settings_from(given)
            if not live:
                settings = replace(settings, record_path='', checkpoint_path='')
            self._prepare(settings, live, scorer)
            declare(self, check(given))
            self._open()
        except BaseException:
            self.destroy_node()
            raise

    def _prepare(self, settings: Settings, live: bool, scorer: Scorer | None) -> None:
        """Make everything that can be refused; nothing is visible outside yet."""
        self.settings = settings
        self._recorder = Recorder(
            Path(settings.record_path), definition,
            self.get_logger().error) if settings.record_path else None
        self.stream = Stream(settings, recorder=self._recorder, scorer=scorer)
        self.converter = Converter(settings, self.stream.reject)
        self._classes = message_classes(settings, self.converter) if live else {}
        self._outputs = Outputs(settings)
        self._checkpoint = Checkpoint(settings, self.stream, self.get_logger())
        restored = self._checkpoint.restore()
        if self._recorder:
            self._recorder.open(restored)
            self.get_logger().info(f'recording to {self._recorder.path}')

    def _open(self) -> None:
        """Appear in the graph."""
        self._out = Publishers(self)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self._each_second, clock=steady)
        if self.settings.checkpoint_path:
            self.create_timer(self.settings.checkpoint_period, self._each_period, clock=steady)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(SetBool, '~/enable', self._on_enable)
        self.create_service(Trigger, '~/save', self._on_save)
        self._in = Subscriptions(
            self, self.settings, self._classes, self.converter.topics, self._take)
        self._introduce()

    def feed(self, topic: str, message: Any, receive_time: int) -> list[Estimate]:
        """
        Take a message and publish the estimates that it releases.

        Parameters
        ----------
        topic : str
            As configured.
        message : object
            Of rclpy or of rosbags.
        receive_time : int
            When it came [ns].

        Returns
        -------
        estimates : list of Estimate
            What was published.

        """
        return self._publish(self._events(topic, message, receive_time))

    def control(self, name: str, value: str) -> list[Estimate]:
        """Do again what a service call did when a log was recorded; publish and return."""
        estimates = self._tell(self.stream.control(name, value))
        if name == 'reset':
            self._show_initial()
        return estimates

    def finish(self) -> list[Estimate]:
        """Publish what is held, save the state and end the record; for the end of a run."""
        self._in.drain()
        estimates = self._tell(self.stream.finish())
        if self.settings.checkpoint_path:
            self._checkpoint.save()
        if self._recorder:
            self._recorder.close()
        self._out.wait(1.0)
        return estimates

    def _take(self, batch: dict[str, list[Received]]) -> None:
        """Take what has come, the oldest data of all topics first."""
        queues = [[event for received in messages for event in self._decoded(received)]
                  for messages in batch.values()]
        self._publish(heapq.merge(*queues, key=lambda event: event.time))

    def _decoded(self, received: Received) -> list[Event]:
        topic = received.topic
        if len(received.cdr) > LARGEST_MESSAGE:
            for name in inputs_of(self.settings, topic):
                self.stream.reject(name, 'too_large')
            return []
        try:
            message = deserialize_message(received.cdr, self._classes[topic])
            return self._events(
                topic, message, received.time, received if self._recorder else None)
        except (RuntimeError, FieldError) as error:  # a peer with another definition
            self.get_logger().error(f'{topic}: {error}', once=True)
            for name in inputs_of(self.settings, topic):
                self.stream.reject(name, 'undecodable')
            return []

    def _events(self, topic: str, message: Any, receive_time: int,
                origin: Any = None) -> list[Event]:
        events = self.converter.events(topic, message, receive_time, origin)
        if receive_time:
            return events
        for event in events:  # simulated time has not begun: there is no time to give it
            if event.time <= 0:
                for sample in event.samples:
                    self.stream.reject(sample.input, 'no_clock')
        return [event for event in events if event.time > 0]

    def _publish(self, events: Iterable[Event]) -> list[Estimate]:
        return self._tell([
            estimate for event in events for estimate in self.stream.receive(event)])

    def _tell(self, estimates: list[Estimate]) -> list[Estimate]:
        for estimate in estimates:
            for output in self._outputs.messages(estimate):
                self._out.publish(output)
        for line in self.stream.take_warnings():
            self.get_logger().warning(line)
        return estimates

    def _on_reset(self, request: Trigger.Request,
                  response: Trigger.Response) -> Trigger.Response:
        self.stream.reset()
        self._show_initial()
        response.success, response.message = True, 'back at the initial values'
        self.get_logger().info(f'~/reset: {response.message}')
        return response

    def _on_enable(self, request: SetBool.Request,
                   response: SetBool.Response) -> SetBool.Response:
        self.stream.enable(request.data)
        response.success = True
        response.message = 'adapting' if request.data else 'frozen'
        self.get_logger().info(f'~/enable: {response.message}')
        return response

    def _on_save(self, request: Trigger.Request,
                 response: Trigger.Response) -> Trigger.Response:
        failed = self._checkpoint.save()
        response.success = not failed
        response.message = failed or f'saved to {self._checkpoint.path}'
        self.get_logger().info(f'~/save: {response.message}')
        return response

    def _show_initial(self) -> None:
        """Let the latched parameters be those that a reset went back to."""
        for output in self._outputs.reset():
            self._out.publish(output)

    def _each_second(self) -> None:
        now = self.get_clock().now().nanoseconds
        self._out.publish(diagnostics(
            self.stream, self.settings, self.get_fully_qualified_name(), now))
        if self._recorder:
            self._recorder.flush()

    def _each_period(self) -> None:
        self._checkpoint.save()

    def _introduce(self) -> None:
        log = self.get_logger()
        for topic, type_name in self.converter.topics.items():
            names = ' and '.join(inputs_of(self.settings, topic))
            log.info(f'{names}: {self.resolve_topic_name(topic)} ({type_name})')
        for dof in self.settings.dofs:
            log.info(f'{dof}: velocity from {self.settings.source(dof)}')
        self._tell([])  # the warnings so far
