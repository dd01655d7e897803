"""
The searches for heading offset, delay and lag, dead-band and terms.

Each search proposes candidates, has a model fitted for each, and takes the one that predicts
held-out blocks best if it gains more than chance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
import math

import numpy as np
from rovid_core.model.dofs import PARAMETERS
from rovid_core.model.trajectory import Array
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
    good = [settings.yaw_offset + angles[i] for i in choice.as_good]
    after = math.remainder(settings.yaw_offset + turn, 2.0 * math.pi) if turn \
        else settings.yaw_offset
    return Stage({'attitude.yaw_offset': Change(
        settings.yaw_offset, after, min(good), max(good))}, choice.gain, choice.spread)


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


KEY = 'thrusters.deadband'
# Of a large command: the dead-bands that are tried first.
SHARES = (0.0, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3)
LARGE = 0.95  # quantile of the sizes of the commands that counts as a large one
# Then these are tried around the best one, in shares of the way to its neighbours.
DEADBAND_FINER = (-0.75, -0.5, -0.25, 0.25, 0.5, 0.75)


def tune_deadband(log: TuningLog, dofs: Sequence[Dof], settings: Settings,
                  pair: tuple[float, float]) -> tuple[Stage, CommandedForce]:
    """
    Find the dead-band, which all thrusters share; return also the force with it.

    ``pair`` is delay and lag of the thrust [s].
    """
    present = settings.thrusters.deadband
    candidates = _Candidates(log, dofs, settings, pair)
    candidates.add([present, *(share * candidates.large for share in SHARES)])
    grid = sorted(candidates.tried)
    i = grid.index(candidates.tried[candidates.choice.index])
    candidates.add([
        grid[i] + abs(share) * (grid[i + step] - grid[i])
        for share in DEADBAND_FINER for step in (-1 if share < 0.0 else 1,)
        if 0 <= i + step < len(grid)])
    choice = candidates.choice
    found = choice.index if choice.is_better else 0
    good = [candidates.tried[k] for k in choice.as_good]
    change = Change(present, candidates.tried[found], min(good), max(good))
    return Stage({KEY: change}, choice.gain, choice.spread), candidates.commanded[found]


class _Candidates:
    """Dead-bands that were tried; the first one is the present one."""

    def __init__(self, log: TuningLog, dofs: Sequence[Dof], settings: Settings,
                 pair: tuple[float, float]) -> None:
        self._log, self._dofs, self._pair = log, dofs, pair
        self._thrusters = settings.thrusters
        self.tried: list[float] = []
        self.commanded: list[CommandedForce] = []
        self._scores: list[list[Array]] = [[] for _ in dofs]

    @property
    def large(self) -> float:
        """Return the size of a large command."""
        thrusters = self._thrusters
        sizes = np.abs((self._log.commands() - thrusters.offset) * thrusters.scale)
        return float(np.quantile(sizes[sizes > 0.0], LARGE)) if (sizes > 0.0).any() else 1.0

    @property
    def choice(self) -> Choice:
        """Return the best one."""
        return choose(relative([np.concatenate(parts) for parts in self._scores], 0), 0)

    def add(self, deadbands: Sequence[float]) -> None:
        """Fit and score models with further dead-bands."""
        new = [value for value in dict.fromkeys(deadbands) if value not in self.tried]
        if not new:
            return
        forces = [self._log.commanded(replace(self._thrusters, deadband=value)) for value in new]
        for parts, dof in zip(self._scores, self._dofs):
            parts.append(dof.fit_commands(forces, self._pair).scores)
        self.tried += new
        self.commanded += forces


# A term has to lower the error by this share to be kept: without it the model is simpler.
WORTH = 0.01


@dataclass(frozen=True)
class TermsChange:
    """The terms of one DOF."""

    dof: str  # its name
    # the same where nothing better was found
    before: tuple[str, ...]
    after: tuple[str, ...]
    # of those that predict best against the present ones on held-out blocks, as a share
    gain: float
    spread: float

    @property
    def key(self) -> str:
        """Return the key in the parameter file."""
        return f'{self.dof}.terms'


def tune_terms(dof: Dof, commanded: CommandedForce, pair: tuple[float, float]) -> TermsChange:
    """
    Choose the terms of a DOF; alpha always stays.

    Terms are left out where the model predicts held-out blocks as well without them, and added
    where it clearly predicts better with them.
    """
    before = dof.settings.terms
    candidates = [before, *(
        ('alpha', *others) for count in range(len(PARAMETERS))
        for others in combinations(PARAMETERS[1:], count) if {'alpha', *others} != {*before})]
    scores = np.concatenate([dof.fit_terms(commanded, pair, terms).scores for terms in candidates])
    cost = scores.mean(axis=1) * [1.0 + WORTH * len(terms) for terms in candidates]
    best = int(np.where(np.isfinite(cost), cost, np.inf).argmin())
    gains = (scores[0] - scores[best]) / scores[0].mean()
    gain, spread = float(gains.mean()), float(half_width(gains))
    taken = {*candidates[best]} < {*before} or gain > spread
    return TermsChange(dof.name, before, candidates[best] if taken else before, gain, spread)
