"""
Where the values are in a serialised message, so that a few can be had without the others.

Lengths of texts and of arrays decide where everything after them is. They hardly ever change
from one message of a topic to the next: as long as they are the same bytes as in a message that
was walked through once, all of its numbers are where they were in that one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
import struct
from struct import Struct
from typing import Any, NamedTuple

from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore
from rovid_ros.messages.field_paths import Step
from rovid_ros.messages.types import WireType

Path = Sequence[Step]
Fetch = Callable[[bytes], tuple[Any, ...]]

_FORMATS = {
    'bool': '?', 'byte': 'b', 'char': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h',
    'uint16': 'H', 'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float32': 'f',
    'float64': 'd'}
_ORDERS = {b'\0\0': '>', b'\0\1': '<'}  # of CDR: its other kinds are not of plain messages
_MAX_ENTRIES = 1000  # messages or texts in one array: a message with more is not worth a layout


class NoLayoutError(ValueError):
    """A message, or a path into it, of a kind that has to be decoded as a whole."""


class Numbers(NamedTuple):
    """One number, or an array of them where ``length`` is not None."""

    offset: int  # [bytes] in the message
    format: str  # as in struct
    length: int | None

    @property
    def text(self) -> str:
        """Return the format of all."""
        return f'{1 if self.length is None else self.length}{self.format}'


@dataclass
class Layout:
    """Where the values are in all messages that ``fits`` accepts."""

    order: str  # ``<`` or ``>``
    # offset and length [bytes] of what decides where the others are: encapsulation, counts, and
    # texts with their lengths
    shape: list[tuple[int, int]] = field(default_factory=list)
    # numbers and texts (or the texts of an array) by path
    places: dict[tuple[Step, ...], Numbers | str | tuple[str, ...]] = field(default_factory=dict)

    @property
    def fits(self) -> Fetch:
        """Return the function from a message to the bytes of its shape."""
        text, end = '<', 0
        for offset, length in self.shape:
            text += f'{offset - end}x{length}s'
            end = offset + length
        return Struct(text).unpack_from

    def fetch(self, paths: Sequence[Path]) -> Fetch:
        """
        Return the function from a message to the values at some paths, an array as a tuple.

        Raises NoLayoutError if one of them has no place of its own.
        """
        places = [self._place(path) for path in paths]
        if all(isinstance(place, Numbers) and place.length is None for place in places):
            return self._scalars([place for place in places if isinstance(place, Numbers)])
        fetches = [self._one(place) for place in places]
        if len(fetches) == 1:
            one, = fetches
            return lambda data: (one(data),)
        if len(fetches) == 2:
            one, other = fetches
            return lambda data: (one(data), other(data))
        return lambda data: tuple([fetch(data) for fetch in fetches])

    def _scalars(self, places: Sequence[Numbers]) -> Fetch:
        """Return how to get single numbers all at once."""
        text, end = self.order, 0
        ordered = sorted(places)
        for place in ordered:
            if place.offset < end:  # twice the same
                raise NoLayoutError
            text += f'{place.offset - end}x{place.format}'
            end = place.offset + struct.calcsize(f'<{place.format}')
        unpack = Struct(text).unpack_from
        if ordered == list(places):
            return unpack
        pick = itemgetter(*[ordered.index(place) for place in places])
        return lambda data: pick(unpack(data))

    def _one(self, place: Numbers | str | tuple[str, ...]) -> Callable[[bytes], Any]:
        if not isinstance(place, Numbers):
            return lambda data: place
        unpack = Struct(f'{self.order}{place.offset}x{place.text}').unpack_from
        if place.length is None:
            return lambda data: unpack(data)[0]
        return unpack

    def _place(self, path: Path) -> Numbers | str | tuple[str, ...]:
        *parent, last = path
        if not isinstance(last, slice) and tuple(path) in self.places:
            return self.places[tuple(path)]
        place = self.places.get(tuple(parent))
        if not isinstance(place, Numbers) or place.length is None or isinstance(last, str):
            raise NoLayoutError
        size = struct.calcsize(f'<{place.format}')
        if isinstance(last, slice):
            start, stop, _ = last.indices(place.length)
            return Numbers(place.offset + start * size, place.format, max(stop - start, 0))
        if last >= place.length:
            raise NoLayoutError
        return Numbers(place.offset + last * size, place.format, None)


def find_layout(wire: WireType, data: bytes) -> Layout:
    """Return the layout of a message; NoLayoutError if it has none, or has another end."""
    order, start = '<', 0
    if wire.encoding == 'cdr':
        order, start = _ORDERS.get(data[:2], ''), 4
        if not order:
            raise NoLayoutError
    reader = _LayoutReader(wire.store, data, Layout(order), start, aligned=wire.encoding == 'cdr')
    try:
        reader.message(wire.name, ())
    except (struct.error, UnicodeDecodeError, KeyError):
        raise NoLayoutError from None
    # behind the last field of a CDR message there can be up to three bytes of padding
    if not 0 <= len(data) - reader.position <= (3 if start else 0):
        raise NoLayoutError
    return reader.layout


class _LayoutReader:
    """Goes through a message from its first byte to its last."""

    def __init__(self, store: Typestore, data: bytes, layout: Layout, start: int,
                 aligned: bool) -> None:
        self.layout = layout
        self.position = start
        self._store = store
        self._data = data
        self._aligned = aligned
        self._start = start
        self._count = Struct(f'{layout.order}I')
        if start:
            layout.shape.append((0, 2))  # the other two are options, which nobody reads

    def message(self, name: str, path: tuple[Step, ...]) -> None:
        """Go through the fields of a message."""
        fields: Any = self._store.fielddefs[name][1]
        for field_name, (node, detail) in fields:
            there = (*path, field_name)
            if node == Nodetype.NAME:
                self.message(detail, there)
            elif node == Nodetype.BASE:
                self.layout.places[there] = (
                    self._text() if detail[0] == 'string' else self._numbers(detail[0], None))
            else:
                entry, size = detail
                self._array(entry, size if node == Nodetype.ARRAY else self._length(), there)

    def _array(self, entry: Any, count: int, path: tuple[Step, ...]) -> None:
        node, detail = entry
        if node == Nodetype.BASE and detail[0] != 'string':
            self.layout.places[path] = self._numbers(detail[0], count)
        elif count > _MAX_ENTRIES:
            raise NoLayoutError
        elif node == Nodetype.BASE:
            self.layout.places[path] = tuple([self._text() for _ in range(count)])
        else:
            for index in range(count):
                self.message(detail, (*path, index))

    def _numbers(self, kind: str, count: int | None) -> Numbers:
        form = _FORMATS[kind]
        size = struct.calcsize(f'<{form}')
        if count != 0:
            self._align(size)
        place = Numbers(self.position, form, count)
        self.position += size * (1 if count is None else count)
        return place

    def _length(self) -> int:
        """Read a count, which is part of the shape."""
        self._align(4)
        count, = self._count.unpack_from(self._data, self.position)
        self.layout.shape.append((self.position, 4))
        self.position += 4
        return int(count)

    def _text(self) -> str:
        """Read a text; it is part of the shape, as its length moves all that follows."""
        length = self._length()
        self.layout.shape[-1] = (self.position - 4, 4 + length)
        raw = self._data[self.position:self.position + length]
        self.position += length
        # CDR counts the zero at the end
        return bytes(raw[:-1] if self._aligned else raw).decode()

    def _align(self, size: int) -> None:
        if self._aligned:
            self.position += -(self.position - self._start) % size
