"""Events in the order of their event times, also when a clock jumps."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Collection, Iterator, Sequence
from heapq import heappop, heappush
from typing import Final

from rovid_core.model.samples import Event
from rovid_core.settings.run import INPUTS, MOST_WAIT

FAR: Final = 1_000_000_000
"""[ns] A stamp this far ahead of all others is not believed before a second input agrees."""

MAX_HELD: Final = 65536
"""Events that are held while they wait for the slowest input; beyond, new ones are dropped."""

RANK = {name: rank for rank, name in enumerate(INPUTS)}
"""In which order events of the same time come."""

MAX_DOUBTED: Final = 4096
"""Events of one input that are kept while it is not clear which clock has jumped."""

WARN_AFTER: Final = 20
"""So many events of one input with a wrong stamp are worth a warning."""

LATE_IN_A_ROW, LATE_FOR = 3, 2_000_000_000
"""Late events of one input in a row, and time that they span [ns], for a longer wait."""

MARGIN: Final = 1.25
"""Of that wait over the greatest lag."""

KEPT_LAG: Final = 0.99
"""Share of the greatest lag of an input that is kept with each late event."""

ENOUGH_ALONE: Final = 20
"""So many events with nothing from the others are believed, where they span ``far``."""

BEFORE_ALL: Final = -(1 << 62)
"""A time before all others [ns]."""

Key = tuple[str, int]
"""Name of an input, and its part (0 unless there is one topic per thruster)."""


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
    grows : bool
        Whether ``max_wait`` grows, by up to ``FAR``, for an input that keeps coming later.
    time_jump : float
        [s] A stamp back by more than this is a jump of time; by less, it is dropped.
    reject : callable
        Called with input and reason of every event that is dropped: ``late``, ``duplicate``,
        ``backward``, ``future``, ``overload``, ``discarded``.
    warn : callable
        Called with one line about inputs whose stamps do not fit those of the others.

    """

    def __init__(self, inputs: Sequence[Key], max_wait: float, time_jump: float,
                 reject: Callable[[str, str], None], warn: Callable[[str], None],
                 grows: bool = False) -> None:
        self._inputs = frozenset(inputs)
        self._grows = grows
        self._max_wait = round(max_wait * 1e9)
        self._longest_wait = FAR + self._max_wait
        self._time_jump = round(time_jump * 1e9)
        self._reject = reject
        self._warn = warn
        # a stamp may lag by max_wait
        self._jumps = ClockJumps(
            self._inputs, max(FAR, self._max_wait), self._time_jump, self._drop, warn)
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
        self._last_lags: dict[Key, int] = {}
        self._lags: dict[Key, list[tuple[int, int]]] = {}  # time and lag of each late one in a row

    def change(self, max_wait: float, grows: bool = False) -> None:
        """Use another ``max_wait`` [s]; what has been released stays the past."""
        self._grows = grows
        self._longest_wait = FAR + round(max_wait * 1e9)
        self._wait(round(max_wait * 1e9))

    def _wait(self, max_wait: int) -> None:
        self._past = max(self._past, self._newest - self._max_wait)
        self._max_wait = max_wait
        self._jumps.far = max(FAR, max_wait)

    def lag(self, name: str) -> float:
        """Return by how much [s] late events of an input are behind the newest one, at most."""
        return max([lag for key, lag in self._last_lags.items() if key[0] == name],
                   default=0) * 1e-9

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
        confirmed = self._jumps.confirmed_behind(key, event, self._last.keys() & self._inputs)
        if not confirmed:
            return [], False
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
            self._note_late(key, event.time, newest - event.time)
        else:
            self._hold(key, event)
        if jumps.ahead:
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
        if self._lags:
            self._lags.pop(key, None)
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

    def _note_late(self, key: Key, time: int, lag: int) -> None:
        self._last_lags[key] = max(lag, round(KEPT_LAG * self._last_lags.get(key, 0)))
        if self._grows and key in self._inputs and lag <= self._longest_wait:
            lags = self._lags.setdefault(key, [])
            lags.append((time, lag))
            if len(lags) >= LATE_IN_A_ROW and time - lags[0][0] >= LATE_FOR:
                wait = min(self._longest_wait, round(MARGIN * max(lag for _, lag in lags)))
                self._lags.clear()
                self._wait(max(wait, self._max_wait))
                self._warn(f'{key[0]} keeps coming {lag / 1e9:.2f} s after newer messages of '
                           f'other inputs: they wait up to {wait / 1e9:.2f} s for it from now on')
            return
        count = self._late[key] = self._late.get(key, 0) + 1
        if count == WARN_AFTER and lag > self._jumps.far:
            needed = MARGIN * lag / 1e9
            advice = (f' or {key[0]}.latency, or, if they come so late, set max_wait to '
                      f'{needed:.1f}' if needed < MOST_WAIT else
                      f', or set {key[0]}.stamp: receive, as where a simulator stamps them')
            self._warn(f'the stamps of {key[0]} are {lag / 1e9:.1f} s behind those of the other '
                       f'inputs; they are refused as late: correct its clock{advice}')
        elif count == WARN_AFTER:
            self._warn(f'messages of {key[0]} come up to {lag / 1e9:.2f} s after newer ones of '
                       'other inputs and are refused as late: raise max_wait, or give the '
                       'latency of the inputs')

    def _drop(self, event: Event, reason: str) -> None:
        for sample in event.samples:
            self._reject(sample.input, reason)


