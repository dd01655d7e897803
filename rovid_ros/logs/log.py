"""Recorded logs: files of several formats, read lazily as one log in time order."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
import os
from pathlib import Path
import re
from tempfile import gettempdir, TemporaryDirectory
from typing import Any, NamedTuple

from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore
from rovid_ros.files.whole_files import remove_stale_files
from rovid_ros.logs.container import (
    Block,
    Channel,
    Container,
    LogError,
    MALFORMED,
    MESSAGE_OVERHEAD,
    Raw,
)
from rovid_ros.logs.paths import open_all
from rovid_ros.messages.field_paths import nearest
from rovid_ros.messages.types import (
    build,
    Decoder,
    decoder,
    MAX_MESSAGE_SIZE,
    normalised,
    typestore,
    TypeUnknownError,
    WireType,
)
from zstandard import ZstdError

RECORD = 'rovid_record'  # name of the metadata in the logs that the node writes itself
# Messages of a topic that cannot be decoded, one after the other from the first one on.
MAX_UNDECODED = 20
# [bytes] Of messages that have to be sorted because their blocks overlap in time
MAX_HELD = 1 << 29


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


# Serialised message and log time [ns] to the data of a ``LogMessage``.
Maker = Callable[[bytes, int], Any]
# Topic, how its messages are written, and their decoder, to the maker of their data.
MakerFactory = Callable[[str, WireType, Decoder], Maker]
_Wanted = Mapping[Container, Mapping[int, Channel]]  # the channels to read of each file


class RawMessage(NamedTuple):
    """A message as it is in the file."""

    time: int  # [ns]
    channel: Channel
    data: bytes


class Log:
    """
    One or more recorded files, as one log.

    Raises LogError if one is not there, is no log, or all of them hold no message.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        remove_stale_files(Path(gettempdir()), 'rovid-')
        self._scratch = TemporaryDirectory(prefix=f'rovid-{os.getpid()}-')
        try:
            self._containers, self._warnings = open_all(paths, Path(self._scratch.name))
            self._containers.sort(key=_by_run_and_part(self._containers))
            if not any(container.blocks for container in self._containers):
                raise LogError(next(iter(self.warnings), None) or (
                    f'{", ".join(map(str, paths))}: holds no messages'))
        except BaseException:
            self.close()
            raise
        for order, container in enumerate(self._containers):
            container.order = order
        # log time of the first and the last message [ns]
        self.start = min(container.start for container in self._containers)
        self.end = max(container.end for container in self._containers)
        self.metadata: dict[str, dict[str, str]] = {}
        for container in reversed(self._containers):  # a run begins where the earliest did
            self.metadata.update(container.metadata)
        self.topics = _topics_of(self._containers)  # names always begin with a slash
        for container in self._containers:
            container.drop_empty_channels()  # announced with another type, and never used
        records = [RECORD in container.metadata for container in self._containers]
        # The node's own recorder wrote all of it: messages come in the order of the file, which is
        # the order in which the node took them.
        self.recorded = all(records)
        if any(records) and not self.recorded:
            self._warnings.append('a record of the node is joined with other logs: it is taken '
                                  'in time order, without the calls of services in it')
        self.progress = 0.0  # fraction, 0 to 1, of what was asked for that has been read

    @property
    def warnings(self) -> list[str]:
        """Return what is wrong with the log; damage only shows when it is read."""
        return [*self._warnings, *chain(*(one.warnings for one in self._containers))]

    @property
    def own_clock(self) -> bool:
        """Tell whether its times do not begin in 1970, but with the device that wrote it."""
        return any(container.own_clock for container in self._containers)

    def files_without(self, topic: str) -> list[str]:
        """Return the names of the files that do not know a topic or hold nothing of it."""
        return [container.name for container in self._containers
                if not any(channel.topic == topic for channel in container.channels.values())]

    def require(self, topics: Mapping[str, str]) -> None:
        """
        Refuse a log that lacks a topic, or has it with another type; '' is any type.

        Raises LogError, which names the topic, the nearest one and those that are there.
        """
        there = sorted(name for name, info in self.topics.items() if info.count != 0)
        for topic, type in topics.items():
            if topic not in there:
                raise LogError(f'{self._name()}: no messages on {topic}; '
                               f'it has {", ".join(there)}{nearest(topic, there)}')
            found = {channel.type for channel in self._channels(topic)}
            if type and found != {normalised(type)}:
                raise LogError(f'{self._name()}: {topic} is {", ".join(sorted(found))}, '
                               f'not {type}')

    def is_readable(self, topic: str) -> bool:
        """Return whether the messages of a topic can be decoded."""
        try:
            for channel in self._channels(topic):
                self._maker(channel, None)
        except LogError:
            return False
        return True

    def blank(self, topic: str) -> Any:
        """Return a message of a topic's type that holds default values only."""
        channel = self._channels(topic)[0]
        return build(self._typestore(channel), channel.type, {})

    def messages(self, topics: Collection[str], start: float = 0.0, duration: float | None = None,
                 make: MakerFactory | None = None) -> Iterator[LogMessage]:
        """
        Yield the decoded messages of some topics; those that the log lacks are left out.

        ``start`` and ``duration`` are a part of the log [s], from its first message on any topic.
        ``make`` gets a topic, how its messages are written and their decoder; it returns what
        makes the data of bytes and log time. Without it, they are decoded as a whole. Raises
        LogError if a topic cannot be decoded.
        """
        # by identity: comparing channels for every message would take a third of the time
        makers = {id(channel): self._maker(channel, make)
                  for topic in topics for channel in self._channels(topic)}
        decoded: set[int] = set()
        failed: dict[int, tuple[int, str]] = {}  # how many, and of the last what is wrong
        for part in self._parts(topics, start, duration):
            for time, _, channel, raw in part:
                if len(raw) > MAX_MESSAGE_SIZE:
                    self._warn_once(
                        f'{self._name()}: {channel.topic} ({channel.type}) has messages of more '
                        f'than {MAX_MESSAGE_SIZE:,} bytes; they are left out')
                    continue
                try:
                    data = makers[id(channel)](raw, time)
                except (SerdeError, ZstdError, AssertionError, *MALFORMED) as error:  # by version
                    line = f'{self._name()}: {channel.topic} ({channel.type}) cannot be decoded'
                    count = failed.get(id(channel), (0, ''))[0] + 1
                    failed[id(channel)] = count, f'{line}: {error}'
                    if id(channel) not in decoded and count == MAX_UNDECODED:
                        raise LogError(f'{line}: {error}') from None
                    self._warn_once(f'{line} everywhere; such messages are left out')
                    continue
                decoded.add(id(channel))
                yield LogMessage(channel.topic, channel.type, time, data)
        for number in failed.keys() - decoded:
            raise LogError(failed[number][1])

    def raw(self, topics: Collection[str], start: float = 0.0,
            duration: float | None = None) -> Iterator[RawMessage]:
        """Yield the messages as they are in the files; parameters as in ``messages``."""
        for part in self._parts(topics, start, duration):
            for time, _, channel, data in part:
                yield RawMessage(time, channel, data)

    def close(self) -> None:
        """Remove unpacked copies."""
        self._scratch.cleanup()

    def __enter__(self) -> Log:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _parts(self, topics: Collection[str], start: float,
               duration: float | None) -> Iterator[list[Raw]]:
        """Yield the messages in order, some at a time, and note how far they are."""
        first = self.start + round(start * 1e9)
        if first > self.end:
            raise LogError(f'{self._name()}: is {(self.end - self.start) * 1e-9:.1f} s long; '
                           f'nothing is left from {start:g} s on')
        last = self.end if duration is None else min(
            self.end, first + round(duration * 1e9) - 1)
        wanted = {
            container: {number: channel for number, channel in container.channels.items()
                        if channel.topic in topics}
            for container in self._containers}
        for part in _ordered_parts(self._containers, wanted, first, last, self.recorded):
            yield part
            if part:
                self.progress = min(max(part[-1][0] - first, 0) / max(last - first, 1), 1.0)
        self.progress = 1.0

    def _maker(self, channel: Channel, make: MakerFactory | None) -> Maker:
        if channel.encoding not in ('cdr', 'ros1'):
            raise LogError(f'{self._name()}: {channel.topic} is encoded as '
                           f'{channel.encoding!r}; cdr and ros1 can be read')
        wire = WireType(self._typestore(channel), channel.type, channel.encoding)
        decode = decoder(*wire)
        return make(channel.topic, wire, decode) if make else lambda raw, time: decode(raw)

    def _warn_once(self, line: str) -> None:
        if line not in self._warnings:
            self._warnings.append(line)

    def _channels(self, topic: str) -> list[Channel]:
        return [channel for container in self._containers
                for channel in container.channels.values() if channel.topic == topic]

    def _typestore(self, channel: Channel) -> Typestore:
        try:
            return typestore(channel.type, channel.definition, channel.idl)
        except TypeUnknownError as error:
            raise LogError(f'{self._name()}: {channel.topic}: {error}') from None

    def _name(self) -> str:
        return ', '.join(container.name for container in self._containers)


