"""
The paper's score: simulate the model with the logged thrust and compare the velocity.

``mae = mean |v_sim - v|`` (Section V) and ``fit = 1 - rms(v_sim - v) / std(v)``.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import math
import os
from tempfile import TemporaryFile
from typing import BinaryIO, NamedTuple

import numpy as np
from rovid_core.model.dofs import DOFS, OWN, own_coefficients
from rovid_core.model.lowpass import filtered
from rovid_core.model.samples import Step
from rovid_core.model.trajectory import Array, trajectory
from rovid_core.settings.run import Settings
from rovid_core.trials.joint_simulation import ForceSegment, JointModel
from rovid_core.trials.record import Record, record_of_steps, Times
from rovid_core.trials.water import LogWater, through_water

NS = 1e-9

Axis = tuple[float, ...]
"""Horizontal direction of an axis of the body in the world, x and y; () where it is not known."""

STILL: Axis = (0.0, 0.0)
"""An axis along which no water moves."""

BLOCK = 1 << 15
"""Rows of a table that are kept in memory, and processed at a time."""


@dataclass(frozen=True)
class Score:
    """
    How well a model predicts the velocity.

    Attributes
    ----------
    mae : float
        Mean absolute velocity error [m/s or rad/s]; NaN if there is nothing to compare.
    fit : float
        1 - rms(error) / std(measured); NaN if the measured velocity is constant.

    An unstable model has an infinite mae and a fit of minus infinity.

    """

    mae: float = math.nan
    fit: float = math.nan

    @staticmethod
    def of(simulated: Sequence[float] | Array, measured: Sequence[float] | Array) -> Score:
        """Return the score of a simulated against a measured velocity."""
        errors, values = np.asarray(simulated) - np.asarray(measured), np.asarray(measured)
        if not len(values):
            return Score()
        if not np.isfinite(errors).all():
            return Score(math.inf, -math.inf)
        mae = float(np.abs(errors).mean())
        if values.min() == values.max():
            return Score(mae)
        return Score(mae, 1.0 - float(np.sqrt((errors**2).mean()) / values.std()))


def _forces(values: Array, parameters: Sequence[float], names: Sequence[str]) -> Array:
    """Return the mean forces of a model, shape (n, 2): thrust, and couplings as such a force."""
    forces = values[:, :2]
    for k, (name, kappa) in enumerate(zip(names, parameters[4:])):
        if name not in OWN:
            forces = forces + kappa / parameters[0] * values[:, 4 + 2 * k:6 + 2 * k]
        elif name == OWN[0]:  # of the thrust as late as the model has it
            forces = forces + kappa / parameters[0] * np.minimum(values[:, :2], 0.0)
    return forces


class _ScoreSum:
    """The score of predictions that are added a block at a time."""

    def __init__(self, block: int) -> None:
        self._block = block
        self._pairs: list[tuple[Array, Array]] = []
        self._count = 0
        self._parts: list[tuple[float, ...]] = []

    def add(self, simulated: Array, measured: Array) -> None:
        """Add some velocities."""
        self._pairs.append((simulated, measured))
        self._count += len(measured)
        if self._count >= self._block:
            self._sum_up()

    def score(self) -> Score:
        """Return the score of all of them."""
        if not self._parts:
            return Score.of(*self._joined())
        if self._count:
            self._sum_up()
        counts, sizes, squares, means, variances, lows, highs = zip(*self._parts)
        count = math.fsum(counts)
        if not math.isfinite(math.fsum(sizes)):
            return Score(math.inf, -math.inf)
        mae = math.fsum(sizes) / count
        if min(lows) == max(highs):
            return Score(mae)
        mean = math.fsum(n * m for n, m in zip(counts, means)) / count
        variance = math.fsum(
            n * (v + (m - mean)**2) for n, m, v in zip(counts, means, variances)) / count
        return Score(mae, 1.0 - math.sqrt(math.fsum(squares) / count / variance))

    def _joined(self) -> tuple[Array, Array]:
        nothing = np.empty(0)
        simulated, measured = zip(*self._pairs) if self._pairs else ((), ())
        return np.concatenate([nothing, *simulated]), np.concatenate([nothing, *measured])

    def _sum_up(self) -> None:
        simulated, measured = self._joined()
        errors = np.abs(simulated - measured)
        total = float(errors.sum())
        self._parts.append((
            len(measured), total if math.isfinite(total) else math.inf,
            float((errors**2).sum()), float(measured.mean()), float(measured.var()),
            float(measured.min()), float(measured.max())))
        self._pairs, self._count = [], 0


class ScoreLog:
    """
    Keeps thrust and velocity of every step, to score any model on them.

    All but the last steps are in a temporary file (48 bytes each, in ``TMPDIR``).

    The simulation restarts from the measured velocity after each gap. For the comparison with
    the measured velocity, v_sim is averaged over the same intervals and low-pass filtered.
    With a reference input, v_sim itself is compared at the reference's stamps.

    Models are of the velocity through the water. Where a current is known, the velocity over
    ground is that and the current along the axis of the body.

    Parameters
    ----------
    settings : Settings
        Of the run.
    block : int
        Number of steps that are kept in memory, and processed at a time.

    """

    def __init__(self, settings: Settings, block: int = BLOCK) -> None:
        self._cutoff = settings.cutoff
        self._block = block
        self._couplings = {dof: settings.couplings(dof) for dof in settings.dofs}
        # of a DOF that moves with the water: its axis in the world, in the middle and at the end
        axes = {dof: 4 if settings.sees_current and dof in ('surge', 'sway') else 0
                for dof in settings.dofs}
        self._tables = {dof: SpillingTable(2, 4 + 2 * len(names) + axes[dof], block)
                        for dof, names in self._couplings.items()}
        self._axes = axes
        self.water = LogWater()
        self.runs: dict[str, list[ScoredRun]] = {dof: [] for dof in settings.dofs}
        self._references = SpillingTable(1, len(DOFS), block)

    def begin_run(self, dof: str, time: int, velocity: float, axis: Axis = ()) -> None:
        """
        Begin a run of steps of a DOF at a time [ns] and a measured velocity.

        ``axis`` is that of surge or sway in the world, x and y, where it may move with the water.
        """
        table = self._tables[dof]
        self.runs[dof].append(
            ScoredRun(table, table.count, time, velocity, [(0, self._cutoff)],
                      self._couplings[dof], self.water if self._axes[dof] else None,
                      axis or STILL))

    def set_cutoff(self, cutoff: float) -> None:
        """Set the cutoff [Hz] of the low-pass for the steps from now on."""
        self._cutoff = cutoff
        for runs in self.runs.values():
            for run in runs[-1:]:
                run.cutoffs.append((run.count, cutoff))

    def add_step(self, dof: str, span: tuple[int, int, int], step: Step,
                 axes: tuple[Axis, Axis] = ((), ())) -> None:
        """
        Add a step to the last run.

        Parameters
        ----------
        dof : str
            One of the run's DOFs.
        span : tuple of int
            Start of the step, start of its measurement, end of the step [ns].
        step : Step
            The measurement.
        axes : tuple of 2 axes
            As in ``begin_run``, at the last two times of the span.

        """
        couplings = [x for parts in step.couplings for x in parts]
        ends = (*(axes[0] or STILL), *(axes[1] or STILL)) if self._axes[dof] else ()
        self._tables[dof].append(
            span[1:], (*step.forces, step.velocity[2], step.mean, *couplings, *ends))
        self.runs[dof][-1].count += 1

    def add_current(self, time: int, x: float, y: float) -> None:
        """Add the current of the water in the world [m/s] at a time [ns], where it is known."""
        self.water.add(time, x, y)

    def add_reference(self, time: int, value: tuple[float, ...]) -> None:
        """Add a reference velocity, first the linear and then the angular one."""
        self._references.append((time,), value)

    def records(self, dof: str) -> list[Record]:
        """Return the measurements of a DOF through the water, for the offline methods."""
        runs = self.runs[dof]
        made = [record_of_steps(runs[0].start, *run.through_water()) for run in runs]
        return [one for one in made if one is not None]

    def series(self, dof: str) -> tuple[list[int], list[float], list[float]]:
        """Return the time [ns], filtered velocity and mean force of every step of a DOF."""
        times: list[int] = []
        velocities: list[float] = []
        forces: list[float] = []
        for run in self.runs[dof]:
            at, values = run.columns
            times += at[1].tolist()
            velocities += values[2].tolist()
            forces += run.mean_forces().tolist()
        return times, velocities, forces

    def predicted(self, dof: str, parameters: Sequence[float],
                  delay: float = 0.0) -> list[float]:
        """Return the velocity of a model at every step, filtered like the measured one."""
        return [v for run in self.runs[dof]
                for found, _ in run.as_measured(parameters, delay=delay) for v in found.tolist()]

    def score(self, dof: str, parameters: Sequence[float], delay: float = 0.0) -> Score:
        """
        Return the score of a model on all steps.

        Parameters
        ----------
        dof : str
            One of the run's DOFs.
        parameters : sequence of floats
            alpha, beta, gamma, delta and the couplings, if the model has them. Their
            regressors are the measured ones.
        delay : float
            Of the thrust, as the method found it [s]; NaN where it finds none.

        """
        return self._score(dof, parameters, delay)

    def score_joint(self, models: Mapping[str, Sequence[float]],
                    delays: Mapping[str, float] | None = None) -> dict[str, Score]:
        """
        Return the scores of models that are simulated together, of those DOFs with couplings.

        Parameters
        ----------
        models : mapping
            By DOF, as in ``score``. The velocities of the others are as measured.
        delays : mapping, optional
            By DOF, as in ``score``.

        """
        coupled = [dof for dof in models if len(models[dof]) > 4]
        if not coupled:
            return {}
        dofs = list(models)
        joint = JointModel(dofs, list(models.values()), [self._couplings[dof] for dof in dofs])
        found = [SpillingTable(1, 1, self._block) for _ in dofs]
        late = delays or {}
        for i, velocity in joint.simulate(
                [self._segments(dof, late.get(dof, 0.0)) for dof in dofs]):
            found[i].append((0,), (velocity,))
        return {dof: self._score(dof, models[dof], simulated=found[dofs.index(dof)])
                for dof in coupled}

    def _segments(self, dof: str, delay: float) -> Iterator[ForceSegment]:
        for run in self.runs[dof]:
            yield from run.segments(delay)

    def _score(self, dof: str, parameters: Sequence[float], delay: float = 0.0,
               simulated: SpillingTable | None = None) -> Score:
        """Return the score of a model, or of velocities at the nodes of all runs."""
        total = _ScoreSum(self._block)
        column = DOFS.index(dof)
        known = any(not np.isnan(values[:, column]).all() for _, values in self._all_references())
        for run in self.runs[dof]:
            if not known:
                for pair in run.as_measured(parameters, simulated, delay):
                    total.add(*pair)
                continue
            for part in run.predicted(parameters, simulated, delay):
                for times, values in self._all_references():
                    there = ~np.isnan(values[:, column])
                    total.add(*run.at(part, times[there, 0], values[there, column]))
        return total.score()

    def _all_references(self) -> Iterator[tuple[Times, Array]]:
        return self._references.blocks(0, self._references.count)


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
    water : LogWater or None
        In which it moves; None for a DOF that does not move with it.
    axis : tuple of 2 floats
        Axis of the DOF in the world at the start.
    count : int
        Number of steps.

    """

    table: SpillingTable
    first: int
    start: int
    velocity: float
    cutoffs: list[tuple[int, float]]
    couplings: tuple[str, ...] = ()
    water: LogWater | None = None
    axis: Axis = STILL
    count: int = 0

    @property
    def columns(self) -> tuple[Times, Array]:
        """Return the columns of the table, shapes (2, n) and (4 + 2 m, n)."""
        times, values = self.table.read(self.first, self.first + self.count)
        return times.T.copy(), values[:, :4 + 2 * len(self.couplings)].T.copy()

    @property
    def first_velocity(self) -> float:
        """Return the measured velocity at the start, through the water."""
        if self.water is None or not self._has_current:
            return self.velocity
        return self.velocity - float(
            self.water.along(np.array([self.start]), np.array([self.axis]))[0])

    def through_water(self) -> tuple[Times, Array]:
        """Return the same relative to the water; the filtered velocity stays over ground."""
        if not self._has_current or not self.count:
            return self.columns
        parts = list(self._parts())
        times = np.concatenate([nodes[1:].reshape(-1, 2) for nodes, _, _ in parts])
        values = np.concatenate([rows for _, rows, _ in parts])
        water = np.concatenate([w[1:].reshape(-1, 2) for _, _, w in parts])
        mean = water[:, 1].copy()
        averaged = (times[:, 0] < times[:, 1])[:-1]
        mean[:-1][averaged] = (
            (water[:-1, 0] + 4.0 * water[:-1, 1] + water[1:, 0]) / 6.0)[averaged]
        values[:, 3] -= mean
        return times.T.copy(), values[:, :4 + 2 * len(self.couplings)].T.copy()

    @property
    def _has_current(self) -> bool:
        return self.water is not None and not self.water.is_still

    def _parts(self, delay: float = 0.0) -> Iterator[tuple[Times, Array, Array]]:
        """
        Yield the table, with the thrust as much later, a block of steps at a time.

        That is the times of the start, and of the middle and end of every step [ns]; its rows,
        with couplings relative to the water; and the velocity of the water at these times [m/s].
        """
        start = self.start
        last = np.zeros(1)
        if self.water is not None and self._has_current:
            last = self.water.along(np.array([start]), np.array([self.axis]))
        blocks = self.table.blocks(self.first, self.first + self.count)
        if delay and math.isfinite(delay):
            blocks = _delayed(blocks, start, delay)
        for times, values in blocks:
            nodes = _nodes(start, times)
            water = np.zeros(len(nodes))
            if self.water is not None and self._has_current:
                water = np.concatenate(
                    [last, self.water.along(nodes[1:], values[:, -4:].reshape(-1, 2))])
                values = through_water(values, self.couplings, nodes, water)
            yield nodes, values, water
            start, last = int(nodes[-1]), water[-1:]

    def segments(self, delay: float = 0.0) -> Iterator[ForceSegment]:
        """Yield the two parts of each step through the water, after the begin of the run."""
        begun, count = False, 2 * len(self.couplings)
        for nodes, values, _ in self._parts(delay):
            if not begun:
                yield ForceSegment(self.start, begins=self.first_velocity)
            begun = True
            for (middle, end), row in zip(
                    nodes[1:].reshape(-1, 2).tolist(), values.tolist()):
                yield ForceSegment(middle, row[0], tuple(row[4:4 + count:2]))
                yield ForceSegment(end, row[1], tuple(row[5:4 + count:2]))
        if not begun:
            yield ForceSegment(self.start, begins=self.velocity)

    def mean_forces(self) -> Array:
        """Return the mean force of every step [N or N m]."""
        times, values = self.columns
        dt = np.diff(_nodes(self.start, times.T)).reshape(-1, 2)
        return np.asarray((dt * values[:2].T).sum(axis=1) / dt.sum(axis=1))

    def predicted(self, parameters: Sequence[float], simulated: SpillingTable | None = None,
                  delay: float = 0.0) -> Iterator[Predicted]:
        """
        Yield the prediction of a model, a block of steps at a time.

        ``simulated`` has it already: two values per step of all runs. ``delay`` [s] is that of
        the thrust.
        """
        first, left = self.first, self.count
        _, reverse_drag = own_coefficients(self.couplings, parameters[4:])
        velocity: float | None = None  # through the water
        if not left:
            yield Predicted(
                np.array([self.start]), np.array([self.velocity]), np.empty(0), True)
        for nodes, values, water in self._parts(delay):
            left -= len(values)
            if velocity is None:
                velocity = self.first_velocity
            if simulated is None:
                found = trajectory(
                    parameters[:4], velocity, np.diff(nodes) * NS,
                    _forces(values, parameters, self.couplings).ravel(), reverse_drag)
            else:
                last = first + len(values)
                found = np.concatenate(
                    [[velocity], simulated.read(2 * first, 2 * last)[1].ravel()])
                first = last
            yield Predicted(nodes, found + water, values[:, 2], left == 0)
            velocity = float(found[-1])

    def as_measured(self, parameters: Sequence[float], simulated: SpillingTable | None = None,
                    delay: float = 0.0) -> Iterator[tuple[Array, Array]]:
        """
        Yield predicted and measured velocity at the ends of the steps, both filtered.

        The prediction is averaged over the intervals and filtered like the measurement.
        """
        time, velocity, done = self.start, self.velocity, 0
        part: Predicted | None = None
        for new in self.predicted(parameters, simulated, delay):
            part = new if part is None else _prepend_last(part, new)
            middle, end = part.velocity[1::2], part.velocity[2::2]
            means = end.copy()
            # for position, the mean from this fix to the next
            averaged = (part.nodes[1::2] < part.nodes[2::2])[:-1]
            means[:-1][averaged] = (
                (middle[:-1] + 4.0 * end[:-1] + middle[1:]) / 6.0)[averaged]
            # the mean of the last step needs the step that follows
            count = len(means) if part.is_last else len(means) - 1
            ends = part.nodes[2::2][:count]
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


