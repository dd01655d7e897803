"""What keeps the log readable: few lines, whatever the network sends."""

from __future__ import annotations

from collections.abc import Sequence

from rovid_core.stream import Stream
from rovid_ros.recent import Counts, difference, in_words

PERIOD = 10.0
"""[s] From one line about what was refused to the next; the unit of all limits here."""

MOST = 10
"""Lines of warning in one period."""


class RefusalLines:
    """
    One line per period about what was refused in it, none when nothing was.

    Parameters
    ----------
    stream : Stream
        Whose counters are told.
    now : float
        Time of a steady clock [s].

    """

    def __init__(self, stream: Stream, now: float) -> None:
        self._stream = stream
        self._since = now
        self._before: Counts = dict(stream.rejected)

    def due(self, now: float, end: bool = False) -> str:
        """Return the line if a period is over (or at the ``end``) and there is one, or ''."""
        elapsed = now - self._since
        if elapsed < PERIOD and not end:
            return ''
        counts = difference(self._before, self._stream.rejected)
        self._since, self._before = now, dict(self._stream.rejected)
        return f'refused in the last {elapsed:.0f} s: {in_words(counts)}' if counts else ''


class LimitedWarnings:
    """Let a warning through once a period, and at most ``MOST`` of them all."""

    def __init__(self) -> None:
        self._since = float('-inf')
        self._told: set[str] = set()
        self._withheld = 0

    def allowed(self, lines: Sequence[str], now: float) -> list[str]:
        """
        Return those of the lines that may be logged.

        Parameters
        ----------
        lines : sequence of str
            What there is to warn of; none asks whether something is due.
        now : float
            Time of a steady clock [s].

        """
        result: list[str] = []
        if now - self._since >= PERIOD:
            if self._withheld:
                result.append(f'{self._withheld} more warnings were not logged')
            self._since, self._withheld = now, 0
            self._told.clear()
        for line in lines:
            if line in self._told:
                continue
            if len(self._told) >= MOST:
                self._withheld += 1
                continue
            self._told.add(line)
            result.append(line)
        return result
