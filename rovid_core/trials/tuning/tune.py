"""
Finding what a parameter file has to say of a vehicle, from a log by cross-validation.

That is delay, lag, dead-band and reverse thrust, heading offset, couplings and terms.

The log is divided into blocks of time. What is found is that with which a model that output
error fitted to the other blocks predicts a block best. Nothing is changed that does not gain
more than chance; only a term is left out as soon as the model predicts as well without it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from rovid_core.model.dofs import OWN
from rovid_core.settings.run import DofSettings, IdentifierSettings, Settings
from rovid_core.trials.tuning.cross_validation import (
    blocks,
    fold_bounds,
    ParallelMap,
    Result,
    Stage,
)
from rovid_core.trials.tuning.dof_fit import Dof, dof_or_reason
from rovid_core.trials.tuning.log import CommandedForce, TuningLog, turnable, turned
from rovid_core.trials.tuning.searches import (
    ListChange,
    tune_couplings,
    tune_deadband,
    tune_heading,
    tune_reverse,
    tune_terms,
    tune_thrust,
)

UNUSED = DofSettings(1.0)  # a DOF that is only looked at
DIGITS = 4  # what is written of a value; the data never tell more


class TuningError(ValueError):
    """A log that tells nothing; the text is the line to print."""


@dataclass(frozen=True)
class Tuned:
    """What was found."""

    stages: tuple[Stage, ...]  # keys that were sought together
    lists: tuple[ListChange, ...]  # couplings and terms of each DOF
    # per DOF before and after: mean absolute error of the velocity that models predict on held-out
    # blocks [m/s or rad/s]
    errors: Mapping[str, tuple[float, float]]
    left_out: Mapping[str, str]  # why nothing was tuned with a DOF, by name

    def changes(self) -> dict[str, float | tuple[str, ...]]:
        """Return the keys that have a better value, with that."""
        changes: dict[str, float | tuple[str, ...]] = {
            key: change.after for stage in self.stages
            for key, change in stage.keys.items() if change.after != change.before}
        changes.update({names.key: names.after for names in self.lists
                        if names.after != names.before})
        return changes


def reading_settings(settings: Settings) -> Settings:
    """
    Return the settings with which a log is read to be tuned.

    Of the plane both DOFs, for a wrong heading shows in the one that has no thrust; all couplings
    of which the regressors are measured; and the simplest identifier, for what it finds is not
    used.
    """
    dofs, pair = settings.dofs, turnable(settings)
    dofs += tuple(dof for dof in pair or () if dof not in dofs)
    seen = replace(settings, dofs=dofs, dof={d: settings.dof.get(d, UNUSED) for d in dofs},
                   identifier=IdentifierSettings())
    return replace(seen, dof={d: replace(
        seen.dof[d], couplings=(*seen.possible_couplings(d), *OWN)) for d in dofs})


def one_by_one(work: Callable[[int], Result], given: Sequence[int]) -> list[Result]:
    """Return ``work`` of each."""
    return [work(k) for k in given]


def tune(log: TuningLog, settings: Settings, done: Callable[[float], None] = lambda share: None,
         each: ParallelMap = one_by_one) -> Tuned:
    """
    Tune with a log that was read with ``reading_settings``; TuningError if it tells nothing.

    ``done`` is told now and then which share of the work is done.
    """
    if log.jumped:
        raise TuningError('time jumps back in it: take a part of it with --start and --duration')
    seen = reading_settings(settings)
    commanded = log.commanded()
    found = {name: dof_or_reason(log, seen, name, settings.dof[name], commanded)
             for name in settings.dofs}
    left_out = {name: why for name, why in found.items() if isinstance(why, str)}
    old = [dof for dof in found.values() if isinstance(dof, Dof)]
    if not old:
        raise TuningError('nothing to tune with: ' + '; '.join(
            f'{name}: {why}' for name, why in left_out.items()))
    done(0.05)
    present = (settings.thrusters.delay, settings.thrusters.time_constant)
    heading = tune_heading(log, old, commanded, seen, present)
    stages = [_rounded(heading)] if heading else []
    new = _with_heading(log, old, heading, commanded, seen, present)
    done(0.1)
    is_turned = new is not old
    couplings: Sequence[ListChange] = ()
    if is_turned:
        # their regressors are products of velocities along axes that are turned now
        stages[0] = replace(stages[0], note='couplings were not sought, for they follow the '
                                            'heading: tune again with the new file')
    else:
        # what they explain hides the rest
        new, _ = _with_couplings(old, commanded, present, each)
    done(0.2)
    stages.append(_rounded(tune_thrust(
        new, commanded, settings, each, lambda share: done(0.2 + 0.5 * share))))
    delay, lag = (change.after for change in stages[-1].keys.values())
    thrusters = seen.thrusters
    for search in (tune_deadband, tune_reverse):
        stage, thrusters = search(log, new, thrusters, (delay, lag))
        stages.append(_rounded(stage))
    done(0.8)
    curved = log.commanded(thrusters)
    if not is_turned:
        # and the rest hid some of them, or looked like one
        new, couplings = _with_couplings(old, curved, (delay, lag), each)
    done(0.9)
    terms = each(lambda k: tune_terms(new[k], curved, (delay, lag)), range(len(new)))
    errors = {}
    for before, dof, names in zip(old, new, terms):
        found_last = replace(dof.settings, terms=names.after)
        error = dof.fit_with(curved, (delay, lag), found_last).scores.mean()
        errors[dof.name] = (_error(before, commanded, present), float(error))
    return Tuned(tuple(stages), (*couplings, *terms), errors, left_out)


def _with_heading(log: TuningLog, dofs: list[Dof], heading: Stage | None,
                  commanded: CommandedForce, settings: Settings,
                  pair: tuple[float, float]) -> list[Dof]:
    """Return the DOFs as they are with the new heading."""
    names = turnable(settings)
    if heading is None or names is None:
        return dofs
    change = heading.keys['attitude.yaw_offset']
    if change.after == change.before:
        return dofs
    forward, sideways = turned(log.segments(names[0]), log.segments(names[1]),
                               change.after - change.before)
    moved = {names[0]: forward, names[1]: sideways}
    made = []
    for dof in dofs:
        segments = moved.get(dof.name, dof.segments)
        parts = blocks(segments, fold_bounds(segments)) if dof.name in moved else None
        made.append(dof if parts is None else Dof(
            dof.name, dof.row, segments, parts, dof.settings, dof.cutoff, dof.possible))
    return made


def _with_couplings(dofs: Sequence[Dof], commanded: CommandedForce, pair: tuple[float, float],
                    each: ParallelMap) -> tuple[list[Dof], Sequence[ListChange]]:
    """Return the DOFs with the couplings that the log wants, and what that changes."""
    found = each(lambda k: tune_couplings(dofs[k], commanded, pair), range(len(dofs)))
    return [dof.with_settings(replace(dof.settings, couplings=names.after))
            for dof, names in zip(dofs, found)], found


def _error(dof: Dof, commanded: CommandedForce, pair: tuple[float, float]) -> float:
    return float(dof.model(commanded, pair).scores.mean())


def _rounded(stage: Stage) -> Stage:
    """Return a stage whose new values are written with few digits."""
    return replace(stage, keys={
        key: change if change.after == change.before else
        replace(change, after=float(f'{change.after:.{DIGITS}g}'))
        for key, change in stage.keys.items()})
