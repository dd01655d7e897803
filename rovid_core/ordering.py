"""Release events in the order of their event times, by their event times alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from heapq import heappop, heappush

from rovid_core.settings import INPUTS
from rovid_core.values import Event

AHEAD = 1_000_000_000
"""[ns] A stamp this far ahead of all others is not believed before a second input agrees."""

MOST_AHEAD = 4096
"""Events of one input that are held while they wait for a second input to agree."""

TELLING = 5
"""So many misplaced stamps of one input are a warning, not an accident."""

Key = tuple[str, int]


class EventOrder:
    """
    Hold events until nothing can come before them any more, then release them in order.

    An event is released when every other input has delivered one at or after its time, or
    when the newest event time is ``max_wait`` later. Only event times decide, never the
    time of arrival: every order of delivery that keeps within ``max_wait`` gives the same
    released sequence. Ties go in the order of ``settings.INPUTS``; within one input, in
    order of arrival.

    Parameters
    ----------
    inputs : sequence of (str, int)
        The inputs that are expected, each with its part (0 unless one topic per thruster).
    max_wait : float
        [s] How much later than its stamp an event may come.
    time_jump : float
        [s] A stamp back by more than this is a jump of time; by less, it is dropped.
    reject : callable
        Told input and reason of every event that is dropped: ``late``, ``duplicate``,
        ``backward``, ``future``, ``discarded``.
    warn : callable
        Told, in one line, of inputs whose stamps do not fit those of the others.

    """

    def __init__(self, inputs: Sequence[Key], max_wait: float, time_jump: float,
                 reject: Callable[[str, str], None], warn: Callable[[str], None]) -> None:
        self._inputs = tuple(inputs)
        self._max_wait = round(max_wait * 1e9)
        self._time_jump = round(time_jump * 1e9)
        self._reject = reject
        self._warn = warn
        self.restart()

    def restart(self) -> None:
        """Forget all times and held events, as at the start."""
        self._last: dict[Key, int] = {}  # newest accepted event time of each input
        self._newest: int | None = None  # newest accepted event time of all
        self._held: list[tuple[int, int, int, Event]] = []
        self._ahead: dict[Key, list[Event]] = {}  # not believed yet
        self._arrivals = 0
        self._far_behind: dict[Key, int] = {}

    def push(self, event: Event) -> tuple[list[Event], bool]:
        """
        Take one event.

        Returns
        -------
        released : list of Event
            What this event releases, in order.
        jumped : bool
            True if time jumped back: what was held has been dropped, and the caller has to
            start its own times anew before it takes ``released``.

        """
        key = _key(event)
        last = self._last.get(key)
        jumped = last is not None and event.time < last - self._time_jump
        if jumped:
            self._discard()
        if self._newest is None or event.time > self._newest + AHEAD:
            self._doubt(key, event)
        else:
            self._accept(key, event)
        self._believe()
        return self._release(), jumped

    def flush(self) -> list[Event]:
        """Release everything that is held, in order; nothing more is coming."""
        for key, events in self._ahead.items():
            for event in events:
                if self._newest is None:  # one input alone: there is nobody to agree
                    self._hold(key, event)
                else:
                    self._drop(event, 'future')
        self._ahead.clear()
        return [heappop(self._held)[3] for _ in range(len(self._held))]

    def _discard(self) -> None:
        for item in self._held:
            self._drop(item[3], 'discarded')
        for events in self._ahead.values():
            for event in events:
                self._drop(event, 'discarded')
        self.restart()

    def _doubt(self, key: Key, event: Event) -> None:
        """Put an event aside until a second input stands for its time."""
        events = self._ahead.setdefault(key, [])
        events.append(event)
        if len(events) > MOST_AHEAD:
            self._drop(events.pop(0), 'future')
        if len(events) == TELLING and len(self._inputs) > 1:
            others = [t for k, t in self._last.items() if k != key]
            others += [e[-1].time for k, e in self._ahead.items() if k != key]
            if others:
                self._warn(f'the stamps of {key[0]} are {(event.time - max(others)) / 1e9:.1f} s '
                           'ahead of those of the other inputs; they are held until another '
                           'input agrees')

    def _believe(self) -> None:
        """Accept the doubted events that a second input has come to agree with."""
        if not self._ahead:
            return
        ends = sorted((events[-1].time, key) for key, events in self._ahead.items())
        agreed = [a[0] for a, b in zip(ends, ends[1:]) if b[0] - a[0] <= AHEAD]
        if agreed:
            self._newest = max(self._newest or agreed[0], agreed[0])
        elif self._newest is None and len(self._inputs) == 1:
            self._newest = ends[0][0]
        while self._newest is not None:
            believed = []
            for key in list(self._ahead):
                believed += self._believed(key, self._newest + AHEAD)
            if not believed:
                break
            # all at once, by time: none of them is late because of another
            for event in sorted(believed, key=lambda e: e.time):
                self._hold_new(_key(event), event)

    def _believed(self, key: Key, until: int) -> list[Event]:
        """Take out the events of one input that are not ahead of ``until``."""
        events = self._ahead.pop(key)
        count = max((i for i, e in enumerate(events, 1) if e.time <= until), default=0)
        if events[count:]:
            self._ahead[key] = events[count:]
        for event in events[:count]:
            if event.time > until:
                self._drop(event, 'future')  # the input itself has come back since
        return [e for e in events[:count] if e.time <= until]

    def _accept(self, key: Key, event: Event) -> None:
        assert self._newest is not None
        for doubted in self._ahead.pop(key, ()):
            self._drop(doubted, 'future')
        if event.time < self._newest - self._max_wait and self._is_new(key, event):
            self._drop(event, 'late')
            self._note_behind(key, event)
        else:
            self._hold_new(key, event)

    def _is_new(self, key: Key, event: Event) -> bool:
        return key not in self._last or event.time > self._last[key]

    def _hold_new(self, key: Key, event: Event) -> None:
        if self._is_new(key, event):
            self._hold(key, event)
        else:
            same = event.time == self._last[key]
            self._drop(event, 'duplicate' if same else 'backward')

    def _hold(self, key: Key, event: Event) -> None:
        for sample in event.samples:
            self._last[(sample.input, sample.part)] = event.time
        self._arrivals += 1
        self._newest = max(self._newest or event.time, event.time)
        heappush(self._held, (event.time, INPUTS.index(key[0]), self._arrivals, event))

    def _release(self) -> list[Event]:
        if self._newest is None:
            return []
        until = self._newest - self._max_wait
        if len(self._last) == len(self._inputs):
            until = max(until, min(self._last.values()))
        released = []
        while self._held and self._held[0][0] <= until:
            released.append(heappop(self._held)[3])
        return released

    def _note_behind(self, key: Key, event: Event) -> None:
        assert self._newest is not None
        if self._newest - event.time > AHEAD:
            self._far_behind[key] = self._far_behind.get(key, 0) + 1
            if self._far_behind[key] == TELLING:
                self._warn(f'the stamps of {key[0]} are {(self._newest - event.time) / 1e9:.1f} '
                           's behind those of the other inputs; they are refused as late')

    def _drop(self, event: Event, reason: str) -> None:
        for sample in event.samples:
            self._reject(sample.input, reason)


def _key(event: Event) -> Key:
    return (event.samples[0].input, event.samples[0].part)
