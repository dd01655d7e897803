"""Plays a log through the pipeline: its messages, and the controls that a node recorded in it."""

from __future__ import annotations

from collections.abc import Mapping
import json
from typing import Any, Protocol

from rovid_core.identify.estimate import Estimate
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_core.trials.score import ScoreLog
from rovid_ros.config.parameters import changed
from rovid_ros.logs.log import LogMessage, Maker
from rovid_ros.messages.converter import Converter, Unpacker
from rovid_ros.messages.types import Decoder, WireType

CONTROL = '/rovid/control'  # topic of a node's own log that says what was done to it
PARAMETERS = 'parameters'  # the control that says which parameters changed, as JSON by dotted key


class Player(Protocol):
    """Plays the messages of a log, one after the other."""

    stream: Stream
    converter: Converter
    scores: ScoreLog

    def maker(self, topic: str, wire: WireType, decode: Decoder) -> Maker:
        """Return what makes the data that ``add_message`` needs, of the messages of a topic."""

    def restore(self, state: Mapping[str, Any]) -> str:
        """Begin where the node began when it recorded the log; return why not, or ''."""

    def add_message(self, message: LogMessage) -> list[Estimate]:
        """Add the next message; return the estimates that it released."""

    def repeat_control(self, name: str, value: str) -> list[Estimate]:
        """Do again what was done to the node when the log was recorded."""

    def finish(self) -> list[Estimate]:
        """Release what is still held back at the log's end."""

    def close(self) -> None:
        """Close what was opened."""


class PipelinePlayer:
    """Plays a log through the pipeline alone: conversion and stream, no ROS."""

    def __init__(self, settings: Settings) -> None:
        self.scores = ScoreLog(settings)
        self.stream = Stream(settings, scorer=self.scores)
        self.converter = Converter(settings, self.stream.reject)

    def maker(self, topic: str, wire: WireType, decode: Decoder) -> Maker:
        """Return what makes events of the messages of a topic."""
        return Unpacker(self.converter, topic, wire, decode).events

    def restore(self, state: Mapping[str, Any]) -> str:
        return restore_recorded(self.stream, state)

    def add_message(self, message: LogMessage) -> list[Estimate]:
        """Add the next message, as events; return the estimates that it released."""
        receive = self.stream.receive
        events = message.data
        if len(events) == 1:
            return receive(events[0])
        return [estimate for event in events for estimate in receive(event)]

    def repeat_control(self, name: str, value: str) -> list[Estimate]:
        return repeat_control(self.stream, name, value)

    def finish(self) -> list[Estimate]:
        return self.stream.end()

    def close(self) -> None:
        """Do nothing: nothing was opened."""


def change_parameters(stream: Stream, changes: Mapping[str, Any]) -> None:
    """
    Give live keys other values, by dotted key, between two steps; the recorder is told.

    Raises SettingsError if a value is refused; then nothing is changed.
    """
    stream.change(changed(stream.settings, changes), json.dumps(dict(changes)))


def recorded_changes(value: str) -> dict[str, Any]:
    """Return what a recorded control of ``PARAMETERS`` changed; ValueError if that is not JSON."""
    changes = json.loads(value)
    if not isinstance(changes, dict):
        raise ValueError(f'a control of parameters that has no keys: {value!r}')
    return changes


def restore_recorded(stream: Stream, state: Mapping[str, Any]) -> str:
    """Go on from the state that a recording began with; return why not, or ''."""
    mine = stream.settings.identifier.method
    if state['method'] != mine:
        return (f'the node began this recording with a state of {state["method"]}; {mine} begins '
                'anew')
    stream.restore(state)
    return ''


def repeat_control(stream: Stream, name: str, value: str) -> list[Estimate]:
    """
    Do a recorded control again; what was recorded before it is released first.

    Raises ValueError for a control that there is not, or parameters that are refused.
    """
    if name != PARAMETERS:
        return stream.control(name, value)
    estimates = stream.finish()
    change_parameters(stream, recorded_changes(value))
    return estimates
