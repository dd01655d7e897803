"""Parameters of one degree of freedom in units in which typical values are 1."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import cast

import numpy as np
from rovid_core.dofs import Four
from rovid_core.ekf.linearised import ALPHA, Array, DELAY, DELTA
from rovid_core.identifier import Scales

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
    prior : ndarray, shape (7, 7)
        Covariance of the state before any measurement; 0 for the motion.
    box : list
        Bounds of the state: index, lowest, highest value.
    bounds : tuple
        The lowest and the highest lumped parameters.

    """

    def __init__(self, scales: Scales) -> None:
        v, f = scales.velocity, scales.force
        self._unit = (v / f, 1.0 / v, 1.0, v)
        self._units = np.outer(self._unit, self._unit)
        self._active = scales.active
        self.initial = [*self.of(scales.initial), 0.0]
        self.bounds = low, high = scales.bounds()
        self.box = [
            (ALPHA + k, low[k] / self._unit[k], high[k] / self._unit[k])
            for k in range(4) if scales.active[k]] + [(DELAY, *DELAYS)]
        # a drag of 2 alpha balances twice the typical force at the typical speed
        alpha, beta, gamma, delta = map(abs, self.initial[:4])
        std = (2.0 * alpha, 2.0 * max(alpha, beta), 2.0 * max(alpha, gamma), max(alpha, delta))
        self.prior = np.diag([
            0.0, 0.0, *[s * s if on else 0.0 for s, on in zip(std, self._active)],
            DELAY_STD**2])

    def of(self, parameters: Sequence[float]) -> list[float]:
        """Return lumped parameters in these units."""
        return [p / u for p, u in zip(parameters, self._unit)]

    def parameters(self, state: Sequence[float]) -> Four:
        """Return the lumped parameters of a state."""
        # unscaling may lead out of the bounds by a last bit
        return cast(Four, tuple([
            min(max(p * u, low), high) for p, u, low, high in zip(
                state[ALPHA:DELTA + 1], self._unit, *self.bounds)]))

    def covariance(self, covariance: Array, inflation: float) -> tuple[float, ...]:
        """Return that of the lumped parameters, 16 floats by rows, times ``inflation``."""
        own = slice(ALPHA, DELTA + 1)
        return tuple((covariance[own, own] * (self._units * inflation)).ravel().tolist())

    def std(self, covariance: Sequence[float]) -> Four:
        """Return the standard deviations in a covariance of 16 floats, NaN for left-out terms."""
        return cast(Four, tuple([
            math.sqrt(x) if on else math.nan for x, on in zip(covariance[::5], self._active)]))
