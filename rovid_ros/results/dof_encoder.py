"""
What the output topics say of one DOF, encoded; what did not change is encoded already.

That is a row of each of the tables, of which ``rov/model`` is what a controller needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
import math
import struct
from typing import Final

from rovid_core.identify.estimate import DofEstimate
from rovid_core.identify.intervals import Uncertainty
from rovid_core.identify.status import Judgement, STATUSES
from rovid_core.model.dofs import PARAMETERS, PHYSICAL
from rovid_core.model.plant import physical
from rovid_core.model.thrusters import AS_CONFIGURED
from rovid_ros.results.wire_encoding import known_status, number_pairs, pair, string

COLUMNS = (
    'stamp', 'age', 'status', 'valid', 'updated', 'fit', 'delay', 'delay_std',
    *(column for name in (*PHYSICAL, *PARAMETERS) for column in (name, f'{name}_std')),
    'velocity', 'v_hat', 'force', 'velocity_delay', 'v_hat_delay', 'dead_band', 'reverse',
    'loss')
"""
Labels of the columns of ``rov/model``; those of couplings follow.

``stamp`` is the time of velocity, v_hat and force, ``age`` how much later the newest data were
when the message was made, ``velocity_delay`` and ``v_hat_delay`` by how much these lag behind the
motion at ``stamp``, all in seconds. ``dead_band``, ``reverse`` and ``loss`` say how much of the
force the thrusters give, as ``Thrusters`` has it. ``status`` is the index in ``STATUSES``. All
else is as in ``rov/estimate``.
"""

AGE, UPDATED = COLUMNS.index('age'), COLUMNS.index('updated')

_FOUR: Final = struct.Struct('<4d')
_ONE: Final = struct.Struct('<d')
_AGE_AT: Final = _ONE.size * AGE
_UPDATED_AT: Final = _ONE.size * UPDATED
_PARAMETERS: Final = [string(name) for name in PARAMETERS]
_STDS: Final = [string(f'{name}_std') for name in PARAMETERS]
_PHYSICAL: Final = [string(name) for name in PHYSICAL]
_ENDS: Final = {
    name: (string(f'{name}_low'), string(f'{name}_high')) for name in (*PARAMETERS, *PHYSICAL)}
_MOTION: Final = [
    string(name) for name in ('velocity', 'v_hat', 'dv', 'force', 'excitation', 'steps')]
_TIME: Final = [string('time')]
_STALE_FOR: Final = string('age')
_OPTIONAL: Final = [string(name) for name in ('delay', 'delay_std', 'W')]
_THRUSTERS: Final = [
    string(name) for name in ('lag', 'dead_band', 'reverse', 'loss', 'lag_of_turns', 'lag_at')]
_UPDATED: Final = pair('updated', 'false'), pair('updated', 'true')
_FIXED = 4 + 4 + 4 + 6 + 4  # pairs that are always there: these, and status, reasons and time


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
        dof.thrusters.dead_band, dof.thrusters.reverse, dof.thrusters.loss]
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


class DofEncoder:
    """
    Encodes a DOF's rows of the tables, and its status in ``rov/estimate``.

    While it is invalid or stale, the rows of parameters and couplings stay the last valid ones.

    Parameters
    ----------
    initial : DofEstimate
        Before the first step.
    own, couplings : tuple of str
        Names of its couplings, and of those of all DOFs.

    Attributes
    ----------
    parameters, std, kappas, kappas_std : bytes
        Rows of ``rov/params``, ``rov/params_std``, ``rov/couplings``, ``rov/couplings_std``.

    """

    def __init__(self, initial: DofEstimate, own: tuple[str, ...],
                 couplings: tuple[str, ...]) -> None:
        self._own, self._couplings = own, couplings
        self._kappas = struct.Struct(f'<{len(couplings)}d')
        self._kappa_keys = [
            (string(f'kappa_{name}'), string(f'kappa_{name}_std')) for name in own]
        self._row_of: Uncertainty | None = None  # whose row ``std`` is
        self._std_of: Uncertainty | None = None  # whose pairs ``_std`` are
        self._said_of: Judgement | None = None  # whose ``_start`` and ``_said`` these are
        self._std = self._start = self._said = ''
        self._take(initial)

    def take(self, estimate: DofEstimate) -> None:
        """Encode this estimate from now on."""
        if estimate is not self._estimate:
            self._take(estimate)

    def _take(self, estimate: DofEstimate) -> None:
        self._estimate = estimate
        self._model = bytearray()
        self._bodies: list[bytes] = []  # of the status: without a step, and with one
        if estimate.status in ('invalid', 'stale'):
            return
        self.parameters = _FOUR.pack(*estimate.parameters)
        if estimate.uncertainty is not self._row_of:
            self._row_of = estimate.uncertainty
            self.std = _FOUR.pack(*estimate.std)
        if self._couplings:
            self.kappas = self._row(estimate.couplings)
            self.kappas_std = self._row(estimate.couplings_std)

    def _row(self, values: Sequence[float]) -> bytes:
        """Return a row of couplings, NaN where the DOF has no such one."""
        known = dict(zip(self._own, values))
        return self._kappas.pack(*[known.get(name, math.nan) for name in self._couplings])

    def model(self, now: int, stepped: bool) -> bytearray:
        """Return the row of ``rov/model`` at an event time [ns]."""
        if not self._model:
            values = model_row(self._estimate, self._own, self._couplings)
            self._model = bytearray(struct.pack(f'<{len(values)}d', *values))
        # these change without a step of this DOF
        _ONE.pack_into(self._model, _AGE_AT, age(self._estimate, now))
        _ONE.pack_into(self._model, _UPDATED_AT, stepped)
        return self._model

    def status(self, stepped: bool) -> bytes:
        """Return the ``status_body``."""
        if not self._bodies:
            self._bodies = self._encode_status()
        return self._bodies[stepped]

    def _encode_status(self) -> list[bytes]:
        """Return the status; a step changes nothing in it but ``updated``."""
        dof = self._estimate
        uncertainty = dof.uncertainty
        if uncertainty is not self._std_of:
            self._std_of = uncertainty
            self._std = number_pairs(_STDS, uncertainty.std)
        if dof.judgement is not self._said_of or dof.stale_for:
            self._said_of = None if dof.stale_for else dof.judgement
            self._start = ''.join([string(dof.dof), string(dof_message(dof)), string('')])
            self._said = pair('status', dof.status) + pair('reasons', ', '.join(dof.reasons))
        keys, numbers = [*_PHYSICAL], [*physical(dof.parameters)]
        intervals = dof.intervals
        for name, interval in intervals.items():
            keys += _ENDS[name]
            numbers += interval
        keys += _MOTION
        numbers += (dof.velocity, dof.v_hat, dof.dv, dof.force, dof.excitation, dof.steps)
        left = ''.join([
            number_pairs(_PARAMETERS, dof.parameters), self._std, number_pairs(keys, numbers),
            self._said, number_pairs(_TIME, [dof.time])])
        keys, numbers = [], []
        for key, value in zip(_OPTIONAL, (dof.delay, uncertainty.delay_std, dof.W)):
            if not math.isnan(value):
                keys.append(key)
                numbers.append(value)
        for both, *kappa in zip(self._kappa_keys, dof.couplings, uncertainty.couplings_std):
            keys += both
            numbers += kappa
        if dof.thrusters != AS_CONFIGURED:
            keys += _THRUSTERS
            numbers += map(float, dof.thrusters)
        if dof.stale_for:
            keys.append(_STALE_FOR)
            numbers.append(dof.stale_for)
        right = number_pairs(keys, numbers)
        count = _FIXED + 2 * len(intervals) + len(keys)
        return [known_status(self._start, count, f'{left}{updated}{right}')
                for updated in _UPDATED]


def dof_message(dof: DofEstimate) -> str:
    """Return status and reasons in one line."""
    reasons = dof.reasons
    return f'{dof.status}: {", ".join(reasons)}' if reasons else dof.status
