"""
What filters begin with, in typical forces and velocities, and say of their parameters.

Beside the parameters that is what they take to move the vehicle besides its model: filters that
believe in something else each run side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import cast, NamedTuple

from rovid_core.identify.ekf.single.linearised_filter import ALPHA
from rovid_core.model.dofs import Four, OWN, RESTORING
from rovid_core.model.plant import Array
from rovid_core.settings.run import Scales

CHANGE = 0.5
"""What the parameters may have changed by, relative, when the vehicle has changed."""

MAX_COUPLING = 100.0
"""Largest coupling, in the standard deviations that it has before any data."""

DELAYS = (-0.05, 0.6)
"""Range of the delay [s]; far below 0 the force would have to be known ahead."""

DELAY_STD = 0.15
"""[s] of the guess that there is none: thrusters and clocks are seldom later than twice that."""


class Unmodelled(NamedTuple):
    """
    What a filter takes to move the vehicle besides its model.

    Attributes
    ----------
    force_std : float
        Stationary standard deviation of an unknown acceleration that goes on for seconds, in
        typical accelerations.
    slip : float
        Standard deviation of what the path moves by itself from one fix to the next, over that of
        a fix. The model's velocity is then off by white noise, and the most likely parameters are
        those whose simulated velocity has the least squares of errors: output error.

    """

    force_std: float
    slip: float

    @property
    def is_there(self) -> bool:
        """Tell whether it takes the model to be wrong."""
        return self.force_std > 0.0 or self.slip > 0.0


UNMODELLED = (Unmodelled(0.0, 0.0), Unmodelled(0.05, 0.0), Unmodelled(0.0, 3.0))
"""
Nothing; an unknown force; a model that is not quite right.

