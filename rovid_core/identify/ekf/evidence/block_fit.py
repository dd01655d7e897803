"""
What some blocks of data give: parameters, honest intervals, and what the model lacks.

The score of a block is the derivative of its log likelihood by the parameters. Where the model
is right the scores of blocks scatter as their information says; where it is not they scatter
more, and the covariance of the parameters follows from that scatter (the sandwich of H. White,
Econometrica 50(1), 1982).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rovid_core.identify.ekf.evidence.unseen_terms import (
    averaged,
    BY_EACH,
    by_question,
    expected,
    foremost,
    judged,
    LESS,
    SPOKEN,
    summed,
    UnseenTerm,
    WEIGHTS,
)
from rovid_core.identify.ekf.evidence.verdict import (
    LAG_SHAPE,
    Missing,
    NAMED_T,
    OTHERWISE,
    Regression,
    Verdict,
)

Array = NDArray[np.float64]

LEAST_COUNT = 6
"""Blocks below which they say nothing."""

REPEATED = 2.0
"""Excess scatter above which an error repeats from block to block and does not average out."""

NAMED_GAIN = 0.01
"""Share of the squared innovations from which a regressor is named, if it is significant."""

NAMED_LEFT, TOLD = 1e-6, 1e-8
"""
Share of a regressor that the parameters cannot take the place of, from which it is named, and
from which the data say anything of it; less is what rounding and the steps of the filter make.
"""

OTHERWISE_POWER = 22.0
"""
From which thrust comes and goes otherwise: chi-squared of three that is as unlikely as ``NAMED_T``
squared of one.
"""

BLOCK = 10.0
"""[s] of a block."""

FALL = 0.25 / 1500.0
"""
[1/s] by which thrust may fall: a battery that is empty in 25 minutes of hard work loses a fifth of
its voltage, and with it a quarter of the thrust or more.
"""

DRIFT = 0.25
"""Share of the thrust that may be lost from the beginning to the end: a battery runs down."""

MATTERS = 0.05
"""Least change of the thrust, or of the mass, that is one, in what the model says."""

WIDE = 1e6
"""Variance of a regressor that is added, in that with which all blocks tell it."""


class Remainder(NamedTuple):
    """
    What is left of a regressor that the parameters cannot take the place of.

    Attributes
    ----------
    leaning : list of a floats
        What a coefficient of 1 that is left out moves the parameters by.
    left : float
        As a share.
    known, coefficient : float
        Information on its coefficient, and what fits best; 0 where too little is left.
    spread : float
        Sum of the squares of what that leaves of the score of each block.

    """

    leaning: list[float]
    left: float
    known: float
    coefficient: float
    spread: float


@dataclass(frozen=True)
class Watched:
    """
    What is watched besides the parameters, and what it is taken to be.

    Attributes
    ----------
    candidates : mapping
        Where the regressors stand that may be missing, by name.
    considered, rows, doubted, found, lags, sizes
        As of ``ScoreBlocks``.
    dynamics : sequence of sequences of int
        Of each row, where those stand that tell how thrust comes and goes.

    """

    candidates: Mapping[str, list[int]]
    considered: Mapping[int, float]
    rows: Sequence[tuple[str, int]]
    doubted: Mapping[int, float]
    found: Sequence[str]
    lags: Mapping[str, float]
    dynamics: Sequence[Sequence[int]]
    sizes: Mapping[str, float]


class BlockFit:
    """
    The parameters that some blocks give, and how their scores scatter.

    Parameters
    ----------
    active : sequence of a ints
        The parameters that are found, of all that the blocks tell of.
    theta, variances : sequence of floats
        What was known of all parameters before.
    information : ndarray, shape (n, q, q)
        Of the blocks.
    score : ndarray, shape (n, q)
        Theirs.
    free : int
        How many of the active ones belong to the model, the first ones; the others are what the
        vehicle may have besides, with priors of that size. 0 for all.

    Attributes
    ----------
    theta : ndarray, shape (a,)
        The parameters that fit best.
    h, c : ndarray, shape (a, a)
        Their information with the prior, and its inverse.
    total, known : ndarray, shapes (q, q) and (a, a)
        Information of all blocks, and on the active parameters alone.
    u, v : ndarray, shapes (n, a) and (a, a)
        What is left of each score, and the sum of its squares; once ``scatter`` was asked for.

    """

    def __init__(self, active: Sequence[int], theta: Sequence[float],
                 variances: Sequence[float], information: Array, score: Array,
                 free: int = 0) -> None:
        self.active, self._p = list(active), len(theta)
        self.free = free or len(active)
        a = np.array(self.active)
        self.n, self.information, self.score = len(information), information, score
        prior, start = 1.0 / np.array(variances)[a], np.array(theta)[a]
        self._start = start
        self.total = information.sum(axis=0)
        self.prior = np.diag(prior)
        self._rows = a[:, None]
        self.known = self.total[self._rows, a]
        self.h = self.known + self.prior
        self.c = np.linalg.inv(self.h)
        self.theta = self.c @ (score[:, a].sum(axis=0) + prior * start)

    def scatter(self) -> float:
        """Find how much more the scores scatter than the model says, 1 where it is right."""
        return max(1.0, self._excess() * self.n / max(self.n - self.free, 0.5))

    def _excess(self) -> float:
        self.own = self.information[:, self._rows, self.active]
        self.u = self.score[:, self.active] - self.own @ self.theta
        self.v = self.u.T @ self.u
        # a parameter that its prior holds adds nothing to the trace, nor to what it is shared by
        known = float(np.trace(self.c @ self.known))
        return float(np.trace(self.c @ self.v)) / max(known, 1.0)

    def verdict(self, counts: Array, wrong_model: bool, watched: Watched) -> Verdict:
        """Return what the blocks of so many measurements say."""
        own = self._verdict(counts, wrong_model, watched)
        whole = self
        if own.missing is not None:  # what it lacks is no drift
            whole = self._with(watched.candidates[own.missing.name])
            whole.scatter()
        drift = drift_of(self, self.information, self.score, counts, watched.rows)
        seen = whole.regressed(drift.to[:, whole.active, None], drift.own[:, None, None],
                               drift.score[:, None])
        if seen is None:
            return own
        # relative to the mean: at -2 nothing is left in the end, and more is something else
        if not (seen.is_significant and -2.0 < seen.kappa.item() <= -MATTERS):
            return replace(own, covariance=self._with_drift(own.covariance, seen, drift, counts))
        whole = self._with([len(drift.thrust)], *drift.beside(self.information, self.score))
        verdict = whole._verdict(counts, wrong_model, watched)
        # what the parameters are is what they are at any time, from the first to the last
        share = whole.theta.item(-1)
        begin, gained = whole.all_parameters()[:self._p], share * drift.thrust[:self._p]
        middle = own.theta - (begin + 0.5 * gained)
        covariance = np.array(verdict.covariance)[:self._p, :self._p] + (
            np.outer(middle, middle) + np.outer(gained, gained) / 12.0)
        first = watched.rows[0][1]
        return replace(verdict, covariance=covariance.tolist(), theta=own.theta,
                       drift=float(gained[first] / begin[first]), begin=begin)

    def _with_drift(self, covariance: list[list[float]], seen: Regression, drift: Drift,
                    counts: Array) -> list[list[float]]:
        """
        Return a covariance that also holds what thrust may fall by that the data do not show.

        At even odds it does, and the parameters are those of the beginning or of the end.
        """
        a, kappa = len(self.active), seen.kappa.item()
        if not kappa:
            return covariance
        std = min(FALL * BLOCK * counts.sum() / counts[-1], DRIFT)
        known = min(seen.power, seen.t_squared) / kappa**2
        begin = -seen.moved[:a] / kappa
        ways = [judged(leaning.tolist(), kappa, known, std, -1)
                for leaning in (begin, begin + drift.thrust[self.active])]
        own = np.array(covariance)[self._rows, self.active]
        return self._full(own + averaged(ways, own))

    def _verdict(self, counts: Array, wrong_model: bool, watched: Watched) -> Verdict:
        """Return what the blocks say where thrust stays the same."""
        candidates, rows, doubted = watched.candidates, watched.rows, watched.doubted
        n, a, scatter = self.n, self.active, self.scatter()
        known, seen = scatter * self.known, n / max(n - len(a), 0.5) * self.v
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
        sizes = {**watched.sizes, **{
            begin + name: std for begin, first in rows
            for name, (std, _) in expected(self.all_parameters()[first:]).items()}}
        whole, left, unexplained = self, dict(candidates), scatter
        alone = self._remainders([*_single(candidates), *doubted])
        missing = self._most_missing(candidates, alone, float(counts.sum()), sizes, rows)
        if missing is not None:  # it hides what else there may be
            whole = self._with(left.pop(missing.name))
            unexplained = whole.scatter()
            missing = replace(missing, alpha=whole.alpha(missing.name, rows))
            alone = {k: one._replace(leaning=one.leaning[:len(a)]) for k, one in
                     whole._remainders([*_single(left), *doubted]).items()}
        moved = self.theta - whole.theta[:len(a)]
        covariance = covariance + np.outer(moved, moved)
        # they are there, of sizes that are not quite known
        there = {name: whole._judged(alone[left.pop(name)[0]], 1.0, sizes[name], 0)
                 for name in watched.found if name in left}
        covariance = covariance + summed(list(there.values()), len(a), True)
        more, untold = np.zeros_like(covariance), []
        for (begin, first), columns in zip(rows, watched.dynamics):
            otherwise = whole._moved_otherwise(columns)[:len(a)]
            alpha = a.index(first)
            if otherwise[alpha]**2 > covariance[alpha, alpha]:
                untold.append(begin + OTHERWISE)
            covariance = covariance + np.outer(otherwise, otherwise)
            questions = by_question(whole._unseen(left, alone, 1.0, begin, first))
            if begin + 'lag' in there:
                # nor is it known what it is that lags
                std = watched.lags[begin + 'lag'] * whole.alpha(begin, rows)
                questions.append({begin + LAG_SHAPE: UnseenTerm(
                    there[begin + 'lag'].leaning, 0.0, 0.0, std * std)})
            for terms in questions:
                added = averaged(list(terms.values()), covariance)
                if added[alpha, alpha] > covariance[alpha, alpha]:
                    untold.append(foremost(terms, alpha))
                more = more + added
        for k, std in doubted.items():
            more = more + averaged([whole._judged(alone[k], 1.0, std, 0)], covariance)
        covariance = covariance + more + self._leaning_on(watched.considered)
        return Verdict(self._full(covariance), scatter, missing, n, self.all_parameters(),
                       tuple(untold), () if missing else self._off(there, rows), unexplained)

    def _moved_otherwise(self, columns: Sequence[int]) -> Array:
        """Return what regressors that together are significant move the parameters by, else 0."""
        left = [k for k in columns if k not in self.active]
        found = self.regression(left) if left else None
        if found is None or not min(found.power, found.t_squared) > OTHERWISE_POWER:
            return np.zeros(len(self.active))
        return found.moved

    def _leaning_on(self, considered: Mapping[int, float]) -> Array:
        """Return what parameters that are not known add (S. F. Schmidt): they move the others."""
        added = np.zeros_like(self.c)
        for k, variance in considered.items():
            leaning = self.c @ self.total[self.active, k]
            added += variance * np.outer(leaning, leaning)
        return added

    def _off(self, there: Mapping[str, UnseenTerm],
             rows: Sequence[tuple[str, int]]) -> tuple[Missing, ...]:
        """Return the terms that are off by more than a standard deviation, by how many."""
        off = [(term.mean * term.mean / term.variance, name) for name, term in there.items()
               if term.mean * term.mean > term.variance]
        return tuple([Missing(name, there[name].mean, 0.0, self.alpha(name, rows))
                      for _, name in sorted(off, reverse=True)])

    def _most_missing(self, candidates: Mapping[str, list[int]],
                      alone: Mapping[int, Remainder], count: float, sizes: Mapping[str, float],
                      rows: Sequence[tuple[str, int]]) -> Missing | None:
        """
        Return the regressor that explains most of what the model does not.

        Where measurements come fast their noise is most of that: one that explains little counts
        as well if the mass depends on it. None of those that are not significant, or known less
        well than to what they may be at all: chance makes some huge ones of a regressor that
        hardly acts. Of several columns the coefficient is their size.
        """
        missing, most = None, 0.0
        for name, columns in candidates.items():
            if len(columns) > 1:
                found = self.regression(columns)
                if found is None:
                    continue
                size, power = float(np.linalg.norm(found.kappa)), found.power
                t_squared, moved = found.t_squared, found.moved
            else:
                one = alone[columns[0]]
                if not one.left > NAMED_LEFT:
                    continue
                size, total = one.coefficient, one.coefficient * one.known
                moved = one.coefficient * np.array(one.leaning)
                power = total * size
                spread = self.n / (self.n - 1) * one.spread
                t_squared = total * total / spread if spread > 0.0 else 0.0
                if not size**2 < power * sizes.get(name, math.inf)**2:
                    continue
            if min(power, t_squared) > NAMED_T * NAMED_T:
                # with the regressor the squared innovations are as many as there are of them
                share = power / (power + count)
                matters = share > NAMED_GAIN or self._matters(name, size, moved, rows)
                if matters and share > most:
                    missing, most = Missing(name, size, share), share
        return missing

    def _matters(self, name: str, size: float, moved: Array,
                 rows: Sequence[tuple[str, int]]) -> bool:
        """Tell whether what a DOF lacks, and thrusters have, moves its mass by what matters."""
        whose = [self.active.index(first) for begin, first in rows if name.startswith(begin)]
        return not (size > 0.0 and name.endswith(LESS)) and any(
            abs(float(moved[i] / self.theta[i])) > MATTERS for i in whose)

    def _with(self, columns: Sequence[int], information: Array | None = None,
              score: Array | None = None) -> BlockFit:
        """Return the fit with further regressors, of any size; those of other blocks if given."""
        information = self.information if information is None else information
        score = self.score if score is None else score
        q = score.shape[1]
        theta, variances = np.zeros(q), np.zeros(q)
        theta[self.active], variances[self.active] = self._start, 1.0 / self.prior.diagonal()
        for k in columns:
            variances[k] = WIDE / information[:, k, k].sum()
        return BlockFit([*self.active, *columns], theta.tolist(), variances.tolist(),
                        information, score)

    def unseen(self, watched: Watched) -> list[list[float]]:
        """
        Return what terms that nothing tells yet add to the covariance.

        Each is there or not by itself: a few blocks cannot weigh one against the other.
        """
        excess = self._excess()
        # one block alone tells nothing of the scatter
        scatter = max(1.0, excess * self.n / (self.n - 1)) if self.n > 1 else math.inf
        candidates, doubted = watched.candidates, watched.doubted
        alone = self._remainders([*_single(candidates), *doubted])
        terms = [term for begin, first in watched.rows
                 for term in self._unseen(candidates, alone, scatter, begin, first).values()]
        terms += [self._judged(alone[k], scatter, std, 0) for k, std in doubted.items()]
        return self._full(summed(terms, len(self.active)) + self._leaning_on(
            watched.considered))

    def _unseen(self, candidates: Mapping[str, list[int]], alone: Mapping[int, Remainder],
                scatter: float, begin: str, first: int) -> dict[str, UnseenTerm]:
        """Return what the blocks say of terms that a DOF may have, by name."""
        terms: dict[str, UnseenTerm] = {}
        for term, (std, sign) in expected(self.all_parameters()[first:]).items():
            found = [self._judged(alone[candidates[name][0]], scatter, std, way)
                     for name, way in ((begin + term, sign), (begin + BY_EACH.get(term, ''), -1))
                     if name in candidates]
            if not found:
                continue
            own, other = found[0], found[-1]
            # what may be one of the whole DOF is that, unless the data speak of each thruster
            by_each = other.evidence > max(own.evidence, SPOKEN)
            terms[begin + term] = replace(
                other if by_each else own, weight=WEIGHTS.get(term, 1.0))
        return terms

    def _judged(self, one: Remainder, scatter: float, std: float, sign: int) -> UnseenTerm:
        """Return what the blocks say of a term whose coefficient is about as large as ``std``."""
        coefficient = information = 0.0
        if one.left > TOLD and self.n > 1:
            spread = self.n / (self.n - 1) * one.spread
            # no better known than the scatter of the blocks says
            coefficient, information = one.coefficient, one.known / max(
                1.0, spread / one.known) / scatter
        return judged(one.leaning, coefficient, information, std, sign)

    def _full(self, covariance: Array) -> list[list[float]]:
        """Return a covariance with zeros for the parameters that are left out."""
        full = np.zeros((self._p, self._p))
        full[self._rows, self.active] = 0.5 * (covariance + covariance.T)
        return list(full.tolist())

    def alpha(self, name: str, rows: Sequence[tuple[str, int]]) -> float:
        """Return alpha of the DOF that a watched regressor is of; 0 for none with thrust."""
        theta = self.all_parameters()
        return math.fsum([theta[first] for begin, first in rows if name.startswith(begin)])

    def all_parameters(self) -> list[float]:
        """Return the parameters, with zeros for those that are left out."""
        theta = np.zeros(self._p)
        theta[self.active] = self.theta
        return list(theta.tolist())

    def _remainders(self, columns: Sequence[int]) -> dict[int, Remainder]:
        """Return what is left of regressors, each of them by itself, by where they stand."""
        k = np.array(columns, dtype=int)
        to, own = self.information[:, self._rows, k], self.information[:, k, k]
        whole, most = to.sum(axis=0), own.sum(axis=0)
        w = self.c @ whole
        rest = most - (whole * w).sum(axis=0)
        none = np.zeros(len(k))
        left = np.divide(rest, most, out=none.copy(), where=most > 0.0)
        s = self.score[:, k] - self.theta @ to - self.u @ w
        kappa = np.divide(s.sum(axis=0), rest, out=none, where=left > TOLD)
        off = s - kappa * (own + (w * (self.own @ w - 2.0 * to)).sum(axis=1))
        return {at: Remainder(*one) for at, *one in zip(
            columns, w.T.tolist(), left.tolist(), rest.tolist(), kappa.tolist(),
            (off * off).sum(axis=0).tolist())}

    def regression(self, columns: Sequence[int]) -> Regression | None:
        """Return what regressors would explain, None where it cannot be told."""
        k = np.array(columns)
        return self.regressed(self.information[:, self._rows, k],
                              self.information[:, k[:, None], k], self.score[:, k])

    def regressed(self, to: Array, own: Array, score: Array) -> Regression | None:
        """
        Return the same of regressors that the blocks do not hold.

        Parameters
        ----------
        to, own, score : ndarray, shapes (n, a, k), (n, k, k) and (n, k)
            Their information with the active parameters and with each other, and their score.

        """
        whole = to.sum(axis=0)
        w = self.c @ whole
        rest = own.sum(axis=0) - whole.T @ w
        most = float(np.diag(own.sum(axis=0)).max())
        if not float(np.diag(rest).min()) > NAMED_LEFT * most or (
                len(rest) > 1 and np.linalg.cond(rest) > 1e6):
            return None
        s = score - self.theta @ to - self.u @ w
        mixed = w.T @ to
        i = own - mixed - mixed.transpose(0, 2, 1) + w.T @ self.own @ w
        total = s.sum(axis=0)
        kappa = np.linalg.solve(rest, total)
        scatter = s - i @ kappa
        spread = self.n / (self.n - 1) * scatter.T @ scatter
        return Regression(kappa, float(total @ kappa), float(
            total @ np.linalg.pinv(spread, hermitian=True) @ total), w @ kappa)


class Drift(NamedTuple):
    """
    A regressor that no block holds: what the thrust does, the more the later it is.

    A coefficient of it is the share by which the thrust rises. Within a block it counts as in its
    middle.

    Attributes
    ----------
    thrust : ndarray, shape (q,)
        The parameters of the thrust where they stand, 0 for all else.
    to, own, score : ndarray, shapes (n, q), (n,) and (n,)
        Its information with the regressors of the blocks and by itself, and its score.

    """

    thrust: Array
    to: Array
    own: Array
    score: Array

    def beside(self, information: Array, score: Array) -> tuple[Array, Array]:
        """Return the blocks with this regressor as the last one."""
        return np.concatenate([
            np.concatenate([information, self.to[:, :, None]], 2),
            np.concatenate([self.to, self.own[:, None]], 1)[:, None]], 1), np.concatenate(
                [score, self.score[:, None]], 1)


def drift_of(older: BlockFit, information: Array, score: Array, counts: Array,
             rows: Sequence[tuple[str, int]]) -> Drift:
    """
    Return the regressor of thrust that changes from the beginning to the end of older blocks.

    Parameters
    ----------
    older : BlockFit
        Of these, which come first.
    information, score, counts : ndarray, shapes (n, q, q), (n, q) and (n,)
        Of all blocks, and how many measurements each has.
    rows : sequence of (str, int)
        As of ``ScoreBlocks``.

    """
    thrust, theta = np.zeros(score.shape[1]), older.all_parameters()
    for _, first in rows:
        thrust[first] = theta[first]
    ends = np.cumsum(counts)
    time = (ends - 0.5 * counts) / ends[older.n - 1]
    to = time[:, None] * (information @ thrust)
    return Drift(thrust, to, time * (to @ thrust), time * (score @ thrust))


def _single(candidates: Mapping[str, list[int]]) -> list[int]:
    """Return where the regressors stand that are candidates by themselves."""
    return [columns[0] for columns in candidates.values() if len(columns) == 1]
