"""
Blocks of a trial that are held out in turn, and the choice among candidates by them.

The trial of a degree of freedom is divided into ``FOLDS`` folds of equal time, and each of these
into equal parts of about ``PART``. A candidate has an error on each part, of a model that was
fitted to the other folds. Candidates are compared by the ratios of their errors on the same part:
a part that is hard to predict, or of another degree of freedom, counts no more than others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.plant import Array
from rovid_core.model.samples import NS
from rovid_core.trials.tuning.log import CommandedForce, Segment

FOLDS = 8  # blocks of time of equal length; each is held out once
PART = 15.0  # [s] longer than most vehicles remember a push, shorter than a pilot drives one axis
# [s] Shorter steps are joined, and longer ones simulated in parts: a vehicle's velocity hardly
# bends in this time, and the impulse over it is exact whatever the delay
STEP = 0.2
FAST = 0.1  # [s] the same where steps are half as long or shorter: then a lag shows within it
MIN_STEPS = 8  # a piece with fewer says nothing


@dataclass(frozen=True)
class Blocks:
    """Pieces of a trial without interruption, each in one fold, padded to one length."""

    # shape (steps + 1, pieces); bounds of the steps [ns]; the padding has length 0
    nodes: NDArray[np.int64]
    measured: Array  # shape (steps, pieces); mean velocity of each step [m/s or rad/s]
    regressors: Array  # shape (steps, k, pieces); means of those of the couplings
    fold: NDArray[np.intp]  # shape (pieces,); which fold each piece is in
    part: NDArray[np.intp]  # shape (steps, pieces); which part of all folds each step is in
    count: int  # parts of each fold
    parts: int  # in which each step is simulated

    @property
    def dt(self) -> Array:
        """Return the lengths of the steps [s]."""
        return np.asarray(np.diff(self.nodes, axis=0) * NS)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Tell which steps are no padding."""
        return np.asarray(np.diff(self.nodes, axis=0) > 0)

    def force(self, commanded: CommandedForce, dof: int, delay: float, lag: float) -> Array:
        """Return the mean force of each part of every step, 0 in the padding [N or N m]."""
        first, length = self.nodes[:-1, None], np.diff(self.nodes, axis=0)[:, None]
        inside = first + length * np.arange(self.parts)[:, None] // self.parts
        nodes = np.concatenate([inside.reshape(-1, self.nodes.shape[1]), self.nodes[-1:]])
        impulse = commanded.impulse(dof, nodes.ravel(), delay, lag)
        dt = np.diff(nodes, axis=0) * NS
        return np.asarray(np.diff(impulse.reshape(nodes.shape), axis=0)
                          / np.where(dt > 0.0, dt, np.inf))

    def moved(self, force: Array) -> Array:
        """Return a force without the padding."""
        return np.asarray(force[np.repeat(self.valid, self.parts, axis=0)])

    def by_part(self, values: Array) -> Array:
        """
        Return the means over each part of values of shape (steps, ..., pieces).

        They have shape (..., FOLDS, count), NaN for a part without a step.
        """
        valid = self.valid.T
        part = self.part.T[valid]
        begins = np.flatnonzero(np.diff(part, prepend=-1))
        steps = np.moveaxis(values, 0, -1)[..., valid]
        found = np.full((*steps.shape[:-1], FOLDS * self.count), np.nan)
        for i, begin, end in zip(part[begins], begins, [*begins[1:], len(part)]):
            found[..., i] = steps[..., begin:end].mean(axis=-1)
        return found.reshape(*steps.shape[:-1], FOLDS, self.count)


def time_of(segments: Sequence[Segment]) -> float:
    """Return the time [s] in steps."""
    return sum(int(segment.ends[-1]) - segment.start for segment in segments) * NS


def part_bounds(segments: Sequence[Segment], count: int) -> Array:
    """Return the bounds of ``count`` parts of each fold [ns], with as much time in steps each."""
    first = segments[0].start
    times, so_far = [], [0]
    for segment in segments:
        start, end = segment.start - first, segment.ends[-1] + 1 - first
        times += [start, end]
        so_far += [so_far[-1] + end - start] * 2
    shares = np.linspace(0, so_far[-1], FOLDS * count + 1)
    return np.asarray(first + np.interp(shares, so_far[:-1], times))


