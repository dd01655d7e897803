"""Choosing among candidates by what they score on held-out blocks, without fooling oneself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.trajectory import Array

SURE = 2.4
"""Standard errors of a mean over 8 folds, for 95 % (Student's t)."""


Done = TypeVar('Done')


class Each(Protocol):
    """What does the same work on many things, possibly at the same time."""

    def __call__(self, work: Callable[[int], Done], given: Sequence[int]) -> Sequence[Done]:
        """Return what ``work`` made of each."""


@dataclass(frozen=True)
class Choice:
    """
    The best candidate.

    Attributes
    ----------
    index : int
        Which one.
    gain, spread : float
        By how much it scores better than the current one, in shares of that one's score,
        and ``SURE`` standard errors of it. For each fold the best is chosen by the others, so
        that the luckiest of many gains nothing by its luck.
    as_good : ndarray of int
        The candidates that the data can not tell from the best.

    """

    index: int
    gain: float
    spread: float
    as_good: NDArray[np.intp]

    @property
    def is_better(self) -> bool:
        """Tell whether the gain is more than chance."""
        return self.gain > self.spread


def choose(scores: Array, current: int) -> Choice:
    """
    Choose the candidate with the lowest mean score.

    Parameters
    ----------
    scores : ndarray, shape (candidates, folds)
        Errors; infinite for a candidate that does not work, but the current one.
    current : int
        The one that is in use.

    """
    total = scores.sum(axis=1)
    best = int(total.argmin())
    without = np.where(np.isfinite(scores), total[:, None] - scores, np.inf)
    folds = np.arange(scores.shape[1])
    gains = scores[current] - scores[without.argmin(axis=0), folds]
    usable = np.flatnonzero(np.isfinite(total))
    worse = scores[usable] - scores[best]
    as_good = usable[worse.mean(axis=1) <= sure_error(worse)]
    mean = float(scores[current].mean())
    return Choice(best, float(gains.mean()) / mean, float(sure_error(gains)) / mean, as_good)


def sure_error(values: Array) -> Array:
    """Return ``SURE`` standard errors of the mean over the last axis."""
    return SURE * _error(values)


def _error(values: Array) -> Array:
    return np.asarray(values.std(axis=-1, ddof=1) / np.sqrt(values.shape[-1]))


def relative(parts: Sequence[Array], current: int) -> Array:
    """Return the scores of several DOFs as one: each in its present ones' mean."""
    return np.asarray(sum(part / part[current].mean() for part in parts) / len(parts))


@dataclass(frozen=True)
class Change:
    """
    What was found for one key.

    Attributes
    ----------
    before, after : float
        The same where nothing better was found.
    low, high : float
        Range that the data can not tell from the best; NaN if it is not known.

    """

    before: float
    after: float
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True)
class Stage:
    """
    Keys that were sought together.

    Attributes
    ----------
    keys : dict
        Change by key.
    gain, spread : float
        Of the best against the present values on held-out blocks, as a share.
    note : str
        What has to be known about it, '' if nothing.

    """

    keys: Mapping[str, Change]
    gain: float
    spread: float
    note: str = ''
