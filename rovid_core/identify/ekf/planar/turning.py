"""Whether the vehicle has turned, which alone tells a current from drag and bias."""

from __future__ import annotations

from collections.abc import Sequence
import math

from rovid_core.identify.ekf.batch_start import PERIOD
from rovid_core.identify.ekf.single.linearised_filter import floats
from rovid_core.identify.estimate import TURN
from rovid_core.model.samples import PlanarPiece

TURNED = 0.8
"""[rad] Range of headings from which the current can be told from bias and drag."""


class Turning:
    """
    The range of headings since the start began, and when it was wide enough.

    Times are those of thrust: what moves without it says nothing of the vehicle.

    Attributes
    ----------
    turned_at : float
        [s] since the start began; infinite until it has turned.

    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Begin to look whether the vehicle turns."""
        self._heading, self._range = 0.0, (0.0, 0.0)
        self.turned_at = math.inf

    def add(self, pieces: Sequence[PlanarPiece], h: float, duration: float) -> None:
        """Go on by pieces of ``h`` [s] each; ``duration`` [s] is that of the start."""
        low, high = self._range
        for piece in pieces:
            self._heading += h * piece.rate
            low, high = min(low, self._heading), max(high, self._heading)
        self._range = low, high
        if high - low > TURNED and not self.has_turned:
            self.turned_at = duration

    @property
    def has_turned(self) -> bool:
        """Tell whether headings so far apart have been seen."""
        return self.turned_at < math.inf

    def lacks(self, duration: float) -> float:
        """Return how much thrust [s] is still needed after the turn, infinite before."""
        return max(self.turned_at + PERIOD - duration, 0.0)

    def advice(self, duration: float) -> str:
        """Return what to do until the current is looked for."""
        if not self.has_turned:
            return TURN
        # in steps of 5 s, so that it is not another text at each fix
        left = 5.0 * math.ceil(0.2 * self.lacks(duration))
        return f'after the turn, thrust for {left:.0f} s more'

    def state(self) -> list[float]:
        """Return the headings [rad]."""
        return [self._heading, *self._range]

    def restore(self, headings: Sequence[float], turned_at: float | None) -> None:
        """Go on from headings [rad] and the time of the turn [s], None for none."""
        self._heading, low, high = floats(headings, 3)
        self._range = low, high
        self.turned_at = math.inf if turned_at is None else float(turned_at)
