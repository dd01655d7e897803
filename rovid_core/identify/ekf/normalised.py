"""Parameters of one degree of freedom in units in which typical values are 1."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import cast, NamedTuple

from rovid_core.identify.ekf.covariance import DIAGONAL, INDICES, Packed
from rovid_core.identify.ekf.linearised import ALPHA, DELAY
from rovid_core.identify.uncertainty import Uncertainty
from rovid_core.model.dofs import Four
from rovid_core.settings.scales import Scales

DELAYS = (-0.05, 0.6)
"""Range of the delay [s]; far below 0 the force would have to be known ahead."""

DELAY_STD = 0.05
"""[s] of the guess that there is none."""


class Normalised:
    """
    What :class:`Linearised` begins with, and its state in SI units.

    alpha to delta become accelerations in typical velocities per second.

    Parameters
    ----------
    scales : Scales
        Of the degree of freedom.

    Attributes
    ----------
    initial : list of 5 floats
        Parameters and delay [s].
    prior : tuple of 7 floats
        Variances of the state before any measurement; 0 for the motion.
    box : list
        Bounds of the state: index, lowest, highest value.
    bounds : tuple
        The lowest and the highest lumped parameters.

    """

    def __init__(self, scales: Scales) -> None:
        v, f = scales.velocity, scales.force
        self._unit = (v / f, 1.0 / v, 1.0, v)
        self._active = scales.active
        self.initial = [*self.of(scales.initial), 0.0]
        self.bounds = low, high = scales.bounds()
        self.box = [
            (ALPHA + k, low[k] / self._unit[k], high[k] / self._unit[k])
            for k in range(4) if scales.active[k]] + [(DELAY, *DELAYS)]
        # a drag of 2 alpha balances twice the typical force at the typical speed
        alpha, beta, gamma, delta = map(abs, self.initial[:4])
        std = (2.0 * alpha, 2.0 * max(alpha, beta), 2.0 * max(alpha, gamma), max(alpha, delta))
        self.prior = (0.0, 0.0, *[s * s if on else 0.0 for s, on in zip(std, self._active)],
                      DELAY_STD**2)

    def of(self, parameters: Sequence[float]) -> list[float]:
        """Return lumped parameters in these units."""
        return [p / u for p, u in zip(parameters, self._unit)]

    def parameters(self, state: Sequence[float]) -> Four:
        """Return the lumped parameters of a state."""
        _, _, p, q, r, s, _ = state
        i, j, k, m = self._unit
        (a, b, c, d), (e, f, g, h) = self.bounds
        p, q, r, s = p * i, q * j, r * k, s * m
        if a <= p <= e and b <= q <= f and c <= r <= g and d <= s <= h:
            return p, q, r, s
        # unscaling may lead out of the bounds by a last bit
        return (min(max(p, a), e), min(max(q, b), f), min(max(r, c), g), min(max(s, d), h))

    def uncertainty(self, covariance: Packed, inflation: float) -> Uncertainty:
        """Return that of the lumped parameters; variances are ``inflation`` times as large."""
        return FilterUncertainty(covariance, inflation, self._unit, self._active)


class FilterUncertainty(NamedTuple):
    """What a filter's covariance says of the lumped parameters."""

    of_state: Packed
    inflation: float
    unit: Four
    active: tuple[bool, bool, bool, bool]

    @property
    def covariance(self) -> tuple[float, ...]:
        """Return that of the lumped parameters, 16 floats by rows."""
        return tuple([self.of_state[k] * (u * v * self.inflation)
                      for of, u in zip(INDICES[ALPHA:DELAY], self.unit)
                      for k, v in zip(of[ALPHA:DELAY], self.unit)])

    @property
    def std(self) -> Four:
        """Return the standard deviations, NaN for left-out terms."""
        return cast(Four, tuple([
            math.sqrt(x) if on else math.nan
            for x, on in zip(self.covariance[::5], self.active)]))

    @property
    def delay_std(self) -> float:
        """Return the standard deviation of the delay [s]."""
        return math.sqrt(self.of_state[DIAGONAL[DELAY]])
