"""
Finding what a parameter file has to say of a vehicle, from a log by cross-validation.

That is heading offset, clocks, delay, lag, dead-band, dead zone, reverse thrust, couplings and
terms.

The log is divided into blocks of time. What is found is that with which a model that output
error fitted to the other blocks predicts a block best. Nothing is changed that does not gain
more than chance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np
from rovid_core.model.dofs import OWN
from rovid_core.model.plant import Array
from rovid_core.settings.run import DofSettings, IdentifierSettings, Settings, ThrusterSettings
from rovid_core.trials.tuning.cross_validation import (
    Change,
    choose,
    FOLDS,
    ParallelMap,
    PART,
    Result,
    Stage,
    time_of,
)
from rovid_core.trials.tuning.dof_fit import Dof, dof_or_reason
from rovid_core.trials.tuning.heading import (
    HEADING,
    LATENCY,
    latency_note,
    tune_heading,
    tune_latency,
)
from rovid_core.trials.tuning.log import CommandedForce, TuningLog, turnable
from rovid_core.trials.tuning.searches import (
    ListChange,
    REVERSE_KEY,
    tune_couplings,
    tune_curve,
    tune_terms,
)
from rovid_core.trials.tuning.timing import Pair, Timing, tune_thrust, with_other_lag

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
        changes: dict[str, float | tuple[str, ...]] = {}
        for stage in self.stages:
            changes.update(_changes(stage))
        changes.update({names.key: names.after for names in self.lists
                        if names.after != names.before})
        return changes


def reading_settings(settings: Settings) -> Settings:
    """
    Return the settings with which a log is read to be tuned.

    Of the plane both DOFs, for a wrong heading shows in the one that has no thrust; all couplings
    of which the regressors are measured, also by an input that no DOF is identified from; and the
    simplest identifier, for what it finds is not used.
    """
    dofs, pair = settings.dofs, turnable(settings)
    dofs += tuple(dof for dof in pair or () if dof not in dofs)
    seen = replace(settings, dofs=dofs, dof={d: settings.dof.get(d, UNUSED) for d in dofs},
                   identifier=IdentifierSettings())
    return replace(seen, dof={d: replace(
        seen.dof[d], couplings=tuple(dict.fromkeys((
            *seen.possible_couplings(d), *OWN, *seen.couplings(d))))) for d in dofs})


def one_by_one(work: Callable[[int], Result], given: Sequence[int]) -> list[Result]:
    """Return ``work`` of each."""
    return [work(k) for k in given]


def tune(read: Callable[[Settings], TuningLog], settings: Settings,
         done: Callable[[float], None] = lambda share: None,
         each: ParallelMap = one_by_one) -> Tuned:
    """
    Tune with a log; TuningError if it tells nothing.

    Parameters
    ----------
    read : callable
        Reads the log as some settings say, with ``reading_settings`` of them.
    settings : Settings
        Those in use.
    done : callable
        Is told now and then which share of the work is done.
    each : callable
        Does the same work on many things.

    """
    now = _read(read, settings, settings.thrusters)
    done(0.05)
    pair = (settings.thrusters.delay, settings.thrusters.time_constant)
    before = {dof.name: dof.error for dof in now.dofs}
    stages = []
    # what the thrusters lack hides what is late, and the other way round: it is sought twice
    _, rough = tune_curve(now.log, now.dofs, settings.thrusters, pair)
    now = replace(now, commanded=now.log.commanded(rough))
    # with other headings the log is another one: it is read again
    heading = tune_heading(now.log, now.dofs, now.commanded, settings, pair)
    if heading is not None:
        stages.append(_rounded(heading))
        if _changes(heading):
            now = _read(read, replace(settings, yaw_offset=stages[-1].keys[HEADING].after), rough)
    turns = tune_latency(now.log, now.dofs, now.commanded, now.settings, pair,
                         lambda share: done(0.05 + 0.15 * share))
    timed = _timed(now, pair, each, lambda share: done(0.2 + 0.25 * share))
    latest = []
    if turns is not None:
        now, timed, stage = _if_better(read, now, timed, turns, rough, pair, each)
        latest.append(stage)
    late = timed.timing.late
    if late is not None:
        now, timed, stage = _if_better(read, now, timed, late, rough, pair, each)
        if _changes(stage):
            # turns tell less of a latency than the thrust does, where that tells it
            latest = [one for one in latest if _changes(one)] + [stage]
            turns = stage
    stages += latest
    done(0.6)
    timing = with_other_lag(timed.timing, timed.dofs, now.log, rough, now.settings, each)
    stages.append(_rounded(timing.stage))
    done(0.7)
    coupled, pair = timed.dofs, timing.pair
    thrusters = timing.kind.of(settings.thrusters)
    found, thrusters = tune_curve(now.log, coupled, thrusters, pair)
    done(0.8)
    # what the thrusters lacked hid some couplings, or looked like one
    first = _Models(now, thrusters, pair, each)
    if thrusters.reverse != settings.thrusters.reverse:
        # and what one DOF does in reverse looks like weaker thrusters
        own = _Models(now, replace(thrusters, reverse=settings.thrusters.reverse), pair, each)
        if choose([np.stack(both) for both in zip(first.errors, own.errors)], 0).is_better:
            first = own
            found = [_unchanged(stage) if REVERSE_KEY in stage.keys else stage for stage in found]
    stages += [_rounded(stage) for stage in found]
    coupled, couplings, commanded = first.dofs, first.couplings, first.commanded
    if turns is not None and LATENCY in turns.keys:
        note = latency_note(now.log, coupled, commanded, now.settings, pair, turns.keys[LATENCY])
        stages = [replace(stage, note=note) if stage is latest[-1] else stage for stage in stages]
    done(0.9)
    terms = each(lambda k: tune_terms(coupled[k], commanded, pair), range(len(coupled)))
    errors = {}
    for dof, names in zip(coupled, terms):
        found_last = replace(dof.settings, terms=names.after)
        error = np.nanmean(dof.fit_models(commanded, pair, [found_last]))
        errors[dof.name] = (before.get(dof.name, math.nan), float(error))
    return Tuned(tuple(stages), (*couplings, *terms), errors, now.left_out)


@dataclass(frozen=True)
class _Reading:
    """A log as some settings read it."""

    settings: Settings
    log: TuningLog
    commanded: CommandedForce
    dofs: Sequence[Dof]  # those that are tuned with
    left_out: Mapping[str, str]  # why each of the others is not


def _read(read: Callable[[Settings], TuningLog], settings: Settings,
          thrusters: ThrusterSettings) -> _Reading:
    """Read the log, for commands to such thrusters; TuningError if it tells nothing."""
    log = read(settings)
    if log.jumped:
        raise TuningError('time jumps back in it: take a part of it with --start and --duration')
    seen, commanded = reading_settings(settings), log.commanded(thrusters)
    longest = max(time_of(log.segments(name)) for name in settings.dofs)
    count = max(1, round(longest / (FOLDS * PART)))
    found = {name: dof_or_reason(log, seen, name, settings.dof[name], commanded, count)
             for name in settings.dofs}
    dofs = [dof for dof in found.values() if isinstance(dof, Dof)]
    left_out = {name: why for name, why in found.items() if isinstance(why, str)}
    if not dofs:
        raise TuningError('nothing to tune with: ' + '; '.join(
            f'{name}: {why}' for name, why in left_out.items()))
    return _Reading(settings, log, commanded, dofs, left_out)


@dataclass(frozen=True)
class _Timed:
    """What was found of delay and lag in a reading."""

    dofs: Sequence[Dof]  # with the couplings of the log
    timing: Timing
    errors: Mapping[str, Array]  # shape (FOLDS, parts), by DOF, on held-out folds [m/s or rad/s]


def _timed(now: _Reading, present: Pair, each: ParallelMap,
           done: Callable[[float], None]) -> _Timed:
    """Find delay and lag in a reading."""
    # what couplings explain hides the rest; but those of ``OWN`` would hide weaker thrusters
    dofs, _ = _with_couplings(now.dofs, now.commanded, present, each, OWN)
    timing = tune_thrust(dofs, now.commanded, now.settings, each, done)
    return _Timed(dofs, timing, {
        dof.name: dof.fit(now.commanded, [timing.pair]).errors[0] for dof in dofs})


def _if_better(read: Callable[[Settings], TuningLog], now: _Reading, timed: _Timed, late: Stage,
               thrusters: ThrusterSettings, present: Pair,
               each: ParallelMap) -> tuple[_Reading, _Timed, Stage]:
    """Read the log again with later inputs; return it and the stage as it was, or better."""
    late = _rounded(late)
    if not _changes(late):
        return now, timed, late
    try:
        other = _read(read, _with_latencies(now.settings, late), thrusters)
    except TuningError:  # so late nothing can be made of it
        return now, timed, _unchanged(late)
    found = _timed(other, present, each, lambda share: None)
    # of turns alone, slow fixes may want what all of the log does not
    if _predicts_better(found, timed):
        return other, found, late
    return now, timed, _unchanged(late)


def _predicts_better(new: _Timed, old: _Timed) -> bool:
    """Tell whether the DOFs of a reading are predicted better than those of another."""
    parts = [np.stack([error, new.errors[name]]) for name, error in old.errors.items()
             if name in new.errors]
    return bool(parts) and choose(parts, 0).is_better


def _with_latencies(settings: Settings, stage: Stage) -> Settings:
    """Return settings with the latencies of a stage."""
    for key, change in stage.keys.items():
        name, _, latency = key.partition('.')
        changed: Any = {name: change.after} if not latency else {
            name: replace(getattr(settings, name), latency=change.after)}
        settings = replace(settings, **changed)
    return settings


class _Models:
    """The DOFs of a reading with the couplings that they want with some thrusters."""

    def __init__(self, now: _Reading, thrusters: ThrusterSettings, pair: Pair,
                 each: ParallelMap) -> None:
        self.commanded = now.log.commanded(thrusters)
        self.dofs, self.couplings = _with_couplings(now.dofs, self.commanded, pair, each)
        # shape (FOLDS, parts), by DOF, on held-out folds [m/s or rad/s]
        self.errors = each(lambda k: self.dofs[k].fit_models(
            self.commanded, pair, [self.dofs[k].settings])[0], range(len(self.dofs)))


def _with_couplings(
        dofs: Sequence[Dof], commanded: CommandedForce, pair: Pair, each: ParallelMap,
        left_out: Sequence[str] = ()) -> tuple[list[Dof], Sequence[ListChange]]:
    """Return the DOFs with the couplings that the log wants, and what that changes."""
    found = each(lambda k: tune_couplings(dofs[k], commanded, pair, left_out), range(len(dofs)))
    return [dof.with_settings(replace(dof.settings, couplings=names.after))
            for dof, names in zip(dofs, found)], found


def _changes(stage: Stage) -> dict[str, float | tuple[str, ...]]:
    """Return the keys of a stage that have a better value, with that."""
    return {key: change.after for key, change in stage.keys.items()
            if change.after != change.before}


def _unchanged(stage: Stage) -> Stage:
    """Return a stage whose keys stay; which values are as good is not known then."""
    return replace(stage, gain=0.0, spread=0.0, keys={
        key: Change(change.before, change.before) for key, change in stage.keys.items()})


def _rounded(stage: Stage) -> Stage:
    """Return a stage whose new values are written with few digits."""
    return replace(stage, keys={
        key: change if change.after == change.before or isinstance(change.after, bool) else
        replace(change, after=float(f'{change.after:.{DIGITS}g}'))
        for key, change in stage.keys.items()})
