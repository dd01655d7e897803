"""What the file formats of logs share: channels, and blocks of messages read one at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Set
from dataclasses import dataclass
from pathlib import Path
import struct
from typing import Any, BinaryIO

from mcap.exceptions import McapError

NEVER = (1 << 63) - 1
_SECTOR = 512  # [bytes]; fewer zeros at the end of a file can well be data
_STEP = 1 << 20

LARGEST = 1 << 27
"""[bytes] A block that is larger, packed or not, is not read; recorders make them of 1 to 4 MB."""
MOST_DECLARED = 1 << 26
"""[bytes] Of topics, types and metadata that are kept of a file; most have less than 1 MB."""


MALFORMED = (
    struct.error, IndexError, KeyError, OverflowError, StopIteration, TypeError, ValueError,
    McapError)
"""What comes of bytes that do not mean anything; LogError is among them."""


class LogError(ValueError):
    """A log that cannot be read or written; the text names the file and says why."""

    def __init__(self, message: str) -> None:
        super().__init__(' '.join(message.splitlines()))  # a damaged name can hold a new line


@dataclass(frozen=True, slots=True)
class Channel:
    """One topic with one type, as a file declares it."""

    number: int  # in the file
    topic: str
    type: str
    encoding: str  # of the messages: cdr or ros1, others cannot be decoded
    definition: str  # '' if the file has none
    idl: bool = False


Raw = tuple[int, int, Channel, bytes]
"""Log time [ns], place (no two messages share one), channel, serialised message."""


@dataclass(frozen=True, slots=True)
class Block:
    """
    A part of a file that is read as a whole.

    Attributes
    ----------
    container : Container
        Whose file it is in.
    number : int
        Place among the blocks of the file.
    start, end : int
        Times of the first and the last message [ns].
    channels : frozenset of int or None
        Those that it has messages of; None if that is not known.
    where : object
        What the container needs to find it.

    """

    container: Container
    number: int
    start: int
    end: int
    channels: frozenset[int] | None
    where: Any


class Container(ABC):
    """
    A file of recorded messages.

    A file without an end, as a power failure leaves it, gives what comes before the cut.

    Attributes
    ----------
    channels, counts : dict
        By channel id; None counts if the file does not say.
    metadata : dict
        MCAP metadata records by name.
    start, end : int
        Times of the first and the last message [ns].
    cut : bool
        Whether the end of the file is missing.

    """

    def __init__(self, path: Path, name: str) -> None:
        self.path = path
        self.name = name  # what to call it in messages
        self.order = 0  # among the files that are read as one log
        self.loaded = 0  # messages, since the reading began
        self.forget()
        self.look_through()
        self._finish()

    def forget(self) -> None:
        """Know nothing of the file."""
        self.channels: dict[int, Channel] = {}
        self.counts: dict[int, int] | None = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.blocks: list[Block] = []
        self.start = NEVER
        self.end = -1
        self.cut = False
        self._warnings: list[str] = []
        self._damaged = False
        self._declared = 0  # [bytes]

    def forget_empty(self) -> None:
        """Know nothing of channels without messages, if the file says how many there are."""
        counts = self.counts
        if counts is not None:
            self.channels = {number: channel for number, channel in self.channels.items()
                             if counts.get(number)}

    @abstractmethod
    def look_through(self) -> None:
        """Take note of channels, counts, metadata and blocks."""

    @abstractmethod
    def load(self, block: Block, wanted: Mapping[int, Channel]) -> list[Raw]:
        """Return the messages of these channels in a block, in the order of the file."""

    def read(self, block: Block, wanted: Mapping[int, Channel]) -> list[Raw]:
        """Load a block; one that makes no sense gives nothing but a warning."""
        try:
            messages = self.load(block, wanted)
        except LogError:
            raise
        except MALFORMED:
            self.damaged()
            return []
        self.loaded += len(messages)
        return messages

    @property
    def warnings(self) -> list[str]:
        """Return what is wrong with the file, one line each."""
        if not self._damaged:
            return self._warnings
        read = f', {self.loaded:,} were read' if self.loaded else ''
        return [*self._warnings,
                f'{self.name}: damaged; some of its messages are left out{read}']

    def _finish(self) -> None:
        """Say what is missing, after the file has been looked through."""
        if self.cut and not self.blocks:
            self._warnings.append(f'{self.name}: cut off before its first message')
        elif self.cut and self.counts is not None:
            self._warnings.append(
                f'{self.name}: cut off after {(self.end - self.start) * 1e-9:.1f} s (no end of '
                f'file); {sum(self.counts.values()):,} messages before the cut are used')

    def add_block(self, start: int, end: int, channels: Set[int] | None, where: Any) -> None:
        """Take note of the next block in the file."""
        known = None if channels is None else frozenset(channels)
        self.blocks.append(Block(self, len(self.blocks), start, end, known, where))
        self.start = min(self.start, start)
        self.end = max(self.end, end)

    def add_counted(self, messages: list[Raw], where: Any) -> None:
        """Take note of the next block, of which all messages are at hand."""
        if not messages:
            return
        assert self.counts is not None
        numbers = [message[2].number for message in messages]
        for number in numbers:
            self.counts[number] = self.counts.get(number, 0) + 1
        times = [message[0] for message in messages]
        self.add_block(min(times), max(times), set(numbers), where)

    def keep(self, known: dict[Any, Any], key: Any, value: Any, size: int) -> None:
        """
        Keep what the file declares, if it is new.

        Raises
        ------
        ValueError
            If these ``size`` bytes are more than a file may declare.

        """
        if known.get(key) == value:
            return
        self._declared += size
        if self._declared > MOST_DECLARED:
            raise ValueError('more declarations than any log needs')
        known[key] = value

    def damaged(self) -> None:
        """Take note of a chunk that is there but cannot be read as a whole."""
        self._damaged = True

    def place(self, block: Block) -> int:
        """Return a number that grows from log to log and from block to block."""
        return self.order << 60 | block.number << 40


class IndexedContainer(Container):
    """A file that says at its end what it holds, if it was closed."""

    def look_through(self) -> None:
        """Read the index, or the whole file."""
        self.size = written_size(self.path)
        with self.path.open('rb') as file:
            try:
                indexed = self.read_index(file)
            except MALFORMED:
                indexed = False
            if not indexed:
                self.forget()
                self.scan(file)

    @abstractmethod
    def read_index(self, file: BinaryIO) -> bool:
        """Return whether the index at the end tells all; note what it tells."""

    @abstractmethod
    def scan(self, file: BinaryIO) -> None:
        """Look through the whole file, up to its end or to where it stops making sense."""


def written_size(path: Path) -> int:
    """
    Return the size of a file [bytes] without the zeros at its end that were never written.

    After a power failure a file can have its new size and not yet its new content.
    """
    size = path.stat().st_size
    end = size
    with path.open('rb') as file:
        while end > 0:
            file.seek(max(end - _STEP, 0))
            tail = file.read(min(end, _STEP)).rstrip(b'\0')
            end = max(end - _STEP, 0) + len(tail)
            if tail:
                break
    return end if size - end >= _SECTOR else size
