"""Stamps far ahead of all others: a leap of time, or the clock of one input."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator

from rovid_core.model.samples import Event
from rovid_core.ordering.clock_behind import Key, MOST, TELLING

ALONE = 20
"""So many events with nothing from the others are believed, where they span more than ``far``."""

NEVER = -(1 << 62)
"""A time before all others [ns]."""


class Leap:
    """
    Events far ahead, put aside until something stands for their time.

    That is when the other inputs have come as far, or a second one leaps as far, or nothing
    else comes for a while. An input that was in step with the others and then stays ahead of
    them, however far they come, has a wrong clock.

    Parameters
    ----------
    several : bool
        Whether there are other inputs that could agree.
    far : int
        [ns] Stamps that are closer are of the same time; an attribute too.
    time_jump : int
        [ns] A stamp back by more than this is that of an input that has come back.
    drop : callable
        Told every event that is not used, and why.
    warn : callable
        Told one line of an input whose clock is ahead.

    """

    def __init__(self, several: bool, far: int, time_jump: int,
                 drop: Callable[[Event, str], None], warn: Callable[[str], None]) -> None:
        self.far = far
        self._several = several
        self._time_jump = time_jump
        self._drop = drop
        self._warn = warn
        self.restart()

    def restart(self) -> None:
        """Forget everything."""
        self._ahead: dict[Key, list[Event]] = {}
        self._counts: dict[Key, int] = {}
        self._in_step: dict[Key, bool] = {}  # with the others, at some time
        self._alone: tuple[Key | None, int, int] = (None, 0, 0)  # input, since when, how many

    def note(self, key: Key, time: int) -> None:
        """Take note of an event, whatever becomes of it."""
        alone, since, count = self._alone
        self._alone = (key, since, count + 1) if key == alone else (key, time, 1)

    def follows(self, key: Key, time: int) -> bool:
        """Tell whether an event comes after one of its input that has been put aside."""
        waiting = self._ahead.get(key)
        return waiting is not None and time > waiting[-1].time

    def put(self, key: Key, event: Event, others: int) -> None:
        """Put an event aside; the other inputs have come to the time ``others`` [ns]."""
        events = self._ahead.setdefault(key, [])
        if events and 0 <= events[-1].time - event.time <= self._time_jump:
            self._drop(event, 'duplicate' if event.time == events[-1].time else 'backward')
            return
        while events and events[-1].time > event.time:
            self._drop(events.pop(), 'future')  # the input itself has come back
        events.append(event)
        if len(events) > MOST:
            self._drop(events.pop(0), 'future')
        count = self._counts[key] = self._counts.get(key, 0) + 1
        silent = self._alone[2] >= TELLING  # then it is they who are behind
        if (count == TELLING and not silent and others != NEVER
                and event.time > others + self.far):
            fate = ('they are refused until its clock is right again' if key in self._in_step
                    else 'they wait until the others have come as far')
            self._warn(f'the stamps of {key[0]} are {(event.time - others) / 1e9:.1f} s ahead of '
                       f'those of the other inputs; {fate}')

    def go_on(self, key: Key) -> None:
        """Take an event that is not ahead: those that were of its input are of no time."""
        self._counts[key] = 0
        self._in_step[key] = True
        for event in self._ahead.pop(key, ()):
            self._drop(event, 'future')

    def believed(self, now: int, others: Callable[[Key], int]) -> Iterator[list[Event]]:
        """
        Hand out what something stands for by now.

        Parameters
        ----------
        now : int
            Time of the newest event [ns].
        others : callable
            To what time the others than an input have come [ns], also by what has been
            handed out.

        Yields
        ------
        list of Event
            By time, so that none is late because of another.

        """
        if not self._ahead:
            return
        ends = sorted((events[-1].time, key) for key, events in self._ahead.items())
        agreed = [a[0] for a, b in zip(ends, ends[1:]) if b[0] - a[0] <= self.far]
        common = agreed[0] + self.far if agreed else NEVER
        alone = self._believed_alone(now)
        while True:
            found: list[Event] = []
            for key, events in list(self._ahead.items()):
                until = max(common, events[-1].time if key == alone else NEVER)
                reached = others(key)
                # once in step with the others, and now ahead however far they come: its clock
                leapt = key in self._in_step and events[-1].time > max(until, reached + self.far)
                count = bisect_right(events, until if leapt else max(until, reached),
                                     key=lambda e: e.time)
                found += events[:count]
                del events[:count]
                while leapt and events and events[0].time <= reached:
                    self._drop(events.pop(0), 'future')
                if not events:
                    del self._ahead[key]
            if not found:
                return
            yield sorted(found, key=lambda e: e.time)

    def take(self) -> list[Event]:
        """Return what was put aside, by time, and forget it."""
        events = [event for events in self._ahead.values() for event in events]
        self._ahead.clear()
        return sorted(events, key=lambda e: e.time)

    def _believed_alone(self, now: int) -> Key | None:
        """Return the input that is believed because nothing else comes, None for none."""
        alone, since, count = self._alone
        if not self._several:
            return alone
        if alone is None or alone not in self._ahead or count < ALONE:
            return None
        # the leap itself is no time in which the others could have come
        since = max(since, self._ahead[alone][0].time)
        return alone if now - since > self.far else None
