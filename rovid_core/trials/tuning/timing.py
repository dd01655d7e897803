"""The search for delay and lag of the thrust, and for the latency of its messages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from rovid_core.model.plant import Array
from rovid_core.settings.run import LEAST_WAIT, Settings, ThrusterSettings
from rovid_core.trials.tuning.cross_validation import (
    Change,
    Choice,
    choose,
    gain_of,
    ParallelMap,
    Stage,
)
from rovid_core.trials.tuning.dof_fit import Dof
from rovid_core.trials.tuning.log import CommandedForce, TuningLog

# [s] where the search begins; below 0 commands are stamped later than the motion that they cause
DELAYS = (-0.6, -0.35, -0.2, -0.1, 0.0, 0.05, 0.1, 0.2, 0.35, 0.6, 1.0)
LAGS = (0.0, 0.1, 0.2, 0.4, 0.7, 1.2, 2.0)
KIND = ('thrusters.lag_of_turns', 'thrusters.lag_at')
LARGEST_EARLY = 0.1  # [s] of the lags that are tried first with a delay below 0
# Around the best so far the grid is refined to this share of its spacing.
FINER = (0.5, 0.125)

Pair = tuple[float, float]


def search_pairs(present: Pair, first: Sequence[Pair],
                 grids: tuple[Sequence[float], Sequence[float]],
                 scores: Callable[[Sequence[Pair]], Sequence[Array]],
                 done: Callable[[float], None]) -> tuple[list[Pair], list[Array]]:
    """
    Search two values at once, on a grid that is refined around the best.

    Parameters
    ----------
    present : tuple of 2 floats
        In use; the first of those that are returned.
    first : sequence of tuples of 2 floats
        Where the search begins.
    grids : tuple of 2 sequences of floats
        The values of that; beyond their ends nothing is tried.
    scores : callable
        Returns the errors of some pairs per DOF, each of shape (pairs, FOLDS, parts).
    done : callable
        Is told which share is done.

    Returns
    -------
    pairs : list of tuples of 2 floats
        All that were tried.
    errors : list of ndarray, shape (pairs, FOLDS, parts)
        By DOF.

    """
    pairs = [present, *(pair for pair in first if pair != present)]
    found = list(scores(pairs))
    for k, finer in enumerate(FINER):
        done((k + 1) / (1 + len(FINER)))
        best = pairs[choose(found, 0).index]
        near = [_near(value, grid, finer) for value, grid in zip(best, grids)]
        new = [(a, b) for a in near[0] for b in near[1] if (a, b) not in pairs]
        found = [np.concatenate(both) for both in zip(found, scores(new))]
        pairs += new
    return pairs, found


def _near(value: float, grid: Sequence[float], finer: float) -> list[float]:
    """Return values around one, in a share of the grid's spacing there."""
    i = min(max(int(np.searchsorted(grid, value)), 1), len(grid) - 1)
    spacing = finer * (grid[i] - grid[i - 1])
    return [round(value + k * spacing, 6) for k in (-2, -1, 0, 1, 2)
            if grid[0] <= value + k * spacing <= max(grid[-1], value)]


class Kind(NamedTuple):
    """
    What lags.

    Attributes
    ----------
    of_turns : bool
        The propellers' turns; else the force does.
    at : float
        [N] above 0 a torque drives them, and they lag so where one of them gives this force.

    """

    of_turns: bool
    at: float

    @staticmethod
    def in_use(thrusters: ThrusterSettings) -> Kind:
        """Return that of some thrusters."""
        return Kind(thrusters.lag_of_turns, thrusters.lag_at)

    def of(self, thrusters: ThrusterSettings) -> ThrusterSettings:
        """Return some thrusters with this kind of lag."""
        return replace(thrusters, lag_of_turns=self.of_turns, lag_at=self.at)


@dataclass(frozen=True)
class Timing:
    """What was found of delay and lag, which all thrusters share."""

    stage: Stage
    pair: Pair  # both, as they are to be used
    kind: Kind
    # which input comes later than the others say, where one does; shown by the delays of the DOFs
    late: Stage | None


