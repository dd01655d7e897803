"""
What the scores of blocks of data say: honest intervals, missing regressors, changes.

The score of a block is the derivative of its log likelihood by the parameters. Where the model
is right the scores of blocks scatter as their information says; where it is not they scatter
more, and the covariance of the parameters follows from that scatter (the sandwich of H. White,
Econometrica 50(1), 1982).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rovid_core.identify.ekf.evidence.unseen_terms import (
    averaged,
    expected,
    foremost,
    judged,
    summed,
    UnseenTerm,
)
from rovid_core.identify.ekf.single.linearised_filter import ALPHA, CANDIDATES, floats
from rovid_core.model.dofs import HEADING

Array = NDArray[np.float64]

BLOCK = 10.0
"""[s] of a block."""

LARGEST_COUNT, SINGLE = 48, 8
"""Blocks that are kept, and how many of the newest are never joined."""

LEAST_COUNT = 6
"""Blocks below which they say nothing."""

WEIGHT = 6.0
"""Blocks that the model's own covariance counts as where newer ones are compared."""

REPEATED = 2.0
"""Excess scatter above which an error repeats from block to block and does not average out."""

PENDING = 64
"""Measurements that are added up at once."""

NAMED_T, NAMED_GAIN = 4.0, 0.01
"""Significance, and share of the squared innovations, from which a regressor is named."""

NAMED_LEFT, TOLD = 1e-6, 1e-8
"""
Share of a regressor that the parameters cannot take the place of, from which it is named, and
from which the data say anything of it; less is what rounding and the steps of the filter make.
"""

FALSE_ALARM = 1e-6
"""Probability that one test takes an unchanged vehicle for changed."""

MATTERS = 0.05
"""Least change of the force that is one, in what the model says."""

SCATTERED = 1.5
"""Excess scatter above which the newest blocks are taken to scatter as the old ones."""


@dataclass(frozen=True)
class Missing:
    """
    A regressor that the model lacks.

    Attributes
    ----------
    name : str
        One of the watched ones, or ``current``.
    coefficient : float
        What it would have, in typical velocities per second; of a current its size.
    share : float
        Of the squared innovations that it explains.

    """

    name: str
    coefficient: float
    share: float


@dataclass(frozen=True)
class Regression:
    """
    What further regressors would explain.

    Attributes
    ----------
    kappa : ndarray, shape (k,)
        Their coefficients.
    power : float
        By how much -2 log of the likelihood would fall; chi-squared if there is nothing.
    t_squared : float
        The same by the scatter of the blocks, whatever the model says (Hotelling).
    moved : ndarray, shape (active parameters,)
        By how much the parameters fall short of what they would be, with the other sign.

    """

    kappa: Array
    power: float
    t_squared: float
    moved: Array


@dataclass(frozen=True)
class Verdict:
    """
    What the blocks say.

    Attributes
    ----------
    covariance : p lists of p floats
        Of the parameters.
    scatter : float
        Of the scores, relative to what the model says; 1 where it is right.
    missing : Missing or None
        The regressor that explains most of what the model does not.
    count : int
        Of the blocks.
    theta : list of p floats
        The parameters that fit all of them best, also beyond their bounds.
    untold : tuple of str
        The term of each DOF that it may have and that makes most of its alpha's variance.

    """

    covariance: list[list[float]]
    scatter: float
    missing: Missing | None
    count: int
    theta: list[float]
    untold: tuple[str, ...]


