"""What came, was taken and was refused of late: the counters behind the diagnostics."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from rovid_core.inputs.refusals import STILL_USED
from rovid_core.model.samples import Event
from rovid_core.pipeline.stream import Stream

WINDOW = 10.0
"""[s] What counts as of late."""

KEPT = 30
"""Arrivals that a rate is taken over."""

Counts = dict[tuple[str, str], int]
"""(input or DOF, reason) -> how many."""


class Arrivals:
    """The messages of each topic as they came, whatever became of them."""

    def __init__(self) -> None:
        self._count: dict[str, int] = {}
        self._last: dict[str, int] = {}
        self._times: dict[str, deque[int]] = {}

    def note(self, topic: str, receive_time: int, events: Sequence[Event] = ()) -> None:
        """Take the receive time [ns] of a message and the events that it gave."""
        self._count[topic] = self._count.get(topic, 0) + 1
        self._last[topic] = receive_time
        if events:
            self._times.setdefault(topic, deque(maxlen=KEPT)).append(events[0].time)

    def count(self, topic: str) -> int:
        """Return how many there were."""
        return self._count.get(topic, 0)

    def last(self, topic: str) -> int:
        """Return the receive time [ns] of the newest, 0 if there was none."""
        return self._last.get(topic, 0)

    def rate(self, topic: str) -> float:
        """Return the rate [Hz] of the newest ones by their own times, 0 while not known."""
        times = [*self._times.get(topic, ())]
        gaps = sorted(after - before for before, after in zip(times, times[1:]) if after > before)
        # the median: one wild stamp is no rate, nor is a burst
        return 1e9 / gaps[len(gaps) // 2] if gaps else 0.0


class Recent:
    """
    What a stream took and refused over the last ``WINDOW``.

    Parameters
    ----------
    stream : Stream
        What runs.
    now : float
        Time of a steady clock [s].

    """

    def __init__(self, stream: Stream, now: float) -> None:
        self._stream = stream
        self._past: deque[tuple[float, Counts, dict[str, int]]] = deque()
        self.tick(now)

    def tick(self, now: float) -> None:
        """Note where the counters stand; to be called about once a second."""
        taken = {name: health.count for name, health in self._stream.inputs.items()}
        self._past.append((now, dict(self._stream.rejected), taken))
        while len(self._past) > 2 and now - self._past[1][0] >= WINDOW:
            self._past.popleft()

    @property
    def span(self) -> float:
        """Return the time [s] that the counts below are about."""
        return self._past[-1][0] - self._past[0][0]

    def refused(self, name: str = '') -> Counts:
        """Return what was refused, of one input or DOF or of all, the most frequent first."""
        found = difference(self._past[0][1], self._past[-1][1], name)
        return {key: count for key, count in found.items() if key[1] not in STILL_USED}

    def taken(self, name: str) -> int:
        """Return how many samples of an input were used."""
        return self._past[-1][2][name] - self._past[0][2][name]


def difference(before: Counts, after: Counts, name: str = '') -> Counts:
    """Return what was counted in between, the most frequent first."""
    found = {key: count - before.get(key, 0) for key, count in after.items()
             if count > before.get(key, 0) and name in ('', key[0])}
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))


def in_words(counts: Counts, most: int = 8) -> str:
    """Return ``position too_fast 12, depth late 3``; beyond ``most`` only how many more."""
    parts = [f'{name} {reason} {count}' for (name, reason), count in counts.items()]
    more = [f'and {len(parts) - most} other reasons'] if len(parts) > most else []
    return ', '.join(parts[:most] + more)
