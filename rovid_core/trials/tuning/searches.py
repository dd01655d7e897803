"""
The searches for dead-band, dead zone, reverse thrust, couplings and terms.

Each search proposes candidates, has a model fitted for each, and takes the one that predicts
held-out blocks best if it gains more than chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from rovid_core.model.dofs import PARAMETERS
from rovid_core.model.plant import Array
from rovid_core.settings.inputs import ThrusterSettings
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

# Of a large command: the dead-bands and dead zones that are tried first.
SHARES = (0.0, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3)
LARGE = 0.95  # quantile of the sizes of the commands that counts as a large one
REVERSE_KEY = 'thrusters.reverse'
# Force of a negative command relative to that of the same positive one, tried first.
REVERSE = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.3)
# Then these are tried around the best one, in shares of the way to its neighbours.
CURVE_FINER = (-0.75, -0.5, -0.25, 0.25, 0.5, 0.75)
FINER = 2  # times


def large_command(log: TuningLog, thrusters: ThrusterSettings) -> float:
    """Return the size of a large command in a log, behind offset and scale."""
    sizes = np.abs((log.commands() - thrusters.offset) * thrusters.scale)
    return float(np.quantile(sizes[sizes > 0.0], LARGE)) if (sizes > 0.0).any() else 1.0


def tune_curve(log: TuningLog, dofs: Sequence[Dof], thrusters: ThrusterSettings,
               pair: tuple[float, float]) -> tuple[list[Stage], ThrusterSettings]:
    """
    Find what all thrusters share: dead-band, dead zone and reverse thrust; return the thrusters.

    What gains more is taken first, for one can look like the other. ``pair`` is delay and lag of
    the thrust [s].
    """
    small = [share * large_command(log, thrusters) for share in SHARES]
    keys = {'deadband': small, 'dead_zone': small, 'reverse': REVERSE}
    found: dict[str, Stage] = {}
    while len(found) < len(keys):
        stages = {key: _tune_key(_Candidates(key, log, dofs, thrusters, pair), first)
                  for key, first in keys.items() if key not in found}
        best = max(stages, key=lambda key: stages[key][0].gain - stages[key][0].spread)
        found[best], changed = stages[best]
        if changed == thrusters:
            found.update({key: stage for key, (stage, _) in stages.items()})
        thrusters = changed
    return [found[key] for key in keys], thrusters


def _tune_key(candidates: _Candidates,
              first: Sequence[float]) -> tuple[Stage, ThrusterSettings]:
    """Try ``first``, then what lies around the best of them, and around the best of these."""
    candidates.add([candidates.present, *first])
    for _ in range(FINER):
        grid = sorted(candidates.tried)
        i = grid.index(candidates.tried[candidates.choice.index])
        candidates.add([
            grid[i] + abs(share) * (grid[i + step] - grid[i])
            for share in CURVE_FINER for step in (-1 if share < 0.0 else 1,)
            if 0 <= i + step < len(grid)])
    choice = candidates.choice
    found = candidates.tried[choice.index if choice.is_better else 0]
    good = [found, *[candidates.tried[k] for k in choice.as_good]]
    change = Change(candidates.present, found, min(good), max(good))
    key, note = f'thrusters.{candidates.key}', ''
    if found != candidates.present and found in (max(first), min(first)) and found > 0.0:
        note = (f'{key}: {found:g} is the end of what is tried: something else than the thrusters '
                'looks like it')
    return Stage({key: change}, choice.gain, choice.spread, note), candidates.thrusters(found)


class _Candidates:
    """Values of one key of the thrusters that were tried; the first one is the present one."""

    def __init__(self, key: str, log: TuningLog, dofs: Sequence[Dof],
                 thrusters: ThrusterSettings, pair: tuple[float, float]) -> None:
        self.key, self.present = key, float(getattr(thrusters, key))
        self._log, self._dofs, self._pair, self._thrusters = log, dofs, pair, thrusters
        self.tried: list[float] = []
        self._errors: list[list[Array]] = [[] for _ in dofs]

    def thrusters(self, value: float) -> ThrusterSettings:
        """Return the thrusters with another value."""
        changed: dict[str, Any] = {self.key: value}
        return replace(self._thrusters, **changed)

    @property
    def choice(self) -> Choice:
        """Return the best one."""
        return choose([np.concatenate(parts) for parts in self._errors], 0)

    def add(self, values: Sequence[float]) -> None:
        """Fit and score models with further values."""
        new = [value for value in dict.fromkeys(values) if value not in self.tried]
        if not new:
            return
        forces = [self._log.commanded(self.thrusters(value)) for value in new]
        for parts, dof in zip(self._errors, self._dofs):
            parts.append(dof.fit_commands(forces, self._pair))
        self.tried += new


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


def tune_couplings(dof: Dof, commanded: CommandedForce, pair: tuple[float, float],
                   left_out: Sequence[str] = ()) -> ListChange:
    """
    Add couplings to a DOF, the best one first, as long as it clearly predicts better with it.

    Those that it has stay, and none that is ``left_out`` is added.
    """
    before = after = dof.settings.couplings
    while True:
        sets = [after, *((*after, name) for name in dof.possible
                         if name not in (*after, *left_out))]
        errors = dof.fit_models(commanded, pair, [
            replace(dof.settings, couplings=names) for names in sets])
        if after == before:
            first = errors[0]
        choice = choose([errors], 0)
        if not choice.is_better:
            break
        after = sets[choice.index]
    return ListChange(f'{dof.name}.couplings', before, after, *gain_of(first, errors[0]))


def tune_terms(dof: Dof, commanded: CommandedForce, pair: tuple[float, float]) -> ListChange:
    """
    Add terms to a DOF that clearly predicts better with them.

    Those that it has stay. A drag that one log could do without is not zero: without it the others
    are wrong, and their intervals too narrow.
    """
    before = dof.settings.terms
    more = [name for name in PARAMETERS if name not in before]
    candidates = [before, *((*before, *others) for count in range(1, len(more) + 1)
                            for others in combinations(more, count))]
    choice = choose([dof.fit_models(commanded, pair, [
        replace(dof.settings, terms=terms) for terms in candidates])], 0)
    return ListChange(f'{dof.name}.terms', before,
                      candidates[choice.index] if choice.is_better else before,
                      choice.gain, choice.spread)


def with_couplings(
        dofs: Sequence[Dof], commanded: CommandedForce, pair: tuple[float, float],
        each: ParallelMap, left_out: Sequence[str] = ()) -> tuple[list[Dof], Sequence[ListChange]]:
    """Return the DOFs with the couplings that the log wants, and what that changes."""
    found = each(lambda k: tune_couplings(dofs[k], commanded, pair, left_out), range(len(dofs)))
    return [dof.with_settings(replace(dof.settings, couplings=names.after))
            for dof, names in zip(dofs, found)], found


class Models:
    """The DOFs of a reading with the couplings that they want with some thrusters."""

    def __init__(self, log: TuningLog, dofs: Sequence[Dof], thrusters: ThrusterSettings,
                 pair: tuple[float, float], each: ParallelMap) -> None:
        self.commanded = log.commanded(thrusters)
        self.dofs, self.couplings = with_couplings(dofs, self.commanded, pair, each)
        # shape (FOLDS, parts), by DOF, on held-out folds [m/s or rad/s]
        self.errors = each(lambda k: self.dofs[k].fit_models(
            self.commanded, pair, [self.dofs[k].settings])[0], range(len(self.dofs)))
