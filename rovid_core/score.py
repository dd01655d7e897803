"""
The paper's score: simulate the model with the logged thrust and compare the velocity.

``mae = mean |v_sim - v|`` (Section V) and ``fit = 1 - rms(v_sim - v) / std(v)``.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
import math

import numpy as np
from numpy.typing import NDArray
from rovid_core.dofs import DOFS
from rovid_core.identifier import Step
from rovid_core.lowpass import filtered
from rovid_core.prediction import predict
from rovid_core.recurrence import Array
from rovid_core.settings import Settings
from rovid_core.trial import Record, record

NS = 1e-9


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


@dataclass
class _Run:
    """The steps of one DOF between two interruptions."""

    start: int
    velocity: float
    ends: array[int] = field(default_factory=lambda: array('q'))
    middles: array[int] = field(default_factory=lambda: array('q'))
    first_forces: array[float] = field(default_factory=lambda: array('d'))
    last_forces: array[float] = field(default_factory=lambda: array('d'))
    velocities: array[float] = field(default_factory=lambda: array('d'))
    means: array[float] = field(default_factory=lambda: array('d'))

    def times(self) -> NDArray[np.int64]:
        """Return the start, and middle and end of every step [ns]."""
        pairs = np.stack([self.middles, self.ends], axis=1)
        return np.concatenate([[self.start], pairs.ravel()])

    def forces(self) -> Array:
        """Return the mean force before and after the middle of every step [N or N m]."""
        return np.stack([self.first_forces, self.last_forces], axis=1)

    def mean_forces(self) -> Array:
        """Return the mean force of every step [N or N m]."""
        dt = np.diff(self.times()).reshape(-1, 2)
        return np.asarray((dt * self.forces()).sum(axis=1) / dt.sum(axis=1))

    def predicted(self, parameters: Sequence[float]) -> Array:
        """Return the velocity of a model at ``times`` [m/s or rad/s]."""
        return predict(parameters, self.velocity, np.diff(self.times()) * NS,
                       self.forces().ravel())

    def at(self, times: NDArray[np.int64], values: Array,
           parameters: Sequence[float]) -> tuple[Array, Array]:
        """Return the prediction at those of some times that are in the run, and the values."""
        own = self.times()
        inside = (own[0] <= times) & (times <= own[-1])
        # from the start: times since 1970 have too many digits for a float
        return np.interp(times[inside] - own[0], own - own[0], self.predicted(parameters)), \
            values[inside]


class ScoreLog:
    """
    Keeps thrust and velocity of every step (48 bytes each) to score any model on them.

    The simulation restarts from the measured velocity after each gap. Against the pipe's
    own velocity v_sim goes through the same interval mean and low-pass; against a
    reference input it is compared as it is, at the reference's stamps.

    Parameters
    ----------
    settings : Settings
        The run.

    """

    def __init__(self, settings: Settings) -> None:
        self._cutoff = settings.cutoff
        self._runs: dict[str, list[_Run]] = {dof: [] for dof in settings.dofs}
        self._reference_times = array('q')
        self._references = [array('d') for _ in DOFS]

    def restarted(self, dof: str, time: int, velocity: float) -> None:
        """Take the velocity that a DOF takes up from."""
        self._runs[dof].append(_Run(time, velocity))

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
        run = self._runs[dof][-1]
        run.middles.append(span[1])
        run.ends.append(span[2])
        run.first_forces.append(step.forces[0])
        run.last_forces.append(step.forces[1])
        run.velocities.append(step.velocity[2])
        run.means.append(step.mean)

    def reference(self, time: int, value: tuple[float, ...]) -> None:
        """Take a reference velocity: the linear then the angular one."""
        self._reference_times.append(time)
        for column, x in zip(self._references, value):
            column.append(x)

    def records(self, dof: str) -> list[Record]:
        """Return what was measured of a DOF, for the offline methods."""
        runs = self._runs[dof]
        made = [record(runs[0].start, run.middles, run.ends, run.first_forces,
                       run.last_forces, run.means) for run in runs]
        return [one for one in made if one is not None]

    def series(self, dof: str) -> tuple[list[int], list[float], list[float]]:
        """Return the time [ns], filtered velocity and mean force of every step of a DOF."""
        runs = self._runs[dof]
        times = [time for run in runs for time in run.ends]
        velocities = [v for run in runs for v in run.velocities]
        forces = [f for run in runs for f in run.mean_forces().tolist()]
        return times, velocities, forces

    def predicted(self, dof: str, parameters: Sequence[float]) -> list[float]:
        """Return the velocity of a model at every step, filtered like the measured one."""
        return [v for run in self._runs[dof] for v in self._as_measured(run, parameters).tolist()]

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
        column = np.array(self._references[DOFS.index(dof)])
        known = ~np.isnan(column)
        if known.any():
            times = np.array(self._reference_times)[known]
            pairs = [run.at(times, column[known], parameters) for run in self._runs[dof]]
        else:
            pairs = [(self._as_measured(run, parameters), np.array(run.velocities))
                     for run in self._runs[dof]]
        simulated, measured = zip(*pairs) if pairs else ((), ())
        nothing = np.empty(0)
        return Score.of(np.concatenate([nothing, *simulated]),
                        np.concatenate([nothing, *measured]))

    def _as_measured(self, run: _Run, parameters: Sequence[float]) -> Array:
        """Return the prediction at every step, averaged and filtered like the measurement."""
        v = run.predicted(parameters)
        middle, end = v[1::2], v[2::2]
        means = end.copy()
        # of position, the mean from this fix to the next
        averaged = (np.array(run.middles) < np.array(run.ends))[:-1]
        means[:-1][averaged] = ((middle[:-1] + 4.0 * end[:-1] + middle[1:]) / 6.0)[averaged]
        dt = np.diff([run.start, run.start, *run.ends]) * NS
        with np.errstate(invalid='ignore'):  # of a model that runs away
            return filtered(self._cutoff, dt, np.concatenate([[run.velocity], means]))[1:]
