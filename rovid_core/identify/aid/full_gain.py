"""
The adaptive identifier with any Gamma, on unfiltered data, by the implicit midpoint rule.

With w the mean of v_hat before and after a step of length h, and the means over the step of the
measured velocity, the force and the regressors of couplings,

    dv          = w - v                                 phi = phi(w, tau)
    v_hat      += h (a dv + theta_mid . phi)            theta_mid = theta_hat - h/2 Gamma dv phi
    theta_hat  -= h Gamma dv phi

The measured velocity is not filtered, so that drag has no bias of a filter. Its noise leaves none
either: where v_hat is noise, the sum of dv v_hat is proportional to that of w (v_hat_after -
v_hat_before), a telescoping sum of squares. An explicit step does not have this property.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

import numpy as np
from rovid_core.identify.aid.adaptive_identifier import AdaptiveIdentifier, Gains, NewState
from rovid_core.model.dofs import OWN
from rovid_core.model.plant import Array
from rovid_core.model.samples import finite, Step
from rovid_core.settings.run import Scales

Rows = tuple[tuple[float, ...], ...]  # of a matrix


class FullGainIdentifier(AdaptiveIdentifier):
    """
    The adaptive identifier with a Gamma that need not be diagonal.

    It is the paper's identifier in other coordinates: with Gamma = R R', parameters R^-1 theta and
    regressors R' phi it has a Gamma of 1, so eq. 9 to 12 hold, with
    W = (dv^2 + dtheta' Gamma^-1 dtheta) / 2. The midpoint rule keeps quadratic forms: over a step
    of any length W changes by h times eq. 12 at the middle, but for the change of phi' Gamma phi
    since the start. No step needs to be divided.

    Without thrust nothing is adapted: what moves then is moved by something else.

    ``feedback`` is |a| of eq. 7 [1/s]; ``gamma`` is Gamma of eq. 11, shape (4 + m, 4 + m) with m
    couplings, symmetric, 0 for terms that are left out.
    """

    filtered = False

    def __init__(self, scales: Scales, feedback: float, gamma: Array) -> None:
        # behind the parameters, that of the drag in reverse, which follows v_hat
        self._own_drag = scales.couplings.index(OWN[1]) if OWN[1] in scales.couplings else -1
        super().__init__(scales, Gains(-feedback, tuple(np.diag(gamma).tolist())))
        self._set_gamma(gamma)

    def _set_gamma(self, gamma: Array) -> None:
        self._rows: Rows = tuple([tuple(row) for row in gamma.tolist()])

    def reset(self) -> None:
        """Return to the initial values."""
        super().reset()
        self._measured = math.nan  # the last velocity, not filtered

    def restart(self, velocity: float) -> None:
        """Set v_hat to a measured velocity [m/s or rad/s] and keep the parameters."""
        super().restart(velocity)
        self._measured = velocity

    def state(self) -> dict[str, Any]:
        """Return all that is needed to continue from here."""
        return {**super().state(), 'theta_hat': list(self.theta_hat),
                'measured': None if math.isnan(self._measured) else self._measured}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``; raise ValueError if it does not fit."""
        measured = math.nan if state['measured'] is None else float(state['measured'])
        if math.isinf(measured):
            raise ValueError(f'measured {measured} is out of range')
        published = self._checked(state['parameters'])
        super().restore({**state, 'parameters': state['theta_hat']})
        self._set_published(published)
        self._measured = measured

    def energy(self, dv: float, parameters: Sequence[float], truth: Sequence[float]) -> float:
        """Return W (terms with gain 0 left out); NaN if the truth lacks that of couplings."""
        if len(truth) < len(parameters):
            return math.nan
        matrix = np.array(self._rows)
        on = np.diag(matrix) > 0.0
        wrong = (np.array(parameters) - np.array(truth))[on]
        return float(0.5 * (dv * dv + wrong @ np.linalg.solve(matrix[np.ix_(on, on)], wrong)))

    def _advance(self, step: Step, adapt: bool, idle: bool) -> NewState:
        h, (lead, tail) = step.dt, step.parts
        tau = (lead * step.forces[0] + tail * step.forces[1]) / h
        before, after = self._measured, step.mean
        if before != before:  # NaN: there is none
            before = step.velocity[0]
        self._measured = after
        # the path over the step, by the fixes; between two velocities the mean
        measured = (lead * before + tail * after) / h if step.interval else 0.5 * (before + after)
        others = tuple([(lead * x + tail * y) / h for x, y in step.couplings]) if (
            step.couplings) else ()
        v, theta, half = self.v_hat, self.theta_hat, 0.5 * h
        alpha, beta, gamma, delta = theta[:4]
        push = alpha * tau + delta
        if others:
            push += _dot(theta[4:], self._regressors(others, 0.0))
        # the adaptation within the step is one more feedback, phi' Gamma phi h/2
        feedback = -self._a
        learns, rows = adapt and not idle, self._rows
        if learns:
            phi = (tau, v * abs(v), v, 1.0, *self._regressors(others, v))
            feedback += half * _dot(_product(rows, phi), phi)
        # w (1 + h/2 (feedback - gamma)) - h/2 beta w|w| = target, in the form without cancellation
        target = v + half * (feedback * measured + push)
        if self._own_drag >= 0 and target < 0.0:  # w has its sign
            beta = min(beta + theta[4 + self._own_drag], 0.0)
        linear, quadratic = 1.0 + half * (feedback - gamma), -half * beta
        if not linear > 0.0:
            return None  # Gamma of a damaged state is not positive
        w = 2.0 * target / (linear + math.sqrt(linear * linear + 4.0 * quadratic * abs(target)))
        if learns:
            impulse = h * (w - measured)
            phi = (tau, w * abs(w), w, 1.0, *self._regressors(others, w))
            theta = self._projected(tuple([
                p - impulse * g for p, g in zip(theta, _product(rows, phi))]))
        v = 2.0 * w - v
        return (v, theta) if finite((v, *theta)) else None

    def _regressors(self, measured: tuple[float, ...], velocity: float) -> tuple[float, ...]:
        """Return those of the couplings at a velocity."""
        i = self._own_drag
        return measured if i < 0 else (
            *measured[:i], min(velocity, 0.0) * abs(velocity), *measured[i + 1:])

    def _projected(self, parameters: tuple[float, ...]) -> tuple[float, ...]:
        """Return the parameters inside the bounds that are nearest in the metric of W."""
        low, high = self._low, self._high
        for bottom, p, top in zip(low, parameters, high):
            if not bottom <= p <= top:
                break
        else:
            return parameters
        # to move one parameter alone would let W grow without limit
        moved = parameters
        for i, row in enumerate(self._rows):
            excess = moved[i] - min(max(moved[i], low[i]), high[i])
            if excess and row[i]:
                share = excess / row[i]
                moved = tuple([p - share * x for p, x in zip(moved, row)])
        return tuple([min(max(p, bottom), top) for bottom, p, top in zip(low, moved, high)])


def _product(rows: Rows, phi: tuple[float, ...]) -> tuple[float, ...]:
    """Return Gamma phi."""
    if len(phi) > 4:
        return tuple([_dot(row, phi) for row in rows])
    # written out, which takes a third of the time
    (a, b, c, d), (e, f, g, h), (i, j, k, m), (n, o, p, q) = rows
    w, x, y, z = phi
    return (a * w + b * x + c * y + d * z, e * w + f * x + g * y + h * z,
            i * w + j * x + k * y + m * z, n * w + o * x + p * y + q * z)


def _dot(x: tuple[float, ...], y: tuple[float, ...]) -> float:
    total = 0.0  # sum() rounds differently from Python 3.12 on
    for p, q in zip(x, y):
        total += p * q
    return total


def inverse_gram(mean: Array, scales: Scales, min_squares: Sequence[float],
                 min_share: float) -> Array:
    """
    Return the inverse of the mean of phi phi', 0 for terms that are left out.

    The mean is in SI units, shape (4 + m, 4 + m) with m couplings. ``min_squares`` are least mean
    squares, in typical ones. ``min_share`` is the least share of a mean square that the other
    regressors are taken to leave unexplained.
    """
    active = np.array((*scales.active, *(True for _ in scales.couplings)))
    typical = np.array((*scales.regressor, *scales.coupling_regressor))
    size = np.sqrt(np.maximum(np.diag(mean), np.array(min_squares) / typical**2))
    normal = (mean / np.outer(size, size))[np.ix_(active, active)]
    out = np.zeros(mean.shape)
    out[np.ix_(active, active)] = np.linalg.inv(normal + min_share * np.eye(int(active.sum())))
    return np.asarray(out / np.outer(size, size))
