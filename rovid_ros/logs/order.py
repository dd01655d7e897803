"""The messages of a log's blocks, in the order of time or as they were written."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence

from rovid_ros.logs.container import Block, Channel, Container, LogError, Raw

MOST_HELD = 1 << 29
"""[bytes] Of messages that have to be sorted because their blocks overlap in time."""

_OVERHEAD = 200  # [bytes] of memory that a message takes beside its data

Wanted = Mapping[Container, Mapping[int, Channel]]
"""The channels to read of each file."""


def parts(containers: Sequence[Container], wanted: Wanted, first: int, last: int,
          in_file_order: bool) -> Iterator[list[Raw]]:
    """
    Yield the messages of some channels, part by part; blocks without them are not read.

    Parameters
    ----------
    containers : sequence of Container
        The files, by the time of their first message.
    wanted : mapping
        By file, the channels by number.
    first, last : int
        Log times [ns] between which they are, both included.
    in_file_order : bool
        Take them as they were written, and not by time.

    Raises
    ------
    LogError
        If too many blocks overlap in time.

    """
    blocks = [
        block for container in containers for block in container.blocks
        if block.end >= first and block.start <= last and wanted[container]
        and not (block.channels and block.channels.isdisjoint(wanted[container]))]
    for container in containers:
        container.loaded = 0
    if in_file_order:
        for part in as_written(blocks, wanted):
            yield [message for message in part if first <= message[0] <= last]
        return
    for part in in_time_order(blocks, wanted):
        if part and not first <= part[0][0] <= part[-1][0] <= last:
            yield part[bisect_left(part, (first,)):bisect_left(part, (last + 1,))]
        else:
            yield part


def as_written(blocks: Sequence[Block], wanted: Wanted) -> Iterator[list[Raw]]:
    """Yield all messages in the order of the files."""
    for block in blocks:
        yield block.container.read(block, wanted[block.container])


def in_time_order(blocks: Sequence[Block], wanted: Wanted) -> Iterator[list[Raw]]:
    """
    Yield all messages in order, holding only blocks that overlap in time.

    Raises
    ------
    LogError
        If too many of them overlap.

    """
    ordered = sorted(blocks, key=lambda block: block.start)
    held: list[Raw] = []
    for block, following in zip(ordered, [*ordered[1:], None]):
        held += block.container.read(block, wanted[block.container])
        held.sort()
        if sum(len(raw[3]) + _OVERHEAD for raw in held) > MOST_HELD:
            raise LogError(f'{block.container.name}: more than {MOST_HELD >> 20} MiB of messages '
                           'overlap in time')
        if following is not None:
            complete = bisect_left(held, (following.start,))
            yield held[:complete]
            del held[:complete]
    yield held
