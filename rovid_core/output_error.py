"""
Output error: the parameters whose simulated response comes closest to the measured one.

Nonlinear least squares with physical bounds and a robust loss, fitted to the position where
there is one. With white noise on the fixes it attains the Cramer-Rao bound; it is what the
other methods are held against.
"""

from __future__ import annotations

from collections.abc import Sequence

from rovid_core.dofs import Four
from rovid_core.identifier import Scales
from rovid_core.residuals import Information, noise, Residuals
from rovid_core.trial import Fit, Record

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
