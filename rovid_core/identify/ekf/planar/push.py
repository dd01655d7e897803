"""The force on surge or sway over a step of their filter."""

from __future__ import annotations

import math

from rovid_core.identify.ekf.single.delayed_force import DelayedForce
from rovid_core.identify.ekf.single.linearised_filter import LAG


class Push:
    """
    The force over the last step; see ``DelayedForce.over``, and ``LinearisedFilter``.

    Attributes
    ----------
    impulse, moment : float
        Of the force, in typical ones.
    before, last : float
        The force at the end of the step before and at that of the last one, NaN before the first.
    lagged, lag : float
        The force behind a lag at the end of the last step, and how it differs over it.
    reverse, reverse_moment, cut, cut_moment : float
        Impulse and moment of the force in reverse, and of what a dead band takes of it.

    """

    __slots__ = ('impulse', 'moment', 'before', 'last', 'lagged', 'lag', 'reverse',
                 'reverse_moment', 'cut', 'cut_moment')

    def __init__(self) -> None:
        self.impulse = self.moment = self.before = self.lag = 0.0
        self.reverse = self.reverse_moment = self.cut = self.cut_moment = 0.0
        self.restart()

    def restart(self) -> None:
        """Begin anew."""
        self.lagged, self.last = 0.0, math.nan

    def move(self, recent: DelayedForce, start: float, end: float, delay: float) -> None:
        """Go on from ``start`` to ``end`` [s] with a force that acts after a delay [s]."""
        h, before = end - start, self.last
        self.impulse, self.moment, first, self.last = recent.over(start, end, delay)
        self.before = first if before != before else before
        force = self.impulse / h
        gone = 1.0 - math.exp(-h / LAG)
        self.lag = (force - self.lagged) * gone * LAG / h
        self.lagged += gone * (force - self.lagged)
        (self.reverse, self.reverse_moment), (self.cut, self.cut_moment) = recent.bent(
            start, end, delay)
