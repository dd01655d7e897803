"""What has to be added to the heading, from the direction in which thrust moves."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np
from rovid_core.model.trajectory import Array
from rovid_core.settings.run import Settings
from rovid_core.trials.tuning.blocks import blocks, edges, FOLDS
from rovid_core.trials.tuning.choice import Change, choose, Stage
from rovid_core.trials.tuning.commanded import Commanded
from rovid_core.trials.tuning.dof import Dof
from rovid_core.trials.tuning.log import Stretch, TuningLog, turnable, turned

TURN = math.radians(15.0)
FINER = (0.25, 0.0625, 0.0156)
"""Around the best so far the grid of ``TURN`` is refined to this share."""


def tune_heading(log: TuningLog, dofs: Sequence[Dof], commanded: Commanded,
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
    both = [log.stretches(name) for name in names]
    found = _Turned(both, [own.get(name) for name in names], commanded, pair)
    angles = [0.0, *(k * TURN for k in range(-12, 12) if k)]
    scores = found.scores(angles)
    choice = choose(scores, 0)
    for share in FINER:
        middle = angles[choice.index]
        new = [middle + k * share * TURN for k in (-4, -3, -2, -1, 1, 2, 3, 4)]
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

    def __init__(self, both: list[list[Stretch]], own: list[Dof | None],
                 commanded: Commanded, pair: tuple[float, float]) -> None:
        self._both, self._own = both, own
        self._commanded, self._pair = commanded, pair
        self._bounds = edges(both[0])

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
