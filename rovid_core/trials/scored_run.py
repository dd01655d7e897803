"""The steps of one DOF between two interruptions, and what a model makes of their thrust."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np
from rovid_core.model.dofs import OWN, own_coefficients
from rovid_core.model.lag import all_spun, all_turns_of, driven_along, follow, inertia_of
from rovid_core.model.lowpass import filtered
from rovid_core.model.plant import Array, trajectory
from rovid_core.model.samples import NS
from rovid_core.model.thrusters import AS_CONFIGURED, Thrusters
from rovid_core.trials.joint_simulation import ForceSegment
from rovid_core.trials.record import LogWater, through_water, Times
from rovid_core.trials.spilling_table import SpillingTable

Axis = tuple[float, ...]
"""Horizontal direction of an axis of the body in the world, x and y; () where it is not known."""

STILL: Axis = (0.0, 0.0)
"""An axis along which no water moves."""


class Predicted(NamedTuple):
    """
    Some consecutive steps, with the velocity that a model predicts.

    Attributes
    ----------
    nodes : ndarray of int64, shape (2 n + 1,)
        Times of the start, and of the middle and end of every step [ns].
    velocity : ndarray, shape (2 n + 1,)
        Velocity of the model at these times [m/s or rad/s].
    measured : ndarray, shape (n,)
        Measured and filtered velocity at the ends [m/s or rad/s].
    is_last : bool
        Whether the run ends with these steps.

    """

    nodes: Times
    velocity: Array
    measured: Array
    is_last: bool


@dataclass
class ScoredRun:
    """
    The steps of one DOF between two interruptions.

    Attributes
    ----------
    table : SpillingTable
        Steps of all runs of the DOF: middle and end of the step [ns]; mean force before and
        after the middle [N or N m], velocity at the end, mean velocity [m/s or rad/s], and
        each regressor of the DOF's couplings before and after the middle.
    first : int
        First row of this run.
    start : int
        Time at which the first step begins [ns].
    velocity : float
        Measured velocity at the start [m/s or rad/s].
    cutoffs : list of (int, float)
        Number of the first step with a cutoff, and the cutoff of the low-pass [Hz].
    couplings : tuple of str
        Names of the DOF's couplings.
    water : LogWater
        In which it moves; still water for a DOF that does not move with it.
    axis : tuple of 2 floats
        Axis of the DOF in the world at the start.
    clock : int
        Number of the clock that its times are of.
    count : int
        Number of steps.

    """

    table: SpillingTable
    first: int
    start: int
    velocity: float
    cutoffs: list[tuple[int, float]]
    couplings: tuple[str, ...]
    water: LogWater
    axis: Axis
    clock: int
    count: int = 0

    @property
    def columns(self) -> tuple[Times, Array]:
        """Return the columns of the table, shapes (2, n) and (4 + 2 m, n)."""
        times, values = self.table.read(self.first, self.first + self.count)
        return times.T.copy(), values[:, :4 + 2 * len(self.couplings)].T.copy()

    @property
    def first_velocity(self) -> float:
        """Return the measured velocity at the start, through the water."""
        return self.velocity - float(self._current_at_start()[0])

    def through_water(self) -> tuple[Times, Array]:
        """Return the same relative to the water; the filtered velocity stays over ground."""
        if self.water.is_still or not self.count:
            return self.columns
        parts = list(self._parts())
        times = np.concatenate([nodes[1:].reshape(-1, 2) for nodes, _, _ in parts])
        values = np.concatenate([rows for _, rows, _ in parts])
        water = np.concatenate([w[1:].reshape(-1, 2) for _, _, w in parts])
        values[:, 3] -= _measured(times, water)
        return times.T.copy(), values[:, :4 + 2 * len(self.couplings)].T.copy()

    def _current_at_start(self) -> Array:
        """Return the velocity of the water along the axis, shape (1,) [m/s]."""
        return self.water.along(np.array([self.start]), np.array([self.axis]))

    def _parts(self, delay: float = 0.0,
               thrusters: Thrusters = AS_CONFIGURED) -> Iterator[tuple[Times, Array, Array]]:
        """
        Yield the table, with the thrust that there is, as much later, a block of steps at a time.

        That is the times of the start, and of the middle and end of every step [ns]; its rows,
        with couplings relative to the water; and the velocity of the water at these times [m/s].
        """
        start = self.start
        last = self._current_at_start()
        blocks = self.table.blocks(self.first, self.first + self.count)
        if thrusters.is_curved:
            blocks = _given(blocks, thrusters)
        if delay - thrusters.lag and math.isfinite(delay):
            blocks = _delayed(blocks, start, delay - thrusters.lag)
        if thrusters.lag:
            blocks = _lagging(blocks, start, thrusters)
        for times, values in blocks:
            nodes = _nodes(start, times)
            water = np.zeros(len(nodes))
            if not self.water.is_still:
                water = np.concatenate(
                    [last, self.water.along(nodes[1:], values[:, -4:].reshape(-1, 2))])
                values = through_water(values, self.couplings, nodes, water)
            yield nodes, values, water
            start, last = int(nodes[-1]), water[-1:]

    def segments(self, delay: float = 0.0,
                 thrusters: Thrusters = AS_CONFIGURED) -> Iterator[ForceSegment]:
        """Yield the two parts of each step through the water, after the begin of the run."""
        yield ForceSegment(
            self.start, begins=self.first_velocity if self.count else self.velocity)
        count = 2 * len(self.couplings)
        for nodes, values, _ in self._parts(delay, thrusters):
            for (middle, end), row in zip(
                    nodes[1:].reshape(-1, 2).tolist(), values.tolist()):
                yield ForceSegment(middle, row[0], tuple(row[4:4 + count:2]),
                                   slowing=thrusters.slowing(row[0]))
                yield ForceSegment(end, row[1], tuple(row[5:4 + count:2]),
                                   slowing=thrusters.slowing(row[1]))

    def mean_forces(self) -> Array:
        """Return the mean force of every step [N or N m]."""
        times, values = self.columns
        dt = np.diff(_nodes(self.start, times.T)).reshape(-1, 2)
        return np.asarray((dt * values[:2].T).sum(axis=1) / dt.sum(axis=1))

    def predicted(self, parameters: Sequence[float], simulated: SpillingTable | None = None,
                  delay: float = 0.0,
                  thrusters: Thrusters = AS_CONFIGURED) -> Iterator[Predicted]:
        """
        Yield the prediction of a model, a block of steps at a time.

        ``simulated`` has it already: two values per step of all runs. ``delay`` [s] is that of
        the thrust, of which ``thrusters`` say how much there is.
        """
        first, left = self.first, self.count
        _, reverse_drag = own_coefficients(self.couplings, parameters[4:])
        velocity = self.first_velocity
        if not left:
            yield Predicted(
                np.array([self.start]), np.array([self.velocity]), np.empty(0), True)
        for nodes, values, water in self._parts(delay, thrusters):
            left -= len(values)
            if simulated is None:
                found = trajectory(
                    parameters[:4], velocity, np.diff(nodes) * NS,
                    _forces(values, parameters, self.couplings).ravel(), reverse_drag,
                    parameters[0] * thrusters.loss * np.sqrt(np.abs(values[:, :2])).ravel())
            else:
                last = first + len(values)
                found = np.concatenate(
                    [[velocity], simulated.read(2 * first, 2 * last)[1].ravel()])
                first = last
            yield Predicted(nodes, found + water, values[:, 2], left == 0)
            velocity = float(found[-1])

    def as_measured(self, parameters: Sequence[float], simulated: SpillingTable | None = None,
                    delay: float = 0.0,
                    thrusters: Thrusters = AS_CONFIGURED) -> Iterator[tuple[Array, Array]]:
        """
        Yield predicted and measured velocity at the ends of the steps, both filtered.

        The prediction is averaged over the intervals and filtered like the measurement.
        """
        time, velocity, done = self.start, self.velocity, 0
        part: Predicted | None = None
        for new in self.predicted(parameters, simulated, delay, thrusters):
            part = new if part is None else _prepend_last(part, new)
            times = part.nodes[1:].reshape(-1, 2)
            means = _measured(times, part.velocity[1:].reshape(-1, 2))
            # the mean of the last step needs the step that follows
            count = len(means) if part.is_last else len(means) - 1
            ends = times[:count, 1]
            with np.errstate(invalid='ignore'):  # infinite velocities of an unstable model
                found = filtered(self._cutoff(done, count), np.diff([time, time, *ends]) * NS,
                                 np.concatenate([[velocity], means[:count]]))[1:]
            yield found, part.measured[:count]
            done += count
            if count:
                time, velocity = int(ends[-1]), float(found[-1])

    def _cutoff(self, first: int, count: int) -> float | Array:
        """Return the cutoffs [Hz] of the step before some steps, and of each of them."""
        if len(self.cutoffs) == 1:
            return self.cutoffs[0][1]
        steps = np.maximum(np.arange(first - 1, first + count), 0)
        firsts, cutoffs = zip(*self.cutoffs)
        return np.array(cutoffs)[np.searchsorted(firsts, steps, side='right') - 1]

    def at(self, part: Predicted, times: Times, values: Array) -> tuple[Array, Array]:
        """Return the prediction at those times that are inside a part, and their values."""
        own = part.nodes
        inside = (own[0] <= times) & (times < own[-1] + part.is_last)
        # relative to the start: absolute times have too many digits for a float
        return np.interp(times[inside] - self.start, own - self.start, part.velocity), \
            values[inside]


def _given(blocks: Iterator[tuple[Times, Array]],
           thrusters: Thrusters) -> Iterator[tuple[Times, Array]]:
    """Yield the rows of a run with the forces that there are for those that were asked for."""
    for times, values in blocks:
        yield times, np.hstack([thrusters.all_given(values[:, :2]), values[:, 2:]])


def _delayed(blocks: Iterator[tuple[Times, Array]], start: int,
             delay: float) -> Iterator[tuple[Times, Array]]:
    """
    Yield the rows of a run with the mean forces that act a delay [s] later.

    Before and after the run the force is taken as held. A delay is shorter than a block.
    """
    shift, before = round(delay / NS), None
    now = next(blocks, None)
    while now is not None:
        after = next(blocks, None)
        around = [block for block in (before, now, after) if block is not None]
        first = start if before is None else int(before[0][0, 0])
        # from the first middle of the block before, or from the start of the run
        nodes = _nodes(first, np.concatenate([times for times, _ in around]))
        forces = np.concatenate([values[:, :2] for _, values in around]).ravel()
        if before is not None:
            nodes, forces = nodes[1:], forces[1:]
        own = _nodes(start, now[0])
        held = abs(shift) + 1
        nodes = np.concatenate([[nodes[0] - held], nodes, [nodes[-1] + held]])
        forces = np.concatenate([forces[:1], forces, forces[-1:]])
        impulse = np.concatenate([[0.0], np.cumsum(forces * np.diff(nodes) * NS)])
        # relative to the start: absolute times have too many digits for a float
        felt = np.diff(np.interp(own - shift - nodes[0], nodes - nodes[0], impulse))
        length = np.diff(own) * NS
        values = now[1].copy()
        values[:, :2] = np.where(
            length > 0.0, felt / np.where(length > 0.0, length, 1.0), 0.0).reshape(-1, 2)
        yield now[0], values
        start, before, now = int(own[-1]), now, after


def _lagging(blocks: Iterator[tuple[Times, Array]], start: int,
             thrusters: Thrusters) -> Iterator[tuple[Times, Array]]:
    """Yield the rows of a run with mean forces that lag; before it the first one was held."""
    lag, at, inertia = thrusters.lag, math.nan, inertia_of(thrusters.lag, thrusters.lag_at)
    for times, values in blocks:
        lengths = np.diff(_nodes(start, times)) * NS
        forces = values[:, :2].ravel()
        steady = all_turns_of(forces) if thrusters.turns else forces
        at = float(steady[0]) if math.isnan(at) else at
        lagged = driven_along(forces, lengths, inertia, at) if inertia else (
            follow(steady, lengths, lag, at))
        at = float(lagged[-1])
        if thrusters.turns and not inertia:
            impulses = all_spun(lagged[:-1], steady, lengths, lag)
        else:
            impulses = forces * lengths - (inertia or lag) * np.diff(lagged)
        values = values.copy()
        values[:, :2] = np.where(lengths > 0.0, impulses / np.where(
            lengths > 0.0, lengths, 1.0), 0.0).reshape(-1, 2)
        yield times, values
        start = int(times[-1, 1])


def _nodes(start: int, times: Times) -> Times:
    return np.concatenate([[start], times.ravel()])


def _measured(times: Times, velocity: Array) -> Array:
    """
    Return what sensors make of velocities at the middle and the end of steps, shape (n, 2).

    That is the one at the end, and for a position the mean from this fix to the next; of the last
    step that is not known.
    """
    middle, end = velocity[:, 0], velocity[:, 1]
    means = end.copy()
    averaged = (times[:, 0] < times[:, 1])[:-1]
    means[:-1][averaged] = ((middle[:-1] + 4.0 * end[:-1] + middle[1:]) / 6.0)[averaged]
    return means


def _prepend_last(part: Predicted, new: Predicted) -> Predicted:
    """Return a part with the last step of the part before it in front."""
    return Predicted(
        np.concatenate([part.nodes[-3:], new.nodes[1:]]),
        np.concatenate([part.velocity[-3:], new.velocity[1:]]),
        np.concatenate([part.measured[-1:], new.measured]), new.is_last)


def _forces(values: Array, parameters: Sequence[float], names: Sequence[str]) -> Array:
    """Return the mean forces of a model, shape (n, 2): thrust, and couplings as such a force."""
    forces = values[:, :2]
    for k, (name, kappa) in enumerate(zip(names, parameters[4:])):
        if name not in OWN:
            forces = forces + kappa / parameters[0] * values[:, 4 + 2 * k:6 + 2 * k]
        elif name == OWN[0]:  # of the thrust as late as the model has it
            forces = forces + kappa / parameters[0] * np.minimum(values[:, :2], 0.0)
    return forces
