"""
95 % intervals of the parameters, in both forms, from the covariance of the lumped ones.

The physical parameters are ratios to alpha, and a ratio to an uncertain number is far from
Gaussian: the bounds are Fieller's (E. C. Fieller, J. R. Stat. Soc. B 16(2), 1954).
"""

from __future__ import annotations

from collections.abc import Sequence
import math

from rovid_core.model.dofs import PARAMETERS, PHYSICAL

Interval = tuple[float, float]

Z95 = 1.959963984540054
"""Half the width of a Gaussian's 95 % interval, in standard deviations."""

UNBOUNDED: Interval = (-math.inf, math.inf)
POSITIVE: Interval = (0.0, math.inf)


def intervals(parameters: Sequence[float], covariance: Sequence[float],
              z: float = Z95) -> dict[str, Interval]:
    """
    Return the interval of each lumped and physical parameter by name.

    Parameters
    ----------
    parameters : sequence of 4 floats
        alpha, beta, gamma, delta.
    covariance : sequence of 16 floats
        Theirs, row-major, 0 for left-out terms; empty where there is none.
    z : float
        Half width in standard deviations.

    Returns
    -------
    dict of str to (low, high)
        An end that the data leave open is infinite. A left-out term has no interval. Masses
        and drags are cut to what is physical (at least 0), except where all of the interval
        is not: such data contradict the model, and it should be seen.

    """
    if len(covariance) != 16 or not all(map(math.isfinite, (*parameters, *covariance))):
        return {}
    found: dict[str, Interval] = {}
    alpha, alpha_variance = parameters[0], covariance[0]
    for i, name in enumerate(PARAMETERS):
        variance = covariance[5 * i]
        if variance > 0.0:
            half = z * math.sqrt(variance)
            found[name] = (parameters[i] - half, parameters[i] + half)
            # a mass is -(-1) / alpha
            top = (parameters[i], variance, covariance[i]) if i else (-1.0, 0.0, 0.0)
            pieces = _fieller(*top, alpha, alpha_variance, z)
            found[PHYSICAL[i]] = _cut(pieces, UNBOUNDED if i == 3 else POSITIVE)
    return {name: found[name] for name in (*PARAMETERS, *PHYSICAL) if name in found}


def _fieller(theta: float, theta_variance: float, covariance: float, alpha: float,
             alpha_variance: float, z: float) -> list[Interval]:
    """
    Return where r = -theta / alpha can be: one or two intervals.

    They hold every r with (theta + r alpha)^2 <= z^2 var(theta + r alpha), which is
    a r^2 + 2 b r + c <= 0.
    """
    a = alpha * alpha - z * z * alpha_variance
    b = theta * alpha - z * z * covariance
    c = theta * theta - z * z * theta_variance
    # for a > 0 the estimate itself solves it, below 0 it is rounding
    discriminant = b * b - a * c
    if a <= 0.0 and (discriminant <= 0.0 or b == 0.0 == a):
        return [UNBOUNDED]
    q = -(b + math.copysign(math.sqrt(max(discriminant, 0.0)), b))  # does not cancel
    first = q / a if a else math.copysign(math.inf, q)
    second = c / q if q else 0.0
    low, high = min(first, second), max(first, second)
    return [(low, high)] if a >= 0.0 else [(-math.inf, low), (high, math.inf)]


def _cut(pieces: Sequence[Interval], physical: Interval) -> Interval:
    """Return the least interval around the physical part, or around all if there is none."""
    inside = [(max(low, physical[0]), min(high, physical[1])) for low, high in pieces]
    inside = [(low, high) for low, high in inside if low < high] or list(pieces)
    return (min(low for low, _ in inside), max(high for _, high in inside))
