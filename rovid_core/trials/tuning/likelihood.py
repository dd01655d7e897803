"""
The search for lag, reverse thrust and dead zone by how well the filter predicts a log.

Blocks that are simulated tell little of what is fast: after some seconds a model is off by drag,
current and tether, whatever its lag is. The filter predicts each measurement from those before
it, which is as fair as a block that is held out (A. P. Dawid, Statistical Theory: The Prequential
Approach, 1984). In a part of the log a filter may err a hundred times as much as in others, where
it loses the vehicle or takes up a current sooner: so thrusters are compared by the median of their
gains in pairs of parts, and its rank interval (J. L. Hodges and E. L. Lehmann, Estimates of
Location Based on Rank Tests, 1963).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from typing import Any

import numpy as np
from rovid_core.model.plant import Array
from rovid_core.model.samples import NS
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.inputs import ThrusterSettings
from rovid_core.trials.tuning.cross_validation import WORTH

LAGS = (0.1, 0.25)  # [s] tried first, of the force and of the propellers' turns
REVERSE = (0.75, 0.875)  # tried first
DEAD_ZONES = (0.0, 0.02, 0.06)  # of a large command, tried first
PART = 5.0  # [s] much longer than the filter takes to correct its velocity
BEGIN = 6  # parts in which it goes through its first data
ROUNDS = 2  # times that a value around the best one is tried
# By how much another value has to be another one: [s], 1, and of a large command.
FINEST = {'time_constant': 0.02, 'reverse': 0.03, 'dead_zone': 0.01}
# What comes from others as a whole.
GROUPS = (('time_constant', 'lag_of_turns', 'lag_at'), ('reverse',), ('dead_zone',), ('deadband',))


@dataclass(frozen=True)
class Prediction:
    """How the filter predicted a log."""

    # shape (n,); by DOF, how large its errors are in each part of the log, by the mean of their
    # log-likelihood, in the unit of what is measured; NaN where nothing is. Empty for settings
    # with which it cannot go through the log
    errors: Mapping[str, Array] = field(default_factory=dict)
    delay: float = math.nan  # [s] of the thrust as it was found


class PredictionErrors:
    """Notes how the filters of a stream predict each part of a log."""

    def __init__(self, stream: Stream) -> None:
        self._filters = {dof: stream.identifier(dof) for dof in stream.settings.dofs}
        for one in self._filters.values():
            one.trust_thrusters()
        self._first: int | None = None
        # by part: of each filter, the surprise so far and how many measurements that was
        self._so_far: list[list[tuple[float, int]]] = []

    def note(self, time: int) -> None:
        """Note what there is after the steps up to a time [ns]."""
        if self._first is None:
            self._first = time
        part = max(0, int((time - self._first) * NS / PART))
        now = [one.surprise for one in self._filters.values()]
        last = self._so_far[-1] if self._so_far else now
        self._so_far += [last] * (part + 1 - len(self._so_far))
        self._so_far[part] = now

    def prediction(self) -> Prediction:
        """Return how the log was predicted."""
        sums = np.array([[(0.0, 0)] * len(self._filters), *self._so_far])
        surprise, count = np.moveaxis(np.diff(sums, axis=0), 2, 0)
        mean = np.divide(surprise, count, out=np.full(count.shape, math.nan), where=count > 0.0)
        found = zip(self._filters, np.exp(0.5 * mean).T)
        return Prediction({dof: errors for dof, errors in found if np.isfinite(errors).any()},
                          self._delay())

    def _delay(self) -> float:
        """Return the delay [s] that all filters together say, NaN if none does."""
        said = np.array([(one.delay, one.delay_std) for one in self._filters.values()])
        delay, std = said[(said[:, 1] > 0.0) & np.isfinite(said).all(axis=1)].T
        return float(np.average(delay, weights=std**-2.0)) if len(delay) else math.nan


Predict = Callable[[Sequence[ThrusterSettings]], Sequence[Prediction]]


@dataclass(frozen=True)
class Likeliest:
    """The thrusters with which the filter predicts a log best."""

    thrusters: ThrusterSettings
    delay: float  # [s] beside them, as the filter found it; NaN if it did not
    # by how much its errors are smaller than with those in use, as a share, and by how much less
    # that may be, with 95 %
    gain: float
    spread: float
    as_good: Sequence[ThrusterSettings]  # those that the log can not tell from them


def likeliest(present: ThrusterSettings, told: ThrusterSettings, large: float,
              predict: Predict) -> Likeliest | None:
    """
    Return the thrusters with which the filter predicts a log best, None for those that are told.

    Parameters
    ----------
    present : ThrusterSettings
        Those in use.
    told : ThrusterSettings
        What blocks of the log tell, which stays unless the filter clearly knows better.
    large : float
        A large command.
    predict : callable
        Lets the filter predict the log with each of some thrusters.

    """
    tried = _Tried(present, predict)
    if not tried.dofs:
        return None
    finest = {**FINEST, 'dead_zone': FINEST['dead_zone'] * large}
    tried.add([told, *_lags(present)])
    tried.refine('time_constant', finest['time_constant'])
    before = tried.best
    for key, values in (('reverse', REVERSE),
                        ('dead_zone', [share * large for share in DEAD_ZONES])):
        tried.add_values(key, values)
        tried.refine(key, finest[key])
    # what one of them lacks looks like the other
    for key in ('time_constant', 'reverse'):
        value = getattr(tried.thrusters[tried.best], key)
        if value and tried.best != before:
            before = tried.best
            tried.add_values(key, [value - 1.5 * finest[key], value + 1.5 * finest[key]])
            tried.refine(key, finest[key])
    best = _clearly_best(tried, told)
    if best is None or tried.thrusters[best] == told:
        return None
    gains = [1.0 - math.exp(-x / len(tried.dofs)) for x in median_and_bounds(tried.gains(0, best))]
    return Likeliest(
        tried.thrusters[best], tried.predictions[best].delay, gains[0], gains[0] - gains[1],
        [one for k, one in enumerate(tried.thrusters) if not tried.is_clear(k, best)])


def _clearly_best(tried: _Tried, told: ThrusterSettings) -> int | None:
    """Return the number of the best that are clearly better than those in use, None for none."""
    clear = [k for k in range(len(tried.thrusters)) if tried.is_clear(0, k)]
    if not clear:
        return None
    best = min(clear, key=tried.score)
    # what blocks tell needs no more than to be no worse here
    for keys in GROUPS:
        as_told: dict[str, Any] = {key: getattr(told, key) for key in keys}
        k = tried.number(replace(tried.thrusters[best], **as_told))
        if tried.score(k) <= tried.score(best) + WORTH:
            best = k
    return best


def median_and_bounds(gains: Array) -> tuple[float, float, float]:
    """Return the median of the means of all pairs of gains, and where it is with 95 %."""
    n = len(gains)
    one, other = np.triu_indices(n)
    means = np.sort(0.5 * (gains[one] + gains[other]))
    # of the signed-rank statistic
    rank = 0.25 * n * (n + 1) - 1.96 * math.sqrt(n * (n + 1) * (2 * n + 1) / 24.0)
    if rank < 0.0:
        return float(np.median(means)) if n else 0.0, -math.inf, math.inf
    return float(np.median(means)), float(means[int(rank)]), float(means[-1 - int(rank)])


def _lags(present: ThrusterSettings) -> list[ThrusterSettings]:
    """Return thrusters with each of the lags that are tried first."""
    kinds = (False,) if present.hold == 'linear' else (False, True)
    return [replace(present, time_constant=0.0), *[
        replace(present, time_constant=lag, lag_of_turns=turns, lag_at=0.0)
        for turns in kinds for lag in LAGS]]


class _Tried:
    """Thrusters that were tried; those in use come first."""

    def __init__(self, present: ThrusterSettings, predict: Predict) -> None:
        self._predict = predict
        self.thrusters = [present]
        self.predictions = list(predict(self.thrusters))
        self.dofs = list(self.predictions[0].errors)

    def add(self, more: Sequence[ThrusterSettings]) -> None:
        """Try further ones; those with which the filter loses a DOF are left out."""
        new = [one for one in dict.fromkeys(more) if one not in self.thrusters]
        for one, prediction in zip(new, self._predict(new) if new else ()):
            if prediction.errors.keys() >= {*self.dofs}:
                self.thrusters.append(one)
                self.predictions.append(prediction)

    def number(self, thrusters: ThrusterSettings) -> int:
        """Return the number of some, that of the best if the filter loses a DOF with them."""
        self.add([thrusters])
        return self.thrusters.index(thrusters) if thrusters in self.thrusters else self.best

    def gains(self, old: int, new: int, dof: str = '') -> Array:
        """
        Return by how much smaller errors are, of some number against others, in logarithms.

        Shape (n,): in each part that all could be in, summed over all DOFs or of one.
        """
        total: Array = np.array(0.0)
        for name in (dof,) if dof else self.dofs:
            before, after = (np.log(self.predictions[k].errors[name]) for k in (old, new))
            n = min(len(before), len(after))
            total = total + (before[BEGIN:n] - after[BEGIN:n])
        return total[np.isfinite(total)]

    def is_clear(self, old: int, new: int) -> bool:
        """Tell whether it predicts better by more than chance, worth it, and no DOF worse."""
        gain, low, _ = median_and_bounds(self.gains(old, new))
        return gain > WORTH and low > 0.0 and all(
            median_and_bounds(self.gains(old, new, dof))[2] >= -WORTH for dof in self.dofs)

    def score(self, k: int) -> float:
        """Return by how much larger errors are than with those in use."""
        return -median_and_bounds(self.gains(0, k))[0]

    @property
    def best(self) -> int:
        """Return the number of those with which the filter predicts best."""
        return min(range(len(self.thrusters)), key=self.score)

    def add_values(self, key: str, values: Sequence[float]) -> None:
        """Try other values of a key in the best."""
        best = self.thrusters[self.best]
        self.add([replace(best, **_of(key, value)) for value in values if value >= 0.0])

    def refine(self, key: str, finest: float) -> None:
        """Try values of a key around the best one."""
        for _ in range(ROUNDS):
            best = self.thrusters[self.best]
            line = {getattr(one, key): self.score(k) for k, one in enumerate(self.thrusters)
                    if _is_alike(one, best, key)}
            value = next_value(line)
            if min(abs(value - known) for known in line) < finest:
                return
            self.add_values(key, [value])


def _of(key: str, value: float) -> dict[str, Any]:
    return {key: value}


def _is_alike(one: ThrusterSettings, other: ThrusterSettings, key: str) -> bool:
    """Tell whether thrusters are others only in a key; none lags in the way of any lag."""
    if key == 'time_constant' and not one.time_constant:
        one = replace(one, lag_of_turns=other.lag_of_turns, lag_at=other.lag_at)
    return replace(one, **_of(key, getattr(other, key))) == other


def next_value(line: Mapping[float, float]) -> float:
    """
    Return a value to try around the best one, or the best one itself if there is no other.

    Parameters
    ----------
    line : mapping of float to float
        What is to be small, by the value.

    """
    values = sorted(line)
    i = min(range(len(values)), key=lambda k: line[values[k]])
    if len(values) == 1:
        return values[0]
    if i == len(values) - 1:
        return 2.0 * values[i] - values[i - 1]
    if i == 0:
        return 0.5 * (values[0] + values[1]) if not values[0] else max(
            2.0 * values[0] - values[1], 0.5 * values[0])
    (a, b, c), (fa, fb, fc) = values[i - 1:i + 2], [line[x] for x in values[i - 1:i + 2]]
    one, other = (b - a) * (fb - fc), (b - c) * (fb - fa)
    return b - 0.5 * ((b - a) * one - (b - c) * other) / (one - other)
