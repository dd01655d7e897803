"""
The searches for heading offset, delay and lag, dead-band, reverse thrust, couplings and terms.

Each search proposes candidates, has a model fitted for each, and takes the one that predicts
held-out blocks best if it gains more than chance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
import math
from typing import Any

import numpy as np
from rovid_core.model.dofs import PARAMETERS
from rovid_core.model.trajectory import Array
from rovid_core.settings.inputs import ThrusterSettings
from rovid_core.settings.run import Settings
from rovid_core.trials.tuning.cross_validation import (
    blocks,
    Change,
    Choice,
    choose,
    fold_bounds,
    FOLDS,
    half_width,
    ParallelMap,
    relative,
    Stage,
)
from rovid_core.trials.tuning.dof_fit import Dof
from rovid_core.trials.tuning.log import CommandedForce, Segment, TuningLog, turnable, turned

HEADING_STEP = math.radians(15.0)
# Around the best so far the grid of ``HEADING_STEP`` is refined to this share.
HEADING_FINER = (0.25, 0.0625, 0.0156)


def tune_heading(log: TuningLog, dofs: Sequence[Dof], commanded: CommandedForce,
                 settings: Settings, pair: tuple[float, float]) -> Stage | None:
    """
    Find what has to be added to the heading, from the direction in which thrust moves.

    Surge thrust of a vehicle with a wrong heading seems to move it sideways as well. None
    where the position is not turned by an attitude, or neither surge nor sway is moved.
    """
    names = turnable(settings)
    own = {dof.name: dof for dof in dofs}
    if names is None or not any(name in own for name in names):
        return None
    both = [log.segments(name) for name in names]
    found = _Turned(both, [own.get(name) for name in names], commanded, pair)
    angles = [0.0, *(k * HEADING_STEP for k in range(-12, 12) if k)]
    scores = found.scores(angles)
    choice = choose(scores, 0)
    for share in HEADING_FINER:
        middle = angles[choice.index]
        new = [middle + k * share * HEADING_STEP for k in (-4, -3, -2, -1, 1, 2, 3, 4)]
        angles += new
        scores = np.concatenate([scores, found.scores(new)])
        choice = choose(scores, 0)
    turn = angles[choice.index] if choice.is_better else 0.0
    best = settings.yaw_offset + angles[choice.index]
    begin = settings.yaw_offset + math.remainder(best, 2.0 * math.pi) - best
    good = [begin + angle for angle in around_the_best(angles, choice)]
    after = math.remainder(settings.yaw_offset + turn, 2.0 * math.pi) if turn \
        else settings.yaw_offset
    return Stage({'attitude.yaw_offset': Change(
        settings.yaw_offset, after, min(good), max(good))}, choice.gain, choice.spread)


def around_the_best(angles: Sequence[float], choice: Choice) -> list[float]:
    """
    Return the angles [rad] that are as good as the best, up to the next each way that is not.

    Far from it a candidate is so much worse on a few blocks that its scatter hides that it is.
    Behind half a turn the circle goes on from its other end.
    """
    best = angles[choice.index]
    apart = [math.remainder(angle - best, 2.0 * math.pi) for angle in angles]
    order = sorted(range(len(angles)), key=lambda i: apart[i])
    as_good = set(choice.as_good.tolist())
    low = high = order.index(choice.index)
    while low > 0 and order[low - 1] in as_good:
        low -= 1
    while high + 1 < len(order) and order[high + 1] in as_good:
        high += 1
    return [best + apart[i] for i in order[low:high + 1]]


class _Turned:
    """How well surge and sway are predicted with another heading."""

    def __init__(self, both: list[list[Segment]], own: list[Dof | None],
                 commanded: CommandedForce, pair: tuple[float, float]) -> None:
        self._both, self._own = both, own
        self._commanded, self._pair = commanded, pair
        self._bounds = fold_bounds(both[0])

    def scores(self, angles: Sequence[float]) -> Array:
        """Return the error of both velocities together, shape (angles, FOLDS) [m/s]."""
        parts = [[blocks(s, self._bounds) for s in turned(self._both[0], self._both[1], angle)]
                 for angle in angles]
        total = np.zeros((len(angles), FOLDS))
        known = next(dof for dof in self._own if dof is not None)
        for i, dof in enumerate(self._own):
            measured = np.stack([
                part[i].measured for part in parts if part[i] is not None], 1)  # type: ignore
            problem = (dof or known).problem
            if dof is not None:
                total += dof.fit(self._commanded, [self._pair], measured).scores
                continue
            # without thrust there is no motion this way
            target = measured / problem.scales.velocity
            total += problem.score(np.zeros((4, 1, 1)), 0.0 * target[0], 0.0 * target, target)
        return total


DELAYS = (0.0, 0.05, 0.1, 0.2, 0.35, 0.6, 1.0)
LAGS = (0.0, 0.1, 0.2, 0.4, 0.7, 1.2, 2.0)  # [s] where the search begins
# Around the best so far the grid is refined to this share of its spacing.
THRUST_FINER = (0.5, 0.125)


def tune_thrust(dofs: Sequence[Dof], commanded: CommandedForce, settings: Settings,
                each: ParallelMap, done: Callable[[float], None]) -> Stage:
    """Find delay and lag, which all thrusters share."""
    present = (settings.thrusters.delay, settings.thrusters.time_constant)
    pairs = [present]
    scores: list[list[Array]] = [[] for _ in dofs]

    def add(wanted: Sequence[tuple[float, float]]) -> Choice:
        new = [pair for pair in dict.fromkeys(wanted) if pair not in pairs[1:]]
        found = each(lambda k: dofs[k].fit(commanded, new).scores, range(len(dofs)))
        for kept, one in zip(scores, found):
            kept.append(one)
        done(len(kept) / (1 + len(THRUST_FINER)))
        pairs.extend(new if len(kept) > 1 else new[1:])
        return choose(relative([np.concatenate(kept) for kept in scores], 0), 0)

    choice = add([present, *((d, lag) for d in DELAYS for lag in LAGS)])
    for finer in THRUST_FINER:
        best = pairs[choice.index]
        near = [_near(value, grid, finer) for value, grid in zip(best, (DELAYS, LAGS))]
        choice = add([(d, lag) for d in near[0] for lag in near[1] if (d, lag) not in pairs])
    good = np.array([pairs[i] for i in choice.as_good])
    after = pairs[choice.index] if choice.is_better else present
    low, high = good.min(axis=0), good.max(axis=0)
    total = good.sum(axis=1)
    note = ''
    if np.ptp(total) < 0.5 * (high - low).min():
        note = (f'only the sum of delay and time_constant is well determined: '
                f'{total.min():.3f} to {total.max():.3f} s')
    names = ('thrusters.delay', 'thrusters.time_constant')
    return Stage({name: Change(present[i], after[i], float(low[i]), float(high[i]))
                  for i, name in enumerate(names)}, choice.gain, choice.spread, note)


def _near(value: float, grid: Sequence[float], finer: float) -> list[float]:
    """Return values around one, in a share of the grid's spacing there."""
    i = min(max(int(np.searchsorted(grid, value)), 1), len(grid) - 1)
    spacing = finer * (grid[i] - grid[i - 1])
    return [round(value + k * spacing, 6) for k in (-2, -1, 0, 1, 2)
            if 0.0 <= value + k * spacing <= 10.0]


