"""How a force would differ if the thrusters lagged, which a filter watches that has no lag."""

from __future__ import annotations

import math
from typing import Final

from rovid_core.model.lag import driven, inertia_of, turns_of

LAG: Final = 0.15
"""[s] of the thruster lag that is looked for."""

LAGS: Final = ('lag', 'turns_lag')
"""Names of the regressors: a lag of the force, and one of the turns."""

SECOND_LAG: Final = 'second_lag'
"""
Name of the regressor of another lag behind the first. Thrust that comes and goes in any way at all
within some tenths of a second is about a sum of a delay, of both lags, and of this.
"""


class WatchedLag:
    """
    What a lag of ``LAG`` takes of a force: one of the force, and one of the propellers' turns.

    The force of a propeller goes with n |n| of its turns n.

    Parameters
    ----------
    lag_at : float
        As of ``Thrusters``.

    Attributes
    ----------
    of_force, of_turns, of_second : float
        What either takes of the mean force of the last step, and what another lag of the force
        takes of what the first leaves.

    """

    def __init__(self, lag_at: float = 0.0) -> None:
        self._inertia = inertia_of(LAG, lag_at)
        self.begin(0.0, 0.0)

    def begin(self, held: float, force: float) -> None:
        """
        Begin under the force that has long been held.

        Parameters
        ----------
        held : float
            The one that would hold the velocity there is: 0 at rest, and under way the thrust.
        force : float
            The first one. It is taken to have come up to that; beyond it is what is not known of
            the velocity.

        """
        held = min(max(held, min(force, 0.0)), max(force, 0.0))
        self._lagged = self._twice = held
        self._turns = turns_of(held)
        self.of_force = self.of_turns = self.of_second = 0.0

    def move(self, force: float, h: float) -> None:
        """Go on over ``h`` [s] with a mean force."""
        left = math.exp(-h / LAG)
        gone = 1.0 - left
        off, late = force - self._lagged, gone * LAG / h
        self.of_force = off * late
        moved = gone * (force - self._twice) - off * left * h / LAG
        self.of_second = moved * LAG / h
        self._twice += moved
        self._lagged += gone * off
        if self._inertia:
            impulse, _, self._turns = driven(self._turns, force, h, self._inertia)
            self.of_turns = force - impulse / h
            return
        steady = turns_of(force)
        off = steady - self._turns
        mean, moved = steady - off * late, gone * off
        self._turns += moved
        # the mean square of what goes straight from one end to the other
        self.of_turns = force - mean * abs(mean) - math.copysign(moved * moved / 12.0, mean)

    def state(self) -> list[float]:
        """Return all that is needed to go on from here."""
        return [self._lagged, self._twice, self._turns]

    def restore(self, values: list[float]) -> None:
        """Go on from three numbers."""
        self._lagged, self._twice, self._turns = values