def _by_run_and_part(containers: Iterable[Container]) -> Callable[[Container], Any]:
    """Return a key that sorts by time, and the parts of a record as they were written."""
    starts: dict[str, int] = {}

    def run_of(container: Container) -> str:
        return container.metadata.get(RECORD, {}).get('run', '')

    for container in containers:
        run = run_of(container)
        starts[run] = min(starts.get(run, container.start), container.start)

    def place(container: Container) -> tuple[int, str, int, int]:
        run = run_of(container)
        part = container.metadata[RECORD].get('part', '') if run else ''
        return (starts[run] if run else container.start, run,
                int(part) if re.fullmatch('[0-9]{1,9}', part) else 0, container.start)

    return place


def _topics_of(containers: Iterable[Container]) -> dict[str, TopicInfo]:
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


def _ordered_parts(containers: Sequence[Container], wanted: _Wanted, first: int, last: int,
                   in_file_order: bool) -> Iterator[list[Raw]]:
    """Yield the messages of some channels, from ``first`` to ``last`` [ns], part by part."""
    blocks = [
        block for container in containers for block in container.blocks
        if block.end >= first and block.start <= last and wanted[container]
        and not (block.channels and block.channels.isdisjoint(wanted[container]))]
    for container in containers:
        container.loaded = 0
    if in_file_order:
        for block in blocks:
            part = block.container.read(block, wanted[block.container])
            yield [message for message in part if first <= message[0] <= last]
        return
    for part in _in_time_order(blocks, wanted):
        if part and not first <= part[0][0] <= part[-1][0] <= last:
            yield part[bisect_left(part, (first,)):bisect_left(part, (last + 1,))]
        else:
            yield part


def _in_time_order(blocks: Sequence[Block], wanted: _Wanted) -> Iterator[list[Raw]]:
    """Yield all messages in order; LogError if too many blocks overlap in time to be held."""
    ordered = sorted(blocks, key=lambda block: block.start)
    held: list[Raw] = []
    for block, following in zip(ordered, [*ordered[1:], None]):
        held += block.container.read(block, wanted[block.container])
        held.sort()
        if sum(len(raw[3]) + MESSAGE_OVERHEAD for raw in held) > MAX_HELD:
            raise LogError(f'{block.container.name}: more than {MAX_HELD >> 20} MiB of messages '
                           'overlap in time')
        if following is not None:
            complete = bisect_left(held, (following.start,))
            yield held[:complete]
            del held[:complete]
    yield held
