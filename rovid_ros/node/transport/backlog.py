"""What to do when more comes than the node can take: let whole fixes go, and say so."""

from __future__ import annotations

LONG = 0.5
"""[s] The oldest message of a batch has waited longer: the node is behind."""

MOST = 64
"""At least one message in so many is always taken."""


class Backlog:
    """
    Decide how many messages to take of those that can be left out.

    A difference over two intervals is a measurement like one over a single one, but with less
    resolution in time; a command that is left out is wrong. So of the sensors only every second
    message is taken, or fourth and so on, while a batch comes late and those before it took
    longer than their messages took to come; and twice as many again once nothing is late. What
    comes late after a pause of the process alone is all taken, also where that was at work.

    Attributes
    ----------
    every : int
        One message in so many is taken, and one whenever the last is long ago.

    """

    def __init__(self) -> None:
        self.every = 1
        self._load = 0.0  # of the last batches: their work by the time in which they came
        self._work = self._span = 0.0  # of those since [s]
        self._newest: float | None = None
        self._counts: dict[str, int] = {}
        self._taken: dict[str, int] = {}  # [ns] when the last one came

    def begin(self, waited: float) -> None:
        """Take how long the oldest message of a batch has waited [s]."""
        if waited > LONG:
            while self._load > 1.0 and self.every < MOST:
                self.every *= 2
                self._load /= 2.0
        elif waited < 0.1 * LONG and self.every > 1:
            self.every //= 2

    def end(self, work: float, newest: float) -> None:
        """Take how long a batch took, and when its newest message came [s]."""
        if self._newest is not None and newest > self._newest:
            self._work += work
            self._span += newest - self._newest
            if self._span >= 0.5 * LONG:  # after less, a pause at work would seem to be load
                self._load = self._work / self._span
                self._work = self._span = 0.0
        self._newest = newest

    def leaves_out(self, topic: str, time: int, patience: int) -> bool:
        """Count a message that came at ``time``; tell whether to leave it out, both [ns]."""
        count = self._counts[topic] = self._counts.get(topic, 0) + 1
        last = self._taken.get(topic)
        if last is not None and count % self.every and time - last < patience:
            return True
        self._taken[topic] = time
        return False