def _key(event: Event) -> Key:
    return (event.samples[0].input, event.samples[0].part)


class ClockJumps:
    """
    Keep events whose stamps are doubted until it is clear which clock has jumped.

    Stamps far ahead are believed when the other inputs have come as far, when a second input
    jumps as far, or when nothing else comes for a while. An input that agreed with the others
    before, and then stays ahead of them however far they come, has a wrong clock.

    Stamps far behind mean that time itself has jumped back when all inputs have gone back to
    about the same time, or when one has for a second in which nothing else came. While another
    input goes on at the old time, the one that went back has a wrong clock.

    Parameters
    ----------
    inputs : collection of (str, int)
        The inputs that decide.
    far : int
        [ns] Stamps that are closer belong to the same time; it can be changed later.
    time_jump : int
        [ns] A stamp that is back by more than this is far behind.
    drop : callable
        Called with every event that is not used, and the reason.
    warn : callable
        Called with one line about an input whose clock is wrong.

    Attributes
    ----------
    ahead : dict
        The events far ahead, by input.

    """

    def __init__(self, inputs: Collection[Key], far: int, time_jump: int,
                 drop: Callable[[Event, str], None], warn: Callable[[str], None]) -> None:
        self.far = far
        self._inputs = inputs
        self._time_jump = time_jump
        self._drop = drop
        self._warn = warn
        self.restart()

    def restart(self) -> None:
        """Forget everything."""
        self.ahead: dict[Key, list[Event]] = {}
        self._ahead_count: dict[Key, int] = {}
        self._agreed: set[Key] = set()  # inputs whose stamps once were like those of the others
        self._alone: tuple[Key | None, int, int] = (None, 0, 0)  # input, since when, how many
        self._behind: dict[Key, list[Event]] = {}
        self._behind_count: dict[Key, int] = {}

    def is_ahead(self, key: Key, event: Event, newest: int) -> bool:
        """
        Tell whether an event that is not far behind is far ahead.

        An event that is neither shows that its input's clock is right: what was doubted of that
        input is dropped. An event at the old time also shows that time has not jumped back.

        Parameters
        ----------
        key : (str, int)
            The input.
        event : Event
            The event.
        newest : int
            The newest event time that is believed [ns].

        """
        time = event.time
        if self._behind and key in self._inputs:
            self._deny_jump_back(key, time, time >= newest - self.far)
        alone, since, count = self._alone
        self._alone = (key, since, count + 1) if key == alone else (key, time, 1)
        if time > newest + self.far:
            return True
        if self.ahead:
            earlier = self.ahead.get(key)
            if earlier is not None and time > earlier[-1].time:
                return True
            for doubted in self.ahead.pop(key, ()):
                self._drop(doubted, 'future')
        self._ahead_count[key] = 0
        self._agreed.add(key)
        return False

    def keep_ahead(self, key: Key, event: Event, others: int) -> None:
        """Keep an event far ahead; the other inputs have come to the time ``others`` [ns]."""
        events = self.ahead.setdefault(key, [])
        if events and 0 <= events[-1].time - event.time <= self._time_jump:
            self._drop(event, 'duplicate' if event.time == events[-1].time else 'backward')
            return
        while events and events[-1].time > event.time:
            self._drop(events.pop(), 'future')  # the input itself has come back
        events.append(event)
        if len(events) > MAX_DOUBTED:
            self._drop(events.pop(0), 'future')
        count = self._ahead_count[key] = self._ahead_count.get(key, 0) + 1
        others_are_silent = self._alone[2] >= WARN_AFTER  # then it is they who are behind
        if (count == WARN_AFTER and not others_are_silent and others != BEFORE_ALL
                and event.time > others + self.far):
            fate = ('they are refused until its clock is right again' if key in self._agreed
                    else 'they wait until the others have come as far')
            self._warn(f'the stamps of {key[0]} are {(event.time - others) / 1e9:.1f} s ahead of '
                       f'those of the other inputs; {fate}')

    def confirmed_ahead(self, now: int,
                        others: Callable[[Key], int]) -> Iterator[list[Event]]:
        """
        Hand out the events far ahead whose time is confirmed by now.

        Parameters
        ----------
        now : int
            Time of the newest event [ns], whatever became of it.
        others : callable
            To what time the other inputs than this one have come [ns]; what has been handed
            out counts as well.

        Yields
        ------
        list of Event
            By time, so that none is late because of another.

        """
        if not self.ahead:
            return
        ends = sorted((events[-1].time, key) for key, events in self.ahead.items())
        agreed = [a[0] for a, b in zip(ends, ends[1:]) if b[0] - a[0] <= self.far]
        common = agreed[0] + self.far if agreed else BEFORE_ALL
        alone = self._believed_alone(now)
        while True:
            found: list[Event] = []
            for key, events in list(self.ahead.items()):
                until = max(common, events[-1].time if key == alone else BEFORE_ALL)
                reached = others(key)
                # it agreed with the others once, and is ahead now however far they come
                is_wrong = key in self._agreed and events[-1].time > max(until, reached + self.far)
                count = bisect_right(events, until if is_wrong else max(until, reached),
                                     key=lambda e: e.time)
                found += events[:count]
                del events[:count]
                while is_wrong and events and events[0].time <= reached:
                    self._drop(events.pop(0), 'future')
                if not events:
                    del self.ahead[key]
            if not found:
                return
            yield sorted(found, key=lambda e: e.time)

    def release_ahead(self) -> list[Event]:
        """Return all events far ahead, by time, and forget them."""
        events = [event for events in self.ahead.values() for event in events]
        self.ahead.clear()
        return sorted(events, key=lambda e: e.time)

    def confirmed_behind(self, key: Key, event: Event, known: Collection[Key]) -> list[Event]:
        """
        Keep an event far behind; return all of these, by time, if time itself has jumped back.

        Parameters
        ----------
        key : (str, int)
            The input.
        event : Event
            The event.
        known : collection of (str, int)
            The inputs that have been heard.

        """
        for other, events in list(self._behind.items()):
            if abs(events[-1].time - event.time) > self.far:
                self._drop_behind(other)  # they do not go back to the same time
        own = self._behind.setdefault(key, [])
        if own and event.time <= own[-1].time:
            self._drop(event, 'duplicate' if event.time == own[-1].time else 'backward')
        else:
            own.append(event)
            if len(own) > MAX_DOUBTED:
                self._drop(own.pop(0), 'backward')
        doubted = [event for events in self._behind.values() for event in events]
        back = {(s.input, s.part) for event in doubted for s in event.samples}
        if own[-1].time - own[0].time > self.far or (
                len(doubted) > 1 and back.issuperset(known)):
            return sorted(doubted, key=lambda event: event.time)
        return []

    def _deny_jump_back(self, key: Key, time: int, at_old_time: bool) -> None:
        """Drop what is far behind: its input, or all others, still stamp with the old time."""
        self._drop_behind(key)
        if not at_old_time:
            return
        for other in list(self._behind):
            lag = time - self._behind[other][-1].time
            self._drop_behind(other)
            count = self._behind_count[other] = self._behind_count.get(other, 0) + 1
            if count == WARN_AFTER:
                self._warn(f'the stamps of {other[0]} have gone back by {lag / 1e9:.1f} s and '
                           'those of the others have not: they are refused until its clock is '
                           'right again')

    def _drop_behind(self, key: Key) -> None:
        for event in self._behind.pop(key, ()):
            self._drop(event, 'backward')

    def _believed_alone(self, now: int) -> Key | None:
        """Return the input that is believed because nothing else comes, None for none."""
        alone, since, count = self._alone
        if len(self._inputs) < 2:
            return alone
        if alone is None or alone not in self.ahead or count < ENOUGH_ALONE:
            return None
        # the others could not have come in the time that was jumped over
        since = max(since, self.ahead[alone][0].time)
        return alone if now - since > self.far else None
