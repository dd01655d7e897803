"""The angular velocities of the last moments, for what is measured away from the origin."""

from __future__ import annotations

from collections import deque

from rovid_core.model.dofs import Vector


class RateHistory:
    """
    Angular velocities in the body [rad/s], interpolated.

    Attributes
    ----------
    timeout : int
        [ns] Between two that are further apart nothing is known.
    memory : int
        [ns] How far back they are needed.

    """

    def __init__(self) -> None:
        self.timeout = self.memory = 0
        self._rates: deque[tuple[int, Vector]] = deque()

    def restart(self) -> None:
        """Forget all."""
        self._rates.clear()

    def add_sample(self, time: int, rate: Vector) -> None:
        """Add an angular velocity, at a time after that of the last one [ns]."""
        rates = self._rates
        if rates and time - rates[-1][0] > self.timeout:
            rates.clear()
        rates.append((time, rate))
        while rates[0][0] < time - self.memory:
            rates.popleft()

    def missing(self, time: int) -> str:
        """Return '' if the angular velocity at ``time`` is known, 'later' if it may become so."""
        if not self._rates or self._rates[-1][0] < time:
            return 'later'
        return '' if self._rates[0][0] <= time else 'no_rate'

    def at(self, time: int) -> Vector:
        """Return the angular velocity at a ``time`` for which ``missing`` is ''."""
        end, after = self._rates[-1]
        for start, before in reversed(self._rates):
            if start <= time:
                break
            end, after = start, before
        share = (time - start) / (end - start) if end > start else 0.0
        return (before[0] + share * (after[0] - before[0]),
                before[1] + share * (after[1] - before[1]),
                before[2] + share * (after[2] - before[2]))
