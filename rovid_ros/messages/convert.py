"""
Messages of any type to events in body FLU, world ENU and SI units.

This is the one place that knows about ROS conventions: field paths, stamps, NED and FRD.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from rovid_core.model.samples import Event, Sample
from rovid_core.settings.run import Settings
from rovid_ros.messages.field_paths import describe, field_names, FieldError, MissingIndexError
from rovid_ros.messages.sample_readers import Reading, reading, RefusedError
from rovid_ros.messages.sources import conflict, Source, sources

__all__ = ['Access', 'Converter', 'FieldError', 'STAMP']

STAMP = ('header.stamp.sec', 'header.stamp.nanosec')


@dataclass(frozen=True, slots=True)
class Access:
    """
    A source made fast for one kind of message: of a class, or serialised in one layout.

    Attributes
    ----------
    fetch : callable
        From the message to what the reading makes the value of.
    stamp : callable or None
        From the message to seconds and nanoseconds; None for the receive time.

    """

    source: Source
    reading: Reading
    fetch: Callable[[Any], tuple[Any, ...]]
    stamp: Callable[[Any], tuple[int, int]] | None

    def value(self, message: Any) -> tuple[float, ...]:
        """Return the value of a sample."""
        return self.reading.make(*self.fetch(message))


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
        self._accesses: dict[tuple[str, type], list[Access]] = {}
        for source in sources(settings):
            self._sources.setdefault(source.topic, []).append(source)
            known = self.topics.setdefault(source.topic, source.type)
            if source.type and known and source.type != known:
                raise conflict(source, next(
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
        accesses = self._accesses.get((topic, type(message)))
        if accesses is None:
            accesses = self._compile(topic, message)
        return self.read(accesses, message, receive_time, origin)

    def accesses(self, topic: str, message: Any) -> list[Access]:
        """Return how messages like one that was converted are read, none if it lacked any."""
        return self._accesses.get((topic, type(message)), [])

    def read(self, accesses: Sequence[Access], message: Any, receive_time: int,
             origin: Any = None) -> list[Event]:
        """Return the events of a message, as in ``events``."""
        events: list[Event] = []
        for access in accesses:
            source = access.source
            try:
                value = access.reading.make(*access.fetch(message))
            except RefusedError as refused:
                self._refuse(source, refused.reason, refused.detail)
                continue
            except IndexError:
                self._refuse(source, 'missing_index', f'{source.field!r} is beyond the end')
                continue
            time = receive_time
            if access.stamp is not None:
                seconds, nanoseconds = access.stamp(message)
                if seconds or nanoseconds:
                    time = seconds * 1_000_000_000 + nanoseconds
                else:
                    self._count(source.input, 'zero_stamp')
            events.append(Event(time - source.latency, (
                Sample(source.input, value, source.part),), origin))
        return events if len(events) < 2 else _joined(events, origin)

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
            _stamped(source, blank)
            try:
                reading(source, blank, self._settings, blank=True)
            except MissingIndexError:  # what an empty array would hold is not known yet
                pass

    def _compile(self, topic: str, message: Any) -> list[Access]:
        sources = self._sources.get(topic, [])
        accesses = []
        for source in sources:
            stamp = attrgetter(*STAMP) if _stamped(source, message) else None
            try:
                found = reading(source, message, self._settings)
            except MissingIndexError as missing:
                self._refuse(source, 'missing_index', str(missing))
            else:
                accesses.append(Access(source, found, found.fetch(), stamp))
        if len(accesses) == len(sources):
            self._accesses[topic, type(message)] = accesses
        return accesses

    def _refuse(self, source: Source, reason: str, detail: str) -> None:
        self._count(source.input, reason)
        if detail and (source.input, reason) not in self.details:
            self.details[source.input, reason] = f'{source.key}.field: {detail}'


def _joined(events: Sequence[Event], origin: Any) -> list[Event]:
    """Return one event per time."""
    times: dict[int, tuple[Sample, ...]] = {}
    for event in events:
        times[event.time] = times.get(event.time, ()) + event.samples
    return [Event(time, samples, origin) for time, samples in times.items()]


def _stamped(source: Source, message: Any) -> bool:
    """Return whether the time is that of the header, and not the receive time."""
    if source.stamp == 'receive':
        return False
    header = getattr(message, 'header', None)
    if 'header' in field_names(message) and 'stamp' in field_names(header):
        return True
    if source.stamp == 'header':
        raise FieldError(
            f'{source.key}.stamp', f"is 'header', but {describe(message)} has none, it has "
                                   f"{', '.join(field_names(message))}; use 'receive'")
    return False
