"""
Output messages as CDR (OMG's Common Data Representation): the bytes that rclpy sends.

A log holds the same bytes. They are packed straight from numbers, because making a message object
and serialising it takes ten times as long. What does not change from message to message, such as
labels and frames, is packed once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import struct
from typing import Any, Final

_ENCAPSULATION: Final = b'\0\1\0\0'  # plain CDR, little endian; alignment counts from behind it
_COUNT: Final = struct.Struct('<I')
_BEGIN: Final = struct.Struct('<4siI')
_BEFORE_FRAME: Final = _BEGIN.size - len(_ENCAPSULATION)
_SECOND: Final = 1_000_000_000  # [ns]


def begin_stamped(time: int) -> bytes:
    """Return the begin of a message with a header, up to its frame; time in ns."""
    return _BEGIN.pack(_ENCAPSULATION, *divmod(time, _SECOND))


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
            string(','.join(names)), _number(rows), _number(rows * columns),
            string(','.join(labels)), _number(columns), _number(columns),
            _number(0), _number(rows * columns)]))  # data offset, count of the data
        self._row = struct.Struct(f'<{columns}d')

    def row(self, values: Sequence[float]) -> bytes:
        """Return a row as ``encode`` takes it: its numbers, 8 bytes each."""
        return self._row.pack(*values)

    def encode(self, rows: Iterable[bytes | bytearray]) -> bytes:
        """Return the message."""
        return b''.join([self._start, *rows])


class StampedEncoder:
    """
    Encodes messages of a header and numbers, in a frame.

    Of three numbers ``geometry_msgs/Vector3Stamped``; of six, the linear and the angular ones,
    ``geometry_msgs/TwistStamped``.
    """

    def __init__(self, frame: str, count: int) -> None:
        # the frame is padded for the numbers of eight bytes that follow
        self._frame = _aligned(_BEFORE_FRAME, string(frame))
        self._numbers = struct.Struct(f'<{count}d')

    def encode(self, begin: bytes, values: Sequence[float]) -> bytes:
        """Return the message; it begins with ``begin_stamped``."""
        return begin + self._frame + self._numbers.pack(*values)


class JointStateEncoder:
    """Encodes ``sensor_msgs/JointState`` messages with velocity and effort, without position."""

    def __init__(self, frame: str, names: Sequence[str]) -> None:
        self._count = len(names)
        self._start = _aligned(_BEFORE_FRAME, ''.join([
            string(frame), _number(self._count), *map(string, names),
            _number(0), _number(self._count)]))  # counts of position and velocity
        # between them the count of effort
        self._numbers = struct.Struct(f'<{self._count}dI4x{self._count}d')

    def encode(self, begin: bytes, velocity: Sequence[float], effort: Sequence[float]) -> bytes:
        """Return the message; it begins with ``begin_stamped``."""
        return begin + self._start + self._numbers.pack(*velocity, self._count, *effort)


class DiagnosticEncoder:
    """Encodes ``diagnostic_msgs/DiagnosticArray`` messages, in a frame."""

    def __init__(self, frame: str) -> None:
        self._frame = string(frame)

    def encode(self, begin: bytes, statuses: Sequence[tuple[int, bytes]]) -> bytes:
        """
        Return the message.

        Parameters
        ----------
        begin : bytes
            As ``begin_stamped`` makes it.
        statuses : sequence of tuple
            Level of each, and what is behind it: see ``status_body``.

        """
        out = bytearray(begin)
        out += f'{self._frame}{_number(len(statuses))}'.encode('latin-1')
        for level, body in statuses:
            out.append(level)
            out += bytes(-len(out) % 4)
            out += body
        return bytes(out)


def status_body(name: str, message: str, hardware_id: str, values: Mapping[str, Any]) -> bytes:
    """Return a ``diagnostic_msgs/DiagnosticStatus`` behind its level; values as ``words``."""
    texts = {key: words(value) for key, value in values.items()}
    body = ''.join([
        string(name), string(message), string(hardware_id), _number(len(texts)),
        *[pair(key, text) for key, text in texts.items()]])
    last = [hardware_id, *texts.values()][-1]
    # behind the count of no pairs nothing is padded
    padding = _padding(len(last.encode())) if texts else 0
    return body[:len(body) - padding].encode('latin-1')


def known_status(start: str, count: int, pairs: str) -> bytes:
    """
    Return the same of parts that are encoded already, padded.

    Parameters
    ----------
    start : str
        Name, message and hardware_id, each as ``string``.
    count : int
        Of the pairs, at least one.
    pairs : str
        Such as ``pair`` and ``number_pairs`` make them; the last value is no empty text.

    """
    return f'{start}{_number(count)}{pairs}'.rstrip('\0').encode('latin-1') + b'\0'


def pair(key: str, text: str) -> str:
    """Return a key and its value."""
    return string(key) + string(text)


def number_pairs(keys: Iterable[str], values: Iterable[float]) -> str:
    """
    Return keys and values that are numbers; a float's text gives its exact bits back.

    ``keys`` are encoded already, by ``string``.
    """
    # str: of numpy's floats repr is another text
    return ''.join([f'{key}{_BEFORE[len(text)]}{text}{_BEHIND[len(text)]}'
                    for key, text in zip(keys, map(str, values))])


def words(value: Any) -> str:
    """Return the text of a value; that of a float gives its exact bits back."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    # numpy's floats are floats, with another repr
    return float.__repr__(value) if isinstance(value, float) else str(value)


def string(text: str) -> str:
    """Return a string as CDR, each byte as a character, padded for another one to follow."""
    raw = text.encode()
    return (_number(len(raw) + 1) + raw.decode('latin-1') + '\0'
            + '\0' * _padding(len(raw)))


def _padding(size: int) -> int:
    """Return how many bytes follow a text of so many and its zero, up to the next string."""
    return 3 - size % 4


def _number(value: int) -> str:
    return _COUNT.pack(value).decode('latin-1')


def _aligned(before: int, text: str) -> bytes:
    """Return a text's bytes, padded for numbers of eight; so many bytes are before it."""
    raw = text.encode('latin-1')
    return raw + bytes(-(before + len(raw)) % 8)


_LONGEST = 64  # of a number's text; one of an integer [ns] has 20 characters, of a float 24
# By the length of a number's text: what is before and behind it.
_BEFORE: Final = [_number(size + 1) for size in range(_LONGEST)]
_BEHIND: Final = ['\0' * (1 + _padding(size)) for size in range(_LONGEST)]
