"""What a controller needs of each degree of freedom, as a row of ``rov/model``."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
import math

from rovid_core.identify.estimate import DofEstimate
from rovid_core.identify.status import STATUSES
from rovid_core.model.dofs import PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical

COLUMNS = (
    'stamp', 'age', 'status', 'valid', 'updated', 'fit', 'delay', 'delay_std',
    *(column for name in (*PHYSICAL, *PARAMETERS) for column in (name, f'{name}_std')),
    'velocity', 'v_hat', 'force', 'velocity_delay', 'v_hat_delay', 'dead_band', 'reverse')
"""
Labels of the columns; those of couplings follow.

``stamp`` is the time of velocity, v_hat and force, ``age`` how much later the newest data were
when the message was made, ``velocity_delay`` and ``v_hat_delay`` by how much these lag behind the
motion at ``stamp``, all in seconds. ``dead_band`` and ``reverse`` say how much of the force the
thrusters give, as ``Thrusters`` has it. ``status`` is the index in ``STATUSES``. All else is as in
``rov/estimate``.
"""


AGE, UPDATED = COLUMNS.index('age'), COLUMNS.index('updated')


def model_columns(couplings: Sequence[str]) -> list[str]:
    """Return the labels of all columns, for the names of the couplings of all DOFs."""
    return [*COLUMNS, *(f'kappa_{name}{end}' for name in couplings for end in ('', '_std'))]


def model_row(dof: DofEstimate, own: Sequence[str], couplings: Sequence[str]) -> list[float]:
    """
    Return the values of a DOF; ``age`` and ``updated`` are NaN, as they change without a step.

    Parameters
    ----------
    own, couplings : sequence of str
        Names of the DOF's couplings, and of those of all DOFs; NaN where it has none.

    """
    mass, quadratic, linear, bias = physical(dof.parameters)
    mass_std, quadratic_std, linear_std, bias_std = dof.physical_std
    alpha, beta, gamma, delta = dof.parameters
    alpha_std, beta_std, gamma_std, delta_std = dof.std
    values = [
        dof.time * 1e-9 if _made_step(dof) else math.nan, math.nan,
        float(STATUSES.index(dof.status)), float(dof.valid), math.nan, dof.fit,
        dof.delay, dof.delay_std,
        mass, mass_std, quadratic, quadratic_std, linear, linear_std, bias, bias_std,
        alpha, alpha_std, beta, beta_std, gamma, gamma_std, delta, delta_std,
        dof.velocity, dof.v_hat, dof.force, dof.velocity_delay, dof.v_hat_delay,
        dof.thrusters.dead_band, dof.thrusters.reverse]
    if not couplings:
        return values
    kappas = dict(zip(own, zip_longest(dof.couplings, dof.couplings_std, fillvalue=math.nan)))
    for name in couplings:
        values += kappas.get(name, (math.nan, math.nan))
    return values


def age(dof: DofEstimate, now: int) -> float:
    """Return how old the numbers of a DOF are [s] at an event time [ns], NaN before a step."""
    if not _made_step(dof):
        return math.nan
    return dof.stale_for or (now - dof.time) * 1e-9


def _made_step(dof: DofEstimate) -> bool:
    return dof.time > 0 or dof.steps > 0
