"""The search for delay and lag of the thrust, and for the latency of its messages."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from rovid_core.model.trajectory import Array
from rovid_core.settings.run import LEAST_WAIT, Settings
from rovid_core.trials.tuning.cross_validation import (
    Change,
    choose,
    ParallelMap,
    relative,
    Stage,
    WORTH,
)
from rovid_core.trials.tuning.dof_fit import Dof
from rovid_core.trials.tuning.log import CommandedForce

# [s] where the search begins; below 0 commands are stamped later than the motion that they cause
DELAYS = (-0.6, -0.35, -0.2, -0.1, 0.0, 0.05, 0.1, 0.2, 0.35, 0.6, 1.0)
LAGS = (0.0, 0.1, 0.2, 0.4, 0.7, 1.2, 2.0)
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
        Returns the error of some pairs per DOF, each of shape (pairs, FOLDS).
    done : callable
        Is told which share is done.

    Returns
    -------
    pairs : list of tuples of 2 floats
        All that were tried.
    errors : list of ndarray, shape (pairs, FOLDS)
        By DOF.

    """
    pairs = [present, *(pair for pair in first if pair != present)]
    found = list(scores(pairs))
    for k, finer in enumerate(FINER):
        done((k + 1) / (1 + len(FINER)))
        best = pairs[choose(relative(found, 0), 0).index]
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


def tune_thrust(dofs: Sequence[Dof], commanded: CommandedForce, settings: Settings,
                each: ParallelMap, done: Callable[[float], None]) -> tuple[Stage, Pair]:
    """
    Find delay and lag, which all thrusters share; return also both as they are to be used.

    A delay below 0 says that commands are stamped late: it becomes their latency.
    """
    present = (settings.thrusters.delay, settings.thrusters.time_constant)
    first = [(delay, lag) for delay in DELAYS for lag in LAGS
             if delay >= 0.0 or lag <= LARGEST_EARLY]
    pairs, errors = search_pairs(
        present, first, (DELAYS, LAGS), lambda new: each(
            lambda k: dofs[k].fit(commanded, new), range(len(dofs))), done)
    together = relative(errors, 0)
    causal = np.array([pair[0] >= 0.0 for pair in pairs])
    choice = choose(np.where(causal[:, None], together, np.inf), 0)
    late = choose(together, choice.index)
    # late stamps show in all DOFs, but one under control may seem to answer before its thrust
    if late.gain > max(late.spread, WORTH) and all(
            error[late.index].mean() < error[choice.index].mean() for error in errors):
        choice = choose(together, 0)
    delay, lag = after = pairs[choice.index] if choice.is_better else present
    good = np.array([after, *[pairs[i] for i in choice.as_good]])
    low, high = np.maximum(good.min(axis=0), 0.0), np.maximum(good.max(axis=0), 0.0)
    total = good.sum(axis=1)
    note = ''
    if np.ptp(total) < 0.5 * (high - low).min():
        note = (f'only the sum of delay and time_constant is well determined: '
                f'{total.min():.3f} to {total.max():.3f} s')
    keys = {name: Change(present[i], value, float(low[i]), float(high[i])) for i, (name, value) in
            enumerate((('thrusters.delay', max(delay, 0.0)), ('thrusters.time_constant', lag)))}
    if delay < 0.0:
        keys.update(latencies(settings, {'thrusters': -delay}))
    return Stage(keys, choice.gain, choice.spread, note), after


def latencies(settings: Settings, more: dict[str, float]) -> dict[str, Change]:
    """Return what changes where inputs come by so much [s] later than their latency says."""
    before = settings.latencies()
    after = {name: latency + more.get(name, 0.0) for name, latency in before.items()}
    changes = {f'{name}.latency': Change(before[name], after[name]) for name in more}
    wait = LEAST_WAIT + max(after.values()) - min(after.values())
    if 0.0 <= settings.max_wait < wait:
        changes['max_wait'] = Change(settings.max_wait, wait)
    return changes
