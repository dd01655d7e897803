"""
How well the parameters are known: covariance, standard deviations and 95 % intervals.

The physical parameters are ratios to alpha, and a ratio to an uncertain number is far from
Gaussian: their bounds are Fieller's (E. C. Fieller, J. R. Stat. Soc. B 16(2), 1954).
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple, Protocol

from rovid_core.model.dofs import Four, NAN4, PARAMETERS, PHYSICAL


class Uncertainty(Protocol):
    """
    The uncertainty of a method's estimate at one step, computed when it is read.

    ``covariance`` is that of the lumped parameters: 16 floats, row-major, 0 for left-out terms,
    and () for a method without a covariance. ``std`` are the standard deviations, NaN where
    there are none. ``delay_std`` is the standard deviation of the delay [s], ``couplings_std``
    are those of the couplings.
    """

    @property
    def covariance(self) -> tuple[float, ...]:
        """Return the covariance of the parameters."""

    @property
    def std(self) -> Four:
        """Return the standard deviations of the parameters."""

    @property
    def delay_std(self) -> float:
        """Return the standard deviation of the delay [s]."""

    @property
    def couplings_std(self) -> tuple[float, ...]:
        """Return the standard deviations of the couplings."""


class KnownUncertainty(NamedTuple):
    """An uncertainty of given values; by default that of a method without any."""

    covariance: tuple[float, ...] = ()
    std: Four = NAN4
    delay_std: float = math.nan
    couplings_std: tuple[float, ...] = ()


NO_UNCERTAINTY = KnownUncertainty()


class WithScaleInDoubt:
    """
    An uncertainty that has in it that all thrust may be other than it is taken to be.

    Parameters
    ----------
    of : Uncertainty
        Where the thrust is right.
    alpha_std : float
        Standard deviation of alpha for that alone; above 0.

    """

    def __init__(self, of: Uncertainty, alpha_std: float) -> None:
        self._of, self._alpha_std = of, alpha_std

    @property
    def covariance(self) -> tuple[float, ...]:
        """Return the covariance of the parameters."""
        found = self._of.covariance
        return found and (found[0] + self._alpha_std**2, *found[1:])

    @property
    def std(self) -> Four:
        """Return the standard deviations of the parameters."""
        alpha, beta, gamma, delta = self._of.std
        return math.hypot(alpha, self._alpha_std), beta, gamma, delta

    @property
    def delay_std(self) -> float:
        """Return the standard deviation of the delay [s]."""
        return self._of.delay_std

    @property
    def couplings_std(self) -> tuple[float, ...]:
        """Return the standard deviations of the couplings."""
        return self._of.couplings_std


Interval = tuple[float, float]
Z95 = 1.959963984540054  # half the width of a Gaussian's 95 % interval, in standard deviations
UNBOUNDED: Interval = (-math.inf, math.inf)


def intervals(parameters: Sequence[float], covariance: Sequence[float]) -> dict[str, Interval]:
    """
    Return the 95 % interval of each lumped and physical parameter by name.

    ``covariance`` has 16 floats, row-major, 0 for left-out terms; it is empty if there is none. An
    end that the data leave open is infinite. A left-out term has no interval. Intervals of masses
    and drags are cut to physical values (at least 0), unless the whole interval is negative: such
    data contradict the model, and the user should see it.
    """
    if len(covariance) != 16 or not all(map(math.isfinite, (*parameters, *covariance))):
        return {}
    lumped: dict[str, Interval] = {}
    ratios: dict[str, Interval] = {}
    alpha, alpha_variance = parameters[0], covariance[0]
    for i, name in enumerate(PARAMETERS):
        theta, variance = parameters[i], covariance[5 * i]
        if variance > 0.0:
            half = Z95 * math.sqrt(variance)
            lumped[name] = theta - half, theta + half
            # the mass is 1 / alpha, that is -(-1) / alpha
            ratio = (_fieller(theta, variance, covariance[i], alpha, alpha_variance) if i
                     else _fieller(-1.0, 0.0, 0.0, alpha, alpha_variance))
            ratios[PHYSICAL[i]] = _cut(ratio, -math.inf if i == 3 else 0.0)
    lumped.update(ratios)
    return lumped


def physical_std(parameters: Sequence[float], covariance: Sequence[float]) -> Four:
    """
    Return the standard deviations of mass, quadratic drag, linear drag and bias.

    They are those of r = -theta / alpha to first order, dr = -(dtheta + r dalpha) / alpha: right
    where alpha is well known, which ``intervals`` does not need. NaN for a left-out term, and
    without a covariance (16 floats, row-major).
    """
    if len(covariance) != 16 or not all(map(math.isfinite, (*parameters, *covariance))):
        return NAN4
    alpha, alpha_variance = parameters[0], covariance[0]
    found = [math.sqrt(alpha_variance) / alpha**2 if alpha_variance > 0.0 else math.nan]
    for i in (1, 2, 3):
        r = -parameters[i] / alpha
        variance = covariance[5 * i] + 2.0 * r * covariance[i] + r * r * alpha_variance
        found.append(math.sqrt(max(variance, 0.0)) / alpha if covariance[5 * i] > 0.0
                     else math.nan)
    return tuple(found)  # type: ignore[return-value]


def _fieller(theta: float, theta_variance: float, covariance: float, alpha: float,
             alpha_variance: float) -> list[Interval]:
    """Return the interval(s) of r = -theta / alpha, by (theta + r alpha)^2 <= z^2 its variance."""
    square = Z95 * Z95
    a = alpha * alpha - square * alpha_variance
    b = theta * alpha - square * covariance
    c = theta * theta - square * theta_variance
    # with a > 0 the estimate is inside, so a discriminant below 0 is rounding
    discriminant = b * b - a * c
    if a <= 0.0 and (discriminant <= 0.0 or b == 0.0 == a):
        return [UNBOUNDED]
    q = -(b + math.copysign(math.sqrt(max(discriminant, 0.0)), b))  # no cancellation
    first = q / a if a else math.copysign(math.inf, q)
    second = c / q if q else 0.0
    low, high = min(first, second), max(first, second)
    return [(low, high)] if a >= 0.0 else [(-math.inf, low), (high, math.inf)]


def _cut(pieces: Sequence[Interval], lowest: float) -> Interval:
    """Return the hull of what is above ``lowest`` of some intervals, or of all if nothing is."""
    inside = [(max(low, lowest), high) for low, high in pieces if low < high and lowest < high]
    inside = inside or list(pieces)
    return inside[0][0], inside[-1][1]
