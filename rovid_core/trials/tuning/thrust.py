"""Delay and lag of the thrust, by output error on held-out blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from rovid_core.model.trajectory import Array
from rovid_core.settings.run import Settings
from rovid_core.trials.tuning.choice import Change, Choice, choose, Each, relative, Stage
from rovid_core.trials.tuning.commanded import Commanded
from rovid_core.trials.tuning.dof import Dof

DELAYS = (0.0, 0.05, 0.1, 0.2, 0.35, 0.6, 1.0)
LAGS = (0.0, 0.1, 0.2, 0.4, 0.7, 1.2, 2.0)
"""[s] where the search begins."""

FINER = (0.5, 0.125)
"""Around the best so far the grid is refined to this share of its spacing."""


def tune_thrust(dofs: Sequence[Dof], commanded: Commanded, settings: Settings,
                each: Each, done: Callable[[float], None]) -> Stage:
    """Find delay and lag, which all thrusters share."""
    present = (settings.thrusters.delay, settings.thrusters.time_constant)
    pairs = [present]
    scores: list[list[Array]] = [[] for _ in dofs]

    def add(wanted: Sequence[tuple[float, float]]) -> Choice:
        new = [pair for pair in dict.fromkeys(wanted) if pair not in pairs[1:]]
        found = each(lambda k: dofs[k].fit(commanded, new).scores, range(len(dofs)))
        for kept, one in zip(scores, found):
            kept.append(one)
        done(len(kept) / (1 + len(FINER)))
        pairs.extend(new if len(kept) > 1 else new[1:])
        return choose(relative([np.concatenate(kept) for kept in scores], 0), 0)

    choice = add([present, *((d, lag) for d in DELAYS for lag in LAGS)])
    for finer in FINER:
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
