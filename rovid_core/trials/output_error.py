"""
Output error: the parameters whose simulated response comes closest to the measured one.

Nonlinear least squares with physical bounds and a robust loss, fitted to the position if it is
measured. With white noise on the fixes it attains the Cramer-Rao bound, so the other methods are
compared with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from rovid_core.model.dofs import Four, OWN, own_coefficients
from rovid_core.model.plant import Array, integral, midpoint_trajectory, sensitivities
from rovid_core.settings.run import Scales
from rovid_core.trials.record import Fit, Record
from scipy.optimize import least_squares
from scipy.signal import lfilter

# Residuals so many times larger than the noise come from the model, and are not white.
MODEL_ERROR = 3.0


def output_error(records: Sequence[Record], scales: Scales, start: Four) -> Fit:
    """
    Fit the model to a trial, and position and velocity at the start of each of its records.

    Couplings are fitted where the records have their regressors, which are a known input.

    The covariance is from curvature and residuals. The integrated path of a vehicle that turns
    drifts, because noise of the attitude enters it: a random walk in the residuals is detected and
    whitened. Correlation that remains over up to ``MAX_LAG`` steps enlarges the covariance.
    """
    problem = Residuals(records, scales, all(len(r.position) for r in records))
    if not problem.size:
        return Fit.none('the trial is too short')
    solution, rms = problem.solve(start)
    if problem.of_position and rms > MODEL_ERROR * noise(records):
        # the model error accumulates in the position: compare velocities instead
        problem = Residuals(records, scales, False)
        solution, rms = problem.solve(solution)
    elif problem.of_position and problem.find_drift(solution):
        solution, rms = problem.solve(solution)
    covariance = problem.information(solution, rms).covariance * problem.inflation(solution)
    return Fit(cast(Four, solution[:4]), covariance[:4, :4], couplings=solution[4:],
               couplings_std=tuple(np.sqrt(np.diag(covariance)[4:]).tolist()))


def information(records: Sequence[Record], scales: Scales,
                parameters: Sequence[float]) -> Information | None:
    """
    Return the Cramer-Rao bound of a trial for the noise it shows, None if it is too short.

    It is that of the couplings too, where the records have their regressors.
    """
    problem = Residuals(records, scales, all(len(r.position) for r in records))
    if not problem.size:
        return None
    return problem.information(parameters, noise(records))


# Kalman gains for a random walk in white noise that are tried, from none to strong
DRIFTS = (0.0, 0.003, 0.006, 0.012, 0.025, 0.05, 0.1, 0.2, 0.4)
# A random walk is accepted if whitening shrinks the residuals at least to this share.
MIN_SHRINKAGE = 0.975
MAX_LAG = 200  # steps over which residuals may be correlated


@dataclass(frozen=True)
class Information:
    """The information of a trial about the parameters."""

    # shape (4 + k, 4 + k); Cramer-Rao bound of the parameters and of k couplings; 0 for terms that
    # are left out
    covariance: Array
    condition: float  # condition number of the information in normalised parameters


def noise(records: Sequence[Record]) -> float:
    """
    Return the standard deviation of the white noise on the fixes or the velocities.

    It comes from third differences, in which the motion is negligible; the median ignores
    outliers.
    """
    parts = [np.diff(r.position if len(r.position) else r.velocity, 3) for r in records]
    differences = np.abs(np.concatenate(parts))
    return float(np.median(differences) / 0.6745 / np.sqrt(20.0))


class Residuals:
    """
    The residuals of a trial as a function of the unknowns, all in typical sizes.

    The unknowns are the active parameters and the couplings, then velocity (and position) at the
    start of each record.
    """

    def __init__(self, records: Sequence[Record], scales: Scales, of_position: bool) -> None:
        self._records = [r for r in records if len(r.time) > 8]
        self.of_position = of_position
        if not all(len(r.couplings) for r in self._records):
            scales = replace(scales, couplings=())
        self._couplings = scales.couplings
        self._active = np.array((*scales.active, *[True] * len(scales.couplings)))
        self._count = int(self._active.sum())
        self._starts = 2 if of_position else 1  # of each record
        self._scale = np.array((*scales.regressor, *scales.coupling_std))
        self._velocity = scales.velocity
        self._low, self._high = (
            (np.array((*own, *others)) / self._scale)[self._active]
            for own, others in zip(scales.bounds(), scales.coupling_bounds()))
        self.size = sum(len(r.velocity) for r in self._records)
        self._drift = 0.0

    def find_drift(self, parameters: Sequence[float]) -> bool:
        """Tell whether the residuals contain a random walk; if so it is whitened from now on."""
        plain = self._fitted_residuals(parameters)

        def size(gain: float) -> float:
            self._drift = gain
            parts = np.split(plain, np.cumsum([len(r.position) for r in self._records])[:-1])
            white = np.concatenate([self._whitened(part) for part in parts])
            return float(np.median(np.abs(white)))

        sizes = [size(gain) for gain in DRIFTS]
        best = sizes.index(min(sizes))
        # with white noise alone, some gain is slightly better by chance
        self._drift = DRIFTS[best] if sizes[best] < MIN_SHRINKAGE * sizes[0] else 0.0
        return self._drift > 0.0

    def solve(self, start: Sequence[float]) -> tuple[tuple[float, ...], float]:
        """Return the best parameters, couplings last, and the robust rms of the residuals."""
        count, first = self._count, self._unknowns(start)
        inside = 1e-9 * (self._high - self._low)  # the solver starts inside the bounds only
        first[:count] = np.clip(first[:count], self._low + inside, self._high - inside)
        free = np.full(len(first) - count, np.inf)
        keep: dict[str, Array] = {}

        def residuals(unknowns: Array) -> Array:
            values, keep['jacobian'] = self._evaluate(unknowns)
            return values

        def jacobian(unknowns: Array) -> Array:
            return keep['jacobian']

        errors = residuals(first)
        final = self._loss_scale(errors)
        # Far from the solution all residuals are outliers on the scale of the noise, and the
        # solver creeps: it comes near on the scale of the residuals first.
        for scale in (max(final, float(np.median(np.abs(errors)))), final):
            first = least_squares(
                residuals, first, jac=jacobian, loss='soft_l1', f_scale=scale, x_scale='jac',
                max_nfev=60,
                bounds=(np.concatenate([self._low, -free]), np.concatenate([self._high, free]))).x
        errors = residuals(first)
        rms = float(np.median(np.abs(errors)) / 0.6745)
        return tuple(self._parameters(first).tolist()), rms

    def information(self, parameters: Sequence[float], sigma: float) -> Information:
        """Return the bound for white noise of ``sigma`` on what is fitted."""
        jacobian = self._evaluate(self._unknowns(parameters))[1]
        values, vectors = np.linalg.eigh(jacobian.T @ jacobian)
        values = np.maximum(values, 1e-300)
        covariance = (vectors / values) @ vectors.T
        own = covariance[:self._count, :self._count]
        scale = self._scale[self._active]
        full = np.zeros((len(self._active), len(self._active)))
        full[np.ix_(self._active, self._active)] = sigma**2 * scale[:, None] * own * scale
        spread = np.linalg.eigvalsh(own)
        with np.errstate(over='ignore'):  # of what a log does not tell at all
            return Information(full, float(spread[-1] / max(spread[0], 1e-300)))

    def inflation(self, parameters: Sequence[float]) -> float:
        """Return by how much correlated residuals raise the variance, at least 1."""
        errors = self._fitted_residuals(parameters)
        jacobian = self._evaluate(self._unknowns(parameters))[1]
        scores = jacobian * errors[:, None]
        white = scores.T @ scores
        total = white.copy()
        for lag in range(1, min(MAX_LAG, len(scores) // 4)):
            cross = scores[lag:].T @ scores[:-lag]
            total += (1.0 - lag / MAX_LAG) * (cross + cross.T)
        inverse = np.linalg.pinv(jacobian.T @ jacobian)
        found, expected = (
            np.diag(inverse @ of @ inverse)[:self._count] for of in (total, white))
        known = expected > 0.0  # the data show nothing of the others
        return max(1.0, float((found[known] / expected[known]).max(initial=1.0)))

    def _fitted_residuals(self, parameters: Sequence[float]) -> Array:
        """Return the residuals at the best starts, without outliers."""
        # the fitted starts are not stored: linear steps find them, with outliers clipped
        errors, jacobian = self._evaluate(self._unknowns(parameters))
        inverse = np.linalg.pinv(jacobian)
        fit = jacobian @ (inverse @ errors)
        for _ in range(5):
            rest = errors - fit
            limit = 3.0 * float(np.median(np.abs(rest))) / 0.6745
            fit = jacobian @ (inverse @ (fit + np.clip(rest, -limit, limit)))
        return np.asarray(np.clip(errors - fit, -limit, limit))

    def _whitened(self, values: Array) -> Array:
        """Return the innovations of columns that are a random walk in white noise."""
        if not self._drift:
            return values
        keep = 1.0 - self._drift
        return np.asarray(lfilter([1.0, -1.0], [1.0, -keep], values, axis=0))

    def _unknowns(self, parameters: Sequence[float]) -> Array:
        """Return the unknowns of parameters, with a guess of the starts; couplings may lack."""
        count, each = self._count, self._starts
        unknowns = np.zeros(count + each * len(self._records))
        known = np.zeros(len(self._active))
        known[:len(parameters)] = parameters
        unknowns[:count] = (known / self._scale)[self._active]
        for k, record in enumerate(self._records):
            unknowns[count + each * k] = np.mean(record.velocity[:5]) / self._velocity
        return unknowns

    def _loss_scale(self, errors: Array) -> float:
        white = noise(self._records)
        if not self.of_position and len(self._records[0].position):
            # mean velocities differ by the model error too
            return max(white, float(np.median(np.abs(errors))))
        return 2.0 * max(white, 1e-9)

    def _parameters(self, unknowns: Array) -> Array:
        parameters = np.zeros(len(self._active))
        scaled = unknowns[:self._count]
        # so small a drag means that it is at its bound, 0
        scaled = np.where(np.abs(scaled) < 1e-9, 0.0, scaled)
        parameters[self._active] = scaled * self._scale[self._active]
        return parameters

    def _evaluate(self, unknowns: Array) -> tuple[Array, Array]:
        """Return the residuals and their derivatives by the unknowns."""
        parameters = self._parameters(unknowns)
        count, each = self._count, self._starts
        errors: list[Array] = []
        blocks: list[Array] = []
        for k, record in enumerate(self._records):
            own = count + each * k
            others, force = record.couplings[:len(parameters) - 4], record.force
            _, reverse_drag = own_coefficients(self._couplings, parameters[4:].tolist())
            if len(others):  # in the model, couplings are such forces
                kappas = [0.0 if name == OWN[1] else kappa
                          for name, kappa in zip(self._couplings, parameters[4:])]
                force = force + np.array(kappas) @ others / parameters[0]
            v = midpoint_trajectory(parameters[:4], unknowns[own] * self._velocity, record.dt,
                                    force, reverse_drag)
            if OWN[1] in self._couplings:
                others = others.copy()
                w = 0.5 * (v[:-1] + v[1:])
                others[self._couplings.index(OWN[1])] = np.minimum(w, 0.0) * np.abs(w)
            slopes = sensitivities(
                parameters[:4], v, record.dt, record.force, others, reverse_drag)
            values, derivatives, measured = self._output(record, v, slopes)
            block = np.zeros((len(measured), len(unknowns)))
            block[:, :count] = (derivatives[:, :-1] * self._scale)[:, self._active]
            block[:, own] = derivatives[:, -1] * self._velocity
            if self.of_position:
                values = values + unknowns[own + 1] * self._velocity
                block[:, own + 1] = self._velocity
            errors.append(self._whitened(values - measured))
            blocks.append(self._whitened(block))
        return np.concatenate(errors), np.concatenate(blocks)

    def _output(self, record: Record, v: Array, slopes: Array) -> tuple[Array, Array, Array]:
        """Return the predicted values, their derivatives, and the measured values."""
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
