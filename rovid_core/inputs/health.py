"""How an input is doing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class InputHealth:
    """Rate and gaps of what was released of an input, and how many of it were taken."""

    count: int = 0
    last_time: int | None = None  # [ns]
    rate: float = 0.0  # [Hz], by event time, over about 20 samples
    longest_gap: float = 0.0  # [s]

    def note(self, time: int) -> None:
        """Take the event time [ns] of a sample."""
        if self.last_time is not None and time > self.last_time:
            gap = time - self.last_time
            if gap * 1e-9 > self.longest_gap:
                self.longest_gap = gap * 1e-9
            self.rate += (1e9 / gap - self.rate) * (0.05 if self.rate else 1.0)
        self.last_time = time
