"""Changes to the messages of a log, of which faults are made."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import isinf
from typing import Any

import numpy as np
from rovid_core.settings.run import Settings
from rovid_ros.logs.log import LogMessage
from rovid_ros.messages.field_paths import resolve, Step

SECOND = 1_000_000_000  # [ns]
ALL = ''

Messages = list[LogMessage]
Values = list[float]


@dataclass(frozen=True)
class Span:
    """When a fault is on [ns]."""

    on: int
    off: int

    def holds(self, time: int) -> bool:
        """Tell whether a time [ns] is in it."""
        return self.on <= time < self.off


@dataclass(frozen=True)
class Moment:
    """A message of a faulty input: its number since the fault came on, and its time."""

    count: int
    since: float  # [s]
    random: np.random.Generator


class Recording:
    """
    The messages of a log, and where in them the value of each input is.

    Parameters
    ----------
    settings : Settings
        Of the vehicle; an input has a stamp in its header.
    messages : list of LogMessage
        In the order of arrival.
    on : float
        When faults come on [s].

    """

    def __init__(self, settings: Settings, messages: Messages, on: float) -> None:
        self.settings = settings
        self.messages = messages
        self.on = on

    @property
    def begin(self) -> int:
        """Return the time of the first message [ns]."""
        return self.messages[0].time

    @property
    def end(self) -> int:
        """Return the time of the last message [ns]."""
        return self.messages[-1].time

    def has(self, input: str) -> bool:
        """Tell whether an input is used; all of them together always are."""
        return input == ALL or input in self._topics

    def carries(self, message: LogMessage, input: str) -> bool:
        """Tell whether a message is one of an input."""
        return input == ALL or message.topic == self._topics[input]

    def get(self, message: LogMessage, input: str) -> Values:
        """Return the value of an input in a message, as it is in there."""
        steps, shape = self._place(input)
        value = message.data
        for step in steps:
            value = getattr(value, str(step))
        if shape in ('vector', 'quaternion'):
            return [float(getattr(value, axis)) for axis in _AXES[shape]]
        return [float(value)] if shape == 'number' else [float(x) for x in value]

    def put(self, message: LogMessage, input: str, values: Sequence[float]) -> LogMessage:
        """Return the message with another value of an input."""
        steps, shape = self._place(input)
        return message._replace(data=_put(message.data, [str(s) for s in steps], shape, values))

    @cached_property
    def _topics(self) -> dict[str, str]:
        settings = self.settings
        return {name: settings.thrusters.topics[0] if name == 'thrusters'
                else settings.input(name).topic for name in settings.used_inputs()}

    def _place(self, input: str) -> tuple[list[Step], str]:
        if input not in self._places:
            field = self.settings.thrusters.field if input == 'thrusters' \
                else self.settings.input(input).field
            first = next(m for m in self.messages if self.carries(m, input))
            steps, _, shape = resolve(input, field, first.data, input)
            self._places[input] = steps, shape
        return self._places[input]

    @cached_property
    def _places(self) -> dict[str, tuple[list[Step], str]]:
        return {}


_AXES = {'vector': 'xyz', 'quaternion': 'xyzw'}

Edit = Callable[[Recording, Span], Messages]
"""Returns the messages of a recording with a fault in them."""

Change = Callable[[LogMessage, Moment], Messages]
"""Returns what becomes of a message."""


def _put(value: Any, steps: list[str], shape: str, values: Sequence[float]) -> Any:
    if steps:
        inner = _put(getattr(value, steps[0]), steps[1:], shape, values)
        return replace(value, **{steps[0]: inner})
    if shape in _AXES:
        return replace(value, **dict(zip(_AXES[shape], values)))
    if shape == 'number':
        return values[0]
    largest = float(np.finfo(value.dtype).max)  # 1e300 is too much for a float32
    return np.array([x if isinf(x) else min(x, largest) for x in values], dtype=value.dtype)


def changed(input: str, change: Change) -> Edit:
    """Return the edit that changes each message of an input while the fault is on."""
    def edit(recording: Recording, span: Span) -> Messages:
        random = np.random.default_rng(1)
        result: Messages = []
        count = 0
        for message in recording.messages:
            if span.holds(message.time) and recording.carries(message, input):
                result += change(message, Moment(
                    count, (message.time - span.on) / SECOND, random))
                count += 1
            else:
                result.append(message)
        return sorted(result, key=lambda m: m.time)  # as a recorder takes them

    return edit


def valued(input: str, change: Callable[[Values, Moment], Sequence[float]]) -> Edit:
    """Return the edit that changes the value of an input."""
    def edit(recording: Recording, span: Span) -> Messages:
        return changed(input, lambda message, moment: [recording.put(
            message, input, change(recording.get(message, input), moment))])(recording, span)

    return edit


def lost(input: str, keep: Callable[[Moment], bool] = lambda moment: False) -> Edit:
    """Return the edit that loses messages, all but those to keep."""
    return changed(input, lambda message, moment: [message] if keep(moment) else [])


def stuck(input: str) -> Edit:
    """Return the edit that repeats the first value."""
    first: Values = []

    def hold(values: Values, moment: Moment) -> Values:
        if moment.count == 0:
            first[:] = values
        return first

    return valued(input, hold)


def late(input: str, delay: Callable[[LogMessage, Moment], float]) -> Edit:
    """Return the edit that makes messages arrive later by a time [s]; their stamps stay."""
    return changed(input, lambda message, moment: [
        message._replace(time=message.time + round(SECOND * delay(message, moment)))])


def stamped(input: str, stamp: Callable[[int, Moment], int]) -> Edit:
    """Return the edit that gives messages another stamp [ns]; they arrive when they did."""
    return changed(input, lambda message, moment: [
        restamped(message, stamp(stamp_of(message), moment))])


def added(input: str, others: Callable[[Recording, LogMessage, Moment], Messages]) -> Edit:
    """Return the edit that adds messages to those of an input."""
    def edit(recording: Recording, span: Span) -> Messages:
        return changed(input, lambda message, moment: [
            message, *others(recording, message, moment)])(recording, span)

    return edit


def stamp_of(message: LogMessage) -> int:
    """Return the stamp of a message [ns]."""
    stamp = message.data.header.stamp
    return stamp.sec * SECOND + stamp.nanosec


def restamped(message: LogMessage, time: int) -> LogMessage:
    """Return a message with another stamp [ns]."""
    header = message.data.header
    seconds, nanoseconds = divmod(time, SECOND)
    stamp = replace(header.stamp, sec=seconds, nanosec=nanoseconds)
    return message._replace(data=replace(message.data, header=replace(header, stamp=stamp)))


def shifted(message: LogMessage, seconds: float) -> LogMessage:
    """Return a message that was sent and came later."""
    shift = round(SECOND * seconds)
    return restamped(message, stamp_of(message) + shift)._replace(time=message.time + shift)
