"""The adaptive identifier offline: the same trial in repeated passes with falling gain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from rovid_core.aid import AdaptiveIdentifier, Gains, MOST_PIECES
from rovid_core.dofs import Four
from rovid_core.identifier import Scales, Step
from rovid_core.integrators import coupled_rates, Five
from rovid_core.trial import Array, Fit, Record

PASSES = (7.0, 7.0, 10.0)
"""Time in which each pass settles, in adaptation times."""

FEEDBACK = 3.0
"""|a| of eq. 7, over the adaptation time: slow, so that v_hat is nearly a simulation."""

LEAST_SHARE = 1e-3
"""Of a regressor's mean square: a direction with less does not get more gain."""

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
        identifier = CoupledIdentifier(
            scales, a, a / (slower * adaptation_time) * _inverse(phi, scales), integrator)
        identifier.parameters = parameters
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


class CoupledIdentifier(AdaptiveIdentifier):
    """
    The adaptive identifier with a Gamma that need not be diagonal.

    It is the paper's in other coordinates: with Gamma = R R', parameters R^-1 theta and
    regressors R' phi it has a Gamma of 1, so eq. 9 to 12 hold, with
    W = (dv^2 + dtheta' Gamma^-1 dtheta) / 2.

    Parameters
    ----------
    scales : Scales
        Initial parameters, terms and typical sizes.
    feedback : float
        |a| of eq. 7 [1/s].
    gamma : ndarray, shape (4, 4)
        Gamma of eq. 11, symmetric; 0 for terms that are left out.
    integrator : str
        As in ``AdaptiveIdentifier``.

    """

    def __init__(self, scales: Scales, feedback: float, gamma: Array, integrator: str) -> None:
        super().__init__(
            scales, Gains(-feedback, cast(Four, tuple(np.diag(gamma).tolist()))), integrator)
        self._least_pieces = PIECES[integrator]
        self._matrix = gamma
        self._rows: list[list[float]] = gamma.tolist()
        self._upper = tuple(gamma[np.triu_indices(4)].tolist())

    def energy(self, dv: float, parameters: Sequence[float], truth: Sequence[float]) -> float:
        """Return W (terms with gain 0 left out)."""
        on = np.diag(self._matrix) > 0.0
        wrong = (np.array(parameters) - np.array(truth))[on]
        return float(0.5 * (
            dv * dv + wrong @ np.linalg.solve(self._matrix[np.ix_(on, on)], wrong)))

    def _pieces(self, step: Step, gamma: Four) -> int:
        tau, v, (_, p0, p1, p2, p3) = step.force[1], self.v_hat, (0.0, *self.parameters)
        # eq. 11 with dv = -1 gives Gamma phi
        _, q0, q1, q2, q3 = coupled_rates(0.0, self._upper, (v, p0, p1, p2, p3), v + 1.0, tau)
        adaptation = q0 * tau + q1 * v * abs(v) + q2 * v + q3
        turns = step.dt * max(
            -self._a + 2.0 * abs(p1 * v) + abs(p2), 2.0 * adaptation / -self._a)
        return (max(int(turns) + 1, self._least_pieces) if turns <= MOST_PIECES
                else MOST_PIECES + 1)

    def _piece(self, state: Five, step: Step, gamma: Four) -> Five:
        if not any(gamma):  # frozen
            return self._advance(self._a, gamma, state, step)
        state = self._advance(self._a, self._upper, state, step, coupled_rates)
        return state[0], *self._inside(state[1:])

    def _inside(self, parameters: Four) -> Four:
        """Return the nearest parameters inside the bounds, as W measures distance."""
        low, high = self.bounds
        if all(a <= p <= b for a, p, b in zip(low, parameters, high)):
            return parameters
        # to cut one parameter off alone would let W grow without end
        moved = list(parameters)
        for i, row in enumerate(self._rows):
            excess = moved[i] - min(max(moved[i], low[i]), high[i])
            if excess and row[i]:
                moved = [p - excess / row[i] * g for p, g in zip(moved, row)]
        return cast(Four, tuple([min(max(p, a), b) for a, p, b in zip(low, moved, high)]))


def _regressors(force_and_velocity: Array) -> Array:
    force, v = force_and_velocity.T
    return np.stack([force, v * np.abs(v), v, np.ones_like(v)], axis=1)


def _smoothed(steps: Sequence[Step]) -> Array:
    """Return the regressors of means of ``SMOOTH`` steps."""
    table = np.array([(step.force[1], step.velocity[1]) for step in steps]).reshape(-1, 2)
    size = min(SMOOTH, max(len(table), 1))
    return _regressors(table[:len(table) // size * size].reshape(-1, size, 2).mean(axis=1))


def _inverse(phi: Array, scales: Scales) -> Array:
    """Return the inverse of the mean of phi phi', 0 for terms that are left out."""
    active = np.array(scales.active)
    # a trial in which nothing moves keeps what is typical
    size = np.maximum(np.sqrt(np.mean(phi**2, axis=0)), 0.01 / np.array(scales.regressor))
    normal = (phi / size)[:, active]
    mean = normal.T @ normal / len(normal) + LEAST_SHARE * np.eye(int(active.sum()))
    inverse = np.zeros((4, 4))
    inverse[np.ix_(active, active)] = np.linalg.inv(mean)
    return np.asarray(inverse / np.outer(size, size))
