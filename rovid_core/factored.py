"""A covariance as U D U', which rounding can not make indefinite."""

from __future__ import annotations

from collections.abc import Sequence
import math

LEAST = 1e-30
"""Of D, beside its first value: far below what data can tell, far above underflow."""


class FactoredCovariance:
    """
    Covariance P = U D U' of a linear regression with n parameters.

    U is upper triangular with ones on its diagonal, D is diagonal and above 0 (Bierman,
    Factorization Methods for Discrete Sequential Estimation, 1977), so that P is symmetric
    and positive definite after any number of updates.

    Parameters
    ----------
    count : int
        n.
    variance : float
        Of each parameter at first.

    """

    def __init__(self, count: int, variance: float) -> None:
        self.u = [[0.0] * count for _ in range(count)]  # column j above the diagonal: u[j][:j]
        self.d = [variance] * count
        self._least = LEAST * variance

    def along(self, x: Sequence[float]) -> float:
        """Return x' P x, the variance of the prediction."""
        total = 0.0
        for j, (column, d) in enumerate(zip(self.u, self.d)):
            f = x[j]
            for i in range(j):
                f += column[i] * x[i]
            total += d * f * f
        return total

    def forget(self, x: Sequence[float], share: float) -> None:
        """
        Take away a share of the information along ``x``, and nothing across it.

        P + x x' share / (1 - share) / (x' inv(P) x): the directional forgetting of Cao &
        Schwartz, Automatica 36(11), 2000.
        """
        y, information = list(x), 0.0
        for j in range(len(y) - 1, -1, -1):  # U y = x
            information += y[j] * y[j] / self.d[j]
            for i in range(j):
                y[i] -= y[j] * self.u[j][i]
        if not 0.0 < information < math.inf:
            return
        c, y = share / (1.0 - share) / information, list(x)
        for j in range(len(y) - 1, -1, -1):  # Agee & Turner's update of rank one
            s, column, before = y[j], self.u[j], self.d[j]
            after = before + c * s * s
            self.d[j] = after
            for i in range(j):
                y[i] -= s * column[i]
                column[i] += c * s / after * y[i]
            c *= before / after

    def update(self, x: Sequence[float], variance: float) -> list[float]:
        """Take a measurement of x' theta with a noise variance above 0; return its gain."""
        total, gain = variance, [0.0] * len(x)
        for j, column in enumerate(self.u):
            f = x[j]
            for i in range(j):
                f += column[i] * x[i]
            v = self.d[j] * f
            before = total
            total += v * f
            self.d[j] = max(self.d[j] * (before / total), self._least)
            for i in range(j):
                old = column[i]
                column[i] = old - f / before * gain[i]
                gain[i] += old * v
            gain[j] = v
        return [g / total for g in gain]

    def matrix(self) -> list[list[float]]:
        """Return P, of the same bits on both sides of the diagonal."""
        n = len(self.d)
        rows = [[0.0] * n for _ in range(n)]
        for j, (column, d) in enumerate(zip(self.u, self.d)):
            entries = [*column[:j], 1.0]
            for i, a in enumerate(entries):
                for k in range(i + 1):
                    rows[i][k] += d * (a * entries[k])
        for i in range(n):
            for k in range(i):
                rows[k][i] = rows[i][k]
        return rows
