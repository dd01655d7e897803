"""The DOFs that a log can be tuned with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np
from rovid_core.model.trajectory import Array
from rovid_core.settings.run import DofSettings, Scales, Settings
from rovid_core.trials.tuning.blocks import Blocks, blocks, edges, FOLDS
from rovid_core.trials.tuning.commanded import Commanded
from rovid_core.trials.tuning.log import Stretch, TuningLog
from rovid_core.trials.tuning.model import Models, OutputError

LEAST_TIME = 60.0
"""[s] of steps, for less the blocks are too short to be predicted."""

LEAST_GAIN = 0.05
"""A model has to be this much better than a constant velocity for a DOF to count."""


class Dof:
    """
    One DOF that is tuned with.

    Parameters
    ----------
    name : str
        Of the DOF.
    row : int
        Of its force.
    stretches : list of Stretch
        Its motion.
    blocks : Blocks
        The same in blocks.
    settings : DofSettings
        With typical sizes from the data.
    cutoff : float
        Of the low-pass through which predictions are compared [Hz].

    """

    def __init__(self, name: str, row: int, stretches: list[Stretch], blocks: Blocks,
                 settings: DofSettings, cutoff: float) -> None:
        self.name, self.row, self.stretches, self.blocks = name, row, stretches, blocks
        self.settings, self.cutoff = settings, cutoff
        self.problem = OutputError(blocks, Scales.of(settings), cutoff)
        self._begin: Array | None = None  # scaled parameters to begin with
        self._models: dict[tuple[float, float], Models] = {}

    def fit_commands(self, candidates: Sequence[Commanded], pair: tuple[float, float]) -> Models:
        """Fit and score a model for each way in which commands become a force."""
        force = [self.blocks.force(commanded, self.row, *pair) for commanded in candidates]
        return self.problem.fit(np.stack(force, 1), None, self._begin_of(force[0]), 6)

    def fit_terms(self, commanded: Commanded, pair: tuple[float, float],
                  terms: tuple[str, ...]) -> Models:
        """Fit and score a model with other terms."""
        problem = OutputError(
            self.blocks, Scales.of(replace(self.settings, terms=terms)), self.cutoff)
        return problem.fit(self.blocks.force(commanded, self.row, *pair)[:, None], iterations=30)

    def fit(self, commanded: Commanded, pairs: Sequence[tuple[float, float]],
            measured: Array | None = None) -> Models:
        """Fit and score a model for each pair of delay and lag."""
        force = np.stack([self.blocks.force(commanded, self.row, *pair) for pair in pairs], 1)
        if measured is not None:
            force = np.broadcast_to(force, measured.shape)
        return self.problem.fit(force, measured, self._begin_of(force[:, 0]), 6)

    def _begin_of(self, force: Array) -> Array:
        """Return the parameters that a fit begins with; they are found once."""
        if self._begin is None:
            self._begin = self.problem.fit(force[:, None], iterations=30).theta[0]
        return self._begin

    def model(self, commanded: Commanded, pair: tuple[float, float]) -> Models:
        """Return the model for one pair of delay and lag; it is fitted once."""
        if pair not in self._models:
            self._models[pair] = self.fit(commanded, [pair])
        return self._models[pair]


def typical(blocks: Blocks, force: Array, settings: DofSettings) -> DofSettings:
    """Return a DOF with the amplitudes of sinusoids as large as its force and velocity."""
    rms = [math.sqrt(2.0 * float(np.mean(x[blocks.valid] ** 2)))
           for x in (force, blocks.measured)]
    return replace(settings, typical_force=rms[0], typical_velocity=rms[1])


def usable(log: TuningLog, settings: Settings, name: str,
           commanded: Commanded) -> Dof | str:
    """Return a DOF, or why nothing can be tuned with it."""
    stretches = log.stretches(name)
    time = sum(int(s.ends[-1]) - s.start for s in stretches) * 1e-9
    if time < LEAST_TIME:
        return f'{time:.0f} s of steps, takes {LEAST_TIME:.0f} s'
    parts = blocks(stretches, edges(stretches))
    if parts is None:
        return f'an eighth of the log without steps, takes steps in each of {FOLDS} parts'
    row = settings.dofs.index(name)
    thrusters = settings.thrusters
    pair = (thrusters.delay, thrusters.time_constant)
    force = parts.force(commanded, row, *pair)
    if np.ptp(force[parts.valid]) <= 1e-9 * max(1.0, float(np.abs(force).max())):
        return 'no thrust that changes'
    if not np.ptp(parts.measured[parts.valid]):
        return 'no motion'
    dof = Dof(name, row, stretches, parts, typical(parts, force, settings.dof[name]),
              settings.cutoff)
    error = float(dof.model(commanded, pair).scores.mean())
    level = parts.measured - parts.by_fold(parts.measured).mean()
    still = float(np.abs(np.where(parts.valid, level, 0.0)).sum() / parts.valid.sum())
    if not error < (1.0 - LEAST_GAIN) * still:
        return 'a motion that its thrust does not explain'
    return dof