A larger force explains everything and leaves the model only what is fast. From a slip of 1 on the
noise of the fixes hardly counts beside it, and a larger one changes little.
"""


class NormalisedModel:
    """
    What a filter begins with, and its parameters in SI units.

    alpha to delta become accelerations in typical velocities per second.

    Parameters
    ----------
    scales : Scales
        Of the degree of freedom.

    Attributes
    ----------
    initial : list of 5 + m floats
        Parameters, m couplings and delay [s].
    prior : tuple of 5 + m floats
        Their variances before any measurement.
    box : list
        Their bounds: index, lowest, highest value.
    bounds : tuple
        The lowest and the highest lumped parameters.
    unit : tuple of 4 floats
        What alpha to delta are multiplied by to be in SI units.
    coupled_unit : tuple of m floats
        The same for the couplings.
    watched : dict
        Names of the regressors that are watched, and how large the coefficients are that they may
        have (standard deviations).
    own : tuple of 2 ints
        Index of the parameter of each of ``OWN``, -1 for none.

    """

    def __init__(self, scales: Scales) -> None:
        v, f = scales.velocity, scales.force
        self.unit = (v / f, 1.0 / v, 1.0, v)
        self.active = scales.active
        self.couplings = scales.couplings
        self.initial = self.of(scales.initial)
        self.bounds = low, high = scales.bounds()
        self.box = [
            (ALPHA + k, low[k] / self.unit[k], high[k] / self.unit[k])
            for k in range(4) if scales.active[k]]
        # those of ``OWN`` stand beside alpha and beta, of the same force and the same velocity
        units = dict(zip(OWN, self.unit))
        self.coupled_unit = tuple([units.get(name, v) for name in scales.couplings])
        one, other = [4 + scales.couplings.index(name) if name in scales.couplings else -1
                      for name in OWN]
        self.own = one, other
        self.watched = {name: std / v for name, std in zip(scales.watched, scales.watched_std)}
        coupled = [std / u for std, u in zip(scales.coupling_std, self.coupled_unit)]
        self.box += [(4 + k, -MAX_COUPLING * s, 0.0 if name in RESTORING else MAX_COUPLING * s)
                     for k, (name, s) in enumerate(zip(scales.couplings, coupled))]
        self.box += [(4 + len(coupled), *DELAYS)]
        # a drag of 2 alpha balances twice the typical force at the typical speed
        alpha, beta, gamma, delta = map(abs, self.initial[:4])
        std = (2.0 * alpha, 2.0 * max(alpha, beta), 2.0 * max(alpha, gamma), max(alpha, delta))
        self.prior = (*[s * s if on else 0.0 for s, on in zip(std, self.active)],
                      *[s * s for s in coupled], DELAY_STD**2)

    def of(self, parameters: Sequence[float]) -> list[float]:
        """Return theta of lumped parameters, with no couplings and no delay."""
        return [*[p / u for p, u in zip(parameters, self.unit)], *[0.0] * len(self.couplings), 0.0]

    def acting(self, theta: Sequence[float], force: float, velocity: float) -> Four:
        """Return alpha to delta with what ``OWN`` adds for a force and a velocity."""
        alpha, beta, gamma, delta = theta[:4]
        thrust, drag = self.own
        if thrust >= 0 and force < 0.0:
            alpha += theta[thrust]
        if drag >= 0 and velocity < 0.0:
            beta = min(beta + theta[drag], 0.0)
        return alpha, beta, gamma, delta

    def coupled(self, theta: Sequence[float], regressors: Sequence[float]) -> float:
        """Return what measured regressors push by, but those of ``OWN``."""
        return math.fsum([kappa * x for k, (kappa, x) in enumerate(zip(theta[4:], regressors), 4)
                          if k not in self.own])

    def kappas(self, theta: Sequence[float]) -> tuple[float, ...]:
        """Return the couplings."""
        return tuple([u * kappa for u, kappa in zip(self.coupled_unit, theta[4:])])

    def parameters(self, theta: Sequence[float]) -> Four:
        """Return the lumped parameters."""
        p, q, r, s = theta[:4]
        i, j, k, m = self.unit
        (a, b, c, d), (e, f, g, h) = self.bounds
        p, q, r, s = p * i, q * j, r * k, s * m
        if a <= p <= e and b <= q <= f and c <= r <= g and d <= s <= h:
            return p, q, r, s
        # unscaling may lead out of the bounds by a last bit
        return (min(max(p, a), e), min(max(q, b), f), min(max(r, c), g), min(max(s, d), h))


class FilterUncertainty:
    """
    What a covariance in normalised units says of the lumped parameters.

    It is not to be changed. What is read is computed once: most of an estimate is told by it.

    Parameters
    ----------
    of_theta : sequence of p sequences of p floats, or ndarray, shape (p, p)
        The covariance; not to be changed either.
    inflation : float
        By which it is to be multiplied.
    model : NormalisedModel
        Whose parameters they are.
    added : sequence of p sequences of p floats, optional
        To the inflated covariance, for what the data do not tell.

    """

    def __init__(self, of_theta: Sequence[Sequence[float]] | Array,
                 inflation: float, model: NormalisedModel,
                 added: Sequence[Sequence[float]] = ()) -> None:
        self._of_theta = of_theta
        self._added = added
        self._inflation = inflation
        self._model = model
        self._covariance: tuple[float, ...] = ()
        self._std: Four | None = None

    @property
    def covariance(self) -> tuple[float, ...]:
        """Return that of the lumped parameters, 16 floats by rows."""
        if not self._covariance:
            self._covariance = tuple([
                u * v * self._entry(i, j)
                for i, u in enumerate(self._model.unit) for j, v in enumerate(self._model.unit)])
        return self._covariance

    @property
    def std(self) -> Four:
        """Return the standard deviations, NaN for left-out terms."""
        if self._std is None:
            self._std = cast(Four, tuple([
                math.sqrt(x) if on else math.nan
                for x, on in zip(self.covariance[::5], self._model.active)]))
        return self._std

    @property
    def delay_std(self) -> float:
        """Return the standard deviation of the delay [s]."""
        return math.sqrt(self._entry(-1, -1))

    @property
    def couplings_std(self) -> tuple[float, ...]:
        """Return the standard deviations of the couplings."""
        return tuple([
            u * math.sqrt(self._entry(k, k)) for k, u in enumerate(self._model.coupled_unit, 4)])

    def _entry(self, i: int, j: int) -> float:
        inflated = float(self._of_theta[i][j]) * self._inflation
        return inflated + self._added[i][j] if self._added else inflated
