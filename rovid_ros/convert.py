"""
Messages of any type to events in body FLU, world ENU and SI units.

This is the one place that knows about ROS conventions: field paths, stamps, NED and FRD.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from rovid_core.settings import INPUTS, Settings, SettingsError
from rovid_core.values import Event, Sample
from rovid_ros.field_paths import (
    describe,
    field_names,
    FieldError,
    MissingIndexError,
    nearest,
)
from rovid_ros.message_types import standard_types
from rovid_ros.sample_readers import Reader, reader, RefusedError, Source

__all__ = ['Converter', 'FieldError']


@dataclass(frozen=True, slots=True)
class _Compiled:
    """A source made fast for one message class."""

    source: Source
    read: Reader
    stamp: Callable[[Any], tuple[int, int]] | None  # None: the receive time


class Converter:
    """
    Turns messages into events.

    Parameters
    ----------
    settings : Settings
        Names the topics, field paths, stamps and frames.
    count : callable
        Called with (input, reason) for what a message lacks: ``missing_index``,
        ``missing_name``, ``wrong_length`` and ``not_numeric`` give no sample,
        ``zero_stamp`` gives one at the receive time.

    Attributes
    ----------
    topics : dict of str to str
        The type of each topic to read; '' takes whatever it has.
    details : dict
        For some of what was counted, by (input, reason), what was wrong the first time.

    Raises
    ------
    SettingsError
        If two inputs expect one topic to have different types.

    """

    def __init__(self, settings: Settings, count: Callable[[str, str], None]) -> None:
        self.topics: dict[str, str] = {}
        self.details: dict[tuple[str, str], str] = {}
        self._settings = settings
        self._count = count
        self._sources: dict[str, list[Source]] = {}
        self._compiled: dict[tuple[str, type], list[_Compiled]] = {}
        for source in _sources(settings):
            self._sources.setdefault(source.topic, []).append(source)
            known = self.topics.setdefault(source.topic, source.type)
            if source.type and known and source.type != known:
                raise _conflict(source, next(
                    other for other in self._sources[source.topic] if other.type == known))
            self.topics[source.topic] = known or source.type

    def events(
        self, topic: str, message: Any, receive_time: int, origin: Any = None,
    ) -> list[Event]:
        """
        Convert a message.

        Parameters
        ----------
        topic : str
            As in ``topics``; another one gives no event.
        message : object
            An rclpy message or the dataclass that a log is decoded to.
        receive_time : int
            [ns]
        origin : object
            Kept in the events.

        Returns
        -------
        events : list of Event
            One per event time, which is one unless inputs differ in latency or stamp.

        Raises
        ------
        FieldError
            If the type of the message has no such field.

        """
        compiled = self._compiled.get((topic, type(message)))
        if compiled is None:
            compiled = self._compile(topic, message)
        times: dict[int, list[Sample]] = {}
        for one in compiled:
            source = one.source
            try:
                value = one.read(message)
            except RefusedError as refused:
                self._refuse(source, refused.reason, refused.detail)
                continue
            except IndexError:
                self._refuse(source, 'missing_index', f'{source.field!r} is beyond the end')
                continue
            time = receive_time
            if one.stamp is not None:
                seconds, nanoseconds = one.stamp(message)
                if seconds or nanoseconds:
                    time = seconds * 1_000_000_000 + nanoseconds
                else:
                    self._count(source.input, 'zero_stamp')
            sample = Sample(source.input, value, source.part)
            times.setdefault(time - source.latency, []).append(sample)
        return [Event(time, tuple(samples), origin) for time, samples in times.items()]

    def check_type(self, topic: str, blank: Any) -> None:
        """
        Refuse settings that do not fit a topic's type, before any message comes.

        Parameters
        ----------
        topic : str
            As in ``topics``.
        blank : object
            A message of the type with default values only.

        Raises
        ------
        FieldError
            Names the input, the path, the type and the fields that are there.

        """
        for source in self._sources.get(topic, ()):
            _stamp(source, blank)
            try:
                reader(source, blank, self._settings, blank=True)
            except MissingIndexError:  # what an empty array would hold is not known yet
                pass

    def _compile(self, topic: str, message: Any) -> list[_Compiled]:
        sources = self._sources.get(topic, [])
        compiled = []
        for source in sources:
            stamp = _stamp(source, message)
            try:
                compiled.append(
                    _Compiled(source, reader(source, message, self._settings), stamp))
            except MissingIndexError as missing:
                self._refuse(source, 'missing_index', str(missing))
        if len(compiled) == len(sources):
            self._compiled[topic, type(message)] = compiled
        return compiled

    def _refuse(self, source: Source, reason: str, detail: str) -> None:
        self._count(source.input, reason)
        if detail and (source.input, reason) not in self.details:
            self.details[source.input, reason] = f'{source.key}.field: {detail}'


def _sources(settings: Settings) -> list[Source]:
    """Return what to read, in the order of INPUTS."""
    sources = []
    for name in INPUTS:
        if name not in settings.used_inputs():
            continue
        if name == 'thrusters':
            given: Any = settings.thrusters
            topics = settings.thrusters.topics
        else:
            given = settings.input(name)
            topics = (given.topic,)
        for part, topic in enumerate(topics):
            sources.append(Source(
                name, topic, given.type, given.field, given.stamp,
                round(given.latency * 1e9), part))
    return sources


def _conflict(one: Source, other: Source) -> SettingsError:
    """Return the error for two types of one topic; one that ROS does not know is at fault."""
    types = standard_types().fielddefs
    if other.type not in types and one.type in types:
        one, other = other, one
    hint = '' if one.type in types else nearest(one.type, [other.type, *types])
    return SettingsError(
        f'{one.key}.type', f'is {one.type}, but {other.key}.type reads {one.topic} as '
                           f'{other.type}{hint}')


def _stamp(source: Source, message: Any) -> Callable[[Any], tuple[int, int]] | None:
    """Return how to get the stamp, None for the receive time."""
    if source.stamp == 'receive':
        return None
    header = getattr(message, 'header', None)
    if 'header' in field_names(message) and 'stamp' in field_names(header):
        return attrgetter('header.stamp.sec', 'header.stamp.nanosec')
    if source.stamp == 'header':
        raise FieldError(
            f'{source.key}.stamp', f"is 'header', but {describe(message)} has none, it has "
                                   f"{', '.join(field_names(message))}; use 'receive'")
    return None
