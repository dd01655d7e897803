"""The adaptive identifier offline: the same trial in repeated passes with falling gain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from rovid_core.identify.aid.self_tuning import FullGainIdentifier, inverse_gram
from rovid_core.model.dofs import Four
from rovid_core.model.samples import Step
from rovid_core.settings.run import Scales
from rovid_core.trials.record import Array, Fit, Record

PASSES = (7.0, 7.0, 10.0)
"""Time in which each pass settles, in adaptation times."""

FEEDBACK = 3.0
"""|a| of eq. 7, over the adaptation time: slow, so that v_hat is nearly a simulation."""

LEAST_SHARE = 1e-3
"""Of a regressor's mean square: a direction with less does not get more gain."""

LEAST_SQUARES = (1e-4,) * 4
"""Of the regressors, in typical ones: a trial in which nothing moves keeps what is typical."""

PIECES = {'euler': 4, 'heun': 2, 'rk4': 1}
"""Into which a step is divided, so that every integrator evaluates eq. 7 and 11 four times."""

SMOOTH = 10
"""Steps of which the first guess of the regressors takes the mean, to leave noise out."""


def repeated_passes(records: Sequence[Record], scales: Scales, adaptation_time: float,
                    integrator: str = 'rk4') -> Fit:
    """
    Identify in three passes, the last one slower (``PASSES``).

    Gamma is the inverse of the trial's mean phi phi', so that every combination of the
    parameters settles in the same time, also those that a slow sinusoid hardly shows. The
    result is the mean over the second half of the last pass, which leaves the noise out.
    The velocity is not filtered, for a filter would bias the drag. With Runge-Kutta that is
    free of bias; Euler and Heun have that of their step, and take the noise of a velocity and
    its echo in v_hat for drag, less so as their steps are divided (``PIECES``).

    Parameters
    ----------
    records : sequence of Record
        The trial.
    scales : Scales
        Initial values, typical sizes and terms.
    adaptation_time : float
        Of the identifier [s]; scales all times of the passes.
    integrator : str
        ``rk4`` as in the paper, ``heun`` or ``euler``.

    Returns
    -------
    Fit
        Without std.

    """
    steps = [record.steps() for record in records]
    half = 0.5 * sum(step.dt for sequence in steps for step in sequence)
    if not half:
        return Fit.none('the trial is too short')
    parameters = scales.initial
    phi = np.concatenate([_smoothed(sequence) for sequence in steps])
    a = FEEDBACK / adaptation_time
    refused = 0
    for slower in PASSES:
        identifier = FullGainIdentifier(
            scales, a, a / (slower * adaptation_time) * inverse_gram(
                phi.T @ phi / len(phi), scales, LEAST_SQUARES, LEAST_SHARE),
            integrator, PIECES[integrator])
        identifier.theta_hat = parameters
        time, means, seen = 0.0, [0.0] * 4, []
        for sequence in steps:
            identifier.restart(sequence[0].velocity[0] if sequence else 0.0)
            for step in sequence:
                refused += bool(identifier.step(step))
                seen.append((step.force[1], identifier.v_hat))
                time += step.dt
                if time > half:
                    means = [m + step.dt * p for m, p in zip(means, identifier.parameters)]
        parameters = cast(Four, tuple([m / (time - half) for m in means]))
        phi = _regressors(np.array(seen))
    return Fit(parameters, note=f'{refused} steps refused as unstable' if refused else '')


def _regressors(force_and_velocity: Array) -> Array:
    force, v = force_and_velocity.T
    return np.stack([force, v * np.abs(v), v, np.ones_like(v)], axis=1)


def _smoothed(steps: Sequence[Step]) -> Array:
    """Return the regressors of means of ``SMOOTH`` steps."""
    table = np.array([(step.force[1], step.velocity[1]) for step in steps]).reshape(-1, 2)
    size = min(SMOOTH, max(len(table), 1))
    return _regressors(table[:len(table) // size * size].reshape(-1, size, 2).mean(axis=1))
