"""The adaptive identifier in coordinates in which no combination of parameters is slow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from rovid_core.identify.aid.adaptive_identifier import AdaptiveIdentifier, Gains, MOST_PIECES
from rovid_core.identify.aid.integrators import coupled_rates
from rovid_core.identify.aid.written_out import general, UNROLLED
from rovid_core.model.dofs import Four
from rovid_core.model.samples import Step
from rovid_core.settings.scales import Scales
from rovid_core.trials.record import Array


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
    least_pieces : int
        Into which every step is divided.

    """

    def __init__(self, scales: Scales, feedback: float, gamma: Array, integrator: str,
                 least_pieces: int = 1) -> None:
        super().__init__(
            scales, Gains(-feedback, cast(Four, tuple(np.diag(gamma).tolist()))), integrator)
        self._rates = coupled_rates
        self._least_pieces = least_pieces
        if least_pieces == 1:
            self._unrolled = UNROLLED.get(integrator, general)
        self._couple(gamma)
        self._resting = self._gamma

    def _couple(self, gamma: Array) -> None:
        """Take another Gamma."""
        self._rows: list[list[float]] = gamma.tolist()
        self._gamma = tuple([x for i, row in enumerate(self._rows) for x in row[i:]])

    def energy(self, dv: float, parameters: Sequence[float], truth: Sequence[float]) -> float:
        """Return W (terms with gain 0 left out)."""
        matrix = np.array(self._rows)
        on = np.diag(matrix) > 0.0
        wrong = (np.array(parameters) - np.array(truth))[on]
        return float(0.5 * (dv * dv + wrong @ np.linalg.solve(matrix[np.ix_(on, on)], wrong)))

    def _pieces(self, step: Step, gamma: tuple[float, ...]) -> int:
        tau, v, (p0, p1, p2, p3) = step.force[1], self.v_hat, self.theta_hat
        # eq. 11 with dv = -1 gives Gamma phi
        _, q0, q1, q2, q3 = coupled_rates(0.0, self._gamma, (v, p0, p1, p2, p3), v + 1.0, tau)
        adaptation = q0 * tau + q1 * v * abs(v) + q2 * v + q3
        turns = step.dt * max(
            -self._a + 2.0 * abs(p1 * v) + abs(p2), 2.0 * adaptation / -self._a)
        return (max(int(turns) + 1, self._least_pieces) if turns <= MOST_PIECES
                else MOST_PIECES + 1)

    def _inside(self, parameters: Four) -> Four:
        low, high = self.bounds
        (a, b, c, d), (e, f, g, h), (p, q, r, s) = low, high, parameters
        if a <= p <= e and b <= q <= f and c <= r <= g and d <= s <= h:
            return parameters
        # to cut one parameter off alone would let W grow without end
        moved = list(parameters)
        for i, row in enumerate(self._rows):
            excess = moved[i] - min(max(moved[i], low[i]), high[i])
            if excess and row[i]:
                moved = [p - excess / row[i] * x for p, x in zip(moved, row)]
        return cast(Four, tuple([
            min(max(p, bottom), top) for bottom, p, top in zip(low, moved, high)]))


def inverse(mean: Array, scales: Scales, least: Sequence[float], share: float) -> Array:
    """
    Return the inverse of the mean of phi phi', 0 for terms that are left out.

    Parameters
    ----------
    mean : ndarray, shape (4, 4)
        In SI units.
    scales : Scales
        Typical sizes and terms.
    least : sequence of 4 floats
        Mean squares that are taken at least, in typical ones.
    share : float
        Of a regressor's mean square that the others are taken to leave of it at least.

    """
    active = np.array(scales.active)
    size = np.sqrt(np.maximum(np.diag(mean), np.array(least) / np.array(scales.regressor)**2))
    normal = (mean / np.outer(size, size))[np.ix_(active, active)]
    out = np.zeros((4, 4))
    out[np.ix_(active, active)] = np.linalg.inv(normal + share * np.eye(int(active.sum())))
    return np.asarray(out / np.outer(size, size))