# Of a large command: the dead-bands that are tried first.
SHARES = (0.0, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3)
LARGE = 0.95  # quantile of the sizes of the commands that counts as a large one
# Force of a negative command relative to that of the same positive one, tried first.
REVERSE = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.3)
# Then these are tried around the best one, in shares of the way to its neighbours.
CURVE_FINER = (-0.75, -0.5, -0.25, 0.25, 0.5, 0.75)


def tune_deadband(log: TuningLog, dofs: Sequence[Dof], thrusters: ThrusterSettings,
                  pair: tuple[float, float]) -> tuple[Stage, ThrusterSettings]:
    """
    Find the dead-band, which all thrusters share; return also the thrusters with it.

    ``pair`` is delay and lag of the thrust [s].
    """
    sizes = np.abs((log.commands() - thrusters.offset) * thrusters.scale)
    large = float(np.quantile(sizes[sizes > 0.0], LARGE)) if (sizes > 0.0).any() else 1.0
    return _tune_curve(_Candidates('deadband', log, dofs, thrusters, pair),
                       [share * large for share in SHARES])


def tune_reverse(log: TuningLog, dofs: Sequence[Dof], thrusters: ThrusterSettings,
                 pair: tuple[float, float]) -> tuple[Stage, ThrusterSettings]:
    """
    Find how much less all thrusters push backwards; return also the thrusters with it.

    ``pair`` is delay and lag of the thrust [s].
    """
    return _tune_curve(_Candidates('reverse', log, dofs, thrusters, pair), REVERSE)


