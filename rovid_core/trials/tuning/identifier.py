"""Cutoff and gains of the adaptive identifier, by what its models predict ahead of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from rovid_core.identify import make_identifier
from rovid_core.model.samples import Step
from rovid_core.model.trajectory import Array
from rovid_core.settings.run import Scales, Settings
from rovid_core.trials.tuning.blocks import edges, FOLDS
from rovid_core.trials.tuning.choice import Change, Each, nearest, Stage, sure_error
from rovid_core.trials.tuning.commanded import Commanded
from rovid_core.trials.tuning.dof import Dof
from rovid_core.trials.tuning.gains import Candidate, GainSweep, Steps, steps

CUTOFFS = (0.1, 0.2, 0.3, 0.45, 0.65, 1.0, 1.5, 2.5)
"""[Hz] beside the present one, up to 0.4 of the sample rate."""

TIMES = (1.0, 2.0, 3.0, 5.0, 8.0, 13.0, 20.0, 35.0, 60.0)
"""[s] beside the present one, as far as ``SETTLED`` of them pass before the first test."""

SETTLED = 3.0
"""With fewer, the test is of the initial values and not of what was identified."""

SIZES = (0.5, 1.0, 2.0)
"""Typical force and velocity, in the amplitudes of the data, beside the present ones."""

FIRST = 2
"""Blocks before the first one that is predicted: the identifier has to settle."""


@dataclass(frozen=True)
class Chain:
    """What the identifier of a DOF was given: delay and lag, and the motion."""

    dof: Dof
    pair: tuple[float, float]


@dataclass(frozen=True)
class Swept:
    """
    The scores of one DOF.

    Attributes
    ----------
    scores : ndarray, shape (cutoffs, times, sizes, FOLDS - FIRST)
        With the new delay, lag and heading; first of each axis: the present value.
    sizes : list of tuple
        Typical force and velocity.
    first, kept : ndarray, shape (FOLDS - FIRST,)
        Of the identifier that the node runs, as everything was, and with the new delay, lag
        and heading [m/s or rad/s].

    """

    scores: Array
    sizes: list[tuple[float, float]]
    first: Array
    kept: Array


def candidates_of(settings: Settings, dofs: Sequence[Dof]) -> tuple[list[float], list[float]]:
    """Return the cutoffs and the adaptation times to try; the first ones are the present."""
    slowest = max(float(np.median(np.diff(dof.stretches[0].bounds))) * 1e-9 for dof in dofs)
    time = min(float(dof.stretches[-1].ends[-1] - dof.stretches[0].start) for dof in dofs) * 1e-9
    cutoff, adaptation = settings.cutoff, settings.identifier.adaptation_time
    longest = time * FIRST / FOLDS / SETTLED
    return ([cutoff, *(f for f in CUTOFFS if f <= 0.4 / slowest and f != cutoff)],
            [adaptation, *(t for t in TIMES if t <= longest and t != adaptation)])


def sweep(old: Chain, new: Chain, commanded: Commanded, settings: Settings,
          cutoffs: Sequence[float], times: Sequence[float]) -> Swept:
    """Run the identifier with all candidates and score what it finds on the blocks ahead."""
    name = new.dof.name
    own = Scales.of(settings.dof[name])
    data = new.dof.problem.scales
    sizes = [(own.force, own.velocity),
             *((f * data.force, v * data.velocity) for f, v in product(SIZES, SIZES))]
    candidates = [Candidate(t, *size) for t, size in product(times, sizes)]
    rows = GainSweep(own, len(cutoffs), candidates, settings.identifier.integrator)
    bounds = edges(new.dof.stretches)
    found = rows.run(_steps(new, commanded, cutoffs), bounds[FIRST:-1].tolist())
    # (noted, 4, cutoffs, candidates)
    scores = _scores(new, commanded, found.reshape(*found.shape[:2], -1))
    present = (settings, cutoffs[0], times[0], sizes[0])
    kept = ahead(new, commanded, *present)
    same = old.dof is new.dof and old.pair == new.pair
    return Swept(scores.reshape(len(cutoffs), len(times), len(sizes), -1), sizes,
                 kept if same else ahead(old, commanded, *present), kept)


def _steps(chain: Chain, commanded: Commanded, cutoffs: Sequence[float]) -> Steps:
    dof = chain.dof
    impulses = [commanded.impulse(dof.row, s.bounds, *chain.pair) for s in dof.stretches]
    return steps(dof.stretches, impulses, cutoffs)


def _scores(chain: Chain, commanded: Commanded, found: Array) -> Array:
    """Return the mean error over the blocks ahead, shape (candidates, FOLDS - FIRST)."""
    dof, problem = chain.dof, chain.dof.problem
    start = dof.model(commanded, chain.pair).start
    force = dof.blocks.force(commanded, dof.row, *chain.pair)[:, None] / problem.scales.force
    target = dof.blocks.measured[:, None] / problem.scales.velocity
    scores = []
    for k, parameters in enumerate(found, FIRST):
        theta = problem.scaled(parameters.T).T[:, :, None]
        errors = problem.score(theta, start, force, target, k)
        scores.append(errors[:, k:].mean(axis=1))
    scores_of = np.stack(scores, axis=-1)
    return np.where(np.isfinite(scores_of), scores_of, np.inf)


@dataclass(frozen=True)
class Chosen:
    """The best settings of the identifier: indices, and what they gain."""

    cutoff: int
    time: int
    sizes: list[int]
    gain: float
    spread: float

    @property
    def is_better(self) -> bool:
        """Tell whether the gain is more than chance."""
        return self.gain > self.spread


def choose_gains(swept: Sequence[Swept], cutoffs: Sequence[float],
                 times: Sequence[float]) -> Chosen:
    """Choose one cutoff and adaptation time for all DOFs, and typical sizes for each."""
    present = [s.scores[0, 0, 0] for s in swept]
    units = [float(p.mean() if np.isfinite(p).all() else s.scores.min()) * len(swept)
             for p, s in zip(present, swept)]
    parts = [s.scores / unit for s, unit in zip(swept, units)]
    far = (_far(cutoffs)[:, None] + _far(times)).ravel()
    far_sizes = [sum(map(_far, zip(*s.sizes))) for s in swept]

    def pick(folds: list[int]) -> tuple[int, int, list[int]]:
        known = [part[..., folds] for part in parts]
        best = np.sum([np.take_along_axis(part, part.mean(axis=-1, keepdims=True).argmin(
            axis=2, keepdims=True), axis=2)[:, :, 0] for part in known], axis=0)
        i, j = divmod(nearest(best.reshape(-1, len(folds)), far), len(times))
        return i, j, [nearest(part[i, j], np.asarray(distance))
                      for part, distance in zip(known, far_sizes)]

    folds = list(range(parts[0].shape[-1]))
    gains = []
    for fold in folds:
        i, j, own = pick([other for other in folds if other != fold])
        gains.append(sum(part[0, 0, 0, fold] - part[i, j, k, fold]
                         for part, k in zip(parts, own)))
    best = pick(folds)
    if not np.isfinite(gains).all():  # the present gains can not be used on this log
        return Chosen(*best, 1.0, 0.0)
    return Chosen(*best, float(np.mean(gains)), float(sure_error(np.array(gains))))


def _far(values: Sequence[float]) -> Array:
    """Return by which factor values differ from the first, as a logarithm."""
    return np.abs(np.log(np.array(values) / values[0]))


def tune_identifier(old: Sequence[Dof], new: Sequence[Dof], pairs: Sequence[tuple[float, float]],
                    commanded: Commanded, settings: Settings,
                    each: Each) -> tuple[Stage, dict[str, tuple[float, float]]]:
    """
    Find cutoff and gains.

    Parameters
    ----------
    old, new : sequence of Dof
        With the present heading, and with what was found.
    pairs : sequence of 2 tuples
        Delay and lag, likewise.
    commanded : Commanded
        The thrust.
    settings : Settings
        As they are.
    each : Each
        Does work on each of some things, possibly at the same time.

    Returns
    -------
    stage : Stage
        Keys, before and after.
    scores : dict
        Per DOF the identifier's score as everything was, and with all that was found.

    """
    cutoffs, times = candidates_of(settings, new)
    # the longest first, or others would wait for it
    order = sorted(range(len(new)), key=lambda k: -sum(len(s.ends) for s in new[k].stretches))
    done = each(lambda k: sweep(Chain(old[k], pairs[0]), Chain(new[k], pairs[1]), commanded,
                                settings, cutoffs, times), order)
    swept = [done[order.index(k)] for k in range(len(new))]
    best = choose_gains(swept, cutoffs, times)
    present = (cutoffs[0], times[0])
    proposed = (cutoffs[best.cutoff], times[best.time])
    moved = [one.kept if (*proposed, k) == (*present, 0) else ahead(
        Chain(dof, pairs[1]), commanded, settings, *proposed, one.sizes[k])
        for dof, one, k in zip(new, swept, best.sizes)]
    gains = np.mean([(s.kept - b) / s.kept.mean() for s, b in zip(swept, moved)], axis=0)
    gain, spread = float(gains.mean()), float(sure_error(gains))
    better = best.is_better and gain > spread
    keys = {'velocity.cutoff': Change(present[0], proposed[0] if better else present[0]),
            'identifier.adaptation_time': Change(
                present[1], proposed[1] if better else present[1])}
    scores = {}
    for k, (dof, one) in enumerate(zip(new, swept)):
        before, after = one.sizes[0], one.sizes[best.sizes[k] if better else 0]
        for n, name in enumerate(('force', 'velocity')):
            keys[f'{dof.name}.typical.{name}'] = Change(before[n], after[n])
        scores[dof.name] = (
            float(one.first.mean()), float((moved[k] if better else one.kept).mean()))
    return Stage(keys, gain, spread), scores


def ahead(chain: Chain, commanded: Commanded, settings: Settings, cutoff: float,
          time: float, size: tuple[float, float]) -> Array:
    """
    Return the error on the blocks ahead of the identifier that the node runs.

    The sweep, of the paper's with a diagonal Gamma, proposes; what the node runs decides.
    """
    dof = chain.dof
    trial = _steps(chain, commanded, [cutoff])
    identifier = make_identifier(replace(settings.identifier, adaptation_time=time), replace(
        settings.dof[dof.name], typical_force=size[0], typical_velocity=size[1]))
    marks = np.searchsorted(trial.end, edges(dof.stretches)[FIRST:-1], 'right').tolist()
    found = []
    for k, (dt, restart, v, w, f) in enumerate(zip(
            trial.dt.tolist(), trial.restarts.tolist(), trial.before[0].tolist(),
            trial.after[0].tolist(), trial.force[0].tolist())):
        found += [identifier.parameters] * marks.count(k)
        if restart:
            identifier.restart(v)
        identifier.step(Step(dt, (v, 0.5 * (v + w), w), (f, f, f)))
    found += [identifier.parameters] * (len(marks) - len(found))
    return np.asarray(_scores(chain, commanded, np.array(found)[:, :, None])[0])
