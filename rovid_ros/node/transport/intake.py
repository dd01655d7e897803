"""What the node makes of the messages that come: events for its stream, or a refusal."""

from __future__ import annotations

from collections.abc import Iterable
import heapq
from typing import Any

from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.serialization import deserialize_message
from rovid_core.model.samples import Event
from rovid_core.pipeline.stream import Stream
from rovid_ros.config.input_topics import inputs_of
from rovid_ros.messages.convert import Converter, FieldError
from rovid_ros.messages.types import LARGEST_MESSAGE, typestore, WireType
from rovid_ros.messages.unpack import Unpacker
from rovid_ros.node.health.recent import Arrivals
from rovid_ros.node.recorder import Received
from rovid_ros.node.transport.message_classes import definition


class Intake:
    """
    Turns messages into events.

    Parameters
    ----------
    stream : Stream
        Told what is refused.
    converter : Converter
        Knows the fields.
    classes : dict
        Message class by topic.
    arrivals : Arrivals
        Told of every message.
    log : RcutilsLogger
        Told of messages that are not of their type.
    keep : bool
        Whether events carry the bytes that they came from, for a record.

    """

    def __init__(self, stream: Stream, converter: Converter, classes: dict[str, type[Any]],
                 arrivals: Arrivals, log: RcutilsLogger, keep: bool) -> None:
        self._stream = stream
        self._converter = converter
        self._unpackers = {
            topic: _unpacker(converter, topic, cls) for topic, cls in classes.items()}
        self._arrivals = arrivals
        self._log = log
        self._keep = keep

    def merged(self, batch: dict[str, list[Received]]) -> Iterable[Event]:
        """Return the events of what has come, the oldest data of all topics first."""
        queues = [[event for received in messages for event in self._decoded(received)]
                  for messages in batch.values()]
        return heapq.merge(*queues, key=lambda event: event.time)

    def events(self, topic: str, message: Any, receive_time: int) -> list[Event]:
        """Return the events of a message that came at ``receive_time`` [ns], 0: no clock yet."""
        return self._noted(
            topic, receive_time, self._converter.events(topic, message, receive_time))

    def _noted(self, topic: str, receive_time: int, events: list[Event]) -> list[Event]:
        self._arrivals.note(topic, receive_time, events)
        if receive_time:
            return events
        for event in events:  # simulated time has not begun: there is no time to give it
            if event.time <= 0:
                for sample in event.samples:
                    self._stream.reject(sample.input, 'no_clock')
        return [event for event in events if event.time > 0]

    def _decoded(self, received: Received) -> list[Event]:
        topic = received.topic
        if len(received.cdr) > LARGEST_MESSAGE:
            self._refuse(topic, 'too_large')
            return []
        try:
            return self._noted(topic, received.time, self._unpackers[topic].events(
                received.cdr, received.time, received if self._keep else None))
        except (RuntimeError, FieldError) as error:  # a peer with another definition
            self._log.error(f'{topic}: {error}', once=True)
            self._arrivals.note(topic, received.time)
            self._refuse(topic, 'undecodable')
            return []

    def _refuse(self, topic: str, reason: str) -> None:
        for name in inputs_of(self._stream.settings, topic):
            self._stream.reject(name, reason)


def _unpacker(converter: Converter, topic: str, cls: type[Any]) -> Unpacker:
    """Return what knows the fields of a topic also in the bytes of its messages."""
    name = converter.topics[topic]
    wire = WireType(typestore(name, definition(name)), name, 'cdr')
    return Unpacker(converter, topic, wire, lambda cdr: deserialize_message(cdr, cls))