class ScoreBlocks:
    """
    Information and score of each block of some seconds.

    Parameters
    ----------
    theta, variances : sequence of p floats
        Parameters and their variances before the first block.
    watched : sequence of str
        Names of the regressors behind the parameters.
    considered : mapping, optional
        Index and variance of parameters that are not found, but not known either.
    further : int
        Regressors behind the watched ones that a verdict does not look at.
    rows : sequence of (str, int)
        What the names of a DOF's watched regressors begin with, and where its parameters do.

    """

    def __init__(self, theta: Sequence[float], variances: Sequence[float],
                 watched: Sequence[str] = CANDIDATES,
                 considered: Mapping[int, float] | None = None, further: int = 0,
                 rows: Sequence[tuple[str, int]] = (('', 0),)) -> None:
        p = len(theta)
        self._rows = rows
        self._considered = considered or {}
        self._q = p + len(watched) + further
        self._candidates = {name: [p + k] for k, name in enumerate(watched)}
        if all(name in watched for name in HEADING):
            # a current pushes in any direction
            self._candidates['current'] = [
                k for name in HEADING for k in self._candidates.pop(name)]
        self.clear(theta, variances)

    def clear(self, theta: Sequence[float], variances: Sequence[float]) -> None:
        """Forget all blocks and begin with other parameters and variances."""
        self._theta, self._variances = list(theta), list(variances)
        self._active = [i for i, variance in enumerate(variances) if variance > 0.0]
        q = self._q
        self._information = np.zeros((0, q, q))
        self._score = np.zeros((0, q))
        self._counts = np.zeros(0)
        self._time = 0.0
        self._begin()

    def _begin(self) -> None:
        q = self._q
        self._open = np.zeros((q, q)), np.zeros(q)
        self._count = 0
        self._pending: list[float] = []  # of each measurement: information, what it told, psi

    @property
    def count(self) -> int:
        """Return how many blocks there are."""
        return len(self._counts)

    @property
    def measurements(self) -> float:
        """Return how many measurements they have."""
        return float(self._counts.sum())

    def add(self, told: float, variance: float, psi: list[float], dt: float) -> bool:
        """
        Add a measurement; return whether it completes a block.

        Parameters
        ----------
        told : float
            What it says of psi theta.
        variance : float
            Of that, for given parameters.
        psi : list of p + c floats
            Its derivatives by the parameters and the watched regressors.
        dt : float
            [s] since the last one.

        """
        pending = self._pending
        pending += [1.0 / variance, told]
        pending += psi
        if len(pending) >= PENDING * (self._q + 2):
            self._sum_up()
        self._time += dt
        if self._time < BLOCK:
            return False
        self._time = 0.0
        self._sum_up()
        information, score = self._open
        self._information = np.concatenate([self._information, information[None]])
        self._score = np.concatenate([self._score, score[None]])
        self._counts = np.append(self._counts, self._count)
        self._begin()
        if self.count > LARGEST_COUNT:
            self._join()
        return True

    def _sum_up(self) -> None:
        if not self._pending:
            return
        rows = np.fromiter(self._pending, float, len(self._pending)).reshape(-1, self._q + 2)
        columns = rows.T.copy()  # sums along what lies together take half of the time
        # not a product of matrices: its last bits depend on the library
        sums = np.einsum('ik,jk->ij', columns[2:] * columns[0], columns[1:])
        information, score = self._open
        self._open = information + sums[:, 1:], score + sums[:, 0]
        self._count += len(rows)
        self._pending = []

    def _join(self) -> None:
        """Join pairs of the older blocks."""
        old = (self.count - SINGLE) // 2 * 2

        def joined(x: Array) -> Array:
            return np.concatenate([x[:old:2] + x[1:old:2], x[old:]])

        self._information, self._score, self._counts = (
            joined(self._information), joined(self._score), joined(self._counts))

    def verdict(self, wrong_model: bool = False) -> Verdict | None:
        """Return what the blocks say; None while there are too few."""
        if self.count < LEAST_COUNT:
            return None
        return self._fit(self.count).verdict(
            self._counts, wrong_model, self._candidates, self._considered, self._rows)

    def regression(self, columns: Sequence[int]) -> Regression | None:
        """
        Return what further regressors would explain, None where it cannot be told.

        Parameters
        ----------
        columns : sequence of int
            Where they stand, also counted from the end.

        """
        fit = self._fit(self.count)
        fit.scatter()
        return fit.regression([k % self._q for k in columns])

    def unseen(self) -> list[list[float]]:
        """Return what terms that nothing tells yet add to the covariance; empty for nothing."""
        return self._fit(self.count).unseen(
            self._candidates, self._rows) if self.count else []

    def _fit(self, count: int) -> _Fit:
        """Return what the oldest blocks give."""
        return _Fit(self._active, self._theta, self._variances, self._information[:count],
                    self._score[:count])

    def solution(self) -> tuple[list[float], list[list[float]]]:
        """Return the parameters that fit all data best, and their covariance."""
        self._sum_up()
        active = self._active
        information, score = self._open
        h = self._information.sum(axis=0) + information
        y = self._score.sum(axis=0) + score
        prior, theta = 1.0 / np.array(self._variances)[active], np.array(self._theta)
        covariance = np.linalg.inv(h[np.ix_(active, active)] + np.diag(prior))
        found = theta.copy()
        found[active] = covariance @ (y[active] + prior * theta[active])
        full = np.zeros((len(theta), len(theta)))
        full[np.ix_(active, active)] = 0.5 * (covariance + covariance.T)
        return found.tolist(), full.tolist()

    def misfit(self, theta: Sequence[float]) -> float:
        """Return what the prior adds to -2 log of the likelihood at some parameters."""
        return math.fsum([(theta[i] - self._theta[i])**2 / self._variances[i]
                          for i in self._active])

    def has_changed(self, largest_scatter: float) -> bool:
        """
        Tell whether the newest blocks contradict the older ones.

        They have to do so for the model as it is, and for one with all that it may lack: where
        the vehicle is driven in another way, what is missing moves the parameters elsewhere.

        Parameters
        ----------
        largest_scatter : float
            Of the older blocks, from which they do not tell.

        """
        for newest in (3, 6):  # one or two may be odd ones
            older = self.count - newest
            if older < max(LEAST_COUNT, len(self._active) + 1):
                break
            newer, fit = (self._information[older:], self._score[older:]), self._fit(older)
            if fit.contradicts(*newer, largest_scatter) and self._with_all_that_may_be_missing(
                    fit).contradicts(*newer, largest_scatter):
                return True
        return False

    def _with_all_that_may_be_missing(self, fit: _Fit) -> _Fit:
        """Return what the same blocks give for a model that has every regressor watched."""
        variances = [*self._variances, *[0.0] * (self._q - len(self._variances))]
        information = fit.total.diagonal().tolist()
        for begin, first in self._rows:
            theta = fit.all_parameters()[first:]
            sizes = expected(theta)
            for name, columns in self._candidates.items():
                if not name.startswith(begin):
                    continue
                std, _ = sizes.get(name[len(begin):], (0.0, 0))
                for k in columns:
                    if information[k] > 0.0:
                        # a coupling may move the vehicle as much as the thrust does
                        variances[k] = std * std or (
                            theta[ALPHA]**2 * information[first] / information[k])
        theta = [*self._theta, *[0.0] * (self._q - len(self._theta))]
        active = [k for k, variance in enumerate(variances) if variance > 0.0]
        return _Fit(active, theta, variances, fit.information, fit.score, len(self._active))

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        information, score = self._open
        rows, width = self._pending, self._q + 2
        return {'theta': self._theta, 'variances': self._variances, 'time': self._time,
                'information': self._information.tolist(), 'score': self._score.tolist(),
                'counts': self._counts.tolist(), 'count': self._count,
                'open': [information.tolist(), score.tolist()],
                'pending': [rows[k:k + width] for k in range(0, len(rows), width)]}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        p = len(self._theta)
        q = self._q
        self.clear(floats(state['theta'], p), floats(state['variances'], p))
        counts = _finite(state['counts'], (-1,))
        n = len(counts)
        information, score = state['open']
        self._information = _finite(state['information'], (n, q, q))
        self._score, self._counts = _finite(state['score'], (n, q)), counts
        self._open = _finite(information, (q, q)), _finite(score, (q,))
        self._time, self._count = float(state['time']), int(state['count'])
        if not 0.0 <= self._time < math.inf:
            raise ValueError('the time of a block is out of range')
        self._pending = [x for row in state['pending'] for x in floats(row, q + 2)]


