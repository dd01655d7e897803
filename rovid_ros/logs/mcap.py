"""
MCAP files (https://mcap.dev/spec), whole or cut off, with chunks or without.

The format's own Python package refuses a file without an end and stops at a chunk without one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from io import BytesIO
import struct
from typing import BinaryIO
import zlib

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from rovid_ros.logs.container import (
    Block,
    Channel,
    IndexedContainer,
    inflate,
    MAX_BLOCK_SIZE,
    MAX_DECLARATIONS,
    Raw,
)
from rovid_ros.messages.types import normalised

MAGIC = b'\x89MCAP0\r\n'
_CHUNK = struct.Struct('<QQQII')  # start, end, uncompressed size and CRC, length of a name
_FOOTER = 9 + 20 + len(MAGIC)
_RUN = 1 << 20  # [bytes] of messages outside chunks that are read as one block
_ENCODINGS = {'ros2msg': False, 'ros1msg': False, 'ros2idl': True, 'omgidl': True}


class McapFile(IndexedContainer):
    """An MCAP file."""

    def clear(self) -> None:
        super().clear()
        self._schemas: dict[int, tuple[str, str, str]] = {}  # name, encoding, definition
        self._lacks_schema = False

    def load(self, block: Block, wanted: Mapping[int, Channel]) -> list[Raw]:
        offset, size, is_chunk = block.where
        with self.path.open('rb') as file:
            file.seek(offset)
            data = file.read(size)
        if is_chunk:
            data, whole = self._chunk(data)
            if not whole and not self.cut:
                self.note_damage()
        return messages(data, wanted, self.first_place(block))

    def _summary(self, file: BinaryIO) -> bytes:
        """Return the records of the index at the end of the file; none if it is damaged."""
        file.seek(max(self.size - _FOOTER, 0))
        tail = file.read(_FOOTER)
        if len(tail) < _FOOTER or tail[-8:] != MAGIC or tail[0] != Opcode.FOOTER:
            return b''
        footer = records.Footer.read(stream(tail[9:]))
        if not 0 < footer.summary_start <= self.size - _FOOTER:
            return b''
        if self.size - footer.summary_start > MAX_BLOCK_SIZE:
            return b''
        file.seek(footer.summary_start)
        summary = file.read(self.size - _FOOTER - footer.summary_start)
        crc = footer.summary_crc
        return b'' if crc and crc != zlib.crc32(summary + tail[:25]) else summary

    def read_index(self, file: BinaryIO) -> bool:
        statistics: records.Statistics | None = None
        chunks: list[records.ChunkIndex] = []
        metadata: list[records.MetadataIndex] = []
        for opcode, body in records_in(self._summary(file)):
            if opcode == Opcode.STATISTICS:
                statistics = records.Statistics.read(stream(body))
            elif opcode == Opcode.CHUNK_INDEX:
                chunks.append(records.ChunkIndex.read(stream(body)))
            elif opcode == Opcode.METADATA_INDEX:
                metadata.append(records.MetadataIndex.read(stream(body)))
            else:
                self._declare(opcode, body)
        if statistics is None or not self._agrees(statistics, len(chunks), len(metadata)):
            return False
        behind = 0
        for index in sorted(chunks, key=lambda index: index.chunk_start_offset):
            if index.chunk_start_offset < behind:
                return False  # two chunks in one place
            behind = index.chunk_start_offset + index.chunk_length
            self._index_chunk(index)
        for entry in metadata:
            file.seek(min(entry.offset + 9, self.size))
            self._declare(
                Opcode.METADATA, file.read(max(min(entry.length - 9, MAX_DECLARATIONS), 0)))
        return True

    def _agrees(self, statistics: records.Statistics, chunks: int, metadata: int) -> bool:
        """Return whether the index is complete; it may leave out most of its parts."""
        self.counts = counts = statistics.channel_message_counts
        return (
            not self._lacks_schema
            # those without messages may not count
            and statistics.channel_count <= len(self.channels)
            and statistics.chunk_count == chunks
            and statistics.metadata_count == metadata
            and statistics.message_count == sum(counts.values())
            and (chunks > 0 or statistics.message_count == 0))

    def _index_chunk(self, index: records.ChunkIndex) -> None:
        if index.chunk_start_offset + index.chunk_length > self.size:
            raise ValueError('a chunk behind the end of the file')
        if index.chunk_length > MAX_BLOCK_SIZE:
            raise ValueError('a chunk that is too large')
        channels = set(index.message_index_offsets)
        if channels or index.message_end_time:
            self.add_block(index.message_start_time, index.message_end_time, channels or None,
                           (index.chunk_start_offset + 9, index.chunk_length - 9, True))

    def _declare(self, opcode: int, body: bytes) -> None:
        """Note a schema, a channel or metadata."""
        if opcode == Opcode.SCHEMA:
            schema = records.Schema.read(stream(body))
            known = schema.encoding in _ENCODINGS
            self.declare(self._schemas, schema.id, (
                normalised(schema.name), schema.encoding,
                schema.data.decode(errors='replace') if known else ''), len(body))
        elif opcode == Opcode.CHANNEL:
            record = records.Channel.read(stream(body))
            self._lacks_schema |= bool(record.schema_id) and record.schema_id not in self._schemas
            name, encoding, text = self._schemas.get(record.schema_id, ('unknown', '', ''))
            self.declare(self.channels, record.id, Channel(
                record.id, '/' + record.topic.lstrip('/'), name, record.message_encoding, text,
                _ENCODINGS.get(encoding, False)), len(body))
        elif opcode == Opcode.METADATA:
            entry = records.Metadata.read(stream(body))
            self.declare(self.metadata, entry.name, dict(entry.metadata), len(body))

    def scan(self, file: BinaryIO) -> None:
        offset = len(MAGIC)
        run = offset  # where the messages outside chunks begin that no block holds yet
        file.seek(offset)
        while True:
            there = offset + RECORD.size <= self.size
            opcode, length = RECORD.unpack(file.read(RECORD.size)) if there else (0, 0)
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                break
            end = offset + RECORD.size + length
            self.cut = opcode == 0 or Opcode.DATA_END < opcode < 0x80 or end > self.size
            is_chunk = opcode == Opcode.CHUNK
            if is_chunk or self.cut or end - run > _RUN:
                self._scan_run(file, run, offset)
                run = end if is_chunk else offset
                file.seek(offset + RECORD.size)
            if is_chunk and min(length, self.size) > MAX_BLOCK_SIZE:
                self.note_damage()
            elif is_chunk:
                self._scan_chunk(
                    file, offset + RECORD.size, min(end, self.size) - offset - RECORD.size)
            if self.cut:
                return
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
                self.attempt(self._declare, opcode, file.read(min(length, MAX_DECLARATIONS)))
            offset = end
            file.seek(offset)
        self._scan_run(file, run, offset)
        file.seek(max(self.size - len(MAGIC), 0))
        self.cut = file.read(len(MAGIC)) != MAGIC

    def _scan_run(self, file: BinaryIO, start: int, end: int) -> None:
        if end - start > MAX_BLOCK_SIZE:
            self.note_damage()  # one message, for others are read before there are so many
            return
        file.seek(start)
        data = file.read(end - start)
        self.add_counted(messages(data, self.channels, 0), (start, end - start, False))

    def _scan_chunk(self, file: BinaryIO, offset: int, length: int) -> None:
        data, whole = self._chunk(file.read(length))
        if not whole and not self.cut:
            self.note_damage()
        for opcode, body in records_in(data):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self.attempt(self._declare, opcode, body)
        self.add_counted(messages(data, self.channels, 0), (offset, length, True))

    def _chunk(self, body: bytes) -> tuple[bytes, bool]:
        """Return the records in a chunk and whether they are all there and right."""
        if len(body) < _CHUNK.size:
            return b'', False
        _, _, size, crc, length = _CHUNK.unpack_from(body)
        start = _CHUNK.size + length
        compression = body[_CHUNK.size:start].decode(errors='replace')
        if len(body) < start + 8:
            return b'', False
        data = inflate(body[start + 8:], compression, self.name, size)
        whole = len(data) == size and (not crc or zlib.crc32(data) == crc)
        if not whole and len(data) >= size and length_of(data) == len(data):
            return b'', False  # every record is there, but some bits are wrong
        return data, whole


RECORD = struct.Struct('<BQ')  # opcode, length
_MESSAGE = struct.Struct('<BQH4xQ8x')  # a record; channel, (sequence,) log time, (publish time)


def stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))


def records_in(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and body of the whole records."""
    position = 0
    while position + RECORD.size <= len(data):
        opcode, length = RECORD.unpack_from(data, position)
        start = position + RECORD.size
        position = start + length
        if not opcode or position > len(data):
            return
        yield opcode, data[start:position]


def length_of(data: bytes) -> int:
    """Return the length of the whole records [bytes]."""
    return sum(RECORD.size + len(body) for _, body in records_in(data))


def messages(data: bytes, wanted: Mapping[int, Channel], place: int) -> list[Raw]:
    """Return the whole messages of these channels."""
    found: list[Raw] = []
    position, size = 0, len(data)
    head, channel_of = _MESSAGE.unpack_from, wanted.get
    while position + 31 <= size:  # no message is shorter
        opcode, length, number, time = head(data, position)
        end = position + 9 + length
        if end > size or not opcode:
            break
        if opcode == 5 and length >= 22:
            channel = channel_of(number)
            if channel is not None:
                found.append((time, place | position, channel, data[position + 31:end]))
        position = end
    return found
