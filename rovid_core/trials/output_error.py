"""
Output error: the parameters whose simulated response comes closest to the measured one.

Nonlinear least squares with physical bounds and a robust loss, fitted to the position where
there is one. With white noise on the fixes it attains the Cramer-Rao bound; it is what the
other methods are held against.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from rovid_core.model.dofs import Four
from rovid_core.model.trajectory import Array, integral, midpoint_trajectory, sensitivities
from rovid_core.settings.run import Scales
from rovid_core.trials.record import Fit, Record
from scipy.optimize import least_squares
from scipy.signal import lfilter

MODEL_ERROR = 3.0
"""Residuals this much larger than the noise are the model's fault, and then not white."""


def output_error(records: Sequence[Record], scales: Scales, start: Four) -> Fit:
    """
    Fit the model to a trial.

    Parameters
    ----------
    records : sequence of Record
        The trial; each record has a position and a velocity of its own at its start.
    scales : Scales
        Typical sizes, terms and bounds.
    start : tuple of 4 floats
        Parameters to begin with.

    Returns
    -------
    Fit
        With the covariance from the curvature and the residuals. The path of a vehicle that
        turns drifts by the noise that the turns leave in it: that is told from the residuals
        and whitened. What correlation is left over ``CORRELATED`` steps makes it larger.

    """
    problem = Residuals(records, scales, all(len(r.position) for r in records))
    if not problem.size:
        return Fit.none('the trial is too short')
    solution, rms = problem.solve(start)
    if problem.of_position and rms > MODEL_ERROR * noise(records):
        # the model's own error drifts away in the position: compare velocities instead
        problem = Residuals(records, scales, False)
        solution, rms = problem.solve(solution)
    elif problem.of_position and problem.find_drift(solution):
        solution, rms = problem.solve(solution)
    white = problem.information(solution, rms).covariance
    return Fit(solution, white * problem.inflation(solution))


def information(records: Sequence[Record], scales: Scales,
                parameters: Four) -> Information | None:
    """
    Return the Cramer-Rao bound of a trial at ``parameters``, for its own noise.

    None where it is too short for one.
    """
    problem = Residuals(records, scales, all(len(r.position) for r in records))
    if not problem.size:
        return None
    return problem.information(parameters, noise(records))


DRIFTS = (0.0, 0.003, 0.006, 0.012, 0.025, 0.05, 0.1, 0.2, 0.4)
"""Gains of the filter for a random walk beside the white noise, from none to much."""

CLEARLY = 0.975
"""Residuals have to shrink by this for a random walk to be believed."""

CORRELATED = 200
"""Steps over which residuals may be correlated."""


@dataclass(frozen=True)
class Information:
    """
    What a trial can say about the parameters at best.

    Attributes
    ----------
    covariance : ndarray, shape (4, 4)
        Cramer-Rao bound of the parameters; 0 for terms that are left out.
    condition : float
        Condition number of the information in normalised parameters.

    """

    covariance: Array
    condition: float


def noise(records: Sequence[Record]) -> float:
    """
    Return the standard deviation of the white noise on the fixes or the velocities.

    From third differences, to which the motion adds next to nothing; the median keeps
    outliers out.
    """
    parts = [np.diff(r.position if len(r.position) else r.velocity, 3) for r in records]
    differences = np.abs(np.concatenate(parts))
    return float(np.median(differences) / 0.6745 / np.sqrt(20.0))


