"""
ArduPilot's dataflash logs (.BIN), which an autopilot writes while it is armed.

Each record is two fixed bytes, its type and plain values; ``FMT`` records say what the other
types hold. A type is a topic, ``RCOU`` is ``/RCOU`` of type ``ardupilot/msg/RCOU``; where a type
has several instances, such as barometers, the second one is ``/BARO_1``. Time counts from the
autopilot's start. There is no index, no checksum and no end: one record follows the other, up to
the cut.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from keyword import iskeyword
import math
import re
import struct
from typing import Any

import numpy as np
import numpy.typing as npt
from rovid_ros.logs.container import Block, Channel, Container, Raw, written_size
from rovid_ros.messages.geographic import metres_per_degree

MAGIC = b'\xa3\x95\x80'
PACKAGE = 'ardupilot'  # that the types of records seem to be from
PARAMETERS = 'ardupilot_parameters'  # name of the metadata that hold the autopilot's own

_HEAD = MAGIC[:2]
_FORMAT = struct.Struct('<3xBB4s16s64s')  # of FMT: type, length, name, format, columns
_FMT = 128  # its type
_STEP = 1 << 21  # [bytes] that are read as one block
# [us] Of records in the order of the file; a time that is further away needs another beside it
_CLOSE = 1_000_000
_LAST = (1 << 63) // 2000  # [us] beyond it a time does not fit
_FIX = 3  # status of a GPS that has a position in three dimensions

# In the file and in the message, by format character: both types and the number to divide by.
_KINDS: dict[str, tuple[str, str, float]] = {
    'a': ('(32,)<i2', 'int16[32]', 1.0), 'b': ('i1', 'int8', 1.0), 'B': ('u1', 'uint8', 1.0),
    'h': ('<i2', 'int16', 1.0), 'H': ('<u2', 'uint16', 1.0), 'i': ('<i4', 'int32', 1.0),
    'I': ('<u4', 'uint32', 1.0), 'q': ('<i8', 'int64', 1.0), 'Q': ('<u8', 'uint64', 1.0),
    'g': ('<f2', 'float32', 1.0), 'f': ('<f4', 'float32', 1.0), 'd': ('<f8', 'float64', 1.0),
    'n': ('(4,)u1', 'uint8[4]', 1.0), 'N': ('(16,)u1', 'uint8[16]', 1.0),
    'Z': ('(64,)u1', 'uint8[64]', 1.0), 'M': ('u1', 'uint8', 1.0),
    'c': ('<i2', 'float64', 100.0), 'C': ('<u2', 'float64', 100.0),
    'e': ('<i4', 'float64', 100.0), 'E': ('<u4', 'float64', 100.0),
    'L': ('<i4', 'float64', 1e7),  # latitude and longitude [deg]
}
# What a type lacks to be an input, and is calculated from what it has.
_DERIVED = {
    'VISO': ('VelX', 'VelY', 'VelZ'),  # [m/s] forward, right, down
    'GPS': ('North', 'East', 'Down'),  # [m] from the first fix
}
_NEEDED = {'VISO': {'dt', 'PosDX', 'PosDY', 'PosDZ'}, 'GPS': {'Lat', 'Lng', 'Alt'}}

Bytes = npt.NDArray[np.uint8]
Places = npt.NDArray[np.int64]


@dataclass(frozen=True)
class _Format:
    """What the records of a type hold."""

    name: str
    length: int  # [bytes] with the three in front
    columns: tuple[str, ...]
    kinds: str  # a format character per column

    @property
    def timed(self) -> bool:
        """Return whether the records have a time; declarations have none."""
        return self.columns[:1] == ('TimeUS',) and self.kinds[:1] == 'Q'

    @cached_property
    def stored(self) -> np.dtype[Any]:
        """Return the type of a record in the file, from its time on."""
        return np.dtype([(name, _KINDS[kind][0]) for name, kind in zip(self.columns, self.kinds)])

    @cached_property
    def derived(self) -> tuple[str, ...]:
        """Return the columns that the file does not have."""
        if self.name not in _DERIVED or not _NEEDED[self.name] <= {*self.columns}:
            return ()
        return tuple(name for name in _DERIVED[self.name] if name not in self.columns)

    @cached_property
    def message(self) -> np.dtype[Any]:
        """Return the type of a message: as ROS 1 writes it, one value right after the other."""
        floats = {'float32': '<f4', 'float64': '<f8'}
        kinds = [floats.get(_KINDS[kind][1], _KINDS[kind][0]) for kind in self.kinds]
        return np.dtype([*zip(self.columns, kinds), *((name, '<f8') for name in self.derived)])

    @property
    def definition(self) -> str:
        """Return what ROS calls the type of the message."""
        types = [_KINDS[kind][1] for kind in self.kinds] + ['float64'] * len(self.derived)
        return ''.join(f'{type} {name}\n' for type, name in zip(
            types, (*self.columns, *self.derived), strict=True))


class DataflashFile(Container):
    """A dataflash log."""

    own_clock = True

    def clear(self) -> None:
        super().clear()
        self._formats: dict[int, _Format] = {}  # by type
        self._lengths = [0] * 256  # [bytes] of records by type; 0: unknown
        self._instances: dict[int, int] = {}  # place of their number in the records, by type
        self._lengths[_FMT] = _FORMAT.size
        self._declaring = {_FMT: self._learn}
        self._first_fix: tuple[float, ...] = ()  # latitude, longitude [deg], altitude [m]
        self._parameters: dict[str, str] = {}

    def read_structure(self) -> None:
        """Go through the whole file."""
        size = written_size(self.path)
        offset = 0
        with self.path.open('rb') as file:
            rest = b''
            while True:
                new = file.read(min(_STEP, size - offset - len(rest)))
                data = rest + new
                places, end = self._records(data)
                self._note(data, places, (offset, end))
                offset += end
                rest = data[end:]
                if not new:
                    break
        self.cut = bool(rest.strip(b'\0\xff'))
        if self._parameters:
            self.metadata[PARAMETERS] = self._parameters

    def load(self, block: Block, wanted: Mapping[int, Channel]) -> list[Raw]:
        offset, size = block.where
        with self.path.open('rb') as file:
            file.seek(offset)
            data = file.read(size)
        place = self.first_place(block)
        found: list[Raw] = []
        for number, (places, times) in self._by_channel(data, self._records(data)[0]).items():
            channel = wanted.get(number)
            if channel is None:
                continue
            format = self._formats[number & 0xff]
            messages = self._messages(data, places, format)
            raw, step = messages.tobytes(), messages.dtype.itemsize
            found += [
                (time, place | where, channel, raw[k * step:(k + 1) * step])
                for k, (time, where) in enumerate(zip(times.tolist(), places.tolist()))]
        found.sort(key=lambda message: message[1])
        return found

    def _records(self, data: bytes) -> tuple[Places, int]:
        """Return where records begin, and where the last whole one ends; formats are learned."""
        places: list[int] = []
        position, size = 0, len(data)
        lengths, declaring = self._lengths, self._declaring
        while position + 3 <= size:
            kind = data[position + 2]
            length = lengths[kind]
            if not length or data[position] != 0xa3 or data[position + 1] != 0x95:
                self.note_damage()
                position = data.find(_HEAD, position + 1)
                if position < 0:
                    position = size - (data[-1:] == _HEAD[:1])
                continue
            if position + length > size:
                break
            if kind in declaring:
                declaring[kind](data, position)
            places.append(position)
            position += length
        return np.array(places, dtype=np.int64), min(position, size)

    def _learn(self, data: bytes, position: int) -> None:
        """Learn what a type holds; what it is told first stays."""
        number, length, *texts = _FORMAT.unpack_from(data, position)
        name, kinds, columns = (text.partition(b'\0')[0].decode(errors='replace')
                                for text in texts)
        if self._lengths[number]:
            if number != _FMT and length != self._lengths[number]:
                self.note_damage()
            return
        names = tuple(f'{column}_' if iskeyword(column) else f'column_{column}'
                      if column.isdigit() else column for column in columns.split(','))
        right = len(names) == len(kinds) == len(set(names)) and all(
            re.fullmatch(r'[A-Za-z][A-Za-z0-9_]*', word) for word in (name, *names))
        if length < 3 or not right:
            self.note_damage()
            return
        self._lengths[number] = length  # so that it can be left out at least
        if not set(kinds) <= _KINDS.keys():
            return
        format = _Format(name, length, names, kinds)
        if 3 + format.stored.itemsize != length:
            self._lengths[number] = 0
            self.note_damage()
        elif format.timed:
            self._formats[number] = format
            self._open_channel(number, 0)
            if name == 'FMTU' and {'FmtType', 'UnitIds'} <= {*names}:
                self._declaring[number] = self._learn_instances

    def _learn_instances(self, data: bytes, position: int) -> None:
        """Learn which column tells the instance: its unit is ``#``."""
        row, = _rows(data, np.array([position]), self._formats[data[position + 2]])
        format = self._formats.get(int(row['FmtType']))
        column = row['UnitIds'].tobytes().partition(b'\0')[0].find(b'#')
        if format is not None and 0 < column < len(format.columns) and (
                format.kinds[column] in 'bB'):
            _, offset, *_ = (format.stored.fields or {})[format.columns[column]]
            self._instances[int(row['FmtType'])] = 3 + offset

    def _open_channel(self, number: int, instance: int) -> None:
        format = self._formats[number]
        channel = number | instance << 8
        topic = f'/{format.name}' + (f'_{instance}' if instance else '')
        self.channels[channel] = Channel(
            channel, topic, f'{PACKAGE}/msg/{format.name}', 'ros1', format.definition)

    def _note(self, data: bytes, places: Places, where: tuple[int, int]) -> None:
        """Note what a block holds: its messages by channel, and what declares."""
        assert self.counts is not None
        channels = self._by_channel(data, places)
        for number, (rows, _) in channels.items():
            format = self._formats[number & 0xff]
            self.counts[number] = self.counts.get(number, 0) + len(rows)
            if format.name == 'PARM' and {'Name', 'Value'} <= {*format.columns}:
                self._note_parameters(_rows(data, rows, format))
            elif format.name == 'GPS' and format.derived and not self._first_fix:
                self._note_fix(_rows(data, rows, format), format)
        if channels:
            self.add_block(
                min(int(times.min()) for _, times in channels.values()),
                max(int(times.max()) for _, times in channels.values()), channels.keys(), where)

    def _by_channel(self, data: bytes, places: Places) -> dict[int, tuple[Places, Places]]:
        """Return where the records of each channel are, and their times [ns]."""
        buffer = np.frombuffer(data, np.uint8)
        timed = np.zeros(256, dtype=bool)
        timed[[*self._formats]] = True
        places = places[timed[buffer[places + 2]]]
        if not len(places):
            return {}
        times = _gathered(buffer, places + 3, 8).view('<u8').ravel()
        times = np.minimum(times, _LAST).astype(np.int64)
        # there is no checksum: a time that is far from those before and behind has to lie between
        # them, and of the last one nobody knows
        steps = np.diff(times)
        close, rising = np.abs(steps) <= _CLOSE, steps >= 0
        near = np.append(close, False) | np.insert(close, 0, False) | (len(times) == 1)
        in_order = np.append(rising, True) & np.insert(rising, 0, True) & (times < _LAST)
        inner = np.arange(len(times)) % (len(times) - 1 or 1) > 0
        right = (near & (times < _LAST)) | (in_order & inner)
        if not (right | in_order).all():
            self.note_damage()
        places, times = places[right], times[right] * 1000
        kinds = buffer[places + 2].astype(np.int64)
        for number, place in self._instances.items():
            of_type = kinds == number
            kinds[of_type] |= buffer[places[of_type] + place].astype(np.int64) << 8
        channels = {}
        for channel in np.unique(kinds).tolist():
            if channel not in self.channels:
                self._open_channel(channel & 0xff, channel >> 8)
            chosen = kinds == channel
            channels[channel] = places[chosen], times[chosen]
        return channels

    def _note_parameters(self, rows: npt.NDArray[Any]) -> None:
        """Note the autopilot's own parameters; one that is changed later keeps its first value."""
        for name, value in zip(rows['Name'], rows['Value']):
            text = name.tobytes().partition(b'\0')[0].decode(errors='replace')
            if re.fullmatch(r'[A-Z][A-Z0-9_]*', text) and math.isfinite(value):
                self._parameters.setdefault(text, f'{value:.9g}')

    def _note_fix(self, rows: npt.NDArray[Any], format: _Format) -> None:
        fixes = self._scaled(rows, format)
        if 'Status' in format.columns:
            fixes = fixes[fixes['Status'] >= _FIX]
        if len(fixes):
            self._first_fix = tuple(float(fixes[name][0]) for name in ('Lat', 'Lng', 'Alt'))

    def _scaled(self, rows: npt.NDArray[Any], format: _Format) -> npt.NDArray[Any]:
        """Return the messages of some records, up to what is derived."""
        made = np.zeros(len(rows), format.message)
        for name, kind in zip(format.columns, format.kinds):
            divisor = _KINDS[kind][2]
            made[name] = rows[name] if divisor == 1.0 else rows[name] / divisor
        return made

    def _messages(self, data: bytes, places: Places, format: _Format) -> npt.NDArray[Any]:
        """Return the messages of some records."""
        made = self._scaled(_rows(data, places, format), format)
        if not format.derived:
            return made
        with np.errstate(all='ignore'):
            if format.name == 'VISO':
                dt = made['dt'].astype(float)
                derived = tuple(made[name] / dt for name in ('PosDX', 'PosDY', 'PosDZ'))
            else:
                derived = self._local(made, format)
        for name, values in zip(_DERIVED[format.name], derived):
            if name in format.derived:
                made[name] = values
        return made

    def _local(self, made: npt.NDArray[Any], format: _Format) -> tuple[Any, ...]:
        """Return north, east and down [m] of the first fix."""
        latitude, longitude, altitude = self._first_fix or (math.nan, math.nan, math.nan)
        north, east = metres_per_degree(latitude)
        turn = np.remainder(made['Lng'] - longitude + 180.0, 360.0) - 180.0
        local = np.array([
            north * (made['Lat'] - latitude), east * turn, altitude - made['Alt']])
        if 'Status' in format.columns:
            local[:, made['Status'] < _FIX] = np.nan
        return tuple(local)


def _gathered(buffer: Bytes, places: Places, size: int) -> Bytes:
    """Return ``size`` bytes from each place on, a row each."""
    rows: Bytes = buffer[places[:, np.newaxis] + np.arange(size)]
    return rows


def _rows(data: bytes, places: Places, format: _Format) -> npt.NDArray[Any]:
    """Return the values of some records as the file has them."""
    whole = _gathered(np.frombuffer(data, np.uint8), places + 3, format.length - 3)
    return np.ascontiguousarray(whole).view(format.stored).ravel()
