"""Tell which clock has jumped when stamps are far ahead of or far behind the others."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Collection, Iterator

from rovid_core.model.samples import Event

MAX_DOUBTED = 4096
"""Events of one input that are kept while it is not clear which clock has jumped."""

WARN_AFTER = 20
"""So many events of one input with a wrong stamp are worth a warning."""

ENOUGH_ALONE = 20
"""So many events with nothing from the others are believed, where they span ``far``."""

BEFORE_ALL = -(1 << 62)
"""A time before all others [ns]."""

Key = tuple[str, int]
"""Name of an input, and its part (0 unless there is one topic per thruster)."""


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
        self._ahead: dict[Key, list[Event]] = {}
        self._ahead_count: dict[Key, int] = {}
        self._agreed: set[Key] = set()  # inputs whose stamps once were like those of the others
        self._alone: tuple[Key | None, int, int] = (None, 0, 0)  # input, since when, how many
        self._behind: dict[Key, list[Event]] = {}
        self._behind_count: dict[Key, int] = {}

    @property
    def any_ahead(self) -> bool:
        """Tell whether an event waits because it is far ahead."""
        return bool(self._ahead)

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
        if self._ahead:
            earlier = self._ahead.get(key)
            if earlier is not None and time > earlier[-1].time:
                return True
            for doubted in self._ahead.pop(key, ()):
                self._drop(doubted, 'future')
        self._ahead_count[key] = 0
        self._agreed.add(key)
        return False

    def keep_ahead(self, key: Key, event: Event, others: int) -> None:
        """Keep an event far ahead; the other inputs have come to the time ``others`` [ns]."""
        events = self._ahead.setdefault(key, [])
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
        if not self._ahead:
            return
        ends = sorted((events[-1].time, key) for key, events in self._ahead.items())
        agreed = [a[0] for a, b in zip(ends, ends[1:]) if b[0] - a[0] <= self.far]
        common = agreed[0] + self.far if agreed else BEFORE_ALL
        alone = self._believed_alone(now)
        while True:
            found: list[Event] = []
            for key, events in list(self._ahead.items()):
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
                    del self._ahead[key]
            if not found:
                return
            yield sorted(found, key=lambda e: e.time)

    def release_ahead(self) -> list[Event]:
        """Return all events far ahead, by time, and forget them."""
        events = [event for events in self._ahead.values() for event in events]
        self._ahead.clear()
        return sorted(events, key=lambda e: e.time)

    def has_jumped_back(self, key: Key, event: Event, known: Collection[Key]) -> bool:
        """
        Keep an event far behind, and tell whether time itself has jumped back.

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
        if own[-1].time - own[0].time > self.far:
            return True
        doubted = [event for events in self._behind.values() for event in events]
        back = {(s.input, s.part) for event in doubted for s in event.samples}
        return len(doubted) > 1 and back.issuperset(known)

    def release_behind(self) -> list[Event]:
        """Return all events far behind, by time, and forget them."""
        doubted = [event for events in self._behind.values() for event in events]
        self._behind, self._behind_count = {}, {}
        return sorted(doubted, key=lambda event: event.time)

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
        if alone is None or alone not in self._ahead or count < ENOUGH_ALONE:
            return None
        # the others could not have come in the time that was jumped over
        since = max(since, self._ahead[alone][0].time)
        return alone if now - since > self.far else None
