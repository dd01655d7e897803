"""
The paper's score: simulate the model with the logged thrust and compare the velocity.

``mae = mean |v_sim - v|`` (Section V) and ``fit = 1 - rms(v_sim - v) / std(v)``.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field
import math

from rovid_core.dofs import DOFS
from rovid_core.lowpass import LowPass
from rovid_core.plant import advance
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

    """

    mae: float = math.nan
    fit: float = math.nan

    @staticmethod
    def of(simulated: Sequence[float], measured: Sequence[float]) -> Score:
        """Return the score of a simulated against a measured velocity."""
        n = len(measured)
        if n == 0:
            return Score()
        errors = [a - b for a, b in zip(simulated, measured)]
        mean = math.fsum(measured) / n
        spread = math.fsum((x - mean) ** 2 for x in measured)
        mae = math.fsum(map(abs, errors)) / n
        if spread == 0.0:
            return Score(mae)
        return Score(mae, 1.0 - math.sqrt(math.fsum(e * e for e in errors) / spread))


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

    def stepped(self, dof: str, span: tuple[int, int, int], force: tuple[float, float],
                velocity: float, mean: float) -> None:
        """
        Take a step.

        Parameters
        ----------
        dof : str
            One of the run's DOFs.
        span : tuple of int
            Start of the step, start of its measurement, end of the step [ns].
        force : tuple of float
            Mean forces of the two parts [N or N m].
        velocity, mean : float
            The measured velocity, filtered and not [m/s or rad/s].

        """
        run = self._runs[dof][-1]
        run.middles.append(span[1])
        run.ends.append(span[2])
        run.first_forces.append(force[0])
        run.last_forces.append(force[1])
        run.velocities.append(velocity)
        run.means.append(mean)

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
        times: list[int] = []
        velocities: list[float] = []
        forces: list[float] = []
        for run in self._runs[dof]:
            before = run.start
            for middle, end, first, last in zip(
                    run.middles, run.ends, run.first_forces, run.last_forces):
                share = (middle - before) / (end - before)
                forces.append(first * share + last * (1.0 - share))
                before = end
            times += run.ends
            velocities += run.velocities
        return times, velocities, forces

    def predicted(self, dof: str, parameters: Sequence[float]) -> list[float]:
        """Return the velocity of a model at every step, filtered like the measured one."""
        return [v for run in self._runs[dof]
                for v in self._as_measured(run, simulate_run(run, parameters)[1])]

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
        simulated: list[float] = []
        measured: list[float] = []
        column = self._references[DOFS.index(dof)]
        has_reference = any(not math.isnan(x) for x in column)
        for run in self._runs[dof]:
            times, velocities = simulate_run(run, parameters)
            if has_reference:
                self._at_references(times, velocities, column, simulated, measured)
            else:
                simulated += self._as_measured(run, velocities)
                measured += run.velocities
        return Score.of(simulated, measured)

    def _as_measured(self, run: _Run, v: Sequence[float]) -> list[float]:
        lowpass = LowPass(self._cutoff)
        lowpass.step(0.0, (run.velocity,))
        out, before, n = [], run.start, len(run.ends)
        for k, end in enumerate(run.ends):
            now = v[2 * k + 2]
            if run.middles[k] < end and k + 1 < n:  # the mean from this fix to the next
                now = (v[2 * k + 1] + 4.0 * now + v[2 * k + 3]) / 6.0
            out.append(lowpass.step((end - before) * NS, (now,))[0])
            before = end
        return out

    def _at_references(self, times: Sequence[int], velocities: Sequence[float],
                       column: Sequence[float], simulated: list[float],
                       measured: list[float]) -> None:
        first = bisect_left(self._reference_times, times[0])
        for k in range(first, len(self._reference_times)):
            time = self._reference_times[k]
            if time > times[-1]:
                break
            if math.isnan(column[k]):
                continue
            i = max(bisect_left(times, time), 1)
            if i == len(times):
                break
            span = times[i] - times[i - 1]
            share = (time - times[i - 1]) / span if span else 1.0
            simulated.append(velocities[i - 1] + share * (velocities[i] - velocities[i - 1]))
            measured.append(column[k])


def simulate_run(run: _Run, parameters: Sequence[float]) -> tuple[list[int], list[float]]:
    """Return times [ns] and velocities at the start, middle and end of every step."""
    times, velocities = [run.start], [run.velocity]
    time, v = run.start, run.velocity
    for middle, end, first, last in zip(
            run.middles, run.ends, run.first_forces, run.last_forces):
        for until, force in ((middle, first), (end, last)):
            if until > time:
                v = advance(parameters, v, force, (until - time) * NS)
                time = until
            times.append(time)
            velocities.append(v)
    return times, velocities
