"""
The paper's score: simulate the model with the logged thrust and compare the velocity.

``mae = mean |v_sim - v|`` (Section V) and ``fit = 1 - rms(v_sim - v) / std(v)``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import math
from typing import NamedTuple

import numpy as np
from rovid_core.model.dofs import DOFS
from rovid_core.model.plant import Array
from rovid_core.model.samples import Step
from rovid_core.model.thrusters import AS_CONFIGURED, Thrusters
from rovid_core.settings.run import Settings
from rovid_core.trials.joint_simulation import ForceSegment, JointModel
from rovid_core.trials.record import LogWater, Record, record_of_steps, Times
from rovid_core.trials.scored_run import Axis, ScoredRun, STILL
from rovid_core.trials.spilling_table import BLOCK, SpillingTable


class Score(NamedTuple):
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
        self._axes = {dof: 4 if settings.sees_current and dof in ('surge', 'sway') else 0
                      for dof in settings.dofs}
        self.water = LogWater()
        self._tables: dict[str, SpillingTable] = {}
        self.runs: dict[str, list[ScoredRun]] = {}
        for dof in settings.dofs:
            self.begin_anew(dof)
        self._references = SpillingTable(1, len(DOFS), block)
        self._clocks = [0]  # rows of the references from which on another clock runs

    def restart(self) -> None:
        """Expect times that have nothing to do with those so far."""
        self._clocks.append(self._references.count)

    def begin_run(self, dof: str, time: int, velocity: float, axis: Axis = ()) -> None:
        """
        Begin a run of steps of a DOF at a time [ns] and a measured velocity.

        ``axis`` is that of surge or sway in the world, x and y, where it may move with the water.
        """
        table = self._tables[dof]
        self.runs[dof].append(
            ScoredRun(table, table.count, time, velocity, [(0, self._cutoff)],
                      self._couplings[dof], self.water if self._axes[dof] else LogWater(),
                      axis or STILL, len(self._clocks) - 1))

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

    def begin_anew(self, dof: str) -> None:
        """Forget the steps of a DOF so far."""
        self._tables[dof] = SpillingTable(
            2, 4 + 2 * len(self._couplings[dof]) + self._axes[dof], self._block)
        self.runs[dof] = []

    def take_steps(self, other: ScoreLog, dofs: Sequence[str]) -> None:
        """Take the steps of some DOFs of another log of the same settings."""
        for dof in dofs:
            self._tables[dof], self.runs[dof] = other._tables[dof], other.runs[dof]

    def add_current(self, time: int, x: float, y: float) -> None:
        """Add the current of the water in the world [m/s] at a time [ns], where it is known."""
        self.water.add(time, x, y)

    def add_commands(self, time: int, raw: tuple[float, ...]) -> None:
        """Do nothing: a score takes the forces of the steps."""

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

    def predicted(self, dof: str, parameters: Sequence[float], delay: float = 0.0,
                  thrusters: Thrusters = AS_CONFIGURED) -> list[float]:
        """Return the velocity of a model at every step, filtered like the measured one."""
        return [v for run in self.runs[dof] for found, _ in run.as_measured(
            parameters, delay=delay, thrusters=thrusters) for v in found.tolist()]

    def score(self, dof: str, parameters: Sequence[float], delay: float = 0.0,
              thrusters: Thrusters = AS_CONFIGURED,
              simulated: SpillingTable | None = None) -> Score:
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
        thrusters : Thrusters
            As the method found them.
        simulated : SpillingTable, optional
            What the model predicts, where that is known; see ``ScoredRun.predicted``.

        """
        total = _ScoreSum(self._block)
        column = DOFS.index(dof)
        every = self._references.blocks(0, self._references.count)
        known = any(not np.isnan(values[:, column]).all() for _, values in every)
        for run in self.runs[dof]:
            if not known:
                for pair in run.as_measured(parameters, simulated, delay, thrusters):
                    total.add(*pair)
                continue
            for part in run.predicted(parameters, simulated, delay, thrusters):
                for times, values in self._references_of(run):
                    there = ~np.isnan(values[:, column])
                    total.add(*run.at(part, times[there, 0], values[there, column]))
        return total.score()

    def score_joint(self, models: Mapping[str, Sequence[float]],
                    delays: Mapping[str, float] | None = None,
                    thrusters: Mapping[str, Thrusters] | None = None) -> dict[str, Score]:
        """
        Return the scores of models that are simulated together, of those DOFs with couplings.

        Parameters
        ----------
        models : mapping
            By DOF, as in ``score``. The velocities of the others are as measured.
        delays, thrusters : mapping, optional
            By DOF, as in ``score``.

        """
        coupled = [dof for dof in models if len(models[dof]) > 4]
        if not coupled:
            return {}
        dofs = list(models)
        joint = JointModel(dofs, list(models.values()), [self._couplings[dof] for dof in dofs])
        found = [SpillingTable(1, 1, self._block) for _ in dofs]
        late, given = delays or {}, thrusters or {}
        for i, velocity in joint.simulate(
                [self._segments(dof, late.get(dof, 0.0), given.get(dof, AS_CONFIGURED))
                 for dof in dofs]):
            found[i].append((0,), (velocity,))
        return {dof: self.score(dof, models[dof], simulated=found[dofs.index(dof)])
                for dof in coupled}

    def _segments(self, dof: str, delay: float,
                  thrusters: Thrusters) -> Iterator[ForceSegment]:
        for run in self.runs[dof]:
            yield from run.segments(delay, thrusters)

    def _references_of(self, run: ScoredRun) -> Iterator[tuple[Times, Array]]:
        """Yield those of the same clock: another one may have had the same times."""
        first, last = [*self._clocks, self._references.count][run.clock:run.clock + 2]
        return self._references.blocks(first, last)
