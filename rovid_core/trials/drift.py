"""
Whether a parameter drifts from dive to dive.

A random-effects meta-regression: the estimate y_k of dive k, with the standard deviation s_k of
its own, is

    y_k = mean + slope (t_k - t) + u_k + e_k       u_k ~ N(0, scatter^2), e_k ~ N(0, s_k^2)

The scatter between dives is that of R. C. Paule and J. Mandel (J. Res. Natl. Bur. Stand. 87(5),
1982): with it the weighted squares of the residuals are as large as their degrees of freedom. The
slope is judged by a t test with the variance of G. Knapp and J. Hartung (Stat. Med. 22(17), 2003),
never below the one that the s_k promise. So intervals that are too narrow raise the scatter and
make no drift, and estimates without any are an ordinary regression.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from rovid_core.model.plant import Array
from scipy.optimize import brentq
from scipy.stats import t as student

LEVEL = 0.05  # of a test, as of all intervals: 95 %


@dataclass(frozen=True)
class Trend:
    """
    A straight line through a parameter over time, in the units of what it was made of.

    Attributes
    ----------
    count : int
        How many dives it is of.
    time : float
        Their weighted mean time.
    mean : float
        The line at ``time``.
    scatter : float
        Standard deviation between dives, beyond that of their estimates.
    slope, low, high : float
        Change per unit of time and its 95 % interval.
    p : float
        Probability of such a slope, or a steeper one, where there is no drift.

    """

    count: int
    time: float
    mean: float
    scatter: float
    slope: float
    low: float
    high: float
    p: float


def trend(times: Sequence[float], values: Sequence[float],
          stds: Sequence[float]) -> Trend | None:
    """
    Return the line through estimates over time; None without three dives at two times.

    ``stds`` are the standard deviations of the estimates, 0 where there are none.
    """
    count = len(times)
    if count < 3 or len(set(times)) < 2:
        return None
    y = np.array(values)
    own = np.array(stds) ** 2
    degrees = count - 2
    span = max(times) - min(times)  # so that columns are of one size
    t = (np.array(times) - min(times)) / span

    def weights(scatter: float) -> Array:
        return np.asarray(1.0 / (own + scatter))

    def squares(scatter: float) -> float:
        w = weights(scatter)
        return float(w @ _residuals(t, y, w)[1] ** 2)

    # Unweighted residuals have the largest weighted squares: no solution lies above.
    top = float(np.sum(_residuals(t, y, np.ones(count))[1] ** 2)) / degrees
    bottom = 0.0 if own.min() > 0.0 else 1e-12 * top
    scatter = 0.0
    if top == 0.0 and own.min() == 0.0:  # without scatter and without intervals: a perfect line
        own = np.ones(count)
    elif top > 0.0 and squares(bottom) > degrees:
        scatter = brentq(lambda s: squares(s) - degrees, bottom, top * (1.0 + 1e-9))
    w = weights(scatter)
    (_, slope), left = _residuals(t, y, w)
    centre = float(w @ t / w.sum())
    ratio = 0.0 if top == 0.0 else max(1.0, float(w @ left ** 2) / degrees)
    std = math.sqrt(ratio / float(w @ (t - centre) ** 2))
    half = float(student.ppf(1.0 - LEVEL / 2.0, degrees)) * std
    p = 2.0 * float(student.sf(abs(slope) / std, degrees)) if std else float(slope == 0.0)
    return Trend(count, min(times) + centre * span, float(w @ y / w.sum()), math.sqrt(scatter),
                 slope / span, (slope - half) / span, (slope + half) / span, p)


def holm(ps: Sequence[float]) -> list[float]:
    """Return p values that hold for many tests together (S. Holm, Scand. J. Stat. 6(2), 1979)."""
    adjusted = [1.0] * len(ps)
    worst = 0.0
    for rank, k in enumerate(sorted(range(len(ps)), key=lambda k: ps[k])):
        worst = max(worst, min(1.0, (len(ps) - rank) * ps[k]))
        adjusted[k] = worst
    return adjusted


def _residuals(t: Array, y: Array, w: Array) -> tuple[tuple[float, float], Array]:
    """Return intercept and slope of the weighted line, and what it leaves of ``y``."""
    centre, mean = w @ t / w.sum(), w @ y / w.sum()
    slope = float(w @ ((t - centre) * (y - mean)) / (w @ (t - centre) ** 2))
    return (float(mean - slope * centre), slope), y - mean - slope * (t - centre)