def _tune_curve(candidates: _Candidates,
                first: Sequence[float]) -> tuple[Stage, ThrusterSettings]:
    """Try ``first``, then what lies around the best of them."""
    candidates.add([candidates.present, *first])
    grid = sorted(candidates.tried)
    i = grid.index(candidates.tried[candidates.choice.index])
    candidates.add([
        grid[i] + abs(share) * (grid[i + step] - grid[i])
        for share in CURVE_FINER for step in (-1 if share < 0.0 else 1,)
        if 0 <= i + step < len(grid)])
    choice = candidates.choice
    found = candidates.tried[choice.index if choice.is_better else 0]
    good = [candidates.tried[k] for k in choice.as_good]
    change = Change(candidates.present, found, min(good), max(good))
    return (Stage({f'thrusters.{candidates.key}': change}, choice.gain, choice.spread),
            candidates.thrusters(found))


class _Candidates:
    """Values of one key of the thrusters that were tried; the first one is the present one."""

    def __init__(self, key: str, log: TuningLog, dofs: Sequence[Dof],
                 thrusters: ThrusterSettings, pair: tuple[float, float]) -> None:
        self.key, self.present = key, float(getattr(thrusters, key))
        self._log, self._dofs, self._pair, self._thrusters = log, dofs, pair, thrusters
        self.tried: list[float] = []
        self._scores: list[list[Array]] = [[] for _ in dofs]

    def thrusters(self, value: float) -> ThrusterSettings:
        """Return the thrusters with another value."""
        changed: dict[str, Any] = {self.key: value}
        return replace(self._thrusters, **changed)

    @property
    def choice(self) -> Choice:
        """Return the best one."""
        return choose(relative([np.concatenate(parts) for parts in self._scores], 0), 0)

    def add(self, values: Sequence[float]) -> None:
        """Fit and score models with further values."""
        new = [value for value in dict.fromkeys(values) if value not in self.tried]
        if not new:
            return
        forces = [self._log.commanded(self.thrusters(value)) for value in new]
        for parts, dof in zip(self._scores, self._dofs):
            parts.append(dof.fit_commands(forces, self._pair).scores)
        self.tried += new


# A term or coupling has to lower the error by this share: without it the model is simpler.
WORTH = 0.01


@dataclass(frozen=True)
class ListChange:
    """What the model of one DOF has: the names in a list of the parameter file."""

    key: str  # in the parameter file
    # the same where nothing better was found
    before: tuple[str, ...]
    after: tuple[str, ...]
    # of those that predict best against the present ones on held-out blocks, as a share
    gain: float
    spread: float


def tune_couplings(dof: Dof, commanded: CommandedForce,
                   pair: tuple[float, float]) -> ListChange:
    """
    Add couplings to a DOF, the best one first, as long as it clearly predicts better with it.

    Those that it has stay. Weaker thrust in reverse is sought as one of the thrusters.
    """
    before = after = dof.settings.couplings
    scores = first = dof.fit_with(commanded, pair, dof.settings).scores
    while True:
        sets = [(*after, name) for name in dof.possible
                if name not in (*after, 'reverse_thrust')]
        if not sets:
            break
        found = [dof.fit_with(commanded, pair, replace(dof.settings, couplings=names)).scores
                 for names in sets]
        choice = choose(np.concatenate([scores, *found]), 0)
        if not (choice.index and choice.gain > max(choice.spread, WORTH)):
            break
        after, scores = sets[choice.index - 1], found[choice.index - 1]
    gains = (first[0] - scores[0]) / first[0].mean()
    return ListChange(f'{dof.name}.couplings', before, after, float(gains.mean()),
                      float(half_width(gains)))


def tune_terms(dof: Dof, commanded: CommandedForce, pair: tuple[float, float]) -> ListChange:
    """
    Choose the terms of a DOF; alpha always stays.

    They change only where the model clearly predicts held-out blocks better. A drag that one log
    could do without is not zero: without it the others are wrong, and their intervals too narrow.
    """
    before = dof.settings.terms
    candidates = [before, *(
        ('alpha', *others) for count in range(len(PARAMETERS))
        for others in combinations(PARAMETERS[1:], count) if {'alpha', *others} != {*before})]
    scores = np.concatenate([
        dof.fit_with(commanded, pair, replace(dof.settings, terms=terms)).scores
        for terms in candidates])
    cost = scores.mean(axis=1) * [1.0 + WORTH * len(terms) for terms in candidates]
    best = int(np.where(np.isfinite(cost), cost, np.inf).argmin())
    gains = (scores[0] - scores[best]) / scores[0].mean()
    gain, spread = float(gains.mean()), float(half_width(gains))
    return ListChange(
        f'{dof.name}.terms', before, candidates[best] if gain > spread else before, gain, spread)
