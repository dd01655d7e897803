"""
From DDS to events: subscriptions, what is left out under overload, and decoding.

What is published only once, as static transforms are, is looked up before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
import heapq
import time
from typing import Any

from rclpy.clock import ROSClock
from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.exceptions import InvalidTopicNameException
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.validate_topic_name import validate_topic_name
from rovid_core.model.samples import Event
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings, SettingsError
from rovid_ros.config.parameters import given_of, inputs_of, section
from rovid_ros.logs.static_frames import StaticFrames, TOPIC, TYPE, wanted_frames
from rovid_ros.messages.converter import Converter, Unpacker
from rovid_ros.messages.field_paths import FieldError
from rovid_ros.messages.types import MAX_MESSAGE_SIZE, typestore, WireType
from rovid_ros.node.recorder import Received
from rovid_ros.node.transport.message_types import definition, import_type, MessageTypeError
from rovid_ros.node.transport.publishers import best_effort, DEPTH, latched, reliable

LATE = 0.5  # [s] the node is behind when the oldest message of a batch has waited longer than this
LARGEST_DECIMATION = 64  # at least one message in so many is always used
# Gap between two used messages of an input, as a share of its timeout, that is never exceeded.
SHARE_OF_TIMEOUT = 0.3

# [s] for static transforms: discovery can take some, and what publishes may be started meanwhile
FRAMES_PATIENCE = 10.0
FRAMES_PERIOD = 0.02  # [s] from one look to the next
FRAMES_DEPTH = 100  # messages: every publisher has one of its own


def message_class(settings: Settings, converter: Converter, topic: str) -> type[Any]:
    """
    Import the message class of a topic and check the field paths against it.

    Raises SettingsError if the name of the topic is invalid, or its type is not given or not
    installed, and FieldError if the type does not have a configured field.
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


def qos(settings: Settings, topic: str) -> QoSProfile:
    """Return the QoS profile of a topic: the strongest that one of its inputs asks for."""
    wanted = [given_of(settings, name).qos for name in inputs_of(settings, topic)]
    if 'transient_local' in wanted:
        return latched(DEPTH)
    return reliable(DEPTH) if 'reliable' in wanted else best_effort(DEPTH)


def is_simulated(node: Node) -> bool:
    """Tell whether the clock of a node follows /clock."""
    clock = node.get_clock()
    return isinstance(clock, ROSClock) and clock.ros_time_is_active


class LoadShedding:
    """
    Decides which sensor messages to leave out when more come than the node can process.

    A velocity over two intervals is a measurement like one over a single interval, with less
    resolution in time; a command that is left out gives a wrong force. So only of the sensors
    every second message is used, or every fourth and so on, while a batch comes late and the
    batches before it took longer to process than their messages took to come. The decimation
    is halved again once nothing is late. What comes late because the process was paused is all
    used, also when the pause fell into the processing.
    """

    def __init__(self) -> None:
        self.decimation = 1
        self._load = 0.0  # processing time per time in which the messages came
        self._work = self._span = 0.0  # of the batches since the load was computed [s]
        self._newest: float | None = None
        self._counts: dict[str, int] = {}
        self._last_used: dict[str, int] = {}  # [ns] when that message came

    def start_batch(self, waited: float) -> None:
        """Adjust the decimation to how long the oldest message of a batch has waited [s]."""
        if waited > LATE:
            while self._load > 1.0 and self.decimation < LARGEST_DECIMATION:
                self.decimation *= 2
                self._load /= 2.0
        elif waited < 0.1 * LATE and self.decimation > 1:
            self.decimation //= 2

    def end_batch(self, work: float, newest: float) -> None:
        """Add the processing time of a batch [s] and when its newest message came [s]."""
        if self._newest is not None and newest > self._newest:
            self._work += work
            self._span += newest - self._newest
            if self._span >= 0.5 * LATE:  # over less, a pause would look like load
                self._load = self._work / self._span
                self._work = self._span = 0.0
        self._newest = newest

    def leaves_out(self, topic: str, time: int, longest_gap: int) -> bool:
        """Count a message that came at ``time`` and tell whether to leave it out, both [ns]."""
        count = self._counts[topic] = self._counts.get(topic, 0) + 1
        last = self._last_used.get(topic)
        if last is not None and count % self.decimation and time - last < longest_gap:
            return True
        self._last_used[topic] = time
        return False


