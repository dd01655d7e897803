"""The signals in a log: every number, vector, rotation and array, with its times."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
import math
import re
from typing import Any

import numpy as np
import numpy.typing as npt
from rovid_ros.logs.log import Log
from rovid_ros.messages.field_paths import (
    field_names,
    GEOGRAPHIC,
    getter,
    parse,
    parse_all,
    shape_of,
)
from rovid_ros.messages.geographic import LocalMetres
from rovid_ros.messages.types import Decoder, WireType

Array = npt.NDArray[np.float64]

MOST_SAMPLES = 20_000  # of a topic; of one with more, every second message, every third, ...
_MOST_ENTRIES = 64  # of an array that could be a vehicle's
# Large, and none of them is an input.
_LEFT_OUT = re.compile(
    r'sensor_msgs/msg/(\w*Image|CameraInfo|PointCloud2?|\w*LaserScan|LaserEcho)|'
    r'(rcl_interfaces|rosgraph_msgs|diagnostic_msgs|visualization_msgs|tf2?_msgs|rosbag2_\w+|'
    r'stereo_msgs|nav_msgs/msg/(OccupancyGrid|Path))/?.*')


@dataclass(frozen=True)
class Signal:
    """What one field path of one topic gives; as such it can be an input."""

    topic: str
    type: str
    path: str  # '' for the whole message
    shape: str  # vector, quaternion, geographic, wrench, array or number
    times: Array  # [s] of the samples, by their stamps where there are some, increasing
    values: Array  # a row per sample; of what is geographic, metres east, north and up
    names: tuple[str, ...] = ()  # of the entries of an array, where the message has them
    rate: float = 0.0  # [Hz] in the log, with what was left out
    longest_gap: float = 0.0  # [s] between two samples of the log
    topics: tuple[str, ...] = ()  # of the entries of an array, where each has its own
    frame: str = ''  # of the header
    received: Array | None = None  # [s] when the log got each, where that is known

    @property
    def of_other_clock(self) -> bool:
        """Tell whether what stamps it tells another time than the log: a simulator's, say."""
        received = self.received
        return received is not None and bool(
            self.times[-1] < received.min() or self.times[0] > received.max())

    def by_receipt(self) -> Signal:
        """Return it with the times at which the log got it."""
        assert self.received is not None
        order = np.argsort(self.received, kind='stable')
        return replace(self, times=self.received[order], values=self.values[order], received=None)

    @cached_property
    def words(self) -> frozenset[str]:
        """Return the words in topic, path and type, in lower case."""
        text = re.sub(r'([a-z])([A-Z])', r'\1 \2', f'{self.topic} {self.path} {self.type}')
        return frozenset(re.split(r'[^a-z]+', text.lower())) - {'', 'msg', 'msgs'}

    @cached_property
    def spread(self) -> Array:
        """Return the standard deviation of each column."""
        return np.asarray(np.std(self.values, axis=0))

    @property
    def place(self) -> str:
        """Return where it is, for a person."""
        return f'{self.topic} {self.path}'.strip()


def part(signal: Signal, columns: Sequence[int], path: str, shape: str) -> Signal:
    """Return a signal of some columns of another."""
    topics = tuple([signal.topics[k] for k in columns]) if signal.topics else ()
    return replace(signal, path=path, shape=shape, values=signal.values[:, list(columns)],
                   names=(), topics=topics)


def together(signals: Sequence[Signal]) -> Signal:
    """Return numbers that come on a topic each as one array: each holds until its next one."""
    first = max(signal.times[0] for signal in signals)
    times = np.unique(np.concatenate([signal.times for signal in signals]))
    times = times[times >= first]
    values = [signal.values[np.searchsorted(signal.times, times, 'right') - 1, 0]
              for signal in signals]
    topics = tuple([signal.topic for signal in signals])
    return replace(
        max(signals, key=lambda signal: signal.longest_gap), topics=topics,
        topic=topics[0] if len(topics) == 1 else f'{topics[0]} to {topics[-1]}', shape='array',
        times=times, values=np.column_stack(values), received=None)


def read_signals(log: Log, start: float, duration: float | None,
                 wanted: dict[str, tuple[str, ...]] | None = None,
                 tick: Callable[[], None] = lambda: None) -> list[Signal]:
    """
    Return the signals of a log, or only those at the ``wanted`` paths by topic.

    Raises LogError if the log cannot be read. Topics that cannot be decoded are left out.
    """
    counts = {name: info.count for name, info in log.topics.items()
              if info.count != 0 and not _LEFT_OUT.fullmatch(info.type)
              and (wanted is None or name in wanted) and log.is_readable(name)}
    samplers = {name: _Sampler(math.ceil((count or 0) / MOST_SAMPLES) or 1)
                for name, count in counts.items()}

    def maker(topic: str, wire: WireType, decode: Decoder) -> Callable[[bytes, int], Any]:
        return lambda raw, time: decode(raw) if samplers[topic].is_due(time) else None

    for message in log.messages([*counts], start, duration, maker):
        if message.data is not None:
            samplers[message.topic].add(message.data, message.time)
        tick()
    signals: list[Signal] = []
    for name, sampler in samplers.items():
        paths = None if wanted is None else wanted[name]
        signals += sampler.signals(name, log.topics[name].type, paths, log.start)
    return signals