def _nodes(start: int, times: Times) -> Times:
    return np.concatenate([[start], times.ravel()])


def _prepend_last(part: Predicted, new: Predicted) -> Predicted:
    """Return a part with the last step of the part before it in front."""
    return Predicted(
        np.concatenate([part.nodes[-3:], new.nodes[1:]]),
        np.concatenate([part.velocity[-3:], new.velocity[1:]]),
        np.concatenate([part.measured[-1:], new.measured]), new.is_last)


class SpillingTable:
    """
    A table of times and values, with its older rows in a nameless temporary file.

    The memory of the process therefore does not grow with the log.

    Parameters
    ----------
    times, values : int
        Number of times and of values in a row.
    block : int
        Number of rows that are kept in memory.

    Attributes
    ----------
    count : int
        Number of rows.

    """

    def __init__(self, times: int, values: int, block: int = BLOCK) -> None:
        self.count = 0
        self._block = block
        self._width = times, values
        self._times = array('q')
        self._values = array('d')
        self._file: BinaryIO | None = None
        self._spilled = 0  # rows

    def append(self, times: tuple[int, ...], values: tuple[float, ...]) -> None:
        """Append a row of times [ns] and values."""
        self._times.extend(times)
        self._values.extend(values)
        self.count += 1
        if self.count - self._spilled == self._block:
            self._spill_rows()

    def read(self, first: int, last: int) -> tuple[Times, Array]:
        """Return times, shape (n, times), and values of the rows ``first`` to ``last - 1``."""
        block = self._block
        parts = [self._read_file(at, max(first, at), min(last, at + block))
                 for at in range(first - first % block, min(last, self._spilled), block)]
        if last > self._spilled or not parts:
            parts.append(self._read_memory(max(first, self._spilled), last))
        times, values = zip(*parts)
        return (times[0], values[0]) if len(parts) == 1 else (
            np.concatenate(times), np.concatenate(values))

    def blocks(self, first: int, last: int) -> Iterator[tuple[Times, Array]]:
        """Yield the same rows, a block at a time."""
        for at in range(first, last, self._block):
            yield self.read(at, min(at + self._block, last))

    def _spill_rows(self) -> None:
        if self._file is None:
            self._file = TemporaryFile(prefix='rovid-')
        self._file.write(self._times.tobytes() + self._values.tobytes())
        self._file.flush()  # writes everything or raises OSError
        del self._times[:], self._values[:]
        self._spilled = self.count

    def _read_file(self, at: int, first: int, last: int) -> tuple[Times, Array]:
        """Return rows of the block of the file that begins with row ``at``."""
        assert self._file is not None
        times, values = self._width
        size = 8 * self._block * (times + values)
        # with an offset: forked processes share the position in the file
        data = os.pread(self._file.fileno(), size, at * 8 * (times + values))
        split = 8 * self._block * times
        return (np.frombuffer(data[:split], np.int64).reshape(-1, times)[first - at:last - at],
                np.frombuffer(data[split:]).reshape(-1, values)[first - at:last - at])

    def _read_memory(self, first: int, last: int) -> tuple[Times, Array]:
        """Return copies of rows in memory; an array cannot grow while a view of it exists."""
        times, values = self._width
        rows = slice(first - self._spilled, last - self._spilled)
        return (np.array(self._times, np.int64).reshape(-1, times)[rows],
                np.array(self._values).reshape(-1, values)[rows])
