"""Stamps that have gone back: a jump of time, or the clock of one input."""

from __future__ import annotations

from collections.abc import Callable, Collection

from rovid_core.model.samples import Event

MOST = 4096
"""Events of one input that are put aside."""

TELLING = 20
"""So often the clock of one input is a warning, not an accident."""

Key = tuple[str, int]


class TimeJump:
    """
    Events far behind, put aside until it is clear whether time jumped.

    It has when all inputs have gone back to about the same time, or one has for a second in
    which nothing else came. While another input goes on, only the clock of that one has.

    Parameters
    ----------
    far : int
        [ns] Stamps that are closer are of the same time; an attribute too.
    drop : callable
        Told every event that is not used, and why.
    warn : callable
        Told one line of an input whose clock has gone back.

    """

    def __init__(self, far: int, drop: Callable[[Event, str], None],
                 warn: Callable[[str], None]) -> None:
        self.far = far
        self._drop = drop
        self._warn = warn
        self.restart()

    def restart(self) -> None:
        """Forget everything."""
        self._behind: dict[Key, list[Event]] = {}
        self._counts: dict[Key, int] = {}

    def put(self, key: Key, event: Event) -> None:
        """Put an event aside."""
        for other, events in list(self._behind.items()):
            if abs(events[-1].time - event.time) > self.far:
                self._drop_all(other)  # they do not go back to the same time
        events = self._behind.setdefault(key, [])
        if events and event.time <= events[-1].time:
            self._drop(event, 'duplicate' if event.time == events[-1].time else 'backward')
            return
        events.append(event)
        if len(events) > MOST:
            self._drop(events.pop(0), 'backward')

    def has_happened(self, key: Key, inputs: Collection[Key]) -> bool:
        """Tell whether time jumped, of the input put last and all that there are."""
        own = self._behind[key]
        if own[-1].time - own[0].time > self.far:
            return True
        pending = [event for events in self._behind.values() for event in events]
        back = {(s.input, s.part) for event in pending for s in event.samples}
        return len(pending) > 1 and back.issuperset(inputs)

    def take(self) -> list[Event]:
        """Return what was put aside, by time, and forget it."""
        pending = [event for events in self._behind.values() for event in events]
        self.restart()
        return sorted(pending, key=lambda event: event.time)

    def go_on(self, key: Key, time: int, at_old_time: bool) -> None:
        """Take an event that is not behind; at the old time it speaks against a jump."""
        if not self._behind:
            return
        self._drop_all(key)
        if not at_old_time:
            return
        for other in list(self._behind):
            lag = time - self._behind[other][-1].time
            self._drop_all(other)
            count = self._counts[other] = self._counts.get(other, 0) + 1
            if count == TELLING:
                self._warn(f'the stamps of {other[0]} have gone back by {lag / 1e9:.1f} s and '
                           'those of the others have not: they are refused until its clock is '
                           'right again')

    def _drop_all(self, key: Key) -> None:
        for event in self._behind.pop(key, ()):
            self._drop(event, 'backward')
