"""The topics that the node subscribes to: their inputs, message classes, QoS, messages."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import time
from typing import Any

from rclpy.clock import ROSClock
from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.validate_topic_name import validate_topic_name
from rovid_core.settings.run import Settings, SettingsError
from rovid_ros.config.input_topics import inputs_of, section
from rovid_ros.messages.convert import Converter
from rovid_ros.node.recorder import Received
from rovid_ros.node.transport.backlog import Backlog
from rovid_ros.node.transport.message_classes import import_type, MessageTypeError
from rovid_ros.node.transport.publishers import best_effort, DEPTH, latched, reliable

SHARE = 0.3
"""Of the timeout of an input: messages that are further apart are never left out."""


def message_classes(settings: Settings, converter: Converter) -> dict[str, type[Any]]:
    """Import the message class of every topic; raises as :func:`message_class`."""
    return {topic: message_class(settings, converter, topic) for topic in converter.topics}


def message_class(settings: Settings, converter: Converter, topic: str) -> type[Any]:
    """
    Import the message class of a topic and check the field paths against it.

    Raises
    ------
    SettingsError
        If the topic's name is not one, or its type is not given or not installed.
    FieldError
        If the type does not have a configured field.

    """
    name = converter.topics[topic]
    key = section(inputs_of(settings, topic)[0])
    try:
        validate_topic_name(topic)
    except InvalidTopicNameException as error:
        reason = str(error).partition(':')[0]
        raise SettingsError(f'{key}.topic', f'got {topic!r}: {reason}') from None
    if not name:
        raise SettingsError(f'{key}.type', f'is required to subscribe to {topic}')
    try:
        cls = import_type(name)
    except MessageTypeError as error:
        raise SettingsError(f'{key}.type', str(error)) from None
    converter.check_type(topic, cls())
    return cls


class Subscriptions:
    """
    One subscription per topic.

    After a stall, an executor would take one message of each topic in turn, and the slow
    topics would run ahead of the fast ones in event time. So when one message is there, all
    that wait behind it and on the other topics are taken at once. Where even so the node stays
    behind, whole fixes are left out.

    Parameters
    ----------
    node : Node
        Owns the subscriptions; its clock gives the receive time where it is simulated.
    settings : Settings
        The quality of service of the inputs.
    classes : dict
        Message class by topic.
    take : callable
        Gets what has come, by topic, each topic's messages in order of arrival.
    reject : callable
        Told input and reason of what the middleware did not deliver: ``lost`` for every
        message, ``incompatible_qos`` for every publisher; and ``overload`` for every fix
        that was left out.

    """

    def __init__(self, node: Node, settings: Settings, classes: dict[str, type[Any]],
                 types: dict[str, str],
                 take: Callable[[dict[str, list[Received]]], None],
                 reject: Callable[[str, str], None]) -> None:
        self._node = node
        self._types = types
        self._take = take
        self._reject = reject
        self._backlog = Backlog()
        inputs = {topic: inputs_of(settings, topic) for topic in classes}
        self._sensors = {  # those of whose messages some can be left out, but not for long
            topic: (names, round(SHARE * 1e9 * min(map(settings.timeout_of, names))))
            for topic, names in inputs.items()
            if 'thrusters' not in names and 'sign' not in names}
        self._topics: dict[str, Subscription[Any]] = {}
        try:
            for topic, cls in classes.items():
                self._topics[topic] = self._subscribe(settings, topic, cls)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Hear nothing more."""
        for subscription in self._topics.values():
            self._node.destroy_subscription(subscription)
        self._topics.clear()

    @property
    def subscriptions(self) -> list[Subscription[Any]]:
        """Return what is subscribed to."""
        return list(self._topics.values())

    def take(self) -> None:
        """Hand over what waits, or what the node can keep up with of it."""
        began = time.time()  # the clock of the middleware's times, whatever the node's is
        batch = self._none()
        self._hand_over(batch, began, self._add_waiting(batch))

    def drain(self) -> None:
        """Hand over everything that waits."""
        batch = self._none()
        self._add_waiting(batch)
        self._take(batch)

    def _subscribe(self, settings: Settings, topic: str, cls: type[Any]) -> Subscription[Any]:
        inputs = inputs_of(settings, topic)
        incompatible = partial(self._on_incompatible, inputs)
        lost: Callable[[Any], None] | None = partial(self._on_lost, inputs)
        while True:
            events = SubscriptionEventCallbacks(
                incompatible_qos=incompatible, message_lost=lost)
            try:
                return self._node.create_subscription(
                    cls, topic, partial(self._arrived, topic), qos(settings, topic),
                    event_callbacks=events, raw=True,
                    qos_overriding_options=QoSOverridingOptions.with_default_policies())
            except UnsupportedEventTypeError:  # not every middleware tells of losses
                if lost is None:
                    raise
                lost = None

    def _on_incompatible(self, inputs: list[str], event: Any) -> None:
        for name in inputs:
            self._count(name, 'incompatible_qos', event)

    def _on_lost(self, inputs: list[str], event: Any) -> None:
        for name in inputs:
            self._count(name, 'lost', event)

    def _count(self, name: str, reason: str, event: Any) -> None:
        for _ in range(event.total_count_change):
            self._reject(name, reason)

    def _arrived(self, topic: str, cdr: bytes, info: Any) -> None:
        if topic not in self._topics:
            return  # taken before, told after the end
        began = time.time()
        batch = self._none()
        batch[topic].append(self._received(topic, cdr, info, self._is_simulated()))
        self._add_waiting(batch)
        self._hand_over(batch, began, info['received_timestamp'])

    def _none(self) -> dict[str, list[Received]]:
        return {topic: [] for topic in self._topics}

    def _hand_over(self, batch: dict[str, list[Received]], began: float, oldest: int) -> None:
        """Hand over a batch whose oldest message came at a time [ns], 0: not known."""
        self._backlog.begin(began - (1e-9 * oldest or began))
        came = time.time()
        self._take(self._thinned(batch))
        self._backlog.end(time.time() - began, came)

    def _thinned(self, batch: dict[str, list[Received]]) -> dict[str, list[Received]]:
        """Leave out what the node cannot keep up with."""
        for topic, (names, patience) in self._sensors.items():
            taken = [one for one in batch[topic]
                     if not self._backlog.leaves_out(topic, one.time, patience)]
            for _ in range(len(batch[topic]) - len(taken)):
                for name in names:
                    self._reject(name, 'overload')
            batch[topic] = taken
        return batch

    def _add_waiting(self, batch: dict[str, list[Received]]) -> int:
        """Add all that waits; return when the oldest of it came [ns], 0: not known."""
        simulated = self._is_simulated()
        oldest = []
        for topic, subscription in self._topics.items():
            messages, handle = batch[topic], subscription.handle
            with handle:
                for count in range(DEPTH):  # a publisher that never pauses must not hold this up
                    taken = handle.take_message(subscription.msg_type, True)
                    if taken is None:
                        break
                    if not count:
                        oldest.append(taken[1]['received_timestamp'])
                    messages.append(self._received(topic, *taken, simulated))
        return min(oldest, default=0)

    def _is_simulated(self) -> bool:
        clock = self._node.get_clock()
        return isinstance(clock, ROSClock) and clock.ros_time_is_active

    def _received(self, topic: str, cdr: bytes, info: Any, simulated: bool) -> Received:
        # where the clock is the system's, the time when it came says more than the present
        time = 0 if simulated else info['received_timestamp']
        return Received(topic, self._types[topic], cdr,
                        time or self._node.get_clock().now().nanoseconds)


def qos(settings: Settings, topic: str) -> QoSProfile:
    """Return a topic's profile: the strongest that one of its inputs asks for."""
    wanted = [settings.thrusters.qos if name == 'thrusters' else settings.input(name).qos
              for name in inputs_of(settings, topic)]
    if 'transient_local' in wanted:
        return latched(DEPTH)
    return reliable(DEPTH) if 'reliable' in wanted else best_effort(DEPTH)