class _Fit:
    """
    The parameters that some blocks give, and how their scores scatter.

    ``free`` is how many of the active ones the data alone have to tell, the first ones; the
    others have priors of the size that they may have.
    """

    def __init__(self, active: Sequence[int], theta: Sequence[float],
                 variances: Sequence[float], information: Array, score: Array,
                 free: int = 0) -> None:
        self.active, self._p = list(active), len(theta)
        self._free = free or len(active)
        a = np.array(self.active)
        self.n, self.information, self.score = len(information), information, score
        prior, start = 1.0 / np.array(variances)[a], np.array(theta)[a]
        self.total = information.sum(axis=0)
        self.prior = np.diag(prior)
        self.h = self.total[a[:, None], a] + self.prior
        self.c = np.linalg.inv(self.h)
        self.theta = self.c @ (score[:, a].sum(axis=0) + prior * start)

    def scatter(self) -> float:
        """Find how much more the scores scatter than the model says, 1 where it is right."""
        return max(1.0, self._excess() * self.n / max(self.n - self._free, 0.5))

    def _excess(self) -> float:
        a = np.array(self.active)
        self.own = self.information[:, a[:, None], a]
        self.u = self.score[:, a] - self.own @ self.theta
        self.v = self.u.T @ self.u
        return float(np.trace(self.c @ self.v)) / len(a)

    def verdict(self, counts: Array, wrong_model: bool, candidates: Mapping[str, list[int]],
                considered: Mapping[int, float], rows: Sequence[tuple[str, int]]) -> Verdict:
        n, a, scatter = self.n, self.active, self.scatter()
        known, seen = scatter * self.total[np.ix_(a, a)], n / max(n - len(a), 0.5) * self.v
        # how far what is seen lies from what the model says, and how far chance alone puts it;
        # what is no more than chance is left out (O. Ledoit and M. Wolf, Journal of Multivariate
        # Analysis 88(2), 2004)
        off = self.c @ seen - scatter * np.eye(len(a))
        chance = scatter * scatter * len(a) * (len(a) + 1) / n
        share = min(chance / max(float(np.einsum('ij,ji', off, off)), chance), 1.0)
        mixed = share * known + (1.0 - share) * seen
        covariance = self.c @ (mixed + self.prior) @ self.c
        if wrong_model or scatter > REPEATED:
            covariance = covariance * max(1.0, n / LEAST_COUNT)
        missing, moved = None, np.zeros(len(a))
        for name, columns in candidates.items():
            found = self._test(columns, float(counts.sum()))
            if found is not None and found[1] > (missing.share if missing else NAMED_GAIN):
                kappa, share, moved = found
                missing = Missing(name, kappa, share)
        covariance = covariance + np.outer(moved, moved)
        more, untold = np.zeros_like(covariance), []
        for begin, first in rows:
            if missing is not None and missing.name.startswith(begin):
                continue
            terms = self._unseen(candidates, 1.0, begin, first)
            if terms:
                added, alpha = averaged(list(terms.values()), covariance), a.index(first)
                if added[alpha, alpha] > covariance[alpha, alpha]:
                    untold.append(foremost(terms, alpha))
                more = more + added
        covariance = covariance + more
        for k, variance in considered.items():
            # after S. F. Schmidt: what it moves the parameters by
            leaning = self.c @ self.total[a, k]
            covariance = covariance + variance * np.outer(leaning, leaning)
        return Verdict(self._full(covariance), scatter, missing, n, self.all_parameters(),
                       tuple(untold))

    def unseen(self, candidates: Mapping[str, list[int]],
               rows: Sequence[tuple[str, int]]) -> list[list[float]]:
        """
        Return what terms that nothing tells yet add to the covariance.

        Each is there or not by itself: a few blocks cannot weigh one against the other.
        """
        excess = self._excess()
        # one block alone tells nothing of the scatter
        scatter = max(1.0, excess * self.n / (self.n - 1)) if self.n > 1 else math.inf
        terms = [term for begin, first in rows
                 for term in self._unseen(candidates, scatter, begin, first).values()]
        return self._full(summed(terms, len(self.active)))

    def _unseen(self, candidates: Mapping[str, list[int]], scatter: float, begin: str,
                first: int) -> dict[str, UnseenTerm]:
        """Return what the blocks say of terms that a DOF may have, by name."""
        terms: dict[str, UnseenTerm] = {}
        for term, (std, sign) in expected(self.all_parameters()[first:]).items():
            name = begin + term
            if name not in candidates:
                continue
            w, rest, s, i, left = self._remainder(candidates[name])
            coefficient = information = 0.0
            if left > TOLD and self.n > 1:
                known = float(rest[0, 0])
                coefficient = float(s.sum()) / known
                off = s[:, 0] - coefficient * i[:, 0, 0]
                spread = self.n / (self.n - 1) * float(np.einsum('n,n', off, off))
                # no better known than the scatter of the blocks says
                information = known / max(1.0, spread / known) / scatter
            terms[name] = judged(w[:, 0].tolist(), coefficient, information, std, sign)
        return terms

    def _full(self, covariance: Array) -> list[list[float]]:
        """Return a covariance with zeros for the parameters that are left out."""
        full = np.zeros((self._p, self._p))
        full[np.ix_(self.active, self.active)] = 0.5 * (covariance + covariance.T)
        return list(full.tolist())

    def all_parameters(self) -> list[float]:
        """Return the parameters, with zeros for those that are left out."""
        theta = np.zeros(self._p)
        theta[self.active] = self.theta
        return list(theta.tolist())

    def _remainder(self, columns: Sequence[int]) -> tuple[Array, Array, Array, Array, float]:
        """
        Return what is left of regressors that the parameters cannot take the place of.

        Returns
        -------
        ndarrays of shape (a, k), (k, k), (n, k) and (n, k, k), and a float
            What they move the parameters by; their information, in all; score and information
            of each block; and what is left, as a share.

        """
        a, k = np.array(self.active)[:, None], np.array(columns)
        to, own = self.information[:, a, k], self.information[:, k[:, None], k]
        w = self.c @ to.sum(axis=0)
        rest = own.sum(axis=0) - to.sum(axis=0).T @ w
        s = self.score[:, k] - self.theta @ to - self.u @ w
        mixed = np.einsum('ak,nal->nkl', w, to)
        i = own - mixed - mixed.transpose(0, 2, 1) + np.einsum(
            'ak,nab,bl->nkl', w, self.own, w)
        most = float(np.diag(own.sum(axis=0)).max())
        left = float(np.diag(rest).min()) / most if most > 0.0 else 0.0
        return w, rest, s, i, left

    def _test(self, columns: Sequence[int],
              count: float) -> tuple[float, float, Array] | None:
        """
        Return coefficient and gain of a regressor, and what the parameters would move by.

        None where it is not significant. Of several columns the coefficient is their size.
        """
        found = self.regression(columns)
        if found is None or not min(found.power, found.t_squared) > NAMED_T * NAMED_T:
            return None
        kappa = found.kappa
        size = float(kappa[0]) if len(kappa) == 1 else float(np.linalg.norm(kappa))
        # with the regressor the squared innovations are as many as there are of them
        return size, found.power / (found.power + count), found.moved

    def regression(self, columns: Sequence[int]) -> Regression | None:
        """Return what regressors would explain, None where it cannot be told."""
        w, rest, s, i, left = self._remainder(columns)
        if not left > NAMED_LEFT or (len(columns) > 1 and np.linalg.cond(rest) > 1e6):
            return None
        total = s.sum(axis=0)
        kappa = np.linalg.solve(rest, total)
        scatter = s - i @ kappa
        spread = self.n / (self.n - 1) * np.einsum('nk,nl->kl', scatter, scatter)
        return Regression(kappa, float(total @ kappa), float(
            total @ np.linalg.pinv(spread, hermitian=True) @ total), w @ kappa)

    def contradicts(self, information: Array, score: Array, largest_scatter: float) -> bool:
        """Tell whether newer blocks do, in a way that matters."""
        a, n, w, m = self.active, self.n, len(information), self._free
        own = information[:, np.array(a)[:, None], a].sum(axis=0)
        u = score[:, a].sum(axis=0) - own @ self.theta
        of_model, theta = own[:m, :m], self.theta[:m]
        step = np.linalg.solve(of_model + self.prior[:m, :m], u[:m])
        if not float(step @ of_model @ step) >= MATTERS**2 * float(theta @ of_model @ theta):
            return False
        scatter = self.scatter()
        if scatter > largest_scatter:
            return False
        mean = WEIGHT * scatter * self.total[np.ix_(a, a)] / n
        b = (mean + self.v) / (WEIGHT + n)
        known = self.c @ ((WEIGHT * scatter * self.h + n * self.v) / (WEIGHT + n)) @ self.c
        if scatter > SCATTERED:
            spread = 0.5 * scatter * own + 0.5 * w * b
        else:
            spread = scatter * own
        s = spread + own @ known @ own
        # not that of one number, though it is one: blocks of a wrong model scatter unevenly
        freedom = n - m
        inverse = np.linalg.pinv(s, hermitian=True)
        by_model = own[:, :m]
        told = by_model.T @ inverse @ u
        t = float(told @ np.linalg.pinv(by_model.T @ inverse @ by_model, hermitian=True)
                  @ told) / m
        if f_tail(t, m, freedom) < FALSE_ALARM:
            return True
        for g in (theta, np.eye(m)[0]):
            row = by_model @ g
            bottom = float(row @ inverse @ row)
            if bottom > 0.0:
                t = float(row @ inverse @ u)**2 / bottom
                if f_tail(t, 1, freedom) < FALSE_ALARM:
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


def _finite(values: Any, shape: tuple[int, ...]) -> Array:
    found = np.array(values, dtype=float).reshape(shape)
    if not np.isfinite(found).all():
        raise ValueError('a block is not finite')
    return found