class Subscriptions:
    """
    One subscription per topic.

    After a stall, an executor would take one message of each topic in turn, and the slow
    topics would run ahead of the fast ones in event time. So when one message is there, all
    that wait behind it and on the other topics are taken at once. Where even so the node stays
    behind, sensor messages are left out.

    Parameters
    ----------
    node : Node
        Owns the subscriptions; its clock gives the receive time where it is simulated.
    settings : Settings
        The quality of service of the inputs.
    process : callable
        Gets what has come, by topic, each topic's messages in order of arrival.
    reject : callable
        Told input and reason of what the middleware did not deliver: ``lost`` for every
        message, ``incompatible_qos`` for every publisher; and ``overload`` for every message
        that was left out.

    """

    def __init__(self, node: Node, settings: Settings, classes: dict[str, type[Any]],
                 types: dict[str, str], process: Callable[[dict[str, list[Received]]], None],
                 reject: Callable[[str, str], None]) -> None:
        self._node = node
        self._types = types
        self._process = process
        self._reject = reject
        self._load_shedding = LoadShedding()
        inputs = {topic: inputs_of(settings, topic) for topic in classes}
        self._sensors = {  # topic -> inputs and longest gap [ns]; commands are never left out
            topic: (names, round(SHARE_OF_TIMEOUT * 1e9 * min(map(settings.timeout_of, names))))
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
        """Unsubscribe from everything."""
        for subscription in self._topics.values():
            self._node.destroy_subscription(subscription)
        self._topics.clear()

    @property
    def subscriptions(self) -> list[Subscription[Any]]:
        """Return all subscriptions."""
        return list(self._topics.values())

    def receive(self) -> None:
        """Process all messages that wait, or as many as the node can keep up with."""
        began = time.time()  # the clock of the middleware's times, whatever the node's clock is
        batch = self._empty_batch()
        self._process_batch(batch, began, self._add_waiting(batch))

    def receive_all(self) -> None:
        """Process all messages that wait, without leaving any out."""
        batch = self._empty_batch()
        self._add_waiting(batch)
        self._process(batch)

    def _subscribe(self, settings: Settings, topic: str, cls: type[Any]) -> Subscription[Any]:
        inputs = inputs_of(settings, topic)
        incompatible = partial(self._count, inputs, 'incompatible_qos')
        lost: Callable[[Any], None] | None = partial(self._count, inputs, 'lost')
        while True:
            events = SubscriptionEventCallbacks(incompatible_qos=incompatible, message_lost=lost)
            try:
                return self._node.create_subscription(
                    cls, topic, partial(self._on_message, topic), qos(settings, topic),
                    event_callbacks=events, raw=True,
                    qos_overriding_options=QoSOverridingOptions.with_default_policies())
            except UnsupportedEventTypeError:  # not every middleware reports losses
                if lost is None:
                    raise
                lost = None

    def _count(self, inputs: list[str], reason: str, event: Any) -> None:
        """Count what an event of the middleware says for every input of its topic."""
        for name in inputs:
            for _ in range(event.total_count_change):
                self._reject(name, reason)

    def _on_message(self, topic: str, cdr: bytes, info: Any) -> None:
        """Process a message from an executor, and all that wait besides."""
        if topic not in self._topics:
            return  # taken by the executor before the end, delivered after it
        began = time.time()
        batch = self._empty_batch()
        batch[topic].append(self._received(topic, cdr, info, is_simulated(self._node)))
        self._add_waiting(batch)
        self._process_batch(batch, began, info['received_timestamp'])

    def _empty_batch(self) -> dict[str, list[Received]]:
        return {topic: [] for topic in self._topics}

    def _process_batch(self, batch: dict[str, list[Received]], began: float, oldest: int) -> None:
        """Process a batch whose oldest message came at a time [ns], 0 if that is not known."""
        self._load_shedding.start_batch(began - (1e-9 * oldest or began))
        came = time.time()
        self._process(self._decimated(batch))
        self._load_shedding.end_batch(time.time() - began, came)

    def _decimated(self, batch: dict[str, list[Received]]) -> dict[str, list[Received]]:
        """Leave out what the node cannot keep up with."""
        for topic, (names, longest_gap) in self._sensors.items():
            used = [one for one in batch[topic]
                    if not self._load_shedding.leaves_out(topic, one.time, longest_gap)]
            for _ in range(len(batch[topic]) - len(used)):
                for name in names:
                    self._reject(name, 'overload')
            batch[topic] = used
        return batch

    def _add_waiting(self, batch: dict[str, list[Received]]) -> int:
        """Add all messages that wait; return when the oldest came [ns], 0 if not known."""
        simulated = is_simulated(self._node)
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

    def _received(self, topic: str, cdr: bytes, info: Any, simulated: bool) -> Received:
        # with the system's clock, the time of arrival is more exact than the present time
        time = 0 if simulated else info['received_timestamp']
        return Received(topic, self._types[topic], cdr,
                        time or self._node.get_clock().now().nanoseconds)


class InputDecoder:
    """
    Turns messages into events for the stream, or counts why they give none.

    ``arrived`` is told the topic, the receive time [ns] and the events of every message that came.
    With ``keep``, events carry the bytes that they came from, for a record.
    """

    def __init__(self, stream: Stream, converter: Converter, classes: dict[str, type[Any]],
                 arrived: Callable[[str, int, Sequence[Event]], None], log: RcutilsLogger,
                 keep: bool) -> None:
        self._stream = stream
        self._converter = converter
        self._unpackers = {
            topic: _unpacker(converter, topic, cls) for topic, cls in classes.items()}
        self._arrived = arrived
        self._log = log
        self._keep = keep

    def batch_events(self, batch: dict[str, list[Received]]) -> Iterable[Event]:
        """Return the events of a batch, the oldest data of all topics first."""
        queues = [[event for received in messages for event in self._decode(received)]
                  for messages in batch.values()]
        return heapq.merge(*queues, key=lambda event: event.time)

    def events(self, topic: str, message: Any, receive_time: int) -> list[Event]:
        """Return the events of a message that came at a time [ns], 0 if there is no clock yet."""
        return self._counted(
            topic, receive_time, self._converter.events(topic, message, receive_time))

    def _counted(self, topic: str, receive_time: int, events: list[Event]) -> list[Event]:
        """Count a message; return those of its events that have a time."""
        self._arrived(topic, receive_time, events)
        if receive_time:
            return events
        for event in events:  # simulated time has not begun: there is no time to give it
            if event.time <= 0:
                for sample in event.samples:
                    self._stream.reject(sample.input, 'no_clock')
        return [event for event in events if event.time > 0]

    def _decode(self, received: Received) -> list[Event]:
        topic = received.topic
        if len(received.cdr) > MAX_MESSAGE_SIZE:
            self._reject(topic, 'too_large')
            return []
        try:
            return self._counted(topic, received.time, self._unpackers[topic].events(
                received.cdr, received.time, received if self._keep else None))
        except (RuntimeError, FieldError) as error:  # a publisher with another definition
            self._log.error(f'{topic}: {error}', once=True)
            self._arrived(topic, received.time, [])
            self._reject(topic, 'undecodable')
            return []

    def _reject(self, topic: str, reason: str) -> None:
        for name in inputs_of(self._stream.settings, topic):
            self._stream.reject(name, reason)


def _unpacker(converter: Converter, topic: str, cls: type[Any]) -> Unpacker:
    """Return what reads the fields of a topic straight from the bytes of its messages."""
    name = converter.topics[topic]
    wire = WireType(typestore(name, definition(name)), name, 'cdr')
    return Unpacker(converter, topic, wire, lambda cdr: deserialize_message(cdr, cls))


def look_up(node: Node, settings: Settings,
            is_stopped: Callable[[], bool] = lambda: False) -> dict[str, Any]:
    """
    Return the values of ``wanted_frames`` by key; waits for them, at most ``FRAMES_PATIENCE``.

    Nothing else of the node runs meanwhile. Raises SettingsError if they do not come, or if it
    is stopped.
    """
    wanted = wanted_frames(settings)
    if not wanted:
        return {}
    try:
        cls = import_type(TYPE)
    except MessageTypeError as error:
        raise SettingsError(f'{next(iter(wanted)).partition(".")[0]}.sensor_frame',
                            str(error)) from None
    frames = StaticFrames()
    take_latched(node, cls, TOPIC, frames.add,
                 lambda: frames.knows(wanted.values(), settings.base_frame), FRAMES_PATIENCE,
                 is_stopped)
    return frames.values(wanted, settings.base_frame, f'within {FRAMES_PATIENCE:g} s')


def take_latched(node: Node, cls: type[Any], topic: str, take: Callable[[Any], object],
                 is_enough: Callable[[], bool], timeout: float,
                 is_stopped: Callable[[], bool]) -> None:
    """Take what was published on a topic and is kept for those who come late, until it does."""
    subscription = node.create_subscription(
        cls, topic, lambda message: None, latched(FRAMES_DEPTH))
    end = time.monotonic() + timeout
    try:
        while not is_enough() and time.monotonic() < end and not is_stopped():
            with subscription.handle:
                taken = subscription.handle.take_message(cls, False)
            if taken is None:
                time.sleep(FRAMES_PERIOD)
            else:
                take(taken[0])
    finally:
        node.destroy_subscription(subscription)
