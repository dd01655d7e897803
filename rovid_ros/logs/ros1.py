"""ROS 1 bags, version 2.0 (https://wiki.ros.org/Bags/Format/2.0), closed or not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import struct
from typing import BinaryIO

from rovid_ros.logs.container import Block, Channel, IndexedContainer, inflate, MAX_BLOCK_SIZE, Raw
from rovid_ros.messages.types import normalised

MAGIC = b'#ROSBAG V2.0\n'
_LENGTH = struct.Struct('<I')
_TIME = struct.Struct('<II')
_MESSAGE, _BAG, _CHUNK, _CHUNK_INFO, _CONNECTION = b'\x02', b'\x03', b'\x05', b'\x06', b'\x07'

Header = dict[bytes, bytes]


class BagFile(IndexedContainer):
    """A ROS 1 bag."""

    def load(self, block: Block, wanted: Mapping[int, Channel]) -> list[Raw]:
        with self.path.open('rb') as file:
            file.seek(block.where)
            _, header, data = next(_records(file, self.size))
        size = _size(header)
        inflated = inflate(data, _compression(header), self.name, size)
        if len(inflated) != size and not self.cut:
            self.note_damage()
        return _messages(inflated, wanted, self.first_place(block))

    def read_index(self, file: BinaryIO) -> bool:
        file.seek(len(MAGIC))
        _, bag, _ = next(_records(file, self.size))
        position, = struct.unpack('<Q', bag[b'index_pos'])
        chunks, = _LENGTH.unpack(bag[b'chunk_count'])
        connections, = _LENGTH.unpack(bag[b'conn_count'])
        if not position:
            return False
        file.seek(position)
        found: list[tuple[int, int, int, dict[int, int]]] = []
        for _, header, data in _records(file, self.size):
            if header[b'op'] == _CONNECTION:
                self._connect(header, data)
            elif header[b'op'] == _CHUNK_INFO:
                place, = struct.unpack('<Q', header[b'chunk_pos'])
                found.append((place, _time(header[b'start_time']), _time(header[b'end_time']),
                              dict(struct.iter_unpack('<II', data))))
        if (len(found), len(self.channels)) != (chunks, connections):
            return False
        for place, start, end, counts in sorted(found, key=lambda info: info[0]):
            self.add_block(start, end, counts.keys(), place)
            for channel, count in counts.items():
                assert self.counts is not None
                self.counts[channel] = self.counts.get(channel, 0) + count
        return True

    def scan(self, file: BinaryIO) -> None:
        self.cut = True  # the index is written when a bag is closed
        file.seek(len(MAGIC))
        for place, header, data in _records(file, self.size):
            if header.get(b'op') == _CHUNK:
                inflated = inflate(data, _compression(header), self.name, _size(header))
                for _, inner, body in _records_in(inflated):
                    if inner.get(b'op') == _CONNECTION:
                        self.attempt(self._connect, inner, body)
                self.add_counted(_messages(inflated, self.channels, 0), place)
            elif header.get(b'op') == _CONNECTION:
                self.attempt(self._connect, header, data)

    def _connect(self, header: Header, data: bytes) -> None:
        number, = _LENGTH.unpack(header[b'conn'])
        fields = {name: text.decode(errors='replace') for name, text in _fields(data).items()}
        topic = header[b'topic'].decode(errors='replace')
        self.declare(self.channels, number, Channel(
            number, '/' + topic.lstrip('/'), normalised(fields[b'type']), 'ros1',
            fields[b'message_definition']), len(topic) + len(data))


def _records(file: BinaryIO, size: int) -> Iterator[tuple[int, Header, bytes]]:
    """Yield place, header and data of the records; of the last one perhaps not all data."""
    while (place := file.tell()) < size:
        parts = []
        for _ in range(2):
            head = file.read(_LENGTH.size)
            if len(head) < _LENGTH.size:
                return
            length, = _LENGTH.unpack(head)
            end = min(file.tell() + length, size)
            parts.append(file.read(max(min(end - file.tell(), MAX_BLOCK_SIZE), 0)))
            file.seek(max(end, file.tell()))
            if len(parts) == 1 and (not length or len(parts[0]) < length):
                return
        yield place, _fields(parts[0]), parts[1]


def _records_in(data: bytes) -> Iterator[tuple[int, Header, bytes]]:
    """Yield place, header and data of the whole records in a chunk."""
    position, size = 0, len(data)
    while position + 8 <= size:
        place = position
        length, = _LENGTH.unpack_from(data, position)
        start = position + 4 + length
        if not length or start + 4 > size:
            return
        end = start + 4 + _LENGTH.unpack_from(data, start)[0]
        if end > size:
            return
        yield place, _fields(data[position + 4:start]), data[start + 4:end]
        position = end


def _fields(data: bytes) -> Header:
    fields = {}
    position = 0
    while position + 4 <= len(data):
        length, = _LENGTH.unpack_from(data, position)
        name, _, value = data[position + 4:position + 4 + length].partition(b'=')
        fields[name] = value
        position += 4 + length
    return fields


def _messages(data: bytes, wanted: Mapping[int, Channel], block: int) -> list[Raw]:
    found: list[Raw] = []
    for place, header, body in _records_in(data):
        conn, time = header.get(b'conn', b''), header.get(b'time', b'')
        if header.get(b'op') == _MESSAGE and (len(conn), len(time)) == (4, 8):
            number, = _LENGTH.unpack(conn)
            if number in wanted:
                found.append((_time(time), block | place, wanted[number], body))
    return found


def _size(header: Header) -> int:
    """Return what a chunk says that is in it [bytes]."""
    size = header.get(b'size', b'')
    return int.from_bytes(size, 'little') if len(size) == _LENGTH.size else MAX_BLOCK_SIZE


def _compression(header: Header) -> str:
    return header.get(b'compression', b'?').decode(errors='replace')


def _time(data: bytes) -> int:
    seconds, nanoseconds = _TIME.unpack(data)
    return int(seconds * 1_000_000_000 + nanoseconds)
