"""
Whether the vehicle has changed: newer blocks of data that contradict the older ones.

It is an F test, with the tail of the distribution by the incomplete beta function.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from rovid_core.identify.ekf.evidence.block_fit import BlockFit, MATTERS

Array = NDArray[np.float64]

WEIGHT = 6.0
"""Blocks that the model's own covariance counts as where newer ones are compared."""

FEW = 8
"""
Freedom of the test below which the model counts as much again as the blocks that confirm it: of a
vehicle that was driven for two minutes before its load was dropped there are few.
"""

FALSE_ALARM = 1e-6
"""Probability that one test takes an unchanged vehicle for changed."""

EXPECTED = 1e-3
"""The same while another DOF has just shown a change: a load changes all of them."""

NEWEST = (3, 6)
"""How many blocks are held against the older ones: one or two may be odd ones."""

STILL = 0.1
"""
Motion that the model sees in the newer blocks, relative to that in the older ones, below which
they tell of the sensors and of what the last motion has left behind rather than of the vehicle.
"""

SCATTERED = 1.5
"""Excess scatter above which the newest blocks are taken to scatter as the old ones."""


def contradicts(information: Array, score: Array, fit: BlockFit, largest_scatter: float,
                false_alarm: float) -> bool:
    """
    Tell whether newer blocks contradict what older ones gave, in a way that matters.

    Parameters
    ----------
    information : ndarray, shape (w, q, q)
        Of the newer blocks.
    score : ndarray, shape (w, q)
        Theirs.
    fit : BlockFit
        Of the older ones.
    largest_scatter : float
        Of the older ones, from which they do not tell.
    false_alarm : float
        Probability of that for a vehicle that has not changed.

    """
    a, n, w, m = fit.active, fit.n, len(information), fit.free
    own = information[:, np.array(a)[:, None], a].sum(axis=0)
    u = score[:, a].sum(axis=0) - own @ fit.theta
    of_model, theta = own[:m, :m], fit.theta[:m]
    step = np.linalg.solve(of_model + fit.prior[:m, :m], u[:m])
    motion = float(theta @ of_model @ theta)
    before = float(theta @ fit.known[:m, :m] @ theta) / n
    if motion < STILL**2 * w * before or not (
            float(step @ of_model @ step) >= MATTERS**2 * motion):
        return False
    scatter = fit.scatter()
    if scatter > largest_scatter:
        return False
    mean = WEIGHT * scatter * fit.known / n
    b = (mean + fit.v) / (WEIGHT + n)
    known = fit.c @ ((WEIGHT * scatter * fit.h + n * fit.v) / (WEIGHT + n)) @ fit.c
    if scatter > SCATTERED:
        spread = 0.5 * scatter * own + 0.5 * w * b
    else:
        spread = scatter * own
    s = spread + own @ known @ own
    # not that of one number, though it is one: blocks of a wrong model scatter unevenly
    freedom = n - m
    if scatter <= SCATTERED:
        freedom = max(freedom, min(2 * freedom, FEW))
    inverse = np.linalg.pinv(s, hermitian=True)
    by_model = own[:, :m]
    told = by_model.T @ inverse @ u
    t = float(told @ np.linalg.pinv(by_model.T @ inverse @ by_model, hermitian=True)
              @ told) / m
    if f_tail(t, m, freedom) < false_alarm:
        return True
    for g in (theta, np.eye(m)[0]):
        row = by_model @ g
        bottom = float(row @ inverse @ row)
        if bottom > 0.0:
            t = float(row @ inverse @ u)**2 / bottom
            if f_tail(t, 1, freedom) < false_alarm:
                return True
    return False


def f_tail(x: float, top: int, bottom: int) -> float:
    """Return the probability that a variable of the F distribution is above ``x``."""
    if not x > 0.0:
        return 1.0
    return _beta(0.5 * bottom, 0.5 * top, bottom / (bottom + top * x))


def _beta(a: float, b: float, x: float) -> float:
    """Return the regularised incomplete beta function by its continued fraction (Lentz)."""
    if not 0.0 < x < 1.0:
        return min(max(x, 0.0), 1.0)
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - _beta(b, a, 1.0 - x)
    front = math.exp(math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b)
                     + a * math.log(x) + b * math.log1p(-x)) / a
    tiny = 1e-300
    c, d = 1.0, 1.0 - (a + b) * x / (a + 1.0)
    d = 1.0 / (d if abs(d) > tiny else tiny)
    h = d
    for m in range(1, 300):
        for term in (m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
                     -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))):
            d = 1.0 + term * d
            d = 1.0 / (d if abs(d) > tiny else tiny)
            c = 1.0 + term / c
            c = c if abs(c) > tiny else tiny
            h *= d * c
        if abs(d * c - 1.0) < 1e-12:
            break
    return front * h
