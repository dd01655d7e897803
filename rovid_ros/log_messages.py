"""What comes out of a log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from rovid_ros.log_container import Channel
from rovid_ros.message_types import Decoder, WireType


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
