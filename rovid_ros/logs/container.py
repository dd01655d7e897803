"""What the file formats of logs share: channels, blocks of messages, and their decompression."""

from __future__ import annotations

from abc import ABC, abstractmethod
import bz2
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass
from pathlib import Path
import struct
from typing import Any, BinaryIO

import lz4.frame
from mcap.exceptions import McapError
import zstandard

# [bytes] A block that is larger, packed or not, is not read; recorders make them of 1 to 4 MB
MAX_BLOCK_SIZE = 1 << 27
# [bytes] Of topics, types and metadata that are kept of a file; most have less than 1 MB
MAX_DECLARATIONS = 1 << 26
# [bytes] of memory that a message takes beside its data
MESSAGE_OVERHEAD = 200
_MAX_TIME = (1 << 63) - 1  # [ns]
_SECTOR = 512  # [bytes]; fewer zeros at the end of a file can well be data
_READ_SIZE = 1 << 20  # [bytes]
_SALVAGE_SIZE = 1024  # [bytes]; what one damaged piece costs when a chunk cannot be had whole

# What comes of bytes that do not mean anything; LogError is among them.
MALFORMED = (
    struct.error, IndexError, KeyError, OverflowError, StopIteration, TypeError, ValueError,
    McapError)


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


# Log time [ns], place (no two messages share one), channel, serialised message.
Raw = tuple[int, int, Channel, bytes]


@dataclass(frozen=True, slots=True)
class Block:
    """A part of a file that is read as a whole."""

    container: Container  # whose file it is in
    number: int  # place among the blocks of the file
    # times of the first and the last message [ns]
    start: int
    end: int
    channels: frozenset[int] | None  # those that it has messages of; None if that is not known
    where: Any  # what the container needs to find it


class Container(ABC):
    """
    A file of recorded messages, which raises LogError if it cannot be read.

    A file without an end, as a power failure leaves it, gives what comes before the cut.
    """

    own_clock = False  # whether its times are of no use in other files

    def __init__(self, path: Path, name: str) -> None:
        self.path = path
        self.name = name  # what to call it in messages
        self.order = 0  # among the files that are read as one log
        self.loaded = 0  # messages, since the reading began
        self.clear()
        self.read_structure()
        self._finish()

    def clear(self) -> None:
        """Drop all that is known of the file."""
        self.channels: dict[int, Channel] = {}  # by number, as the counts
        self.counts: dict[int, int] | None = {}  # None if the file does not say
        self.metadata: dict[str, dict[str, str]] = {}
        self.blocks: list[Block] = []
        # times of the first and the last message [ns]
        self.start = _MAX_TIME
        self.end = -1
        self.cut = False  # whether the end of the file is missing
        self._warnings: list[str] = []
        self._damaged = False
        self._declared = 0  # [bytes]

    def drop_empty_channels(self) -> None:
        """Drop channels without messages, if the file says how many there are."""
        counts = self.counts
        if counts is not None:
            self.channels = {number: channel for number, channel in self.channels.items()
                             if counts.get(number)}

    @abstractmethod
    def read_structure(self) -> None:
        """Note channels, counts, metadata and blocks."""

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
            self.note_damage()
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
        """Warn of what is missing, once the structure is known."""
        if self.cut and not self.blocks:
            self._warnings.append(f'{self.name}: cut off before its first message')
        elif self.cut and self.counts is not None:
            self._warnings.append(
                f'{self.name}: cut off after {(self.end - self.start) * 1e-9:.1f} s (no end of '
                f'file); {sum(self.counts.values()):,} messages before the cut are used')

    def add_block(self, start: int, end: int, channels: Set[int] | None, where: Any) -> None:
        """Add the next block of the file."""
        known = None if channels is None else frozenset(channels)
        self.blocks.append(Block(self, len(self.blocks), start, end, known, where))
        self.start = min(self.start, start)
        self.end = max(self.end, end)

    def add_counted(self, messages: list[Raw], where: Any) -> None:
        """Add and count the next block of the file, of which all messages are at hand."""
        if not messages:
            return
        assert self.counts is not None
        numbers = [message[2].number for message in messages]
        for number in numbers:
            self.counts[number] = self.counts.get(number, 0) + 1
        times = [message[0] for message in messages]
        self.add_block(min(times), max(times), set(numbers), where)

    def declare(self, known: dict[Any, Any], key: Any, value: Any, size: int) -> None:
        """Keep what the file declares, if it is new; ValueError if it declares too many bytes."""
        if known.get(key) == value:
            return
        self._declared += size
        if self._declared > MAX_DECLARATIONS:
            raise ValueError('more declarations than any log needs')
        known[key] = value

    def note_damage(self) -> None:
        """Note that something is there but cannot be read as a whole."""
        self._damaged = True

    def attempt(self, read: Callable[..., None], *given: Any) -> None:
        """Read one declaration; one that makes no sense is damage."""
        try:
            read(*given)
        except MALFORMED:
            self.note_damage()

    def first_place(self, block: Block) -> int:
        """Return the place of the first message of a block; it grows with file and block."""
        return self.order << 60 | block.number << 40


class IndexedContainer(Container):
    """A file that says at its end what it holds, if it was closed."""

    def read_structure(self) -> None:
        """Read the index, or the whole file."""
        self.size = written_size(self.path)
        with self.path.open('rb') as file:
            try:
                indexed = self.read_index(file)
            except MALFORMED:
                indexed = False
            if not indexed:
                self.clear()
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
            file.seek(max(end - _READ_SIZE, 0))
            tail = file.read(min(end, _READ_SIZE)).rstrip(b'\0')
            end = max(end - _READ_SIZE, 0) + len(tail)
            if tail:
                break
    return end if size - end >= _SECTOR else size


_DAMAGE = (zstandard.ZstdError, RuntimeError, OSError, EOFError, MemoryError)
_DECOMPRESSORS: dict[str, Any] = {
    'zstd': lambda: zstandard.ZstdDecompressor().decompressobj(),
    'lz4': lz4.frame.LZ4FrameDecompressor,
    'bz2': bz2.BZ2Decompressor,
}


def inflate(data: bytes, compression: str, name: str, size: int) -> bytes:
    """
    Decompress a chunk, or as much of it as can be had.

    No more comes out than one byte beyond the ``size`` that the chunk says, nor than
    ``MAX_BLOCK_SIZE``. Raises LogError if the compression is another.
    """
    if compression in ('', 'none'):
        return data
    if compression not in _DECOMPRESSORS:
        raise LogError(f'{name}: its chunks are compressed as {compression!r}; '
                       f'{", ".join(_DECOMPRESSORS)} can be read')
    most = min(size, MAX_BLOCK_SIZE) + 1
    try:
        if compression == 'zstd':
            return zstandard.ZstdDecompressor().stream_reader(data).read(most)
        whole: bytes = _DECOMPRESSORS[compression]().decompress(data, max_length=most)
        return whole
    except _DAMAGE:
        pass
    decompressor = _DECOMPRESSORS[compression]()
    pieces, left = [], most
    try:
        for position in range(0, len(data), _SALVAGE_SIZE):
            piece = decompressor.decompress(data[position:position + _SALVAGE_SIZE])
            pieces.append(piece[:left])
            left -= len(piece)
            if left <= 0:
                break
    except _DAMAGE:
        pass
    return b''.join(pieces)
