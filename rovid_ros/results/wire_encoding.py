"""
Output messages as CDR (OMG's Common Data Representation): the bytes that rclpy sends.

A log holds the same bytes. They are packed straight from numbers, because making a message object
and serialising it takes ten times as long. What does not change from message to message, such as
labels and frames, is packed once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
import struct
from typing import Any

_ENCAPSULATION = b'\0\1\0\0'  # plain CDR, little endian; alignment counts from behind it
_COUNT = struct.Struct('<I')
_STAMP = struct.Struct('<iI')
_SECOND = 1_000_000_000  # [ns]


class ArrayEncoder:
    """
    Encodes ``std_msgs/Float64MultiArray`` messages with a row per name and a column per label.

    Parameters
    ----------
    names, labels : sequence of str
        Each dimension's label is these, joined by commas.

    """

    def __init__(self, names: Sequence[str], labels: Sequence[str]) -> None:
        rows, columns = len(names), len(labels)
        self._start = _ENCAPSULATION + _aligned(0, ''.join([
            _number(2),
            _string(','.join(names)), _number(rows), _number(rows * columns),
            _string(','.join(labels)), _number(columns), _number(columns),
            _number(0), _number(rows * columns)]))  # data offset, count of the data
        self._pack = struct.Struct(f'<{rows * columns}d').pack

    def encode(self, rows: Sequence[Sequence[float]]) -> bytes:
        """Return the message; its data are row-major."""
        return self._start + self._pack(*[value for row in rows for value in row])


class StampedEncoder:
    """
    Encodes messages of a header and numbers, in a frame.

    Of three numbers ``geometry_msgs/Vector3Stamped``; of six, the linear and the angular ones,
    ``geometry_msgs/TwistStamped``.
    """

    def __init__(self, frame: str, count: int) -> None:
        # the frame is padded for the numbers of eight bytes that follow
        self._frame = _aligned(_STAMP.size, _string(frame))
        self._pack = struct.Struct(f'<{count}d').pack

    def encode(self, time: int, values: Sequence[float]) -> bytes:
        """Return the message; time in ns."""
        return _ENCAPSULATION + _stamp(time) + self._frame + self._pack(*values)


class JointStateEncoder:
    """Encodes ``sensor_msgs/JointState`` messages with velocity and effort, without position."""

    def __init__(self, frame: str, names: Sequence[str]) -> None:
        self._start = _aligned(_STAMP.size, ''.join([
            _string(frame), _number(len(names)), *map(_string, names),
            _number(0), _number(len(names))]))  # counts of position and velocity
        self._pack = struct.Struct(f'<{len(names)}d').pack
        self._count = _COUNT.pack(len(names)) + bytes(4)  # of effort

    def encode(self, time: int, velocity: Sequence[float], effort: Sequence[float]) -> bytes:
        """Return the message; time in ns."""
        return (_ENCAPSULATION + _stamp(time) + self._start + self._pack(*velocity)
                + self._count + self._pack(*effort))


class StatusBody:
    """
    A ``diagnostic_msgs/DiagnosticStatus`` behind its level, kept while nothing changes.

    Parameters
    ----------
    name, message, hardware_id : str
        As in the message.
    values : mapping
        Key to value. A float's text gives its exact bits back.
    switch : str, optional
        A key whose value is true or false, and may be another each time.

    """

    def __init__(self, name: str, message: str, hardware_id: str, values: Mapping[str, Any],
                 switch: str | None = None) -> None:
        parts = [_string(name), _string(message), _string(hardware_id), _number(len(values))]
        self._left = ''
        size, is_last = 3, False  # 3: the count of no values needs no padding behind it
        for key, value in values.items():
            parts.append(_string(key))
            is_last = key == switch
            if is_last:
                self._left, parts = ''.join(parts), []
            else:
                text = repr(value) if type(value) is float else words(value)
                size = len(text)
                if size < _SHORT and text.isascii():
                    parts += _BEFORE[size], text, _BEHIND[size]
                else:
                    parts.append(_string(text))
                    size = len(text.encode())
        self._right = ''.join(parts)
        self._has_switch = switch in values
        self._size = None if is_last else size  # of the last text, behind which is no padding

    def encode(self, switch: bool = False) -> bytes:
        """Return the bytes; ``switch`` is the value of that key."""
        text = words(switch)
        middle = _string(text) if self._has_switch else ''
        body = f'{self._left}{middle}{self._right}'
        size = len(text) if self._size is None else self._size
        return body[:len(body) - _padding(size)].encode('latin-1')


def diagnostic_array(time: int, frame: str, statuses: Iterable[tuple[int, bytes]]) -> bytes:
    """
    Return a ``diagnostic_msgs/DiagnosticArray`` message.

    Parameters
    ----------
    time : int
        Of the header [ns].
    frame : str
        Of the header.
    statuses : iterable of tuple
        Level and ``StatusBody.encode`` of each.

    """
    statuses = list(statuses)
    out = bytearray(_ENCAPSULATION + _stamp(time))
    out += f'{_string(frame)}{_number(len(statuses))}'.encode('latin-1')
    for level, body in statuses:
        out.append(level)
        out += bytes(-len(out) % 4)
        out += body
    return bytes(out)


def words(value: Any) -> str:
    """Return the text of a value; that of a float gives its exact bits back."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    # numpy's floats are floats, with another repr
    return float.__repr__(value) if isinstance(value, float) else str(value)


@lru_cache(maxsize=4096)
def _string(text: str) -> str:
    """Return a string as CDR, each byte as a character, padded for another one to follow."""
    raw = text.encode()
    return (_number(len(raw) + 1) + raw.decode('latin-1') + '\0'
            + '\0' * _padding(len(raw)))


def _padding(size: int) -> int:
    """Return how many bytes follow a text of so many and its zero, up to the next string."""
    return 3 - size % 4


def _number(value: int) -> str:
    return _COUNT.pack(value).decode('latin-1')


def _stamp(time: int) -> bytes:
    return _STAMP.pack(*divmod(time, _SECOND))


def _aligned(before: int, text: str) -> bytes:
    """Return a text's bytes, padded for numbers of eight; so many bytes are before it."""
    raw = text.encode('latin-1')
    return raw + bytes(-(before + len(raw)) % 8)


_SHORT = 64
# By the length of a short text of ASCII: what is before and behind it.
_BEFORE = [_number(size + 1) for size in range(_SHORT)]
_BEHIND = ['\0' * (1 + _padding(size)) for size in range(_SHORT)]
