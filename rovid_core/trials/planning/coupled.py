"""
What planned profiles tell of couplings when all of them are driven at once.

Each DOF is planned by itself. The regressor of a coupling is a product of velocities, so it takes
the profiles of all DOFs that are in it: their velocities are those of their own models.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from rovid_core.identify.intervals import Z95
from rovid_core.model.dofs import OWN, RESTORING, velocity_factors
from rovid_core.model.plant import Array
from rovid_core.settings.run import Scales
from rovid_core.trials.output_error import Residuals
from rovid_core.trials.planning.information import paths, Sensor
from rovid_core.trials.planning.plan import Plan, STEP
from rovid_core.trials.planning.shapes import samples, times
from rovid_core.trials.record import Record


@dataclass(frozen=True)
class CoupledProspect:
    """What the profiles tell of the couplings of a DOF, driven at once."""

    # half the width of the 95 % interval of kappa, infinite for one that they do not tell
    kappas: Mapping[str, float]
    alpha: float  # the same of alpha, relative, with the couplings unknown
    partners: tuple[str, ...]  # whose profiles are needed


def coupled_prospect(dof: str, plans: Mapping[str, Plan], scales: Scales, sensor: Sensor,
                     kappas: Sequence[float]) -> CoupledProspect:
    """
    Return what the profiles of all plans tell of a DOF with couplings (``scales.couplings``).

    ``kappas`` are what is known of them; they take part in the motion of this DOF alone. A
    coupling with the attitude, or with a DOF that is not planned, is not told.
    """
    told = tuple([name for name in scales.couplings if name not in RESTORING
                  and all(other in plans for other in velocity_factors(name))])
    partners = tuple(dict.fromkeys(
        other for name in told for other in velocity_factors(name) if other != dof))
    dt = STEP if sensor.of_velocity else 0.5 * STEP
    moved = {d: _mean_velocity(plans[d], dt) for d in {dof, *partners}}
    force = samples(plans[dof].planned.waveforms, times(plans[dof].limits.duration, dt))
    regressors = np.array([
        # that of the drag is made where the motion is
        np.minimum(force, 0.0) if name in OWN else
        np.prod([moved[other] for other in velocity_factors(name)], axis=0)
        for name in told]).reshape(-1, len(force))
    known = [kappa for name, kappa in zip(scales.couplings, kappas) if name in told]
    model = (*plans[dof].vehicles.parameters[:, 0].tolist(), *known)
    information = Residuals(
        [_record(moved[dof], force, regressors, dt, sensor.of_velocity)],
        replace(scales, couplings=told), not sensor.of_velocity).information(
            model, sensor.noise / math.sqrt(STEP * sensor.rate))
    half = Z95 * np.sqrt(np.diag(information.covariance))
    found = dict(zip(told, half[4:].tolist()))
    return CoupledProspect({name: found.get(name, math.inf) for name in scales.couplings},
                           float(half[0]) / model[0], partners)


def _mean_velocity(plan: Plan, dt: float) -> Array:
    """Return the mean velocity of the model over each step of its profile."""
    force = samples(plan.planned.waveforms, times(plan.limits.duration, dt))[:, None]
    path = paths(plan.vehicles.parameters[:, :1], force, dt)[:, 0, 0]
    return np.asarray(np.diff(path, prepend=0.0) / dt)


def _record(velocity: Array, force: Array, regressors: Array, dt: float,
            of_velocity: bool) -> Record:
    """Return a trial without noise, with a measurement after every ``STEP``."""
    path = np.concatenate([[0.0], np.cumsum(velocity * dt)])
    if of_velocity:
        speed = np.concatenate([[0.0], 0.5 * (velocity[1:] + velocity[:-1]), velocity[-1:]])
        return Record(_grid(len(path)), np.empty(0), speed, np.full(len(force), dt), force,
                      regressors)
    path = path[:len(path) // 2 * 2 + 1:2]
    count = 2 * (len(path) - 1)
    return Record(_grid(len(path)), path, np.diff(path) / STEP, np.full(count, dt),
                  force[:count], regressors[:, :count])


def _grid(count: int) -> Array:
    return np.asarray(np.arange(count) * STEP, dtype=np.float64)