def tune_thrust(dofs: Sequence[Dof], commanded: CommandedForce, settings: Settings,
                each: ParallelMap, done: Callable[[float], None]) -> Timing:
    """
    Find delay and lag, which all thrusters share, and an input that comes late.

    A delay below 0 says that commands are stamped late: it becomes their latency.
    """
    present = (settings.thrusters.delay, settings.thrusters.time_constant)
    first = [(delay, lag) for delay in DELAYS for lag in LAGS
             if delay >= 0.0 or lag <= LARGEST_EARLY]

    def scores(new: Sequence[Pair]) -> Sequence[Array]:
        return each(lambda k: dofs[k].fit(commanded, new).errors, range(len(dofs)))

    pairs, errors = search_pairs(present, first, (DELAYS, LAGS), scores, done)
    causal = np.array([pair[0] >= 0.0 for pair in pairs])
    choice = choose([np.where(causal[:, None, None], own, np.inf) for own in errors], 0)
    late = choose(errors, choice.index)
    # late stamps show in all DOFs, but one under control may seem to answer before its thrust
    if late.is_better and all(
            gain_of(error[choice.index], error[late.index])[0] > 0.0 for error in errors):
        choice = choose(errors, 0)
    # a delay that one DOF clearly does not have is that of an input, and none of the thrust
    better = choice.is_better and not choice.contradicted
    after = pairs[choice.index] if better else present
    sources = [settings.source(dof.name) for dof in dofs]
    return Timing(
        _stage(choice, after, [pairs[i] for i in choice.as_good], settings), after,
        Kind.in_use(settings.thrusters),
        late_input(sources, pairs, errors, choice.index, settings, scores))


def _stage(choice: Choice, after: Pair, as_good: Sequence[Pair], settings: Settings) -> Stage:
    """Return what changes with other delay and lag."""
    present = (settings.thrusters.delay, settings.thrusters.time_constant)
    good = np.array([after, *as_good])
    low, high = np.maximum(good.min(axis=0), 0.0), np.maximum(good.max(axis=0), 0.0)
    total = good.sum(axis=1)
    note = ''
    if np.ptp(total) < 0.5 * (high - low).min():
        note = (f'only the sum of delay and time_constant is well determined: '
                f'{total.min():.3f} to {total.max():.3f} s')
    delay, lag = after
    keys = {name: Change(present[i], value, float(low[i]), float(high[i])) for i, (name, value) in
            enumerate((('thrusters.delay', max(delay, 0.0)), ('thrusters.time_constant', lag)))}
    if delay < 0.0:
        keys.update(latencies(settings, {'thrusters': -delay}))
    return Stage(keys, choice.gain, choice.spread, note)


def with_other_lag(timing: Timing, dofs: Sequence[Dof], log: TuningLog,
                   thrusters: ThrusterSettings, settings: Settings, each: ParallelMap) -> Timing:
    """
    Return the timing with a lag of another kind, where that clearly predicts better.

    The force lags, or the propellers' turns do, which a torque may drive. The ``timing`` was found
    with ``thrusters``; the other kinds take about the same delay and lag.
    """
    if thrusters.hold == 'linear':  # only of commands that are held the turns are known
        return timing
    before = log.commanded(thrusters)

    def scores(force: CommandedForce, pairs: Sequence[Pair]) -> Sequence[Array]:
        return each(lambda k: dofs[k].fit(force, pairs).errors, range(len(dofs)))

    as_before = (settings.thrusters.delay, settings.thrusters.time_constant)
    now = scores(before, [timing.pair])
    torque = float(f'{before.usual:.3g}')
    for kind in (Kind(False, 0.0), Kind(True, 0.0), Kind(True, torque)):
        if kind.of_turns == timing.kind.of_turns and (kind.at > 0.0) == (timing.kind.at > 0.0):
            continue
        other = log.commanded(kind.of(thrusters))
        delay, lag = timing.pair
        near = [(a, b) for a in _near(delay, DELAYS, 1.0) for b in _near(lag, LAGS, 1.0)
                if a >= min(delay, 0.0)]
        pairs, errors = search_pairs(timing.pair, near, (DELAYS, LAGS), partial(scores, other),
                                     lambda share: None)
        choice = _choose_after(now, errors)
        if not (choice.index and choice.is_better) or choice.contradicted:
            continue
        after, now = pairs[choice.index - 1], [own[[choice.index - 1]] for own in errors]
        gained = _choose_after(scores(before, [as_before]), errors)
        stage = _stage(gained, after, [pairs[i - 1] for i in choice.as_good if i], settings)
        keys = {**stage.keys, **{name: Change(old, new) for name, old, new in zip(
            KIND, Kind.in_use(settings.thrusters), kind) if new != old}}
        timing = Timing(replace(stage, keys=keys), after, kind, None)
    return timing