def blocks(segments: Sequence[Segment], bounds: Array) -> Blocks | None:
    """
    Divide a trial of one DOF into blocks; None if some fold has no piece.

    ``bounds`` are those of the parts of all folds [ns], as many in each.
    """
    count = len(bounds) // FOLDS
    pieces: list[tuple[NDArray[np.intp], NDArray[np.int64], Array]] = []
    for segment in segments:
        nodes, means = _joined(*segment.intervals())
        of_step = np.searchsorted(bounds, nodes[:-1], 'right') - 1
        for fold in range(FOLDS):
            own = np.flatnonzero(of_step // count == fold)
            if len(own) >= MIN_STEPS:
                pieces.append((of_step[own], nodes[own[0]:own[-1] + 2], means[:, own]))
    folds = np.array([part[0] // count for part, _, _ in pieces], np.intp)
    if {*folds.tolist()} != {*range(FOLDS)}:
        return None
    longest = max(means.shape[1] for _, _, means in pieces)
    # shape (1 + k, steps, pieces)
    padded = np.stack([np.pad(means, ((0, 0), (0, longest - means.shape[1])))
                       for _, _, means in pieces], axis=2)
    return Blocks(
        np.stack([np.pad(nodes, (0, longest + 1 - len(nodes)), mode='edge')
                  for _, nodes, _ in pieces], axis=1),
        padded[0], padded[1:].transpose(1, 0, 2), folds,
        np.stack([np.pad(part, (0, longest - len(part))) for part, _, _ in pieces], axis=1), count,
        max(1, round(float(np.median([np.median(np.diff(n)) for _, n, _ in pieces])) * NS / STEP)))


def _joined(nodes: NDArray[np.int64], means: Array) -> tuple[NDArray[np.int64], Array]:
    """Join steps to about ``STEP`` or ``FAST``; ``means`` has shape (1 + k, steps)."""
    dt = np.diff(nodes) * NS
    if not len(dt):
        return nodes, means
    usual = float(np.median(dt))
    size = max(1, round((FAST if usual <= 0.5 * FAST else STEP) / usual))
    count = len(dt) // size * size
    zero = np.zeros((len(means), 1))
    path = np.concatenate([zero, np.cumsum(means * dt, axis=1)], axis=1)[:, :count + 1:size]
    nodes = nodes[:count + 1:size]
    return nodes, np.diff(path) / (np.diff(nodes) * NS)


# Anything else has to lower the error by this share: what is in use is simpler, or known.
WORTH = 0.01

DIGITS = 4  # what is written of a value; the data never tell more
TINY = 1e-12  # [m/s or rad/s] no smaller error counts: of a ratio it would be a division by 0

Result = TypeVar('Result')


class ParallelMap(Protocol):
    """What does the same work on many things, possibly at the same time."""

    def __call__(self, work: Callable[[int], Result], given: Sequence[int]) -> Sequence[Result]:
        """Return what ``work`` made of each."""


@dataclass(frozen=True)
class Choice:
    """The best candidate."""

    index: int  # which one
    # By how much its errors are smaller than those of the current one, as a share, and by how much
    # less that may be, with 95 %. For each fold the best is chosen by the others, so that the
    # luckiest of many gains nothing by its luck.
    gain: float
    spread: float
    as_good: NDArray[np.intp]  # the candidates that the data can not tell from the best
    contradicted: bool  # some DOF is predicted worse by more than chance

    @property
    def is_better(self) -> bool:
        """Tell whether the gain is more than chance, and worth it."""
        return self.gain > max(self.spread, WORTH)


def choose(errors: Sequence[Array], current: int) -> Choice:
    """
    Choose the candidate with the lowest errors; ``current`` is the one that is in use.

    ``errors`` of each DOF have shape (candidates, FOLDS, parts). They are infinite for a candidate
    that does not work, and NaN where a part has no step.
    """
    scores, weights = _logarithms(errors)
    of_fold = scores.sum(axis=2)
    total = of_fold.sum(axis=1)
    best = int(total.argmin())
    without = np.subtract(total[:, None], of_fold, out=np.full(of_fold.shape, np.inf),
                          where=np.isfinite(of_fold))
    gains = scores[current] - scores[without.argmin(axis=0), np.arange(len(weights))]
    usable = np.flatnonzero(np.isfinite(total))
    worse, width = _mean_and_width(scores[usable] - scores[best], weights)
    return Choice(best, *_as_share(*_mean_and_width(gains, weights)), usable[worse <= width], any(
        _is_worse(own[current], own[best]) for own in errors))


def _is_worse(before: Array, after: Array) -> bool:
    """Tell whether the errors of a DOF, shape (FOLDS, parts), have grown by more than chance."""
    scores, weights = _logarithms([np.stack([before, after])])
    mean, width = _mean_and_width(scores[0] - scores[1], weights)
    return bool(mean < -width)


def gain_of(before: Array, after: Array) -> tuple[float, float]:
    """Return gain and spread, as in ``Choice``, of the errors of a DOF, shape (FOLDS, parts)."""
    scores, weights = _logarithms([np.stack([before, after])])
    return _as_share(*_mean_and_width(scores[0] - scores[1], weights))


def _logarithms(errors: Sequence[Array]) -> tuple[Array, Array]:
    """Return sums over all DOFs of the logarithms of errors, and how many there are each."""
    known = [~np.isnan(own[0]) for own in errors]
    scores = sum(np.log(np.maximum(np.where(there, own, 1.0), TINY))
                 for there, own in zip(known, errors))
    return np.asarray(scores), np.sum(known, axis=0, dtype=float)


def _mean_and_width(sums: Array, weights: Array) -> tuple[Array, Array]:
    """
    Return means per DOF and part, and half the widths of their 95 % intervals.

    ``sums`` over the DOFs that ``weights`` counts have shape (..., FOLDS, parts). What DOFs do at
    the same time may hang together: each part counts as one draw.
    """
    more = int((weights > 0.0).sum()) - 1
    mean = sums.sum(axis=(-2, -1)) / weights.sum()
    squares = ((sums - mean[..., None, None] * weights) ** 2).sum(axis=(-2, -1))
    quantile = 1.96 + 2.37 / more + 2.82 / more ** 2  # of Student's t
    return mean, np.asarray(quantile * np.sqrt(squares * (1.0 + 1.0 / more)) / weights.sum())


def _as_share(mean: Array, width: Array) -> tuple[float, float]:
    """Return a gain in shares from a mean of the logarithms of ratios, and its spread."""
    gain = -math.expm1(-float(mean))
    return gain, gain + math.expm1(float(width - mean))


@dataclass(frozen=True)
class Change:
    """What was found for one key."""

    # the same where nothing better was found
    before: float
    after: float
    # range that the data can not tell from the best; NaN if it is not known
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True)
class Stage:
    """Keys that were sought together."""

    keys: Mapping[str, Change]  # change by key
    # of the best against the present values on held-out blocks, as a share
    gain: float
    spread: float
    note: str = ''  # what has to be known about it, '' if nothing

    @property
    def changes(self) -> dict[str, float]:
        """Return the keys that have a better value, with that."""
        return {key: change.after for key, change in self.keys.items()
                if change.after != change.before}

    def unchanged(self) -> Stage:
        """Return it with keys that stay; which values are as good is not known then."""
        return replace(self, gain=0.0, spread=0.0, keys={
            key: Change(change.before, change.before) for key, change in self.keys.items()})

    def without(self, key: str) -> Stage:
        """Return it with a key that stays."""
        if key not in self.changes:
            return self
        before = self.keys[key].before
        others = replace(self, keys={**self.keys, key: Change(before, before)})
        return others if others.changes else self.unchanged()

    def rounded(self) -> Stage:
        """Return it with new values of few digits."""
        return replace(self, keys={
            key: change if change.after == change.before or isinstance(change.after, bool) else
            replace(change, after=float(f'{change.after:.{DIGITS}g}'))
            for key, change in self.keys.items()})
