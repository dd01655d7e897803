"""
The offline methods by name: least squares, the adaptive identifier, and output error.

Least squares as the paper does it (Section II), or without acceleration, is linear in the
parameters and biased by noise in the regressors. The other methods are compared with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
import math
from typing import cast

import numpy as np
from rovid_core.identify.aid.full_gain import FullGainIdentifier, inverse_gram
from rovid_core.model.dofs import Four, PARAMETERS
from rovid_core.model.lowpass import filtered
from rovid_core.model.plant import Array
from rovid_core.model.samples import Step
from rovid_core.settings.run import DofSettings, Scales, Settings
from rovid_core.trials.output_error import output_error
from rovid_core.trials.record import Fit, Record
from scipy.signal import butter, sosfiltfilt

LOWPASS_ORDER = 4  # order of the zero-phase low-pass
# Directions with less than this share of the largest singular value are undetermined.
MIN_SINGULAR = 1e-3
PASS_TIMES = (7.0, 7.0, 10.0)  # settling time of each pass over the trial, in adaptation times
FEEDBACK = 3.0  # |a| of eq. 7 times the adaptation time: so slow that v_hat is nearly a simulation
# Least share of a mean square that the other regressors are taken to leave unexplained.
MIN_SHARE = 1e-3
# Least mean squares of the regressors, in typical ones, for trials without motion.
MIN_SQUARE = 1e-4
# The first guess of the regressors uses means of so many steps, to reduce noise.
AVERAGED_STEPS = 10


def with_acceleration(records: Sequence[Record], scales: Scales, cutoff: float) -> Fit:
    """
    Identify by eq. 5 and 6: position filtered without phase and differentiated twice.

    ``cutoff`` [Hz] is that of the zero-phase low-pass on position and thrust. There is no
    covariance, as the residuals are filtered noise, not white.
    """
    parts: list[Array] = []
    targets: list[Array] = []
    for record in records:
        grid = np.arange(record.time[0], record.time[-1], np.median(np.diff(record.time)))
        dt = float(grid[1] - grid[0])
        band = min(cutoff, 0.4 / dt)
        edge = int(1.0 / (band * dt))
        if len(grid) < 4 * edge + 16:
            continue
        smooth = butter(LOWPASS_ORDER, band, fs=1.0 / dt, output='sos')
        middles = 0.5 * (record.time[:-1] + record.time[1:])
        force = sosfiltfilt(smooth, np.interp(grid, middles, record.mean_force))
        if len(record.position):
            position = sosfiltfilt(smooth, np.interp(grid, record.time, record.position))
            velocity = np.gradient(position, dt)
        else:
            velocity = sosfiltfilt(smooth, np.interp(grid, record.time, record.velocity))
        inside = slice(edge, -edge)
        parts.append(_regressors(force, velocity)[inside])
        targets.append(np.gradient(velocity, dt)[inside])
    return _solve(parts, targets, scales)


def without_acceleration(records: Sequence[Record], scales: Scales, cutoff: float) -> Fit:
    """
    Identify by eq. 3 passed through a low-pass, whose derivative needs no acceleration.

    The filtered acceleration is the difference of the filtered velocity; thrust and drag go
    through the same filter (the approach of the paper's references 2, 15 and 22). There is no
    covariance.
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
        regressor = filtered(cutoff, dt, _regressors(force, middle).T).T
        start = len(dt) // 50
        parts.append(regressor[start:])
        targets.append(filtered(cutoff, dt, np.diff(velocity) / dt)[start:])
    return _solve(parts, targets, scales)


def _regressors(force: Array, velocity: Array, *couplings: Array) -> Array:
    """Return phi = [tau, v|v|, v, 1, x ...] of many steps, shape (n, 4 + m)."""
    return np.stack([force, velocity * np.abs(velocity), velocity, np.ones_like(velocity),
                     *couplings], axis=1)


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


def adaptive_identifier(records: Sequence[Record], scales: Scales,
                        adaptation_time: float) -> Fit:
    """
    Identify by the paper's identifier in three passes over the trial, the last one slower.

    Gamma is the inverse of the trial's mean of phi phi', so that every combination of the
    parameters settles in the same time, also those that a slow sinusoid hardly shows. The result
    is the mean over the second half of the last pass, which averages the noise; it has no
    covariance. The velocity is not filtered, because a filter would bias the drag. Couplings are
    identified where the records have their regressors. ``adaptation_time`` [s] scales the times
    of all passes.
    """
    steps = [record.steps() for record in records]
    half = 0.5 * sum(step.dt for sequence in steps for step in sequence)
    if not half:
        return Fit.none('the trial is too short')
    if not all(len(record.couplings) for record in records):
        scales = replace(scales, couplings=())
    count = 4 + len(scales.couplings)
    theta: tuple[float, ...] = (*scales.initial, *(0.0 for _ in scales.couplings))
    phi = np.concatenate([_averaged_regressors(sequence, count) for sequence in steps])
    a = FEEDBACK / adaptation_time
    refused = 0
    for slower in PASS_TIMES:
        identifier = FullGainIdentifier(
            scales, a, a / (slower * adaptation_time) * inverse_gram(
                phi.T @ phi / len(phi), scales, (MIN_SQUARE,) * count, MIN_SHARE))
        identifier.theta_hat = theta
        time, means, seen = 0.0, (0.0,) * count, []
        for sequence in steps:
            identifier.restart(sequence[0].velocity[0] if sequence else 0.0)
            for step in sequence:
                refused += bool(identifier.step(step))
                seen.append((step.force[1], identifier.v_hat, *step.filtered_couplings))
                time += step.dt
                if time > half:
                    means = tuple([
                        m + step.dt * p for m, p in zip(means, identifier.theta_hat)])
        theta = tuple([m / (time - half) for m in means])
        phi = _regressors(*np.array(seen).T)
    return Fit(cast(Four, theta[:4]), note=f'{refused} steps refused' if refused else '',
               couplings=theta[4:], couplings_std=(math.nan,) * (count - 4))


def _averaged_regressors(steps: Sequence[Step], count: int) -> Array:
    """Return the regressors of means of ``AVERAGED_STEPS`` steps, shape (n, count)."""
    table = np.array([(step.force[1], step.velocity[1], *step.filtered_couplings)
                      for step in steps]).reshape(-1, count - 2)
    size = min(AVERAGED_STEPS, max(len(table), 1))
    means = table[:len(table) // size * size].reshape(-1, size, count - 2).mean(axis=1)
    return _regressors(*means.T)


Method = Callable[[Sequence[Record], Scales, Settings], Fit]


def _output_error(records: Sequence[Record], scales: Scales, settings: Settings) -> Fit:
    start = with_acceleration(records, scales, settings.cutoff).parameters
    if not all(map(math.isfinite, start)):
        start = scales.initial
    return output_error(records, scales, start)


# Least squares as in the paper and without acceleration, the paper's identifier in several passes
# with Runge-Kutta, and output error, which is the reference.
METHODS: dict[str, Method] = {
    'least_squares': lambda records, scales, settings: with_acceleration(
        records, scales, settings.cutoff),
    'filtered_least_squares': lambda records, scales, settings: without_acceleration(
        records, scales, settings.cutoff),
    'aid_offline': lambda records, scales, settings: adaptive_identifier(
        records, scales, settings.identifier.adaptation_time),
    'output_error': _output_error,
}


def subsets(settings: DofSettings) -> Iterator[DofSettings]:
    """Yield the DOF without one or two of its configured terms; alpha stays."""
    others = [term for term in settings.terms if term != 'alpha']
    for count in (1, 2):
        for kept in combinations(others, max(len(others) - count, 0)):
            yield replace(settings, terms=tuple(
                term for term in PARAMETERS if term == 'alpha' or term in kept))
