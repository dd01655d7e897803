"""
The adaptive identifier online: Gamma from the data, and a running mean of the parameters.

Gamma of eq. 11 is here a full matrix. The usual step with it is written out in plain floats,
with one product of Gamma and phi instead of the three of the general form by Heun.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from rovid_core.identify.aid.adaptive_identifier import (
    AdaptiveIdentifier,
    DirectStep,
    Five,
    Gains,
    MAX_PIECES,
    NewState,
    no_direct_step,
)
from rovid_core.identify.excitation import (
    add_products,
    BATCH,
    MIN_EXCITATION,
    MIN_MOTION,
    NO_SUMS,
    Sums,
)
from rovid_core.model.dofs import Four
from rovid_core.model.samples import finite, Step
from rovid_core.settings.run import Scales

Array = NDArray[np.float64]
Bounds = tuple[Four, Four]

# Time in motion [s] after which Gamma is first taken from the data; then whenever it doubles.
FIRST_LEARNED = 20.0
# Least share of a mean square that the other regressors are taken to leave unexplained.
MIN_SHARE = 0.03
# Least mean squares of the regressors, in typical ones; smaller ones are mostly noise.
MIN_SQUARES = (MIN_EXCITATION, MIN_MOTION**2, MIN_MOTION, 1.0)
MAX_REFUSED = 5  # refused steps in a row after which the data that Gamma comes from are forgotten
# Steps with more than so many typical forces or velocities are left out of Gamma.
MAX_TYPICAL = 1000.0
MEAN_SHARE = 0.3  # memory of the running mean, as a share of the time in motion so far
# Longest memory of the running mean [s], so that it follows a vehicle that changes.
MAX_MEMORY = 40.0


def full_gain_rates(a: float, gamma: tuple[float, ...], state: Five, v: float, tau: float) -> Five:
    """Return the rates for the upper triangle of a symmetric Gamma, row by row."""
    v_hat, p0, p1, p2, p3 = state
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = gamma
    dv = v_hat - v
    drag = v_hat * abs(v_hat)
    return (
        a * dv + p0 * tau + p1 * drag + p2 * v_hat + p3,
        -dv * (g00 * tau + g01 * drag + g02 * v_hat + g03),
        -dv * (g01 * tau + g11 * drag + g12 * v_hat + g13),
        -dv * (g02 * tau + g12 * drag + g22 * v_hat + g23),
        -dv * (g03 * tau + g13 * drag + g23 * v_hat + g33),
    )


def _direct_euler(a: float, gamma: tuple[float, ...], v: float, theta: Four, step: Step,
                  bounds: Bounds) -> NewState:
    """Return v_hat and theta_hat after one step by Euler, None if it needs the general form."""
    h, tau, dv = step.dt, step.force[1], v - step.velocity[0]
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = gamma
    p0, p1, p2, p3 = theta
    size = abs(v)
    drag = v * size
    # Gamma phi, phi = [tau, drag, v, 1]
    q0 = g00 * tau + g01 * drag + g02 * v + g03
    q1 = g01 * tau + g11 * drag + g12 * v + g13
    q2 = g02 * tau + g12 * drag + g22 * v + g23
    q3 = g03 * tau + g13 * drag + g23 * v + g33
    if not (h * (q0 * tau + q1 * drag + q2 * v + q3) < -0.5 * a
            and h * (-a - 2.0 * p1 * size - p2) < 1.0):  # p1, p2: drag, not above 0
        return None
    e = h * dv
    v += h * (a * dv + p0 * tau + p1 * drag + p2 * v + p3)
    p0 -= e * q0
    p1 -= e * q1
    p2 -= e * q2
    p3 -= e * q3
    (l0, l1, l2, l3), (h0, h1, h2, h3) = bounds
    if l0 <= p0 <= h0 and l1 <= p1 <= h1 and l2 <= p2 <= h2 and l3 <= p3 <= h3 and v - v == 0.0:
        return v, (p0, p1, p2, p3)
    return None


def _direct_heun(a: float, gamma: tuple[float, ...], v: float, theta: Four, step: Step,
                 bounds: Bounds) -> NewState:
    """Return v_hat and theta_hat after one step by Heun with a constant force; as above."""
    h, (start, _, end), (tau, _, last) = step[:3]
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = gamma
    p0, p1, p2, p3 = theta
    size = abs(v)
    drag = v * size
    q0 = g00 * tau + g01 * drag + g02 * v + g03
    q1 = g01 * tau + g11 * drag + g12 * v + g13
    q2 = g02 * tau + g12 * drag + g22 * v + g23
    q3 = g03 * tau + g13 * drag + g23 * v + g33
    # the parts of theta . phi and of Gamma phi that do not change within the step
    push, gain = p0 * tau + p3, q0 * tau + q3
    if not (tau == last and h * (gain + q1 * drag + q2 * v) < -0.5 * a
            and h * (-a - 2.0 * p1 * size - p2) < 1.0):
        return None
    dv = v - start
    rate = a * dv + push + p1 * drag + p2 * v
    # the end of an Euler step, and the rate there with the parameters there
    w = v + h * rate
    drag_w = w * abs(w)
    dw = w - end
    rate_w = (a * dw + push + p1 * drag_w + p2 * w
              - h * dv * (gain + q1 * drag_w + q2 * w))
    # Gamma phi there is q plus Gamma times the change of phi
    half = 0.5 * h
    e, f = half * (dv + dw), half * dw
    b, c = f * (drag_w - drag), f * (w - v)
    v += half * (rate + rate_w)
    p0 -= e * q0 + b * g01 + c * g02
    p1 -= e * q1 + b * g11 + c * g12
    p2 -= e * q2 + b * g12 + c * g22
    p3 -= e * q3 + b * g13 + c * g23
    (l0, l1, l2, l3), (h0, h1, h2, h3) = bounds
    if l0 <= p0 <= h0 and l1 <= p1 <= h1 and l2 <= p2 <= h2 and l3 <= p3 <= h3 and v - v == 0.0:
        return v, (p0, p1, p2, p3)
    return None


# To rounding the same as ``INTEGRATORS`` with ``full_gain_rates``.
DIRECT_STEPS: dict[str, DirectStep] = {'euler': _direct_euler, 'heun': _direct_heun}


class FullGainIdentifier(AdaptiveIdentifier):
    """
    The adaptive identifier with a Gamma that need not be diagonal.

    It is the paper's identifier in other coordinates: with Gamma = R R', parameters R^-1 theta and
    regressors R' phi it has a Gamma of 1, so eq. 9 to 12 hold, with
    W = (dv^2 + dtheta' Gamma^-1 dtheta) / 2.

    ``feedback`` is |a| of eq. 7 [1/s]; ``gamma`` is Gamma of eq. 11, shape (4, 4), symmetric, 0
    for terms that are left out. Every step is divided into at least ``min_pieces``.
    """

    def __init__(self, scales: Scales, feedback: float, gamma: Array, integrator: str,
                 min_pieces: int = 1) -> None:
        super().__init__(
            scales, Gains(-feedback, cast(Four, tuple(np.diag(gamma).tolist()))), integrator)
        self._rates = full_gain_rates
        self._min_pieces = min_pieces
        if min_pieces == 1:
            self._direct_step = DIRECT_STEPS.get(integrator, no_direct_step)
        self._set_gamma(gamma)
        self._resting = self._gamma

    def _set_gamma(self, gamma: Array) -> None:
        self._matrix: list[list[float]] = gamma.tolist()
        self._gamma = tuple([x for i, row in enumerate(self._matrix) for x in row[i:]])

    def energy(self, dv: float, parameters: Sequence[float], truth: Sequence[float]) -> float:
        """Return W (terms with gain 0 left out)."""
        matrix = np.array(self._matrix)
        on = np.diag(matrix) > 0.0
        wrong = (np.array(parameters) - np.array(truth))[on]
        return float(0.5 * (dv * dv + wrong @ np.linalg.solve(matrix[np.ix_(on, on)], wrong)))

    def _number_of_pieces(self, step: Step, gamma: tuple[float, ...]) -> int:
        tau, v, (p0, p1, p2, p3) = step.force[1], self.v_hat, self.theta_hat
        # eq. 11 with dv = -1 gives Gamma phi
        _, q0, q1, q2, q3 = full_gain_rates(0.0, self._gamma, (v, p0, p1, p2, p3), v + 1.0, tau)
        adaptation = q0 * tau + q1 * v * abs(v) + q2 * v + q3
        turns = step.dt * max(
            -self._a + 2.0 * abs(p1 * v) + abs(p2), 2.0 * adaptation / -self._a)
        return (max(int(turns) + 1, self._min_pieces) if turns <= MAX_PIECES
                else MAX_PIECES + 1)

    def _projected(self, parameters: Four) -> Four:
        low, high = self.bounds
        (a, b, c, d), (e, f, g, h), (p, q, r, s) = low, high, parameters
        if a <= p <= e and b <= q <= f and c <= r <= g and d <= s <= h:
            return parameters
        # to move one parameter alone would let W grow without limit
        moved = list(parameters)
        for i, row in enumerate(self._matrix):
            excess = moved[i] - min(max(moved[i], low[i]), high[i])
            if excess and row[i]:
                moved = [p - excess / row[i] * x for p, x in zip(moved, row)]
        return cast(Four, tuple([
            min(max(p, bottom), top) for bottom, p, top in zip(low, moved, high)]))


def inverse_gram(mean: Array, scales: Scales, min_squares: Sequence[float],
                 min_share: float) -> Array:
    """
    Return the inverse of the mean of phi phi', 0 for terms that are left out, shape (4, 4).

    The mean is in SI units. ``min_squares`` are least mean squares, in typical ones. ``min_share``
    is the least share of a mean square that the other regressors are taken to leave unexplained.
    """
    active = np.array(scales.active)
    least = np.array(min_squares) / np.array(scales.regressor)**2
    size = np.sqrt(np.maximum(np.diag(mean), least))
    normal = (mean / np.outer(size, size))[np.ix_(active, active)]
    out = np.zeros((4, 4))
    out[np.ix_(active, active)] = np.linalg.inv(normal + min_share * np.eye(int(active.sum())))
    return np.asarray(out / np.outer(size, size))


class SelfTuningIdentifier(FullGainIdentifier):
    """
    The adaptive identifier with gains from the data, which publishes a mean of theta_hat.

    *Gains.* Gamma is |a| / 2 T times the inverse of the mean of phi phi' over the data so far:
    the gain that T gives for a sinusoid of typical amplitude, whose mean square is 1/2. Thus
    every combination of parameters that the data show settles in about 2 T, whatever typical
    sizes were configured. The typical sizes determine Gamma for the first ``FIRST_LEARNED``
    seconds of motion, and give the least mean squares later. Gamma is computed then and
    whenever the time in motion has doubled, and is constant in between. While it is constant W
    never grows; a new Gamma redefines W. Data at rest, while frozen, and of refused steps do
    not count. Thrust far beyond the data of Gamma makes steps unstable; after several of those
    Gamma returns to the typical sizes.

    *Mean.* theta_hat never stops to follow the noise of the velocity. The published
    ``parameters`` are its running mean, with a memory of ``MEAN_SHARE`` of the time in motion,
    at most ``MAX_MEMORY``. v_hat and W belong to ``theta_hat``. At rest only delta shows in the
    data, so the means of the others stay.

    Parameters
    ----------
    adaptation_time : float
        T [s]; theta_hat settles (1/e) in about 2 T.
    integrator : str
        As in ``AdaptiveIdentifier``.

    """

    def __init__(self, scales: Scales, adaptation_time: float, integrator: str) -> None:
        gains = Gains.from_time(adaptation_time, scales)
        self._max_force = MAX_TYPICAL * scales.force
        self._max_velocity = MAX_TYPICAL * scales.velocity
        self._start = np.diag([g if on else 0.0 for g, on in zip(gains.adaptation, scales.active)])
        super().__init__(scales, -gains.feedback, self._start, integrator)
        g = self._start.diagonal().tolist()
        self._resting = (g[0], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, g[3])
        self.adaptation_time = adaptation_time

    def reset(self) -> None:
        """Return to the initial values and gains."""
        super().reset()
        self._refused = 0  # in a row
        self._forget()

    def _forget(self) -> None:
        """Forget the data that Gamma comes from."""
        self._sums: Sums = NO_SUMS
        self._new: list[Step] = []  # steps that are not in the sums yet
        self._time = 0.0  # of all steps that count [s]
        self._next = FIRST_LEARNED
        self._set_gamma(self._start)

    def step(self, step: Step, adapt: bool = True) -> str:
        """Process one step; see ``AdaptiveIdentifier``."""
        refused = super().step(step, adapt)
        if not refused:
            self._refused = 0
        elif adapt:
            self._refused += 1
            if self._refused == MAX_REFUSED:
                self._forget()
        return refused

    def retune(self, adaptation_time: float) -> None:
        """Change T [s]; the data that Gamma comes from stay."""
        before = -self._a / self.adaptation_time
        self._a = Gains.from_time(adaptation_time, self._scales).feedback
        self.adaptation_time = adaptation_time
        factor = -self._a / adaptation_time / before  # Gamma goes with |a| / T
        self._start = factor * self._start
        self._resting = tuple([factor * g for g in self._resting])
        self._set_gamma(factor * np.array(self._matrix))

    def state(self) -> dict[str, Any]:
        """Return all that is needed to continue from here."""
        return {**super().state(), 'parameters': list(self.parameters),
                'theta_hat': list(self.theta_hat), 'gamma': [list(row) for row in self._matrix],
                'sums': list(self._add_new()), 'next': self._next}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``; raise ValueError if it does not fit."""
        gamma = np.array(state['gamma'], dtype=float)
        sums = [float(x) for x in state['sums']]
        after = float(state['next'])
        if gamma.shape != (4, 4) or len(sums) != 10:
            raise ValueError('gamma or sums have the wrong length')
        if not (np.isfinite(gamma).all() and (gamma == gamma.T).all()
                and (np.diag(gamma) >= 0.0).all()):
            raise ValueError('gamma is not that of an identifier')
        if not (finite(tuple(sums)) and 0.0 <= sums[9] < after < math.inf):
            raise ValueError('sums or next are out of range')
        published = self._checked(state['parameters'])
        super().restore({**state, 'parameters': state['theta_hat']})
        self.parameters = published
        self._sums, self._new = tuple(sums), []
        self._time, self._next = sums[9], after
        self._set_gamma(gamma)

    def _publish(self, step: Step, rest: bool) -> None:
        dt, velocity, force = step[:3]
        time, new = self._time, self._new
        if not rest and (abs(force[1]) <= self._max_force
                         and abs(velocity[1]) <= self._max_velocity):
            time = self._time = time + dt
            new.append(step)
            if len(new) == BATCH:
                self._add_new()
        memory = MEAN_SHARE * (time if time > dt else dt)
        share = dt / (dt + (memory if memory < MAX_MEMORY else MAX_MEMORY))
        a, b, c, d = self.parameters
        p, q, r, s = self.theta_hat
        d += share * (s - d)
        self.parameters = (a, b, c, d) if rest else (
            a + share * (p - a), b + share * (q - b), c + share * (r - c), d)
        if time >= self._next:
            self._learn_gamma()

    def _add_new(self) -> Sums:
        self._sums = add_products(self._sums, self._new)
        self._new.clear()
        return self._sums

    def _learn_gamma(self) -> None:
        """Compute Gamma from the data so far."""
        mean = np.zeros((4, 4))
        mean[np.triu_indices(4)] = np.array(self._add_new()) / self._time
        mean += np.triu(mean, 1).T
        gamma = -0.5 * self._a / self.adaptation_time * inverse_gram(
            mean, self._scales, MIN_SQUARES, MIN_SHARE)
        self._set_gamma(0.5 * (gamma + gamma.T))
        self._next = 2.0 * self._time
