"""The steps of one DOF between two interruptions, and what a model predicts for them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from rovid_core.model.lowpass import filtered
from rovid_core.model.samples import Step
from rovid_core.model.trajectory import Array, trajectory
from rovid_core.trials.rows import Rows, Times

NS = 1e-9


class Predicted(NamedTuple):
    """
    Some steps on end, with the velocity that a model predicts.

    Attributes
    ----------
    nodes : ndarray of int64, shape (2 n + 1,)
        The start, and middle and end of every step [ns].
    velocity : ndarray, shape (2 n + 1,)
        Of the model there [m/s or rad/s].
    measured : ndarray, shape (n,)
        At the ends, filtered [m/s or rad/s].
    is_last : bool
        Whether the run ends with them.

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
    rows : Rows
        Of all runs of the DOF: middle and end of the step [ns]; mean force before and after
        the middle [N or N m], velocity at the end, mean velocity [m/s or rad/s].
    first : int
        The first row of this one.
    start : int
        Time from which the first step goes [ns].
    velocity : float
        Measured there [m/s or rad/s].
    cutoffs : list of (int, float)
        Of the low-pass [Hz], each from the number of its first step.
    count : int
        How many steps.

    """

    rows: Rows
    first: int
    start: int
    velocity: float
    cutoffs: list[tuple[int, float]]
    count: int = 0

    @property
    def steps(self) -> tuple[Times, Array]:
        """Return all rows, as columns: shapes (2, n) and (4, n)."""
        times, values = self.rows.read(self.first, self.first + self.count)
        return times.T.copy(), values.T.copy()

    def mean_forces(self) -> Array:
        """Return the mean force of every step [N or N m]."""
        times, values = self.steps
        dt = np.diff(_nodes(self.start, times.T)).reshape(-1, 2)
        return np.asarray((dt * values[:2].T).sum(axis=1) / dt.sum(axis=1))

    def predicted(self, parameters: Sequence[float]) -> Iterator[Predicted]:
        """Yield the prediction of a model, some steps at a time."""
        time, velocity, left = self.start, self.velocity, self.count
        if not left:
            yield Predicted(np.array([time]), np.array([velocity]), np.empty(0), True)
        for times, values in self.rows.blocks(self.first, self.first + self.count):
            left -= len(times)
            nodes = _nodes(time, times)
            found = trajectory(parameters, velocity, np.diff(nodes) * NS, values[:, :2].ravel())
            yield Predicted(nodes, found, values[:, 2], left == 0)
            time, velocity = int(nodes[-1]), float(found[-1])

    def as_measured(self, parameters: Sequence[float]) -> Iterator[tuple[Array, Array]]:
        """
        Yield the prediction at the ends of the steps and what was measured, both filtered.

        The prediction is averaged over the intervals and filtered like the measurement.
        """
        time, velocity, done = self.start, self.velocity, 0
        part: Predicted | None = None
        for new in self.predicted(parameters):
            part = new if part is None else _joined(part, new)
            middle, end = part.velocity[1::2], part.velocity[2::2]
            means = end.copy()
            # of position, the mean from this fix to the next
            averaged = (part.nodes[1::2] < part.nodes[2::2])[:-1]
            means[:-1][averaged] = (
                (middle[:-1] + 4.0 * end[:-1] + middle[1:]) / 6.0)[averaged]
            # the last one is not known before the step that follows
            count = len(means) if part.is_last else len(means) - 1
            ends = part.nodes[2::2][:count]
            with np.errstate(invalid='ignore'):  # of a model that runs away
                found = filtered(self._cutoff(done, count), np.diff([time, time, *ends]) * NS,
                                 np.concatenate([[velocity], means[:count]]))[1:]
            yield found, part.measured[:count]
            done += count
            if count:
                time, velocity = int(ends[-1]), float(found[-1])

    def _cutoff(self, first: int, count: int) -> float | Array:
        """Return the cutoff [Hz] of the step before some steps and of each of them."""
        if len(self.cutoffs) == 1:
            return self.cutoffs[0][1]
        steps = np.maximum(np.arange(first - 1, first + count), 0)
        firsts, cutoffs = zip(*self.cutoffs)
        return np.array(cutoffs)[np.searchsorted(firsts, steps, side='right') - 1]

    def at(self, part: Predicted, times: Times, values: Array) -> tuple[Array, Array]:
        """Return the prediction at those of some times that are in a part, and the values."""
        own = part.nodes
        inside = (own[0] <= times) & (times < own[-1] + part.is_last)
        # from the start: times since 1970 have too many digits for a float
        return np.interp(times[inside] - self.start, own - self.start, part.velocity), \
            values[inside]


class ScoredSteps:
    """
    All steps of one DOF.

    Parameters
    ----------
    spill : bool
        False: keep all in memory.

    Attributes
    ----------
    runs : list of ScoredRun
        In order.

    """

    def __init__(self, spill: bool) -> None:
        self.runs: list[ScoredRun] = []
        self._rows = Rows(2, 4, spill)

    def restarted(self, time: int, velocity: float, cutoff: float) -> None:
        """Begin a run at a time [ns] and velocity, with this cutoff [Hz]."""
        self.runs.append(ScoredRun(
            self._rows, self._rows.count, time, velocity, [(0, cutoff)]))

    def changed(self, cutoff: float) -> None:
        """Take the cutoff [Hz] of the steps from now on."""
        for run in self.runs[-1:]:
            run.cutoffs.append((run.count, cutoff))

    def stepped(self, span: tuple[int, int, int], step: Step) -> None:
        """Take a step, as ``ScoreLog`` does."""
        self._rows.append(span[1:], (*step.forces, step.velocity[2], step.mean))
        self.runs[-1].count += 1


def _nodes(start: int, times: Times) -> Times:
    return np.concatenate([[start], times.ravel()])


def _joined(part: Predicted, new: Predicted) -> Predicted:
    """Return the last step of one part in front of the next."""
    return Predicted(
        np.concatenate([part.nodes[-3:], new.nodes[1:]]),
        np.concatenate([part.velocity[-3:], new.velocity[1:]]),
        np.concatenate([part.measured[-1:], new.measured]), new.is_last)
