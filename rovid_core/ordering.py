"""Release events in the order of their event times, by their event times alone."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from heapq import heappop, heappush

from rovid_core.settings import INPUTS
from rovid_core.time_jump import Key, TELLING, TimeJump
from rovid_core.values import Event

AHEAD = 1_000_000_000
"""[ns] A stamp this far ahead of all others is not believed before a second input agrees."""

MOST_AHEAD = 4096
"""Events of one input that are held while they wait for a second input to agree."""

MOST_HELD = 65536
"""Events that are held while they wait for the slowest input; beyond, new ones are dropped."""

ALONE = 20
"""So many events with nothing from the others, the doubted over more than AHEAD, are believed."""

NEVER = -(1 << 62)

RANK = {name: rank for rank, name in enumerate(INPUTS)}
"""In which order events of the same time come."""


class EventOrder:
    """
    Hold events until nothing can come before them any more, then release them in order.

    An event is released when every other input has delivered one at or after its time, or
    when the newest event time is more than ``max_wait`` later. Only event times decide,
    never the time of arrival: every order of delivery that keeps within ``max_wait`` gives
    the same released sequence. Ties go in the order of ``settings.INPUTS``; within one
    input, in order of arrival.

    A stamp far ahead is put aside until the other inputs have come as far, or a second one
    leaps as far, or nothing else comes for a while. An input that was in step with the others
    and then stays ahead of them, however far they come, has a wrong clock. What comes of a
    stamp far back is told by ``TimeJump``.

    Parameters
    ----------
    inputs : sequence of (str, int)
        The inputs that decide, each with its part (0 unless one topic per thruster). Others
        (a reference) are put in their place and wait for nobody, nor does anybody for them.
    max_wait : float
        [s] How much later than its stamp an event may come.
    time_jump : float
        [s] A stamp back by more than this is a jump of time; by less, it is dropped.
    reject : callable
        Told input and reason of every event that is dropped: ``late``, ``duplicate``,
        ``backward``, ``future``, ``overload``, ``discarded``.
    warn : callable
        Told, in one line, of inputs whose stamps do not fit those of the others.

    """

    def __init__(self, inputs: Sequence[Key], max_wait: float, time_jump: float,
                 reject: Callable[[str, str], None], warn: Callable[[str], None]) -> None:
        self._inputs = frozenset(inputs)
        self._max_wait = round(max_wait * 1e9)
        self._far = max(AHEAD, self._max_wait)  # a stamp may lag by max_wait
        self._time_jump = round(time_jump * 1e9)
        self._reject = reject
        self._warn = warn
        self._jump = TimeJump(self._far, self._drop, warn)
        self.restart()

    def restart(self) -> None:
        """Forget all times and held events, as at the start."""
        self._last: dict[Key, int] = {}  # newest accepted event time of each input
        self._slowest: Key | None = None  # when all have been heard: the input that is
        self._reached = NEVER  # furthest behind, and how far it has come
        self._newest: int | None = None  # newest accepted event time of all
        self._past = NEVER  # what is before it is late, even if ``max_wait`` has grown
        self._held: list[tuple[int, int, int, Event]] = []
        self._ahead: dict[Key, list[Event]] = {}  # not believed yet
        self._jump.restart()
        self._arrivals = 0
        self._late: dict[Key, int] = {}
        self._doubted: dict[Key, int] = {}
        self._in_step: dict[Key, bool] = {}  # with the others, at some time
        self._alone: tuple[Key | None, int, int] = (None, 0, 0)  # input, since when, how many

    def change(self, max_wait: float) -> None:
        """Take another ``max_wait`` [s]; what has been released stays the past."""
        if self._newest is not None:
            self._past = max(self._past, self._newest - self._max_wait)
        self._max_wait = round(max_wait * 1e9)
        self._jump.far = self._far = max(AHEAD, self._max_wait)

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
        if last is None or event.time >= last - self._time_jump:
            self._take(key, event)
            return self._release(), False
        if key not in self._inputs:  # decides nothing
            self._drop(event, 'backward')
            return [], False
        self._jump.put(key, event)
        if not self._jump.has_happened(key, self._last.keys() & self._inputs):
            return [], False
        confirmed = self._jump.take()
        self._discard()
        for doubted in confirmed:
            self._take(_key(doubted), doubted)
        return self._release(), True

    def flush(self) -> list[Event]:
        """Release everything that is held, in order; nothing more is coming."""
        doubted = [event for events in self._ahead.values() for event in events]
        self._ahead.clear()
        for event in sorted(doubted, key=lambda e: e.time):
            self._hold_new(_key(event), event)
        return [heappop(self._held)[3] for _ in range(len(self._held))]

    def _take(self, key: Key, event: Event) -> None:
        if key in self._inputs:
            self._jump.go_on(key, event.time, self._newest is not None
                             and event.time >= self._newest - self._far)
        alone, since, count = self._alone
        self._alone = (key, since, count + 1) if key == alone else (key, event.time, 1)
        if self._is_doubtful(key, event):
            self._doubt(key, event)
        else:
            self._accept(key, event)
        if self._ahead:
            self._believe(event.time)

    def _is_doubtful(self, key: Key, event: Event) -> bool:
        if self._newest is None or event.time > self._newest + self._far:
            return True
        waiting = self._ahead.get(key)
        return waiting is not None and len(waiting) > 0 and event.time > waiting[-1].time

    def _doubt(self, key: Key, event: Event) -> None:
        """Put an event aside until something stands for its time."""
        events = self._ahead.setdefault(key, [])
        if events and 0 <= events[-1].time - event.time <= self._time_jump:
            self._drop(event, 'duplicate' if event.time == events[-1].time else 'backward')
            return
        while events and events[-1].time > event.time:
            self._drop(events.pop(), 'future')  # the input itself has come back
        events.append(event)
        if len(events) > MOST_AHEAD:
            self._drop(events.pop(0), 'future')
        count = self._doubted[key] = self._doubted.get(key, 0) + 1
        others = self._others(key)
        silent = self._alone[2] >= TELLING  # then it is they who are behind
        if (count == TELLING and not silent and others != NEVER
                and event.time > others + self._far):
            fate = ('they are refused until its clock is right again' if key in self._in_step
                    else 'they wait until the others have come as far')
            self._warn(f'the stamps of {key[0]} are {(event.time - others) / 1e9:.1f} s ahead of '
                       f'those of the other inputs; {fate}')

    def _others(self, key: Key) -> int:
        return max([t for k, t in self._last.items() if k != key], default=NEVER)

    def _believe(self, now: int) -> None:
        """Accept the doubted events that something stands for by now."""
        ends = sorted((events[-1].time, key) for key, events in self._ahead.items())
        agreed = [a[0] for a, b in zip(ends, ends[1:]) if b[0] - a[0] <= self._far]
        common = agreed[0] + self._far if agreed else NEVER
        alone, since, count = self._alone
        if len(self._inputs) > 1:
            # the leap itself is no time in which the others could have come
            since = max(since, self._ahead[alone][0].time if alone in self._ahead else now)
            if count < ALONE or now - since <= self._far:
                alone = None
        while True:
            believed: list[Event] = []
            for key, events in list(self._ahead.items()):
                until = max(common, events[-1].time if key == alone else NEVER)
                others = self._others(key)
                # once in step with the others, and now ahead however far they come: its clock
                leapt = key in self._in_step and events[-1].time > max(until, others + self._far)
                count = bisect_right(events, until if leapt else max(until, others),
                                     key=lambda e: e.time)
                believed += events[:count]
                del events[:count]
                while leapt and events and events[0].time <= others:
                    self._drop(events.pop(0), 'future')
                if not events:
                    del self._ahead[key]
            if not believed:
                return
            # all at once, by time: none of them is late because of another
            for event in sorted(believed, key=lambda e: e.time):
                self._hold_new(_key(event), event)

    def _accept(self, key: Key, event: Event) -> None:
        assert self._newest is not None
        self._doubted[key] = 0
        self._in_step[key] = True
        for doubted in self._ahead.pop(key, ()):
            self._drop(doubted, 'future')
        past = max(self._past, self._newest - self._max_wait)
        if event.time < past and self._is_new(key, event):
            self._drop(event, 'late')
            self._note_late(key, self._newest - event.time)
        else:
            self._hold_new(key, event)

    def _is_new(self, key: Key, event: Event) -> bool:
        return key not in self._last or event.time > self._last[key]

    def _hold_new(self, key: Key, event: Event) -> None:
        last = self._last.get(key, NEVER)
        if event.time <= last:
            self._drop(event, 'duplicate' if event.time == last else 'backward')
            return
        if len(self._held) >= MOST_HELD:
            self._drop(event, 'overload')
            return
        for sample in event.samples:
            self._last[(sample.input, sample.part)] = event.time
        if len(event.samples) > 1:  # some of these inputs may have been further
            self._slowest = None
        if key in self._inputs and (self._newest is None or event.time > self._newest):
            self._newest = event.time
        self._arrivals += 1
        heappush(self._held, (event.time, RANK[key[0]], self._arrivals, event))

    def _release(self) -> list[Event]:
        if self._newest is None:
            return []
        # strictly later, so that ties do not depend on the order of delivery
        until = self._newest - self._max_wait - (1 if self._max_wait else 0)
        slowest = self._slowest
        if slowest is None or self._last[slowest] != self._reached:
            # the slowest input has come further, or was not known yet
            if self._last.keys() >= self._inputs:
                self._slowest = min(self._inputs, key=self._last.__getitem__)
                self._reached = self._last[self._slowest]
        if self._slowest is not None and self._reached > until:
            until = self._reached
        released = []
        while self._held and self._held[0][0] <= until:
            released.append(heappop(self._held)[3])
        return released

    def _note_late(self, key: Key, lag: int) -> None:
        count = self._late[key] = self._late.get(key, 0) + 1
        if count == TELLING and lag > self._far:
            self._warn(f'the stamps of {key[0]} are {lag / 1e9:.1f} s behind those of the other '
                       'inputs; they are refused as late until its clock is right')
        elif count == TELLING:
            self._warn(f'messages of {key[0]} come up to {lag / 1e9:.2f} s after newer ones of '
                       'other inputs and are refused as late: raise max_wait, or give the '
                       'latency of the inputs')

    def _discard(self) -> None:
        for item in self._held:
            self._drop(item[3], 'discarded')
        for events in self._ahead.values():
            for event in events:
                self._drop(event, 'discarded')
        self.restart()

    def _drop(self, event: Event, reason: str) -> None:
        for sample in event.samples:
            self._reject(sample.input, reason)


def _key(event: Event) -> Key:
    return (event.samples[0].input, event.samples[0].part)
