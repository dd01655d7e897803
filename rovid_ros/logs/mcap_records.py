"""The records that an MCAP file is made of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from io import BytesIO
import struct

from mcap.data_stream import ReadDataStream
from rovid_ros.logs.container import Channel, Raw

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