def _choose_after(first: Sequence[Array], errors: Sequence[Array]) -> Choice:
    """Choose among some candidates, with one before them that is in use."""
    return choose([np.concatenate(both) for both in zip(first, errors)], 0)


def late_input(sources: Sequence[str], pairs: list[Pair], errors: list[Array], shared: int,
               settings: Settings, scores: Callable[[Sequence[Pair]], Sequence[Array]],
               ) -> Stage | None:
    """
    Find an input whose DOFs answer the thrust later than all others; None if there is none.

    Thrusters have one delay: what comes to it in the DOFs of one input is that input's latency.
    ``pairs`` of delay and lag have the ``errors`` of ``search_pairs``, and the one of index
    ``shared`` suits all DOFs best. ``sources`` are the inputs by which the DOFs are measured.
    """
    if len({*sources}) < 2:
        return None
    found = [_Late(name, sources, pairs, errors, shared) for name in dict.fromkeys(sources)]
    late = max(found, key=lambda late: late.choice.gain - late.choice.spread)
    for finer in FINER:
        if not late.choice.is_better:
            return None
        i, j = late.best
        lags = _near(pairs[i][1], LAGS, finer)
        new = [pair for pair in dict.fromkeys(
            (delay, lag) for k in (i, j) for lag in lags
            for delay in _near(pairs[k][0], DELAYS, finer) if delay >= 0.0) if pair not in pairs]
        if new:
            errors = [np.concatenate(both) for both in zip(errors, scores(new))]
            pairs = pairs + new
        late = _Late(late.name, sources, pairs, errors, shared)
    choice = late.choice
    if not choice.is_better:
        return None
    latency = late.latencies[choice.index]
    keys = latencies(settings, {late.name: latency})
    good = [latency, *[late.latencies[k] for k in choice.as_good]]
    key = f'{late.name}.latency'
    keys[key] = replace(keys[key], low=keys[key].before + min(good),
                        high=keys[key].before + max(good))
    return Stage(keys, choice.gain, choice.spread)


class _Late:
    """How well all is predicted if one input comes late."""

    def __init__(self, name: str, sources: Sequence[str], pairs: Sequence[Pair],
                 errors: Sequence[Array], shared: int) -> None:
        self.name = name
        cases = [(shared, shared), *[
            (i, j) for i, (late, lag) in enumerate(pairs) for j, (delay, its) in enumerate(pairs)
            if its == lag and late > delay >= 0.0]]
        self.latencies = [pairs[i][0] - pairs[j][0] for i, j in cases]
        own, others = np.array(cases).T
        self.choice = choose([error[own if source == name else others]
                              for error, source in zip(errors, sources)], 0)
        self.best = cases[self.choice.index]


def latencies(settings: Settings, more: dict[str, float]) -> dict[str, Change]:
    """Return what changes where inputs come by so much [s] later than their latency says."""
    before = settings.latencies()
    after = {name: latency + more.get(name, 0.0) for name, latency in before.items()}
    changes = {f'{name}.latency': Change(before[name], after[name]) for name in more}
    wait = LEAST_WAIT + max(after.values()) - min(after.values())
    if 0.0 <= settings.max_wait < wait:
        changes['max_wait'] = Change(settings.max_wait, wait)
    return changes
