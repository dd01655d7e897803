"""Release events in the order of their event times, by their event times alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from heapq import heappop, heappush

from rovid_core.model.samples import Event
from rovid_core.ordering.clock_jumps import BEFORE_ALL, ClockJumps, Key, WARN_AFTER
from rovid_core.settings.run import INPUTS

FAR = 1_000_000_000
"""[ns] A stamp this far ahead of all others is not believed before a second input agrees."""

MAX_HELD = 65536
"""Events that are held while they wait for the slowest input; beyond, new ones are dropped."""

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

    ``ClockJumps`` decides about stamps far ahead and far behind.

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
        Called with input and reason of every event that is dropped: ``late``, ``duplicate``,
        ``backward``, ``future``, ``overload``, ``discarded``.
    warn : callable
        Called with one line about inputs whose stamps do not fit those of the others.

    """

    def __init__(self, inputs: Sequence[Key], max_wait: float, time_jump: float,
                 reject: Callable[[str, str], None], warn: Callable[[str], None]) -> None:
        self._inputs = frozenset(inputs)
        self._max_wait = round(max_wait * 1e9)
        self._far = max(FAR, self._max_wait)  # a stamp may lag by max_wait
        self._time_jump = round(time_jump * 1e9)
        self._reject = reject
        self._warn = warn
        self._jumps = ClockJumps(
            self._inputs, self._far, self._time_jump, self._drop, warn)
        self.restart()

    def restart(self) -> None:
        """Forget all times and held events, as at the start."""
        self._last: dict[Key, int] = {}  # newest accepted event time of each input
        self._slowest: Key | None = None  # when all have been heard: the input that is
        self._reached = BEFORE_ALL  # furthest behind, and how far it has come
        self._newest = BEFORE_ALL  # newest accepted event time of all
        self._past = BEFORE_ALL  # what is before it is late, even if ``max_wait`` has grown
        self._held: list[tuple[int, int, int, Event]] = []
        self._jumps.restart()
        self._arrivals = 0
        self._late: dict[Key, int] = {}

    def change(self, max_wait: float) -> None:
        """Use another ``max_wait`` [s]; what has been released stays the past."""
        self._past = max(self._past, self._newest - self._max_wait)
        self._max_wait = round(max_wait * 1e9)
        self._jumps.far = self._far = max(FAR, self._max_wait)

    def push(self, event: Event) -> tuple[list[Event], bool]:
        """
        Add one event, and release what need not wait any more.

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
            self._add(key, event)
            return self._release(), False
        if key not in self._inputs:  # decides nothing
            self._drop(event, 'backward')
            return [], False
        if not self._jumps.has_jumped_back(key, event, self._last.keys() & self._inputs):
            return [], False
        confirmed = self._jumps.release_behind()
        for discarded in [*(item[3] for item in self._held), *self._jumps.release_ahead()]:
            self._drop(discarded, 'discarded')
        self.restart()
        for doubted in confirmed:
            self._add(_key(doubted), doubted)
        return self._release(), True

    def flush(self) -> list[Event]:
        """Release everything that is held, in order; nothing more is coming."""
        for event in self._jumps.release_ahead():
            self._hold(_key(event), event)
        return [heappop(self._held)[3] for _ in range(len(self._held))]

    def _add(self, key: Key, event: Event) -> None:
        """Hold an event that is not far behind, and those whose time it confirms."""
        jumps, newest = self._jumps, self._newest
        if jumps.is_ahead(key, event, newest):
            jumps.keep_ahead(key, event, self._others(key))
        elif (event.time < max(self._past, newest - self._max_wait)
                and event.time > self._last.get(key, BEFORE_ALL)):
            self._drop(event, 'late')
            self._note_late(key, newest - event.time)
        else:
            self._hold(key, event)
        if jumps.any_ahead:
            for confirmed in jumps.confirmed_ahead(event.time, self._others):
                for doubted in confirmed:
                    self._hold(_key(doubted), doubted)

    def _others(self, key: Key) -> int:
        """Return the newest event time of the inputs other than this one [ns]."""
        return max([t for k, t in self._last.items() if k != key], default=BEFORE_ALL)

    def _hold(self, key: Key, event: Event) -> None:
        last = self._last.get(key, BEFORE_ALL)
        if event.time <= last:
            self._drop(event, 'duplicate' if event.time == last else 'backward')
            return
        if len(self._held) >= MAX_HELD:
            self._drop(event, 'overload')
            return
        for sample in event.samples:
            self._last[(sample.input, sample.part)] = event.time
        if len(event.samples) > 1:  # some of these inputs may have been further
            self._slowest = None
        if key in self._inputs and event.time > self._newest:
            self._newest = event.time
        self._arrivals += 1
        heappush(self._held, (event.time, RANK[key[0]], self._arrivals, event))

    def _release(self) -> list[Event]:
        if self._newest == BEFORE_ALL:
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
        if count == WARN_AFTER and lag > self._far:
            self._warn(f'the stamps of {key[0]} are {lag / 1e9:.1f} s behind those of the other '
                       'inputs; they are refused as late until its clock is right')
        elif count == WARN_AFTER:
            self._warn(f'messages of {key[0]} come up to {lag / 1e9:.2f} s after newer ones of '
                       'other inputs and are refused as late: raise max_wait, or give the '
                       'latency of the inputs')

    def _drop(self, event: Event, reason: str) -> None:
        for sample in event.samples:
            self._reject(sample.input, reason)


def _key(event: Event) -> Key:
    return (event.samples[0].input, event.samples[0].part)