class Residuals:
    """The residuals of a trial as a function of scaled unknowns."""

    def __init__(self, records: Sequence[Record], scales: Scales, of_position: bool) -> None:
        self._records = [r for r in records if len(r.time) > 8]
        self.of_position = of_position
        self._active = np.array(scales.active)
        self._scale = np.array(scales.regressor)
        self._velocity = scales.velocity
        low, high = scales.bounds()
        self._low = (np.array(low) / self._scale)[self._active]
        self._high = (np.array(high) / self._scale)[self._active]
        self.size = sum(len(r.velocity) for r in self._records)
        self._drift = 0.0

    def find_drift(self, parameters: Four) -> bool:
        """Tell whether the residuals hold a random walk; whiten it from now on."""
        plain = self._best_linear(parameters)

        def size(gain: float) -> float:
            self._drift = gain
            parts = np.split(plain, np.cumsum([len(r.position) for r in self._records])[:-1])
            white = np.concatenate([self._whitened(part) for part in parts])
            return float(np.median(np.abs(white)))

        sizes = [size(gain) for gain in DRIFTS]
        best = sizes.index(min(sizes))
        # white noise alone gives some gain a slight lead by chance
        self._drift = DRIFTS[best] if sizes[best] < CLEARLY * sizes[0] else 0.0
        return self._drift > 0.0

    def solve(self, start: Four) -> tuple[Four, float]:
        """Return the best parameters and the robust rms of the residuals."""
        count = int(self._active.sum())
        each = 2 if self.of_position else 1
        first = np.zeros(count + each * len(self._records))
        # inside the box: the solver starts nowhere else
        inside = 1e-9 * (self._high - self._low)
        first[:count] = np.clip(
            (np.array(start) / self._scale)[self._active], self._low + inside,
            self._high - inside)
        for k, record in enumerate(self._records):
            first[count + each * k] = np.mean(record.velocity[:5]) / self._velocity
        free = np.full(len(first) - count, np.inf)
        keep: dict[str, Array] = {}

        def residuals(unknowns: Array) -> Array:
            values, keep['jacobian'] = self._evaluate(unknowns)
            return values

        def jacobian(unknowns: Array) -> Array:
            return keep['jacobian']

        solution = least_squares(
            residuals, first, jac=jacobian, loss='soft_l1',
            f_scale=self._loss_scale(residuals(first)), x_scale='jac', max_nfev=60,
            bounds=(np.concatenate([self._low, -free]), np.concatenate([self._high, free])))
        errors = residuals(solution.x)
        rms = float(np.median(np.abs(errors)) / 0.6745)
        return cast(Four, tuple(self._parameters(solution.x).tolist())), rms

    def information(self, parameters: Four, sigma: float) -> Information:
        """Return the bound for white noise of ``sigma`` on what is fitted."""
        count = int(self._active.sum())
        jacobian = self._evaluate(self._unknowns(parameters))[1]
        values, vectors = np.linalg.eigh(jacobian.T @ jacobian)
        values = np.maximum(values, 1e-300)
        covariance = (vectors / values) @ vectors.T
        own = covariance[:count, :count]
        scale = self._scale[self._active]
        full = np.zeros((4, 4))
        full[np.ix_(self._active, self._active)] = sigma**2 * scale[:, None] * own * scale
        spread = np.linalg.eigvalsh(own)
        return Information(full, float(spread[-1] / max(spread[0], 1e-300)))

    def inflation(self, parameters: Four) -> float:
        """Return by how much correlated residuals raise the variance, at least 1."""
        errors = self._best_linear(parameters)
        jacobian = self._evaluate(self._unknowns(parameters))[1]
        scores = jacobian * errors[:, None]
        white = scores.T @ scores
        total = white.copy()
        for lag in range(1, min(CORRELATED, len(scores) // 4)):
            cross = scores[lag:].T @ scores[:-lag]
            total += (1.0 - lag / CORRELATED) * (cross + cross.T)
        inverse = np.linalg.pinv(jacobian.T @ jacobian)
        count = int(self._active.sum())
        ratio = (np.diag(inverse @ total @ inverse)[:count]
                 / np.diag(inverse @ white @ inverse)[:count])
        return max(1.0, float(ratio.max()))

    def _best_linear(self, parameters: Four) -> Array:
        # the starts are not at hand: linear steps bring them, with outliers drawn in
        errors, jacobian = self._evaluate(self._unknowns(parameters))
        inverse = np.linalg.pinv(jacobian)
        fit = jacobian @ (inverse @ errors)
        for _ in range(5):
            rest = errors - fit
            limit = 3.0 * float(np.median(np.abs(rest))) / 0.6745
            fit = jacobian @ (inverse @ (fit + np.clip(rest, -limit, limit)))
        return np.asarray(np.clip(errors - fit, -limit, limit))

    def _whitened(self, values: Array) -> Array:
        """Return the innovations of a random walk in white noise, of columns over time."""
        if not self._drift:
            return values
        keep = 1.0 - self._drift
        return np.asarray(lfilter([1.0, -1.0], [1.0, -keep], values, axis=0))

    def _unknowns(self, parameters: Four) -> Array:
        count = int(self._active.sum())
        each = 2 if self.of_position else 1
        unknowns = np.zeros(count + each * len(self._records))
        unknowns[:count] = (np.array(parameters) / self._scale)[self._active]
        for k, record in enumerate(self._records):
            unknowns[count + each * k] = np.mean(record.velocity[:5]) / self._velocity
        return unknowns

    def _loss_scale(self, errors: Array) -> float:
        white = noise(self._records)
        if not self.of_position and len(self._records[0].position):
            # of mean velocities, beside the model's own error
            return max(white, float(np.median(np.abs(errors))))
        return 2.0 * max(white, 1e-9)

    def _parameters(self, unknowns: Array) -> Array:
        parameters = np.zeros(4)
        count = int(self._active.sum())
        # beside a typical acceleration of 1e-3 that is a drag at its bound, which is 0
        scaled = np.where(np.abs(unknowns[:count]) < 1e-9, 0.0, unknowns[:count])
        parameters[self._active] = scaled * self._scale[self._active]
        return parameters

    def _evaluate(self, unknowns: Array) -> tuple[Array, Array]:
        """Return residuals and their derivatives by the unknowns."""
        parameters = self._parameters(unknowns)
        count = int(self._active.sum())
        each = 2 if self.of_position else 1
        errors: list[Array] = []
        blocks: list[Array] = []
        for k, record in enumerate(self._records):
            own = count + each * k
            v = midpoint_trajectory(
                parameters, unknowns[own] * self._velocity, record.dt, record.force)
            slopes = sensitivities(parameters, v, record.dt, record.force)
            values, derivatives, measured = self._output(record, v, slopes)
            block = np.zeros((len(measured), len(unknowns)))
            block[:, :count] = (derivatives[:, :4] * self._scale)[:, self._active]
            block[:, own] = derivatives[:, 4] * self._velocity
            if self.of_position:
                values = values + unknowns[own + 1] * self._velocity
                block[:, own + 1] = self._velocity
            errors.append(self._whitened(values - measured))
            blocks.append(self._whitened(block))
        return np.concatenate(errors), np.concatenate(blocks)

    def _output(self, record: Record, v: Array, slopes: Array) -> tuple[Array, Array, Array]:
        if self.of_position:
            nodes = record.nodes
            return (integral(v, record.dt)[nodes], integral(slopes, record.dt)[nodes],
                    record.position)
        if not len(record.position):
            return v, slopes, record.velocity
        spans = record.dt.reshape(-1, 2).sum(axis=1)
        means = np.diff(integral(v, record.dt)[record.nodes]) / spans
        derivatives = np.diff(integral(slopes, record.dt)[record.nodes], axis=0) / spans[:, None]
        return means, derivatives, record.velocity
