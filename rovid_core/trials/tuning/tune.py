"""
Finding what a parameter file has to say of a vehicle, from a log by cross-validation.

That is heading offset, clocks, delay, lag, dead-band, dead zone, reverse thrust, couplings and
terms.

The log is divided into blocks of time. What is found is that with which a model that output
error fitted to the other blocks predicts a block best; of lag, reverse thrust, dead-band and dead
zone, that with which the filter predicts each measurement best from those before it, unless blocks
contradict. Nothing is changed that does not gain more than chance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from rovid_core.settings.run import Settings, ThrusterSettings
from rovid_core.trials.tuning.clocks import Timed, with_clocks
from rovid_core.trials.tuning.cross_validation import (
    Change,
    choose,
    ParallelMap,
    Result,
    Stage,
)
from rovid_core.trials.tuning.dof_fit import Dof
from rovid_core.trials.tuning.likelihood import Likeliest, likeliest, Prediction
from rovid_core.trials.tuning.log import TuningLog
from rovid_core.trials.tuning.reading import read_log, Reading
from rovid_core.trials.tuning.searches import (
    large_command,
    ListChange,
    Models,
    REVERSE_KEY,
    tune_curve,
    tune_terms,
)
from rovid_core.trials.tuning.timing import KIND, Kind, with_other_lag

FAR = 0.3  # [s] a delay that the filter does not find from 0 on
PREDICTIONS = 18  # of the log by the filter, about


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
            changes.update(stage.changes)
        changes.update({names.key: names.after for names in self.lists
                        if names.after != names.before})
        return changes


def one_by_one(work: Callable[[int], Result], given: Sequence[int]) -> list[Result]:
    """Return ``work`` of each."""
    return [work(k) for k in given]


def tune(read: Callable[[Settings], TuningLog], settings: Settings,
         done: Callable[[float], None] = lambda share: None,
         each: ParallelMap = one_by_one,
         predict: Callable[[Settings], Prediction] | None = None) -> Tuned:
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
    predict : callable, optional
        Lets the filter predict the log with some settings, whose thrusters are taken to be as
        they say. Without it simulated blocks alone tell of the thrusters.

    """
    def begun(share: float) -> None:  # most of the time is that of the predictions
        done(0.3 * share if predict else 0.9 * share)

    first = read_log(read, settings, settings.thrusters)
    begun(0.05)
    before = {dof.name: dof.error for dof in first.dofs}
    now, timed, clocks = with_clocks(read, first, each, begun)
    found, thrusters = _with_thrusters(now, timed, clocks.rough, each)
    begun(1.0)
    if predict is not None and thrusters.delay >= 0.0:
        found, thrusters = _with_prediction(
            now, timed.dofs, found, thrusters, predict, each,
            lambda share: done(0.3 + 0.6 * share))
    pair = thrusters.delay, thrusters.time_constant
    # what the thrusters lacked hid some couplings, or looked like one
    models = Models(now.log, now.dofs, thrusters, pair, each)
    if thrusters.reverse != settings.thrusters.reverse:
        # and what one DOF does in reverse looks like weaker thrusters
        as_now = replace(thrusters, reverse=settings.thrusters.reverse)
        own = Models(now.log, now.dofs, as_now, pair, each)
        if choose([np.stack(both) for both in zip(models.errors, own.errors)], 0).is_better:
            models = own
            found = [stage.without(REVERSE_KEY) for stage in found]
    stages = clocks.stages(now.log, models, now.settings, pair)
    stages += [stage.rounded() for stage in found]
    done(0.9)
    coupled, commanded = models.dofs, models.commanded
    terms = each(lambda k: tune_terms(coupled[k], commanded, pair), range(len(coupled)))
    errors = {}
    for dof, names in zip(coupled, terms):
        found_last = replace(dof.settings, terms=names.after)
        error = np.nanmean(dof.fit_models(commanded, pair, [found_last]))
        errors[dof.name] = (before.get(dof.name, math.nan), float(error))
    return Tuned(tuple(stages), (*models.couplings, *terms), errors, now.left_out)


def _with_thrusters(now: Reading, timed: Timed, rough: ThrusterSettings,
                    each: ParallelMap) -> tuple[list[Stage], ThrusterSettings]:
    """Return the thrusters that blocks tell, and what changes with them."""
    timing = with_other_lag(timed.timing, timed.dofs, now.log, rough, now.settings, each)
    found, thrusters = tune_curve(
        now.log, timed.dofs, timing.kind.of(now.settings.thrusters), timing.pair)
    delay, lag = timing.pair
    return [timing.stage, *found], replace(thrusters, delay=delay, time_constant=lag)


def _with_prediction(
        now: Reading, dofs: Sequence[Dof], stages: list[Stage], told: ThrusterSettings,
        predict: Callable[[Settings], Prediction], each: ParallelMap,
        done: Callable[[float], None]) -> tuple[list[Stage], ThrusterSettings]:
    """
    Return the thrusters with which the filter predicts best, and what changes.

    Those that blocks ``told``, and the ``stages`` of these, where it knows none that are clearly
    better, or where blocks are clearly predicted worse with these.
    """
    settings = replace(now.settings, dof={
        **now.settings.dof, **{dof.name: dof.settings for dof in dofs}})
    base = max(told.delay - FAR, 0.0)  # the filter finds the rest
    present = replace(settings.thrusters, delay=base)
    tried = 0

    def predict_all(given: Sequence[ThrusterSettings]) -> Sequence[Prediction]:
        nonlocal tried
        tried += len(given)
        found = each(lambda k: predict(replace(settings, thrusters=given[k])), range(len(given)))
        done(min(tried / PREDICTIONS, 1.0))
        return found

    found = likeliest(present, replace(told, delay=base), large_command(now.log, present),
                      predict_all)
    if found is None:
        return stages, told
    delay = told.delay if math.isnan(found.delay) else max(base + found.delay, 0.0)
    best = replace(found.thrusters, delay=delay)
    errors = each(lambda k: np.stack([
        dofs[k].fit(now.log.commanded(one), [(one.delay, one.time_constant)]).errors[0]
        for one in (best, told)]), range(len(dofs)))
    if choose(errors, 0).is_better:
        return stages, told
    stage = _predicted_stage(settings.thrusters, best, found)
    return [stage, *[one for one in stages if not one.keys.keys() & stage.keys.keys()]], best


def _predicted_stage(before: ThrusterSettings, best: ThrusterSettings, found: Likeliest) -> Stage:
    """Return what changes with thrusters with which the filter predicts better."""
    keys = {'thrusters.delay': Change(before.delay, best.delay)}
    for key in ('time_constant', 'reverse', 'dead_zone', 'deadband'):
        new = getattr(best, key)
        good = [new, *[getattr(one, key) for one in found.as_good]]
        keys[f'thrusters.{key}'] = Change(getattr(before, key), new, min(good), max(good))
    kinds = zip(KIND, Kind.in_use(before), Kind.in_use(best))
    keys.update({name: Change(old, new) for name, old, new in kinds if new != old})
    stage = Stage(keys, found.gain, found.spread)
    return replace(stage, note=f'{" and ".join(stage.changes)}: judged by how well ekf predicts '
                   'each measurement from those before it')
