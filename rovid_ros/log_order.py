"""The messages of several files in the order of their log times, a few blocks at a time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Sequence

from rovid_ros.log_container import Block, Channel, Container, Raw

Wanted = Mapping[Container, Mapping[int, Channel]]


def parts(containers: Sequence[Container], wanted: Wanted, first: int, last: int,
          in_file_order: bool) -> Iterator[list[Raw]]:
    """
    Yield the messages of some channels, part by part.

    Only what overlaps in time is held, and blocks without such channels are not read.

    Parameters
    ----------
    containers : sequence of Container
        The files, by the time of their first message.
    wanted : mapping
        By file, the channels by number.
    first, last : int
        Log times [ns] between which they are, both included.
    in_file_order : bool
        Take them as they come in the files, and not by time.

    """
    blocks = [
        block for container in containers for block in container.blocks
        if block.end >= first and block.start <= last and wanted[container]
        and not (block.channels and block.channels.isdisjoint(wanted[container]))]
    for container in containers:
        container.loaded = 0
    if in_file_order:
        for block in blocks:
            batch = block.container.read(block, wanted[block.container])
            yield [message for message in batch if first <= message[0] <= last]
        return
    for batch in _sorted(blocks, wanted):
        if batch and not first <= batch[0][0] <= batch[-1][0] <= last:
            yield batch[bisect_left(batch, (first,)):bisect_right(batch, (last + 1,))]
        else:
            yield batch


def _sorted(blocks: list[Block], wanted: Wanted) -> Iterator[list[Raw]]:
    """Yield all messages of the blocks by time, holding only blocks that overlap."""
    blocks.sort(key=lambda block: block.start)
    held: list[Raw] = []
    for block, following in zip(blocks, [*blocks[1:], None]):
        held += block.container.read(block, wanted[block.container])
        held.sort()
        if following is not None:
            complete = bisect_left(held, (following.start,))
            yield held[:complete]
            del held[:complete]
    yield held
