"""
MCAP files of ROS 2, written message by message (https://mcap.dev/spec).

The file is, byte for byte, what the format's own package would write; a message takes a fifth of
the time. All records but messages are those of the package.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import struct
from typing import BinaryIO, Final
import zlib

from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from rovid_ros.logs.mcap import MAGIC
import zstandard

_MESSAGE: Final = struct.Struct('<BQHIQQ')  # a record; channel, sequence, log and publish time
_MESSAGE_SIZE: Final = _MESSAGE.size
_BEHIND_LENGTH: Final = _MESSAGE.size - 9
_OPCODE: Final = int(Opcode.MESSAGE)
_INDEX = struct.Struct('<BQHI')  # a record; channel, bytes of the entries
_SUMMARY_CRC = struct.Struct('<BQQQ')


class McapWriter:
    """
    Writes the records of a file, messages in chunks that zstd compresses.

    Parameters
    ----------
    stream : BinaryIO
        Where to; it is not closed.
    chunk_size : int
        A chunk ends when it is larger [bytes].

    """

    def __init__(self, stream: BinaryIO, chunk_size: int) -> None:
        self._stream = stream
        self._chunk_size = chunk_size
        self._compressor = zstandard.ZstdCompressor()
        self._schemas: list[records.Schema] = []
        self._channels: list[records.Channel] = []
        self._counts: dict[int, int] = {}  # of messages by channel
        self._times: tuple[int, int] | None = None  # of all messages, first and last
        self._chunks: list[records.ChunkIndex] = []
        self._metadata: list[records.MetadataIndex] = []
        self._begin_chunk()
        stream.write(MAGIC)
        self._write(records.Header('ros2', 'rovid'))

    def _begin_chunk(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0  # of the parts
        self._indices: dict[int, list[int]] = {}  # by channel: time, offset, time, offset ...
        self._first, self._last = -1, 0  # log times of the chunk

    def add_schema(self, name: str, definition: bytes) -> int:
        """Add the definition of a type; return its number."""
        schema = records.Schema(
            id=len(self._schemas) + 1, data=definition, encoding='ros2msg', name=name)
        self._schemas.append(schema)
        self._add_to_chunk(_bytes(schema))
        return schema.id

    def add_channel(self, topic: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Add a channel; return its number."""
        channel = records.Channel(
            id=len(self._channels) + 1, topic=topic, message_encoding='cdr', schema_id=schema,
            metadata=dict(metadata))
        self._channels.append(channel)
        self._add_to_chunk(_bytes(channel))
        return channel.id

    def add_messages(self, channels: Sequence[int], messages: Sequence[bytes], log_time: int,
                     publish_time: int) -> None:
        """Add a message to each of some channels, all at the same times [ns], from 0."""
        for channel, data in zip(channels, messages):
            entries = self._indices.get(channel)
            if entries is None:
                entries = self._indices[channel] = []
            entries.append(log_time)
            entries.append(self._size)
            if log_time < self._first or self._first < 0:
                self._first = log_time
            if log_time > self._last:
                self._last = log_time
            self._parts.append(_MESSAGE.pack(
                _OPCODE, _BEHIND_LENGTH + len(data), channel, 0, log_time, publish_time))
            self._size += _MESSAGE_SIZE
            self._add_to_chunk(data)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add metadata."""
        offset = self._stream.tell()
        length = self._write(records.Metadata(name=name, metadata=dict(values)))
        self._metadata.append(records.MetadataIndex(offset=offset, length=length, name=name))

    def flush(self) -> None:
        """End the chunk and hand everything so far to the operating system."""
        self._end_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Write what is left and the index."""
        self._end_chunk()
        self._write(records.DataEnd(0))
        start = self._stream.tell()
        summary, offsets = bytearray(), bytearray()
        first, last = self._times or (0, 0)
        for opcode, group in (
                (Opcode.SCHEMA, self._schemas), (Opcode.CHANNEL, self._channels),
                (Opcode.STATISTICS, [records.Statistics(
                    attachment_count=0, channel_count=len(self._channels),
                    channel_message_counts=self._counts, chunk_count=len(self._chunks),
                    message_count=sum(self._counts.values()), metadata_count=len(self._metadata),
                    message_start_time=first, message_end_time=last,
                    schema_count=len(self._schemas))]),
                (Opcode.CHUNK_INDEX, self._chunks), (Opcode.ATTACHMENT_INDEX, []),
                (Opcode.METADATA_INDEX, self._metadata)):
            begin = len(summary)
            for record in group:
                summary += _bytes(record)
            offsets += _bytes(records.SummaryOffset(
                group_opcode=opcode, group_start=start + begin,
                group_length=len(summary) - begin))
        offset = start + len(summary)
        summary += offsets
        crc = zlib.crc32(_SUMMARY_CRC.pack(Opcode.FOOTER, 20, start, offset), zlib.crc32(summary))
        self._stream.write(summary)
        self._write(records.Footer(
            summary_start=start, summary_offset_start=offset, summary_crc=crc))
        self._stream.write(MAGIC)

    def _add_to_chunk(self, data: bytes) -> None:
        self._parts.append(data)
        self._size += len(data)
        if self._size > self._chunk_size:
            self._end_chunk()

    def _end_chunk(self) -> None:
        if not self._indices:  # schemas and channels wait for a message
            return
        data = b''.join(self._parts)
        compressed = self._compressor.compress(data)
        start = self._stream.tell()
        length = self._write(records.Chunk(
            compression='zstd', data=compressed, message_start_time=self._first,
            message_end_time=self._last, uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data)))
        index, offsets = bytearray(), {}
        for channel, entries in self._indices.items():
            offsets[channel] = start + length + len(index)
            size = 8 * len(entries)
            index += _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size)
            index += struct.pack(f'<{len(entries)}Q', *entries)
            self._counts[channel] = self._counts.get(channel, 0) + len(entries) // 2
        self._stream.write(index)
        self._chunks.append(records.ChunkIndex(
            message_start_time=self._first, message_end_time=self._last,
            chunk_start_offset=start, chunk_length=length, message_index_offsets=offsets,
            message_index_length=len(index), compression='zstd',
            compressed_size=len(compressed), uncompressed_size=len(data)))
        first, last = self._times or (self._first, self._last)
        self._times = min(first, self._first), max(last, self._last)
        self._begin_chunk()

    def _write(self, record: records.McapRecord) -> int:
        """Write a record; return its length."""
        data = _bytes(record)
        self._stream.write(data)
        return len(data)


def _bytes(record: records.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data
