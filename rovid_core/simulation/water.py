"""The current of the simulated water: constant, turning, tidal."""

from __future__ import annotations

import math

from rovid_core.settings.run import SimulationSettings


class Water:
    """
    A horizontal current that is the same everywhere.

    It turns once in ``current_turn`` [s], from x of the world to y, and comes and goes once in
    ``current_tide`` [s]; 0 for never.
    """

    def __init__(self, settings: SimulationSettings) -> None:
        self._start = settings.current
        self._turn = _frequency(settings.current_turn)
        self._tide = _frequency(settings.current_tide)

    def at(self, t: float) -> tuple[float, float]:
        """Return the velocity of the water in the ENU world [m/s] at ``t`` [s]."""
        x, y = self._start
        if self._tide:
            strength = math.cos(self._tide * t)
            x, y = strength * x, strength * y
        if self._turn:
            c, s = math.cos(self._turn * t), math.sin(self._turn * t)
            x, y = c * x - s * y, s * x + c * y
        return x, y


def _frequency(period: float) -> float:
    """Return the angular frequency [rad/s] of a period [s], 0 for none."""
    return 2.0 * math.pi / period if period else 0.0
