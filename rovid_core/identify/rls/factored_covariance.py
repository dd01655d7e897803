"""A covariance of four parameters as U D U', which rounding can not make indefinite."""

from __future__ import annotations

import math
from typing import cast, NamedTuple

from rovid_core.model.dofs import Four

LEAST = 1e-30
"""Of D, beside its first value: far below what data can tell, far above underflow."""

Six = tuple[float, float, float, float, float, float]


class FactoredCovariance:
    """
    Covariance P = U D U' of a linear regression with 4 parameters, in plain floats.

    U is upper triangular with ones on its diagonal, D is diagonal and above 0 (Bierman,
    Factorization Methods for Discrete Sequential Estimation, 1977), so that P is symmetric
    and positive definite after any number of updates. A parameter whose regressor is always 0
    stays as it is, and without a covariance.

    Parameters
    ----------
    variance : float
        Of each parameter at first.

    Attributes
    ----------
    u : tuple of 6 floats
        Above the diagonal, by columns.
    d : tuple of 4 floats
        D.

    """

    def __init__(self, variance: float) -> None:
        self.u: Six = (0.0,) * 6
        self.d: Four = (variance,) * 4
        self._least = LEAST * variance

    def along(self, x: Four) -> float:
        """Return x' P x, the variance of the prediction."""
        x0, x1, x2, x3 = x
        u01, u02, u12, u03, u13, u23 = self.u
        d0, d1, d2, d3 = self.d
        x3 += u03 * x0 + u13 * x1 + u23 * x2
        x2 += u02 * x0 + u12 * x1
        x1 += u01 * x0
        return d0 * x0 * x0 + d1 * x1 * x1 + d2 * x2 * x2 + d3 * x3 * x3

    def forget(self, x: Four, share: float) -> None:
        """
        Take away a share of the information along ``x``, and nothing across it.

        P + x x' share / (1 - share) / (x' inv(P) x): the directional forgetting of Cao &
        Schwartz, Automatica 36(11), 2000.
        """
        x0, x1, x2, x3 = x
        u01, u02, u12, u03, u13, u23 = self.u
        d0, d1, d2, d3 = self.d
        # U y = x from below; what is left of x on the way is needed again
        y2, r1, q0 = x2 - u23 * x3, x1 - u13 * x3, x0 - u03 * x3
        y1, r0 = r1 - u12 * y2, q0 - u02 * y2
        y0 = r0 - u01 * y1
        information = x3 * x3 / d3 + y2 * y2 / d2 + y1 * y1 / d1 + y0 * y0 / d0
        if not 0.0 < information < math.inf:
            return
        c = share / (1.0 - share) / information
        # Agee & Turner's update of rank one, column by column from the last
        e3 = d3 + c * x3 * x3
        k = c * x3 / e3
        u03, u13, u23 = u03 + k * q0, u13 + k * r1, u23 + k * y2
        c *= d3 / e3
        e2 = d2 + c * y2 * y2
        k = c * y2 / e2
        u02, u12 = u02 + k * r0, u12 + k * y1
        c *= d2 / e2
        e1 = d1 + c * y1 * y1
        u01 += c * y1 / e1 * y0
        c *= d1 / e1
        self.u = (u01, u02, u12, u03, u13, u23)
        self.d = (d0 + c * y0 * y0, e1, e2, e3)

    def update(self, x: Four, variance: float) -> Four:
        """Take a measurement of x' theta with a noise variance above 0; return its gain."""
        x0, x1, x2, x3 = x
        u01, u02, u12, u03, u13, u23 = self.u
        d0, d1, d2, d3 = self.d
        least = self._least
        f1 = x1 + u01 * x0
        f2 = x2 + u02 * x0 + u12 * x1
        f3 = x3 + u03 * x0 + u13 * x1 + u23 * x2
        v0, v1, v2, v3 = d0 * x0, d1 * f1, d2 * f2, d3 * f3
        t0 = variance + v0 * x0
        t1 = t0 + v1 * f1
        t2 = t1 + v2 * f2
        t3 = t2 + v3 * f3
        # each column takes the gain of those before it, which grows on the way
        k = f1 / t0
        g0, u01 = v0 + u01 * v1, u01 - k * v0
        k = f2 / t1
        a, b = u02, u12
        u02, u12 = a - k * g0, b - k * v1
        g0, g1 = g0 + a * v2, v1 + b * v2
        k = f3 / t2
        a, b, c = u03, u13, u23
        u03, u13, u23 = a - k * g0, b - k * g1, c - k * v2
        self.u = (u01, u02, u12, u03, u13, u23)
        d0, d1, d2, d3 = d0 * (variance / t0), d1 * (t0 / t1), d2 * (t1 / t2), d3 * (t2 / t3)
        self.d = (d0 if d0 > least else least, d1 if d1 > least else least,
                  d2 if d2 > least else least, d3 if d3 > least else least)
        return ((g0 + a * v3) / t3, (g1 + b * v3) / t3, (v2 + c * v3) / t3, v3 / t3)

    def matrix(self) -> list[list[float]]:
        """Return P, of the same bits on both sides of the diagonal."""
        return product(self.u, self.d)


