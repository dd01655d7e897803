"""The adaptive identifier offline: the same trial in repeated passes with falling gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from rovid_core.aid import AdaptiveIdentifier, Gains
from rovid_core.dofs import Four
from rovid_core.identifier import Scales
from rovid_core.trial import Fit, Record

SLOWER = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 4.0)
"""Adaptation time of each pass, in those of the first."""


def repeated_passes(records: Sequence[Record], scales: Scales, adaptation_time: float,
                    integrator: str = 'rk4') -> Fit:
    """
    Identify in eight passes, the last ones slower (``SLOWER``).

    The gains are scaled by the trial's own force and velocity. The first passes come near
    from any guess, also in directions that are excited poorly; the result is the mean over
    the second half of the last, which leaves the noise out. The velocity is not filtered,
    for a filter would bias the drag. With Runge-Kutta that is free of bias; Euler and Heun
    take the noise of a velocity and its echo in v_hat for drag.

    Parameters
    ----------
    records : sequence of Record
        The trial.
    scales : Scales
        Initial values, typical sizes and terms.
    adaptation_time : float
        Of the first pass [s].
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
    sized = _measured(records, scales)
    parameters = scales.initial
    refused = 0
    for slower in SLOWER:
        identifier = AdaptiveIdentifier(
            replace(scales, initial=parameters),
            Gains.from_time(adaptation_time * slower, sized), integrator)
        time, means = 0.0, [0.0] * 4
        for sequence in steps:
            identifier.restart(sequence[0].velocity[0] if sequence else 0.0)
            for step in sequence:
                refused += bool(identifier.step(step))
                time += step.dt
                if time > half:
                    means = [m + step.dt * p for m, p in zip(means, identifier.parameters)]
        parameters = identifier.parameters
    average = cast(Four, tuple([m / (time - half) for m in means]))
    return Fit(average, note=f'{refused} steps refused as unstable' if refused else '')


def _measured(records: Sequence[Record], scales: Scales) -> Scales:
    """Return the scales with the force and velocity of the trial, which is all at hand."""
    forces = np.concatenate([record.force for record in records])
    # means of ten leave the noise out
    velocities = np.concatenate([
        record.velocity[:len(record.velocity) // 10 * 10].reshape(-1, 10).mean(axis=1)
        for record in records])
    force, velocity = (float(np.sqrt(2.0 * np.mean(x**2))) if len(x) else 0.0
                       for x in (forces, velocities))
    # a trial in which nothing moves keeps what is typical
    return replace(scales, force=max(force, 0.01 * scales.force),
                   velocity=max(velocity, 0.01 * scales.velocity))
