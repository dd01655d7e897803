"""What takes the messages of a log: the pipe itself, or the node around it."""

from __future__ import annotations

from typing import Protocol

from rovid_core.identify.estimate import Estimate
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_core.trials.score import ScoreLog
from rovid_ros.commands.controls import repeat
from rovid_ros.logs.log import LogMessage, Maker
from rovid_ros.messages.convert import Converter
from rovid_ros.messages.types import Decoder, WireType
from rovid_ros.messages.unpack import Unpacker


class Feeder(Protocol):
    """Takes the messages of a log, one after the other."""

    stream: Stream
    converter: Converter
    scores: ScoreLog

    def take(self, topic: str, wire: WireType, decode: Decoder) -> Maker:
        """Return what makes the data that ``feed`` takes, of the messages of a topic."""

    def feed(self, message: LogMessage) -> list[Estimate]:
        """Take the next message; return the estimates that it released."""

    def control(self, name: str, value: str) -> list[Estimate]:
        """Do again what a service call did when the log was recorded."""

    def finish(self) -> list[Estimate]:
        """Take the log's end."""

    def close(self) -> None:
        """Let go of what was opened."""


class PipeFeeder:
    """The pipe alone: conversion and stream, no ROS."""

    def __init__(self, settings: Settings, scores: ScoreLog | None = None) -> None:
        self.scores = scores or ScoreLog(settings)
        self.stream = Stream(settings, scorer=self.scores)
        self.converter = Converter(settings, self.stream.reject)

    def take(self, topic: str, wire: WireType, decode: Decoder) -> Maker:
        """Return what makes events of the messages of a topic."""
        return Unpacker(self.converter, topic, wire, decode).events

    def feed(self, message: LogMessage) -> list[Estimate]:
        """Take the next message, as events; return the estimates that it released."""
        receive = self.stream.receive
        events = message.data
        if len(events) == 1:
            return receive(events[0])
        return [estimate for event in events for estimate in receive(event)]

    def control(self, name: str, value: str) -> list[Estimate]:
        """Do again what a service call did when the log was recorded."""
        return repeat(self.stream, name, value)

    def finish(self) -> list[Estimate]:
        """Take the log's end."""
        return self.stream.finish()

    def close(self) -> None:
        """Do nothing: nothing was opened."""
