"""
The paper's score: simulate the model with the logged thrust and compare the velocity.

``mae = mean |v_sim - v|`` (Section V) and ``fit = 1 - rms(v_sim - v) / std(v)``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math

import numpy as np
from rovid_core.model.dofs import DOFS
from rovid_core.model.samples import Step
from rovid_core.model.trajectory import Array
from rovid_core.settings.run import Settings
from rovid_core.trials.record import Record, record
from rovid_core.trials.rows import BLOCK, Rows, Times
from rovid_core.trials.scored_run import ScoredSteps


@dataclass(frozen=True)
class Score:
    """
    How well a model predicts.

    Attributes
    ----------
    mae : float
        Mean absolute velocity error [m/s or rad/s]; NaN with nothing to compare.
    fit : float
        1 - rms(error) / std(measured); NaN where the velocity never changes.

    A model that runs away has an infinite mae and a fit of minus infinity.

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


class _Tally:
    """The score of predictions that come a few at a time."""

    def __init__(self) -> None:
        self._pairs: list[tuple[Array, Array]] = []
        self._count = 0
        self._parts: list[tuple[float, ...]] = []

    def add(self, simulated: Array, measured: Array) -> None:
        """Take some velocities."""
        self._pairs.append((simulated, measured))
        self._count += len(measured)
        if self._count >= BLOCK:
            self._sum_up()

    def score(self) -> Score:
        """Return the score of all."""
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
    Keeps thrust and velocity of every step to score any model on them.

    All but the last ones are in a temporary file (48 bytes each, where ``TMPDIR`` says), and are
    read again a few at a time, so that the memory of the process does not grow with the log.

    The simulation restarts from the measured velocity after each gap. Against the pipe's
    own velocity v_sim goes through the same interval mean and low-pass; against a
    reference input it is compared as it is, at the reference's stamps.

    Parameters
    ----------
    settings : Settings
        The run.
    spill : bool
        False: keep all in memory.

    """

    def __init__(self, settings: Settings, spill: bool = True) -> None:
        self._cutoff = settings.cutoff
        self._steps = {dof: ScoredSteps(spill) for dof in settings.dofs}
        self._references = Rows(1, len(DOFS), spill)

    def restarted(self, dof: str, time: int, velocity: float) -> None:
        """Take the velocity that a DOF takes up from."""
        self._steps[dof].restarted(time, velocity, self._cutoff)

    def changed(self, cutoff: float) -> None:
        """Take the cutoff [Hz] of the steps from now on."""
        self._cutoff = cutoff
        for steps in self._steps.values():
            steps.changed(cutoff)

    def stepped(self, dof: str, span: tuple[int, int, int], step: Step) -> None:
        """
        Take a step.

        Parameters
        ----------
        dof : str
            One of the run's DOFs.
        span : tuple of int
            Start of the step, start of its measurement, end of the step [ns].
        step : Step
            What was measured.

        """
        self._steps[dof].stepped(span, step)

    def reference(self, time: int, value: tuple[float, ...]) -> None:
        """Take a reference velocity: the linear then the angular one."""
        self._references.append((time,), value)

    def records(self, dof: str) -> list[Record]:
        """Return what was measured of a DOF, for the offline methods."""
        runs = self._steps[dof].runs
        made = [record(runs[0].start, *run.steps) for run in runs]
        return [one for one in made if one is not None]

    def series(self, dof: str) -> tuple[list[int], list[float], list[float]]:
        """Return the time [ns], filtered velocity and mean force of every step of a DOF."""
        times: list[int] = []
        velocities: list[float] = []
        forces: list[float] = []
        for run in self._steps[dof].runs:
            at, values = run.steps
            times += at[1].tolist()
            velocities += values[2].tolist()
            forces += run.mean_forces().tolist()
        return times, velocities, forces

    def predicted(self, dof: str, parameters: Sequence[float]) -> list[float]:
        """Return the velocity of a model at every step, filtered like the measured one."""
        return [v for run in self._steps[dof].runs
                for found, _ in run.as_measured(parameters) for v in found.tolist()]

    def score(self, dof: str, parameters: Sequence[float]) -> Score:
        """
        Return the score of a model on what was kept.

        Parameters
        ----------
        dof : str
            One of the run's DOFs.
        parameters : sequence of 4 floats
            alpha, beta, gamma, delta.

        """
        tally = _Tally()
        column = DOFS.index(dof)
        known = any(not np.isnan(values[:, column]).all() for _, values in self._all_references())
        for run in self._steps[dof].runs:
            if not known:
                for pair in run.as_measured(parameters):
                    tally.add(*pair)
                continue
            for part in run.predicted(parameters):
                for times, values in self._all_references():
                    there = ~np.isnan(values[:, column])
                    tally.add(*run.at(part, times[there, 0], values[there, column]))
        return tally.score()

    def _all_references(self) -> Iterator[tuple[Times, Array]]:
        return self._references.blocks(0, self._references.count)