class _Sampler:
    """Collects the messages of a topic."""

    def __init__(self, every: int) -> None:
        self._every = every
        self._count = 0
        self._last = 0
        self._gap = 0
        self._first = 0
        self._messages: list[Any] = []
        self._received: list[int] = []

    def is_due(self, time: int) -> bool:
        """Count a message; return whether it is to be kept."""
        if self._count == 0:
            self._first = self._last = time
        self._gap = max(self._gap, time - self._last)
        self._last = max(time, self._last)
        self._count += 1
        return (self._count - 1) % self._every == 0

    def add(self, message: Any, time: int) -> None:
        """Keep a message."""
        self._messages.append(message)
        self._received.append(time)

    def signals(self, topic: str, type: str, paths: Sequence[str] | None,
                begin: int) -> Iterator[Signal]:
        """Yield the signals in what was kept."""
        if len(self._messages) < 3:
            return
        stamps = np.array([_stamp(message) for message in self._messages])
        received = np.array(self._received)
        rate = (self._count - 1) / max(1e-9 * (self._last - self._first), 1e-9)
        seconds = (np.where(stamps > 0, stamps, received) - begin) * 1e-9
        middle = self._messages[len(self._messages) // 2]
        frame = getattr(getattr(middle, 'header', None), 'frame_id', '')
        found = _paths(middle, '') if paths is None else ((path, 'array') for path in paths)
        for path, shape in found:
            values, names = _values(self._messages, path, shape)
            if shape == 'array' and not names:  # what is never there comes last
                path, values = _without_end(path, values)
            good = np.isfinite(values).all(axis=1)
            order = np.flatnonzero(good)
            order = order[np.argsort(seconds[order], kind='stable')]
            if len(order) >= 3:
                yield Signal(topic, type, path, shape, seconds[order], values[order], names,
                             rate, 1e-9 * self._gap, frame=frame,
                             received=(received[order] - begin) * 1e-9)


def _without_end(path: str, values: Array) -> tuple[str, Array]:
    """Return an array and its path without its last entries that are never numbers."""
    used = np.flatnonzero(np.isfinite(values).any(axis=0))
    count = int(used[-1]) + 1 if len(used) else 0
    if not 0 < count < values.shape[1]:
        return path, values
    return f'{path}[0:{count}]', values[:, :count]


def _has_fix(position: Any) -> bool:
    """Tell whether a geographic position is one; a NavSatFix says so."""
    return 'status' not in field_names(position) or position.status.status >= 0


def _stamp(message: Any) -> int:
    """Return the stamp of a message [ns], 0 if it has none."""
    header = getattr(message, 'header', None)
    stamp = getattr(header, 'stamp', None)
    return 0 if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _paths(value: Any, path: str) -> Iterator[tuple[str, str]]:
    """Yield the paths to all signals in a message, with their shapes."""
    shape = shape_of(value)
    if shape == 'array':
        whole = isinstance(value, np.ndarray) and value.dtype == np.uint8
        if not whole and 1 <= len(value) <= _MOST_ENTRIES:
            yield path, shape
    elif shape in ('vector', 'quaternion', 'geographic', 'number', 'wrench'):
        yield path, shape
    else:
        for name in field_names(value):
            if name not in ('header', 'layout') and not name.endswith('covariance'):
                yield from _paths(getattr(value, name), f'{path}.{name}' if path else name)


def _values(messages: Sequence[Any], path: str, shape: str) -> tuple[Array, tuple[str, ...]]:
    """Return the values at a path, NaN where a message has others, and the names beside them."""
    if ',' in path:
        gets = [getter(steps) for steps in parse_all(path, 'field')]
        return np.array([[get(message) for get in gets] for message in messages], float), ()
    get = getter(parse(path, 'field'))
    names = {'vector': ('x', 'y', 'z'), 'quaternion': ('x', 'y', 'z', 'w')}.get(shape)
    found = [get(message) for message in messages]
    if names:
        return np.array([[getattr(one, name) for name in names] for one in found], float), ()
    if shape == 'geographic':
        local = LocalMetres()
        return np.array([local(*[getattr(one, name) for name in GEOGRAPHIC])
                         if _has_fix(one) else (math.nan,) * 3 for one in found]), ()
    if shape == 'wrench':
        return np.array([[getattr(getattr(one, half), name) for half in ('force', 'torque')
                          for name in 'xyz'] for one in found], float), ()
    rows = [np.atleast_1d(np.asarray(one, dtype=float)) for one in found]
    length = int(np.bincount([len(row) for row in rows]).argmax())
    bad = np.full(length, np.nan)
    beside = getattr(messages[0], 'name', ()) if path in ('effort', 'velocity', 'position') else ()
    return (np.array([row if len(row) == length else bad for row in rows]).reshape(-1, length),
            tuple(beside) if len(beside) == length else ())