def product(u: Six, d: Four) -> list[list[float]]:
    """Return U D U', of the same bits on both sides of the diagonal."""
    u01, u02, u12, u03, u13, u23 = u
    d0, d1, d2, d3 = d
    p03, p13, p23 = u03 * d3, u13 * d3, u23 * d3
    w02, w12 = u02 * d2, u12 * d2
    w01 = u01 * d1
    p02, p12 = w02 + u03 * p23, w12 + u13 * p23
    p01 = w01 + u02 * w12 + u03 * p13
    return [[d0 + u01 * w01 + u02 * w02 + u03 * p03, p01, p02, p03],
            [p01, d1 + u12 * w12 + u13 * p13, p12, p13],
            [p02, p12, d2 + u23 * p23, p23],
            [p03, p13, p23, d3]]


def projected(estimate: Four, p: list[list[float]], low: Four, high: Four) -> list[float]:
    """Return an estimate with covariance ``p``, given that what is out of bounds lies on them."""
    theta = list(estimate)
    for _ in theta:
        beyond = [max(bottom - x, x - top) for bottom, x, top in zip(low, theta, high)]
        if max(beyond) <= 0.0:
            break
        j = max(range(len(theta)), key=lambda j: beyond[j] / math.sqrt(p[j][j])
                if beyond[j] > 0.0 < p[j][j] else 0.0)
        if not p[j][j] > 0.0:
            break
        shift = (min(max(theta[j], low[j]), high[j]) - theta[j]) / p[j][j]
        column = [row[j] for row in p]
        theta = [x + c * shift for x, c in zip(theta, column)]
        p = [[x - a * b / p[j][j] for x, b in zip(row, column)] for row, a in zip(p, column)]
        p[j][j] = 0.0
    return theta


class FactoredUncertainty(NamedTuple):
    """What U D U' says of the lumped parameters."""

    u: Six
    d: Four
    unit: Four
    active: tuple[bool, bool, bool, bool]
    delay_std: float = math.nan

    @property
    def covariance(self) -> tuple[float, ...]:
        """Return that of the lumped parameters, 16 floats by rows."""
        return tuple([p / u / v if on and here else 0.0
                      for row, u, on in zip(product(self.u, self.d), self.unit, self.active)
                      for p, v, here in zip(row, self.unit, self.active)])

    @property
    def std(self) -> Four:
        """Return the standard deviations, NaN for left-out terms."""
        p = product(self.u, self.d)
        return cast(Four, tuple([
            math.sqrt(p[i][i]) / self.unit[i] if on else math.nan
            for i, on in enumerate(self.active)]))
