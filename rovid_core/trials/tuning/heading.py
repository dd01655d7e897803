"""
The searches for what is wrong with the axes along which fixes become velocities.

That is what has to be added to the heading, and how much later than the attitude fixes come.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
import math

import numpy as np
from rovid_core.model.plant import Array
from rovid_core.settings.run import Settings
from rovid_core.trials.tuning.cross_validation import (
    blocks,
    Change,
    Choice,
    choose,
    part_bounds,
    Stage,
)
from rovid_core.trials.tuning.dof_fit import Dof, Fit
from rovid_core.trials.tuning.log import (
    CommandedForce,
    Segment,
    TuningLog,
    turnable,
    turned,
    turned_by_time,
)
from rovid_core.trials.tuning.timing import latencies, Pair, search_pairs

HEADING = 'attitude.yaw_offset'
LATENCY = 'position.latency'
HEADING_STEP = math.radians(15.0)
# Around the best so far the grid of ``HEADING_STEP`` is refined to this share.
HEADING_FINER = (0.25, 0.0625, 0.0156)


def tune_heading(log: TuningLog, dofs: Sequence[Dof], commanded: CommandedForce,
                 settings: Settings, pair: Pair) -> Stage | None:
    """
    Find what has to be added to the heading, from the direction in which thrust moves.

    Surge thrust of a vehicle with a wrong heading seems to move it sideways as well. None
    where the position is not turned by an attitude, or neither surge nor sway is moved.
    """
    found = _turned_dofs(log, dofs, commanded, settings, pair)
    if found is None:
        return None
    angles = [0.0, *(k * HEADING_STEP for k in range(-12, 12) if k)]
    scores = found.scores(angles)
    choice = choose([scores], 0)
    for share in HEADING_FINER:
        middle = angles[choice.index]
        new = [middle + k * share * HEADING_STEP for k in (-4, -3, -2, -1, 1, 2, 3, 4)]
        angles += new
        scores = np.concatenate([scores, found.scores(new)])
        choice = choose([scores], 0)
    turn = angles[choice.index] if choice.is_better else 0.0
    best = settings.yaw_offset + angles[choice.index]
    begin = settings.yaw_offset + math.remainder(best, 2.0 * math.pi) - best
    good = [begin + angle for angle in around_the_best(angles, choice)]
    after = math.remainder(settings.yaw_offset + turn, 2.0 * math.pi) if turn \
        else settings.yaw_offset
    return Stage({HEADING: Change(
        settings.yaw_offset, after, min(good), max(good))}, choice.gain, choice.spread)


def around_the_best(angles: Sequence[float], choice: Choice) -> list[float]:
    """
    Return the angles [rad] that are as good as the best, up to the next each way that is not.

    Far from it a candidate is so much worse on a few blocks that its scatter hides that it is.
    Behind half a turn the circle goes on from its other end.
    """
    best = angles[choice.index]
    apart = [math.remainder(angle - best, 2.0 * math.pi) for angle in angles]
    order = sorted(range(len(angles)), key=lambda i: apart[i])
    as_good = set(choice.as_good.tolist())
    low = high = order.index(choice.index)
    while low > 0 and order[low - 1] in as_good:
        low -= 1
    while high + 1 < len(order) and order[high + 1] in as_good:
        high += 1
    return [best + apart[i] for i in order[low:high + 1]]


# [s] by which fixes may come later than the attitude, or earlier
LATENCIES = (-0.35, -0.2, -0.1, 0.0, 0.1, 0.2, 0.35, 0.6, 1.0, 2.0)
# [s] how late the thrust may act by the clock of the attitude
DELAYS = (-0.2, 0.0, 0.1, 0.2, 0.4, 0.8)
TRIED = 9  # latencies of a range that are tried for what they do to the masses
MASS_KNOWN = 0.1  # share to which a converged mass is known: what changes it less is not told


def tune_latency(log: TuningLog, dofs: Sequence[Dof], commanded: CommandedForce,
                 settings: Settings, pair: Pair, done: Callable[[float], None]) -> Stage | None:
    """
    Find how much later than the attitude fixes are stamped, from the turns of the vehicle.

    A fix is turned by the attitude of its time: with a wrong one, thrust ahead seems to push
    sideways while the vehicle turns. None where fixes are not turned, or have the same clock.
    """
    turned_dofs = _turned_dofs(log, dofs, commanded, settings, pair)
    if turned_dofs is None or settings.attitude.topic in ('', settings.position.topic):
        return None
    pairs, errors = search_pairs(
        (0.0, pair[0]), [*product(LATENCIES, DELAYS)], (LATENCIES, DELAYS), turned_dofs.late, done)
    choice = choose(errors, 0)
    late = pairs[choice.index][0] if choice.is_better else 0.0
    good = [late, *[pairs[i][0] for i in choice.as_good]]  # what stays is no worse
    name = 'position' if late >= 0.0 else 'attitude'
    change = latencies(settings, {name: abs(late)})
    if name == 'position':
        known = change[LATENCY]
        change[LATENCY] = replace(
            known, low=known.before + min(good), high=known.before + max(good))
    return Stage(change, choice.gain, choice.spread)


def latency_note(log: TuningLog, dofs: Sequence[Dof], commanded: CommandedForce,
                 settings: Settings, pair: Pair, change: Change) -> str:
    """
    Return what a range of ``position.latency`` does to the masses, '' if they stay as they are.

    ``change`` is that of the key; ``settings`` are those that the log was read with, and ``pair``
    is delay and lag of the thrust [s], which narrow the range further.
    """
    found = _turned_dofs(log, dofs, commanded, settings, pair)
    if found is None or not change.low < change.high:
        return ''
    known = settings.position.latency
    lates = np.array([0.0, *np.linspace(change.low - known, change.high - known, TRIED)])
    fits = found.fits(lates.tolist())
    as_good = [0, *choose([fit.errors for fit in fits.values()], 0).as_good]
    told = []
    for name, fit in fits.items():
        masses = fit.masses[as_good] / fit.masses[0] - 1.0
        if np.abs(masses).max() > max(fit.mass_widths[0] / fit.masses[0], MASS_KNOWN):
            told.append(f'the mass of {name} by {100.0 * masses.min():+.0f} to '
                        f'{100.0 * masses.max():+.0f} %')
    low, high = known + lates[as_good].min(), known + lates[as_good].max()
    return '' if not told else (
        f'{LATENCY}: {low:.2f} to {high:.2f} s predict this log alike, but change '
        f'{" and ".join(told)}, which no interval has in it: measure the latency')


def _turned_dofs(log: TuningLog, dofs: Sequence[Dof], commanded: CommandedForce,
                 settings: Settings, pair: Pair) -> _Turned | None:
    """Return surge and sway with other axes; None where they have none, or are not moved."""
    names = turnable(settings)
    own = {dof.name: dof for dof in dofs}
    if names is None or not any(name in own for name in names):
        return None
    return _Turned(log, (log.segments(names[0]), log.segments(names[1])),
                   [own.get(name) for name in names], commanded, pair)


class _Turned:
    """How well surge and sway are predicted with other axes."""

    def __init__(self, log: TuningLog, both: tuple[list[Segment], list[Segment]],
                 own: list[Dof | None], commanded: CommandedForce, pair: Pair) -> None:
        self._log, self._both, self._own = log, both, own
        self._commanded, self._pair = commanded, pair
        self._bounds = part_bounds(
            both[0], next(dof.blocks.count for dof in own if dof is not None))

    def scores(self, angles: Sequence[float]) -> Array:
        """Return the errors of both velocities together, shape (angles, FOLDS, parts) [m/s]."""
        return self._scores([turned(*self._both, angle) for angle in angles], [self._pair])

    def late(self, pairs: Sequence[Pair]) -> list[Array]:
        """Return the errors with later fixes, and a delay by the attitude's clock."""
        axes = {late: turned_by_time(self._log, *self._both, late) for late, _ in pairs}
        return [self._scores([axes[late] for late, _ in pairs],
                             [(late + delay, self._pair[1]) for late, delay in pairs])]

    def fits(self, lates: Sequence[float]) -> dict[str, Fit]:
        """Return the models with later fixes [s], by DOF that has thrust."""
        axes = [turned_by_time(self._log, *self._both, late) for late in lates]
        pairs = [(late + self._pair[0], self._pair[1]) for late in lates]
        return {dof.name: dof.fit(self._commanded, pairs, measured)
                for dof, measured in zip(self._own, self._measured(axes)) if dof is not None}

    def _measured(self, both: Sequence[tuple[list[Segment], list[Segment]]]) -> list[Array]:
        """Return the velocities of surge and sway, shape (steps, candidates, pieces)."""
        parts = [[blocks(segments, self._bounds) for segments in own] for own in zip(*both)]
        return [np.stack([part.measured for part in own if part is not None], 1) for own in parts]

    def _scores(self, both: Sequence[tuple[list[Segment], list[Segment]]],
                pairs: Sequence[Pair]) -> Array:
        """
        Return the errors of candidates, shape (candidates, FOLDS, parts) [m/s].

        They are summed over both: other axes move the motion from one to the other, and what has
        none is predicted well.
        """
        known = next(dof for dof in self._own if dof is not None)
        found = []
        for dof, measured in zip(self._own, self._measured(both)):
            problem = (dof or known).problem
            if dof is not None:
                found.append(dof.fit(self._commanded, pairs, measured).errors)
                continue
            # without thrust there is no motion this way
            target = measured / problem.scales.velocity
            force = np.zeros((len(target) * problem.blocks.parts, 1, 1))
            found.append(problem.score(np.zeros((4, 1, 1)), 0.0 * target[0], force, target))
        return found[0] + found[1]
