"""What comes out of a log."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

from rovid_ros.logs.container import Channel, Container
from rovid_ros.messages.types import Decoder, WireType


@dataclass(frozen=True)
class TopicInfo:
    """What a log holds of a topic."""

    type: str
    count: int | None  # None: the log does not say


class LogMessage(NamedTuple):
    """A decoded message; ``time`` is when it was received [ns]."""

    topic: str
    type: str
    time: int
    data: Any


Maker = Callable[[bytes, int], Any]
"""Serialised message and log time [ns] to the data of a ``LogMessage``."""

Take = Callable[[str, WireType, Decoder], Maker]
"""Topic, how its messages are written, and their decoder, to what to make of them."""


class RawMessage(NamedTuple):
    """A message as it is in the file."""

    time: int  # [ns]
    channel: Channel
    data: bytes


def topics_of(containers: Iterable[Container]) -> dict[str, TopicInfo]:
    """Return what files hold of their topics together, by name."""
    topics: dict[str, TopicInfo] = {}
    for container in containers:
        for channel in container.channels.values():
            counts = container.counts
            count = None if counts is None else counts.get(channel.number, 0)
            known = topics.get(channel.topic, TopicInfo(channel.type, 0))
            total = None if count is None or known.count is None else known.count + count
            topics[channel.topic] = TopicInfo(known.type, total)
    return topics
