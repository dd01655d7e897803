"""The dead-band of the thrusters, by output error on held-out blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from rovid_core.model.trajectory import Array
from rovid_core.settings.run import Settings
from rovid_core.trials.tuning.choice import Change, Choice, choose, relative, Stage
from rovid_core.trials.tuning.commanded import Commanded
from rovid_core.trials.tuning.dof import Dof
from rovid_core.trials.tuning.log import TuningLog

KEY = 'thrusters.deadband'

SHARES = (0.0, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3)
"""Of a large command: the dead-bands that are tried first."""

LARGE = 0.95
"""Quantile of the sizes of the commands that counts as a large one."""

FINER = (-0.75, -0.5, -0.25, 0.25, 0.5, 0.75)
"""Then these are tried around the best one, in shares of the way to its neighbours."""


def tune_deadband(log: TuningLog, dofs: Sequence[Dof], settings: Settings,
                  pair: tuple[float, float]) -> tuple[Stage, Commanded]:
    """
    Find the dead-band, which all thrusters share.

    Parameters
    ----------
    log : TuningLog
        Has the raw commands.
    dofs : sequence of Dof
        The DOFs whose models are to predict well.
    settings : Settings
        As they are.
    pair : tuple of 2 floats
        Delay and lag of the thrust [s].

    Returns
    -------
    stage : Stage
        What was found.
    commanded : Commanded
        The force with the dead-band that was found.

    """
    present = settings.thrusters.deadband
    candidates = _Candidates(log, dofs, settings, pair)
    candidates.add([present, *(share * candidates.large for share in SHARES)])
    grid = sorted(candidates.tried)
    i = grid.index(candidates.tried[candidates.choice.index])
    candidates.add([
        grid[i] + abs(share) * (grid[i + step] - grid[i])
        for share in FINER for step in (-1 if share < 0.0 else 1,) if 0 <= i + step < len(grid)])
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
        self.commanded: list[Commanded] = []
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
