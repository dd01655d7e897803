"""
Least squares on whole trials: as the paper does it (Section II), and without acceleration.

Both are linear in the parameters, and biased by noise in the regressors. The other methods are
compared with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from rovid_core.model.dofs import Four, PARAMETERS
from rovid_core.model.lowpass import filtered
from rovid_core.model.trajectory import Array
from rovid_core.settings.run import Scales
from rovid_core.trials.record import Fit, Record
from scipy.signal import butter, sosfiltfilt

ORDER = 4
"""Order of the zero-phase low-pass."""

MIN_SINGULAR = 1e-3
"""Directions with less than this share of the largest singular value are undetermined."""


def with_acceleration(records: Sequence[Record], scales: Scales, cutoff: float) -> Fit:
    """
    Identify by eq. 5 and 6: position filtered without phase and differentiated twice.

    Parameters
    ----------
    records : sequence of Record
        Of the trial.
    scales : Scales
        Typical sizes and terms.
    cutoff : float
        Cutoff of the zero-phase low-pass on position and thrust [Hz].

    Returns
    -------
    Fit
        Without covariance: the residuals are filtered noise, not white.

    """
    parts: list[Array] = []
    targets: list[Array] = []
    for record in records:
        grid = np.arange(record.time[0], record.time[-1], np.median(np.diff(record.time)))
        dt = float(grid[1] - grid[0]) if len(grid) > 1 else 0.0
        band = min(cutoff, 0.4 / dt) if dt else cutoff
        edge = int(1.0 / (band * dt)) if dt else 0
        if len(grid) < 4 * edge + 16:
            continue
        smooth = butter(ORDER, band, fs=1.0 / dt, output='sos')
        middles = 0.5 * (record.time[:-1] + record.time[1:])
        force = sosfiltfilt(smooth, np.interp(grid, middles, record.mean_force))
        if len(record.position):
            position = sosfiltfilt(smooth, np.interp(grid, record.time, record.position))
            velocity = np.gradient(position, dt)
        else:
            velocity = sosfiltfilt(smooth, np.interp(grid, record.time, record.velocity))
        inside = slice(edge, -edge)
        parts.append(regressors(force, velocity)[inside])
        targets.append(np.gradient(velocity, dt)[inside])
    return _solve(parts, targets, scales)


def without_acceleration(records: Sequence[Record], scales: Scales, cutoff: float) -> Fit:
    """
    Identify by eq. 3 passed through a low-pass, whose derivative needs no acceleration.

    The filtered acceleration is the difference of the filtered velocity; thrust and drag go
    through the same filter (the approach of the paper's references 2, 15 and 22).
    Parameters and result as in ``with_acceleration``.
    """
    parts: list[Array] = []
    targets: list[Array] = []
    for record in records:
        steps = record.steps()
        if len(steps) < 16:
            continue
        dt = np.array([step.dt for step in steps])
        velocity = filtered(cutoff, dt, np.array([step.velocity[2] for step in steps]))
        dt = dt[1:]
        force = filtered(cutoff, dt, np.array([step.force[1] for step in steps[1:]]))
        middle = 0.5 * (velocity[:-1] + velocity[1:])
        regressor = filtered(cutoff, dt, regressors(force, middle).T).T
        start = len(dt) // 50
        parts.append(regressor[start:])
        targets.append(filtered(cutoff, dt, np.diff(velocity) / dt)[start:])
    return _solve(parts, targets, scales)


def regressors(force: Array, velocity: Array) -> Array:
    """Return phi = [tau, v|v|, v, 1] of many steps, shape (n, 4)."""
    return np.stack(
        [force, velocity * np.abs(velocity), velocity, np.ones_like(velocity)], axis=1)


def _solve(parts: Sequence[Array], targets: Sequence[Array], scales: Scales) -> Fit:
    """Return the pseudoinverse's solution (eq. 6), with a note if it is not unique."""
    if not parts:
        return Fit.none('the trial is too short')
    active = np.array(scales.active)
    size = np.array(scales.regressor)[active]
    table = np.concatenate(parts)[:, active] * size
    _, singular, directions = np.linalg.svd(table, full_matrices=False)
    rank = int((singular > MIN_SINGULAR * singular[0]).sum())
    note = ''
    if rank < len(singular):
        names = np.array(PARAMETERS)[active]
        mixed = names[np.abs(directions[-1]) > 0.3]
        note = (f'rank {rank} of {len(singular)}: this trial does not determine '
                f'{" and ".join(mixed)}')
    solution = np.linalg.pinv(table, rcond=MIN_SINGULAR) @ np.concatenate(targets)
    parameters = np.zeros(4)
    parameters[active] = solution * size
    return Fit(cast(Four, tuple(parameters.tolist())), note=note)
