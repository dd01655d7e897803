"""The output log of a replay: under a name of its own until it is whole."""

from __future__ import annotations

from contextlib import suppress
import os
from pathlib import Path
from types import TracebackType
from zlib import crc32

from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from rovid_ros.files.whole_files import remove_leftovers, sync_folder
from rovid_ros.logs.container import MALFORMED
from rovid_ros.logs.writer import LogWriter
from rovid_ros.results.outputs import LATCHED
from zstandard import ZstdError


class OutputError(ValueError):
    """What an interrupted replay wrote is not there any more."""


class OutputFile(LogWriter):
    """
    A log that is written to ``NAME.part.mcap`` and gets its name when it is finished.

    So a run that is killed or interrupted leaves what was there under the name as it was, and
    what it wrote itself beside it, to be read and to be gone on from. A device or a pipe is
    written to as it is.

    Parameters
    ----------
    path : Path
        The name that it gets.
    earlier : tuple of int
        ``count`` and ``checksum`` of what an interrupted run had written and this one goes on
        from. What that run wrote later is dropped: it comes again.

    Attributes
    ----------
    part : Path
        The file that is written.
    count, checksum : int
        How many messages were written, and the CRC-32 of them all.

    Raises
    ------
    OutputError
        If neither the part nor the finished file begins with what was written earlier.

    """

    def __init__(self, path: Path, earlier: tuple[int, int] = (0, 0)) -> None:
        self.part = part_of(path)
        self.count = self.checksum = 0
        self._path = Path(os.path.realpath(path)) if path.is_symlink() else path
        if not earlier[0]:
            super().__init__(self.part)
        elif not any(source.is_file() and self._goes_on(source, earlier)
                     for source in (self.part, self._path)):
            raise OutputError(f'{path}: neither it nor {self.part.name} holds the '
                              f'{earlier[0]:,} messages that were written before')

    def write_raw(self, topic: str, type: str, cdr: bytes, time: int,
                  definition: str | None = None, publish_time: int | None = None,
                  latched: bool = False) -> None:
        """Write a message that is serialised already; see ``LogWriter``."""
        super().write_raw(topic, type, cdr, time, definition, publish_time, latched)
        self.count += 1
        self.checksum = crc32(cdr, self.checksum)

    def finish(self) -> None:
        """Give it its name, whole and on the disk."""
        self.close()
        if self.part != self._path:
            with self.part.open('rb') as file:
                os.fsync(file.fileno())
            self.part.replace(self._path)
            sync_folder(self._path.parent)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        """Close the file; a part that holds nothing is removed."""
        self.close()
        if self.part != self._path and not self.count:
            self.part.unlink(missing_ok=True)

    def _goes_on(self, source: Path, earlier: tuple[int, int]) -> bool:
        """Begin with the messages of a log; return whether they are those."""
        prefix = f'.{self.part.name}.'
        remove_leftovers(self.part.parent, prefix)
        copy = self.part.with_name(f'{prefix}{os.getpid()}')
        self.count = self.checksum = 0
        super().__init__(copy)
        try:
            self._take(source, earlier[0])
            if (self.count, self.checksum) == earlier:
                self.flush()
                self.sync()
                copy.replace(self.part)
                return True
        except BaseException:
            self.close()
            copy.unlink(missing_ok=True)
            raise
        self.close()
        copy.unlink()
        return False

    def _take(self, source: Path, count: int) -> None:
        """Copy the first messages of a log, as far as it can be read."""
        schemas: dict[int, str] = {}
        topics: dict[int, tuple[str, str]] = {}
        with source.open('rb') as file, suppress(ZstdError, *MALFORMED):  # the count tells
            for record in StreamReader(file).records:
                if self.count == count:
                    return
                if isinstance(record, Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, Channel):
                    topics[record.id] = record.topic, schemas[record.schema_id]
                elif isinstance(record, Message):
                    topic, type = topics[record.channel_id]
                    self.write_raw(
                        topic, type, record.data, record.log_time,
                        publish_time=record.publish_time, latched=topic[1:] in LATCHED)


def part_of(path: Path) -> Path:
    """Return where an output is written until it is finished."""
    place = Path(os.path.realpath(path)) if path.is_symlink() else path
    if place.exists() and not place.is_file():
        return place
    return place.with_name(f'{place.stem}.part{place.suffix}')
