"""The search for heading offset and latencies, for which a log is read again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rovid_core.model.dofs import OWN
from rovid_core.model.plant import Array
from rovid_core.settings.run import Settings, ThrusterSettings
from rovid_core.trials.tuning.cross_validation import choose, ParallelMap, Stage
from rovid_core.trials.tuning.dof_fit import Dof
from rovid_core.trials.tuning.heading import (
    HEADING,
    LATENCY,
    latency_note,
    tune_heading,
    tune_latency,
)
from rovid_core.trials.tuning.log import TuningLog
from rovid_core.trials.tuning.reading import read_log, Reading, TuningError
from rovid_core.trials.tuning.searches import Models, tune_curve, with_couplings
from rovid_core.trials.tuning.timing import Pair, Timing, tune_thrust


@dataclass(frozen=True)
class Timed:
    """What was found of delay and lag in a reading."""

    dofs: Sequence[Dof]  # with the couplings of the log
    timing: Timing
    errors: Mapping[str, Array]  # shape (FOLDS, parts), by DOF, on held-out folds [m/s or rad/s]


@dataclass(frozen=True)
class Clocks:
    """What was found of the heading, and of what is late."""

    rough: ThrusterSettings  # those with which it was sought
    heading: Sequence[Stage]
    latest: Sequence[Stage]
    turns: Stage | None  # of them, that which turns or the thrust told

    def stages(self, log: TuningLog, models: Models, settings: Settings,
               pair: Pair) -> list[Stage]:
        """Return all stages, with what the masses owe to a latency that is not known."""
        latest = list(self.latest)
        if self.turns is not None and LATENCY in self.turns.keys:
            note = latency_note(log, models.dofs, models.commanded, settings, pair,
                                self.turns.keys[LATENCY])
            latest[-1] = replace(latest[-1], note=note)
        return [*self.heading, *latest]


def with_clocks(read: Callable[[Settings], TuningLog], now: Reading, each: ParallelMap,
                done: Callable[[float], None]) -> tuple[Reading, Timed, Clocks]:
    """Find heading offset and latencies; return the log as it is read with them."""
    thrusters = now.settings.thrusters
    pair = (thrusters.delay, thrusters.time_constant)
    # what the thrusters lack hides what is late, and the other way round: it is sought twice
    _, rough = tune_curve(now.log, now.dofs, thrusters, pair)
    now = replace(now, commanded=now.log.commanded(rough))
    # with other headings the log is another one: it is read again
    heading = tune_heading(now.log, now.dofs, now.commanded, now.settings, pair)
    headings = [] if heading is None else [heading.rounded()]
    if heading is not None and heading.changes:
        turned = replace(now.settings, yaw_offset=headings[0].keys[HEADING].after)
        now = read_log(read, turned, rough)
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
        if stage.changes:
            # turns tell less of a latency than the thrust does, where that tells it
            latest = [one for one in latest if one.changes] + [stage]
            turns = stage
    done(0.6)
    return now, timed, Clocks(rough, headings, latest, turns)


def _timed(now: Reading, present: Pair, each: ParallelMap,
           done: Callable[[float], None]) -> Timed:
    """Find delay and lag in a reading."""
    # what couplings explain hides the rest; but those of ``OWN`` would hide weaker thrusters
    dofs, _ = with_couplings(now.dofs, now.commanded, present, each, OWN)
    timing = tune_thrust(dofs, now.commanded, now.settings, each, done)
    return Timed(dofs, timing, {
        dof.name: dof.fit(now.commanded, [timing.pair]).errors[0] for dof in dofs})


def _if_better(read: Callable[[Settings], TuningLog], now: Reading, timed: Timed, late: Stage,
               thrusters: ThrusterSettings, present: Pair,
               each: ParallelMap) -> tuple[Reading, Timed, Stage]:
    """Read the log again with later inputs; return it and the stage as it was, or better."""
    late = late.rounded()
    if not late.changes:
        return now, timed, late
    try:
        other = read_log(read, _with_latencies(now.settings, late), thrusters)
    except TuningError:  # so late nothing can be made of it
        return now, timed, late.unchanged()
    found = _timed(other, present, each, lambda share: None)
    # of turns alone, slow fixes may want what all of the log does not
    if _predicts_better(found, timed):
        return other, found, late
    return now, timed, late.unchanged()


def _predicts_better(new: Timed, old: Timed) -> bool:
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
