"""
Blocks of a trial that are held out in turn, and the choice among candidates by them.

The trial of a degree of freedom is divided into ``FOLDS`` folds of equal time. A candidate is
scored on each fold by a model that was fitted to the others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.trajectory import Array
from rovid_core.trials.tuning.log import CommandedForce, Segment

NS = 1e-9
FOLDS = 8  # blocks of time of equal length; each is held out once
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

    def by_fold(self, values: Array) -> Array:
        """Return the means over each fold of values of shape (steps, ..., pieces)."""
        total = np.einsum('k...p,kp->...p', values, self.valid.astype(float))
        member = self.fold[:, None] == np.arange(FOLDS)
        return np.asarray(total @ member / (self.valid.sum(axis=0) @ member))


def fold_bounds(segments: Sequence[Segment]) -> Array:
    """Return the bounds of the folds [ns], with as much time in steps each; (FOLDS + 1,)."""
    first = segments[0].start
    times, so_far = [], [0]
    for segment in segments:
        start, end = segment.start - first, segment.ends[-1] + 1 - first
        times += [start, end]
        so_far += [so_far[-1] + end - start] * 2
    shares = np.linspace(0, so_far[-1], FOLDS + 1)
    return np.asarray(first + np.interp(shares, so_far[:-1], times))


def blocks(segments: Sequence[Segment], bounds: Array) -> Blocks | None:
    """
    Divide a trial of one DOF into blocks; None if some fold has no piece.

    ``bounds`` are those of the folds [ns], shape (FOLDS + 1,).
    """
    pieces: list[tuple[int, NDArray[np.int64], Array]] = []
    for segment in segments:
        nodes, means = _joined(*segment.intervals())
        of_step = np.searchsorted(bounds, nodes[:-1], 'right') - 1
        for fold in range(FOLDS):
            own = np.flatnonzero(of_step == fold)
            if len(own) >= MIN_STEPS:
                pieces.append((fold, nodes[own[0]:own[-1] + 2], means[:, own]))
    if {fold for fold, _, _ in pieces} != set(range(FOLDS)):
        return None
    longest = max(means.shape[1] for _, _, means in pieces)
    # shape (1 + k, steps, pieces)
    padded = np.stack([np.pad(means, ((0, 0), (0, longest - means.shape[1])))
                       for _, _, means in pieces], axis=2)
    return Blocks(
        np.stack([np.pad(nodes, (0, longest + 1 - len(nodes)), mode='edge')
                  for _, nodes, _ in pieces], axis=1),
        padded[0], padded[1:].transpose(1, 0, 2), np.array([fold for fold, _, _ in pieces]),
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


# Another term or clock has to lower the error by this share: without it the model is simpler.
WORTH = 0.01

T95 = 2.4  # standard errors of a mean over 8 folds, for 95 % (Student's t)


Result = TypeVar('Result')


class ParallelMap(Protocol):
    """What does the same work on many things, possibly at the same time."""

    def __call__(self, work: Callable[[int], Result], given: Sequence[int]) -> Sequence[Result]:
        """Return what ``work`` made of each."""


@dataclass(frozen=True)
class Choice:
    """The best candidate."""

    index: int  # which one
    # By how much it scores better than the current one, in shares of that one's score, and ``T95``
    # standard errors of it. For each fold the best is chosen by the others, so that the luckiest
    # of many gains nothing by its luck.
    gain: float
    spread: float
    as_good: NDArray[np.intp]  # the candidates that the data can not tell from the best

    @property
    def is_better(self) -> bool:
        """Tell whether the gain is more than chance."""
        return self.gain > self.spread


def choose(scores: Array, current: int) -> Choice:
    """
    Choose the candidate with the lowest mean score; ``current`` is the one that is in use.

    ``scores`` are errors, shape (candidates, folds), infinite for a candidate that does not work.
    """
    total = scores.sum(axis=1)
    best = int(total.argmin())
    without = np.subtract(total[:, None], scores, out=np.full(scores.shape, np.inf),
                          where=np.isfinite(scores))
    folds = np.arange(scores.shape[1])
    gains = scores[current] - scores[without.argmin(axis=0), folds]
    usable = np.flatnonzero(np.isfinite(total))
    worse = scores[usable] - scores[best]
    as_good = usable[worse.mean(axis=1) <= half_width(worse)]
    mean = float(scores[current].mean())
    return Choice(best, float(gains.mean()) / mean, float(half_width(gains)) / mean, as_good)


def half_width(values: Array) -> Array:
    """Return half the width of the 95 % interval of the mean over the last axis."""
    return np.asarray(T95 * values.std(axis=-1, ddof=1) / np.sqrt(values.shape[-1]))


def relative(parts: Sequence[Array], current: int) -> Array:
    """Return the scores of several DOFs as one: each in its present ones' mean."""
    return np.asarray(sum(part / part[current].mean() for part in parts) / len(parts))


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
