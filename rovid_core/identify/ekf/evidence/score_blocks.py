"""Blocks of data: the information and the score of each, from one measurement after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rovid_core.identify.ekf.evidence.block_fit import (
    BLOCK,
    BlockFit,
    DRIFT,
    drift_of,
    LEAST_COUNT,
    Watched,
)
from rovid_core.identify.ekf.evidence.unseen_terms import expected
from rovid_core.identify.ekf.evidence.vehicle_change import contradicts, FALSE_ALARM, NEWEST
from rovid_core.identify.ekf.evidence.verdict import Regression, Verdict
from rovid_core.identify.ekf.single.linearised_filter import ALPHA, CANDIDATES
from rovid_core.identify.ekf.single.watched_lag import LAGS, SECOND_LAG
from rovid_core.identify.method import floats
from rovid_core.model.dofs import HEADING

Array = NDArray[np.float64]

LARGEST_COUNT: Final = 48
SINGLE: Final = 8
"""Blocks that are kept, and how many of the newest are never joined."""

PENDING: Final = 64
"""Measurements that are added up at once."""


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
    configured : sequence of str
        Names of watched regressors that are among the parameters as well.
    doubted : mapping, optional
        Where regressors stand, also counted from the end, that no DOF has alone; and how large the
        coefficients are that they may have (standard deviations).
    found : sequence of str
        Names of watched regressors whose effect is in the model already, of a size that was found
        from these data: their coefficients are about 0, but as uncertain as the data leave them.
    lags : mapping, optional
        Names of the lags that may be among these, and what all of each is as a coefficient of its
        regressor, relative to alpha.
    sizes : mapping, optional
        Names of watched regressors, and how large the coefficients are that they may have at all
        (standard deviations).

    """

    def __init__(self, theta: Sequence[float], variances: Sequence[float],
                 watched: Sequence[str] = CANDIDATES,
                 considered: Mapping[int, float] | None = None, further: int = 0,
                 rows: Sequence[tuple[str, int]] = (('', 0),),
                 configured: Sequence[str] = (),
                 doubted: Mapping[int, float] | None = None,
                 found: Sequence[str] = (), lags: Mapping[str, float] | None = None,
                 sizes: Mapping[str, float] | None = None) -> None:
        p = len(theta)
        self._q = p + len(watched) + further
        columns = {name: p + k for k, name in enumerate(watched)}
        candidates = {name: [k] for name, k in columns.items()
                      if name not in configured and not name.endswith(SECOND_LAG)}
        if all(name in watched for name in HEADING):
            # a current pushes in any direction
            candidates['current'] = [k for name in HEADING for k in candidates.pop(name)]
        self._watched = Watched(
            candidates, considered or {}, rows,
            {k % self._q: std for k, std in (doubted or {}).items()}, found, lags or {},
            [[columns[begin + name] for name in (*LAGS, SECOND_LAG) if begin + name in columns]
             for begin, _ in rows], sizes or {})
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
        self._unseen: list[list[float]] = []
        self._unseen_of = 0  # blocks that it was made of
        self._begin()

    def _begin(self) -> None:
        q = self._q
        self._open = np.zeros((q, q)), np.zeros(q)
        self._count = 0
        self._pending: list[float] = []  # of each measurement: information, what it told, psi

    @property
    def found(self) -> Sequence[str]:
        """Return the names of watched regressors whose effect is in the model already."""
        return self._watched.found

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
        return self._fit(self.count).verdict(self._counts, wrong_model, self._watched)

    def regressions(self, places: Sequence[Sequence[int]]) -> list[Regression | None]:
        """
        Return what further regressors would explain, None where it cannot be told.

        Parameters
        ----------
        places : sequence of sequences of int
            Where those stand that are looked at together, also counted from the end.

        """
        fit = self._fit(self.count)
        fit.scatter()
        return [fit.regression([k % self._q for k in columns]) for columns in places]

    def unseen(self) -> list[list[float]]:
        """Return what terms that nothing tells yet add to the covariance; empty for nothing."""
        if self.count != self._unseen_of:
            self._unseen, self._unseen_of = self._fit(self.count).unseen(
                self._watched), self.count
        return self._unseen

    def _fit(self, count: int) -> BlockFit:
        """Return what the oldest blocks give."""
        return BlockFit(self._active, self._theta, self._variances, self._information[:count],
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

    def has_changed(self, largest_scatter: float, false_alarm: float = FALSE_ALARM) -> bool:
        """
        Tell whether the newest blocks contradict the older ones.

        They have to do so for the model as it is, and for one with all that it may lack: where
        the vehicle is driven in another way, what is missing moves the parameters elsewhere.

        Parameters
        ----------
        largest_scatter : float
            Of the older blocks, from which they do not tell.
        false_alarm : float
            Probability that one test takes an unchanged vehicle for changed.

        """
        for newest in NEWEST:
            older = self.count - newest
            if older < max(LEAST_COUNT, len(self._active) + 1):
                break
            fit = self._fit(older)
            if not contradicts(self._information[older:], self._score[older:], fit,
                               largest_scatter, false_alarm):
                continue
            blocks = self._information, self._score
            drift = drift_of(fit, *blocks, self._counts, self._watched.rows)
            information, score = drift.beside(*blocks)
            whole = self._with_all_that_may_be_missing(fit, information[:older], score[:older])
            if contradicts(information[older:], score[older:], whole, largest_scatter,
                           false_alarm):
                return True
        return False

    def _with_all_that_may_be_missing(self, fit: BlockFit, information: Array,
                                      score: Array) -> BlockFit:
        """
        Return what the same blocks give for a model that has every regressor watched.

        ``information`` and ``score`` have that of thrust that falls besides.
        """
        variances = [*self._variances, *[0.0] * (self._q - len(self._variances)), DRIFT**2]
        known = fit.total.diagonal().tolist()
        for begin, first in self._watched.rows:
            theta = fit.all_parameters()[first:]
            sizes = expected(theta)
            for name, columns in self._watched.candidates.items():
                if not name.startswith(begin):
                    continue
                term = name[len(begin):]
                for k in columns:
                    if term in sizes:
                        variances[k] = sizes[term][0]**2 if known[k] > 0.0 else 0.0
                    elif known[k] > 0.0:
                        # a coupling may move the vehicle as much as the thrust does
                        variances[k] = theta[ALPHA]**2 * known[first] / known[k]
        theta = [*self._theta, *[0.0] * (len(variances) - len(self._theta))]
        active = [k for k, variance in enumerate(variances) if variance > 0.0]
        return BlockFit(active, theta, variances, information, score, len(self._active))

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


def _finite(values: Any, shape: tuple[int, ...]) -> Array:
    found = np.array(values, dtype=float).reshape(shape)
    if not np.isfinite(found).all():
        raise ValueError('a block is not finite')
    return found
