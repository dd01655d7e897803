"""
A linearised Kalman filter for surge and sway together, in water that moves.

    u' = alpha tau(t - d) + beta u|u| + gamma u + delta + sum kappa_j x_j + f   and v' alike
    X' = e_surge u + e_sway v + e_heave w + c      c' = white noise      f' = -f / T + white noise

u and v are velocities through the water, X the position in the world, e_surge to e_heave the
horizontal parts of the body's axes, and c the current. Attitude and heave are known inputs;
regressors with u or v take them from the state. The motion [X, u, v, c, f] has a covariance for
given parameters, and sensitivities to them, as in ``linearised_filter``. The current in the
beginning is a pair of parameters, so that it can be free or considered; what it has changed by
since then is motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rovid_core.identify.ekf.divergence import DivergenceError
from rovid_core.identify.ekf.linearised_filter import (
    Bounds,
    CANDIDATES,
    DEAD_BAND,
    felt,
    floats,
    FORCE_TIME,
    LAG,
    LARGEST_SPEED,
    LARGEST_SUBSTEPS,
    LONGEST,
)
from rovid_core.identify.ekf.planar_layout import (
    ALTERNATIVES,
    CURRENT,
    Noise,
    PlanarInnovation,
    Row,
    SIZE,
)
from rovid_core.identify.ekf.recent_force import RecentForce
from rovid_core.model.samples import PlanarPiece

Array = NDArray[np.float64]


class Push(NamedTuple):
    """The force on a row over a step; see ``RecentForce.over``, and ``LinearisedFilter``."""

    impulse: float
    moment: float
    before: float  # at the end of the last step
    last: float
    lag: float
    # impulse and moment of the force in reverse, and of that up to ``DEAD_BAND``
    reverse: tuple[float, float]
    cut: tuple[float, float]


class Law(NamedTuple):
    """What moves a row over a step: v' = push +- rise + (drag |v| + linear) v + turning w."""

    push: float
    rise: float
    drag: float
    linear: float
    turning: float


class PlanarFilter:
    """
    Motion, parameters and their uncertainty, moved from measurement to measurement.

    Lengths are in m, accelerations of the parameters in typical velocities per second.

    Parameters
    ----------
    rows : pair of Row
        Surge and sway.
    theta : sequence of p floats
        Parameters of surge, of sway, and the current in the beginning [m/s].
    variances : sequence of p floats
        Of the parameters; 0 for those that stay as they are.
    noise : Noise
        What moves without being modelled.

    Attributes
    ----------
    motion : ndarray, shape (8,)
    covariance : ndarray, shape (8, 8)
        Of the motion for given parameters.
    sensitivities : ndarray, shape (8, p + c)
        Derivatives of the motion by the parameters and the watched regressors.
    theta_covariance : ndarray, shape (p, p)

    """

    def __init__(self, rows: tuple[Row, Row], theta: Sequence[float],
                 variances: Sequence[float], noise: Noise) -> None:
        self._rows = rows
        self.theta: Array = np.array(theta, dtype=float)
        self.theta_covariance: Array = np.diag(np.array(variances, dtype=float))
        self._noise = noise
        self.force_std = noise.force_std
        p = self._p = len(self.theta)
        q = p + sum(len(CANDIDATES) + row.watched for row in rows) + len(ALTERNATIVES)
        self.motion: Array = np.zeros(SIZE)
        self.covariance: Array = np.zeros((SIZE, SIZE))
        self.sensitivities: Array = np.zeros((SIZE, q))
        self.motion[CURRENT] = self.theta[-2:]
        self.sensitivities[4, p - 2] = self.sensitivities[5, p - 1] = 1.0
        self.set_motion((0.0, 0.0), (1.0, 0.0, 0.0, 1.0), 0.0, 0.0)

    def set_motion(self, velocity: Sequence[float], axes: Sequence[float], variance: float,
                   gap: float) -> None:
        """
        Begin with a velocity over ground; parameters and current stay.

        Parameters
        ----------
        velocity : 2 floats
            Of surge and sway [m/s].
        axes : 4 floats
            Horizontal parts of the surge and the sway axis.
        variance : float
            Of the velocity [m^2/s^2].
        gap : float
            [s] in which the current went on unseen.

        """
        back = np.array(axes).reshape(2, 2)  # from the world into the body
        c = self.motion[CURRENT].copy()
        spread = self.covariance[CURRENT, CURRENT] + self._noise.current * gap * np.eye(2)
        kept = self.sensitivities[CURRENT].copy()
        self.motion[:] = 0.0
        self.motion[2:4] = np.array(velocity) - back @ c
        self.motion[CURRENT] = c
        self.covariance[:] = 0.0
        turned = back @ spread @ back.T
        self.covariance[2:4, 2:4] = variance * np.eye(2) + 0.5 * (turned + turned.T)
        self.covariance[2:4, CURRENT] = -back @ spread
        self.covariance[CURRENT, 2:4] = self.covariance[2:4, CURRENT].T
        self.covariance[CURRENT, CURRENT] = spread
        for k, row in enumerate(self._rows):
            self.covariance[6 + k, 6 + k] = (self.force_std * row.velocity)**2
        self.sensitivities[:] = 0.0
        self.sensitivities[2:4] = -back @ kept
        self.sensitivities[CURRENT] = kept
        self._lagged = [0.0, 0.0]
        self._force: list[float | None] = [None, None]  # at the end of the last step

    def set_position(self, x: Sequence[float], variance: float) -> None:
        """Begin at a position [m] of some variance."""
        self.motion[:2] = x
        self.covariance[:2] = self.covariance[:, :2] = 0.0
        self.covariance[0, 0] = self.covariance[1, 1] = variance
        self.sensitivities[:2] = 0.0

    def move(self, recent: Sequence[RecentForce], start: float, end: float,
             pieces: Sequence[PlanarPiece], couplings: Sequence[Sequence[float]],
             heading_noise: float, alone: bool = False) -> None:
        """
        Predict from ``start`` to ``end`` [s], in steps that resolve drag and turning.

        Parameters
        ----------
        recent : pair of RecentForce
            On surge and sway.
        start, end : float
            [s]
        pieces : sequence of PlanarPiece
            Attitude over equal parts of that time.
        couplings : pair of sequences of floats
            The measured regressors of surge and sway over that time.
        heading_noise : float
            Spectral density of the heading's noise [rad^2 s].
        alone : bool
            Whether the motion alone is moved, without its uncertainty.

        """
        h = (end - start) / len(pieces)
        for k, piece in enumerate(pieces):
            fastest = 1.0 / LONGEST
            for i, row in enumerate(self._rows):
                _, beta, gamma = self.theta[row.first:row.first + 3].tolist()
                fastest = max(fastest, 2.0 * abs(
                    beta * self.motion.item(2 + i) / row.velocity) + abs(gamma))
            count = min(int(h * fastest * 0.999999), LARGEST_SUBSTEPS - 1) + 1
            for j in range(count):
                begin = start + (k + j / count) * h
                self._predict(recent, begin, begin + h / count,
                              piece if count == 1 else piece.turned(
                                  piece.rate * h * ((j + 0.5) / count - 0.5)),
                              couplings, heading_noise, alone)

    def _push(self, k: int, recent: RecentForce, start: float, end: float) -> Push:
        """Return the force on a row over a step."""
        h, delay = end - start, self.theta.item(self._rows[k].end - 1)
        impulse, moment, first, last = recent.over(start - delay, end - delay)
        before = self._force[k]
        self._force[k] = last
        force = impulse / h
        gone = -math.expm1(-h / LAG)
        lag = (force - self._lagged[k]) * gone * LAG / h
        self._lagged[k] += gone * (force - self._lagged[k])
        reverse, cut = recent.bent(start - delay, end - delay, DEAD_BAND)
        return Push(impulse, moment, first if before is None else before, last, lag, reverse, cut)

    def _law(self, k: int, push: Push, h: float, rate: float,
             couplings: Sequence[float]) -> Law:
        """Return what moves a row over a step, in m and s."""
        row = self._rows[k]
        alpha, beta, gamma, delta = self.theta[row.first:row.first + 4].tolist()
        scale = row.velocity
        rest = alpha * push.impulse / h + delta
        for i, m in row.measured:
            rest += self.theta.item(i) * couplings[m]
        # a straight line with the same integral and the same way; this is half its rise
        rise = 3.0 * push.impulse / h - 6.0 * push.moment / (h * h)
        return Law(scale * rest + self.motion.item(6 + k), scale * alpha * rise, beta / scale,
                   gamma, scale * self.theta.item(row.turning) * rate if row.turning >= 0 else 0.0)

    def _predict(self, recent: Sequence[RecentForce], start: float, end: float,
                 piece: PlanarPiece, couplings: Sequence[Sequence[float]],
                 heading_noise: float, alone: bool) -> None:
        h, r = end - start, piece.rate
        _, _, u0, v0, cx, cy, *_ = self.motion.tolist()
        pushes = [self._push(k, one, start, end) for k, one in enumerate(recent)]
        laws = [self._law(k, pushes[k], h, r, couplings[k]) for k in range(2)]
        (a, da, ba, ga, ka), (b, db, bb, gb, kb) = laws

        def rate(u: float, v: float, at: float) -> tuple[float, float]:
            return (a + at * da + (ba * abs(u) + ga) * u + ka * v,
                    b + at * db + (bb * abs(v) + gb) * v + kb * u)

        k1, l1 = rate(u0, v0, -1.0)
        k2, l2 = rate(u0 + 0.5 * h * k1, v0 + 0.5 * h * l1, 0.0)
        um, vm = u0 + 0.5 * h * k2, v0 + 0.5 * h * l2
        k3, l3 = rate(um, vm, 0.0)
        k4, l4 = rate(u0 + h * k3, v0 + h * l3, 1.0)
        u = u0 + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        v = v0 + h / 6.0 * (l1 + 2.0 * (l2 + l3) + l4)
        if not abs(u) + abs(v) < LARGEST_SPEED:
            raise DivergenceError(f'a speed of {u}, {v}')
        # while it goes along, the body turns about the attitude of the middle
        shrunk = 1.0 - (r * h)**2 / 24.0
        along = shrunk * h * (u0 + h / 6.0 * (k1 + k2 + k3)) - r * h * h / 12.0 * (v - v0)
        across = shrunk * h * (v0 + h / 6.0 * (l1 + l2 + l3)) + r * h * h / 12.0 * (u - u0)
        sx, sy, wx, wy, hx, hy, _ = piece
        dx, dy = sx * along + wx * across + h * hx, sy * along + wy * across + h * hy
        motion = self.motion
        motion[:4] = motion[0] + dx + h * cx, motion[1] + dy + h * cy, u, v
        if alone:
            return
        self._spread(h, piece, laws, pushes, (um, vm), couplings)
        # headings that are off turn the path through the water
        self.sensitivities[0, -1] -= dy
        self.sensitivities[1, -1] += dx
        covariance, noise = self.covariance, heading_noise / h
        covariance[0, 0] += noise * dy * dy
        covariance[1, 1] += noise * dx * dx
        covariance[0, 1] -= noise * dx * dy
        covariance[1, 0] = covariance[0, 1]
        covariance[4, 4] += self._noise.current * h
        covariance[5, 5] += self._noise.current * h
        if self.force_std:
            e = math.exp(-h / FORCE_TIME)
            motion[6:] *= e
            for k, row in enumerate(self._rows):
                covariance[6 + k, 6 + k] += (
                    1.0 - e * e) * (self.force_std * row.velocity)**2

    def _spread(self, h: float, piece: PlanarPiece, laws: Sequence[Law],
                pushes: Sequence[Push], middle: tuple[float, float],
                couplings: Sequence[Sequence[float]]) -> None:
        """Move sensitivities and covariance over a step of ``h`` [s]."""
        sx, sy, wx, wy, _, _, _ = piece
        (_, _, ba, ga, ka), (_, _, bb, gb, kb) = laws
        du, dv = 2.0 * ba * abs(middle[0]) + ga, 2.0 * bb * abs(middle[1]) + gb
        # integrals of the velocity's transition: once, and of that for a push all the time
        a00, a01, a10, a11 = (du * du + ka * kb, ka * (du + dv), kb * (du + dv),
                              dv * dv + ka * kb)
        one, two, three = h, 0.5 * h * h, h * h * h / 6.0
        g00, g01, g10, g11 = (one + two * du + three * a00, two * ka + three * a01,
                              two * kb + three * a10, one + two * dv + three * a11)
        w00, w01, w10, w11 = (two + three * du, three * ka, three * kb, two + three * dv)
        p00, p01 = 1.0 + du * g00 + ka * g10, du * g01 + ka * g11
        p10, p11 = kb * g00 + dv * g10, 1.0 + kb * g01 + dv * g11
        e = math.exp(-h / FORCE_TIME)
        transition = np.array((
            (1.0, 0.0, sx * g00 + wx * g10, sx * g01 + wx * g11, h, 0.0,
             sx * w00 + wx * w10, sx * w01 + wx * w11),
            (0.0, 1.0, sy * g00 + wy * g10, sy * g01 + wy * g11, 0.0, h,
             sy * w00 + wy * w10, sy * w01 + wy * w11),
            (0.0, 0.0, p00, p01, 0.0, 0.0, g00, g01), (0.0, 0.0, p10, p11, 0.0, 0.0, g10, g11),
            (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0),
            (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, e, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, e)))
        forcing = transition[:, 6:].copy()
        forcing[6:] = 0.0
        phi = np.zeros((2, self.sensitivities.shape[1]))
        ways = [self._regressors(phi[k], k, h, one, middle, piece.rate, couplings[k])
                for k, one in enumerate(zip(pushes, (du, dv), (g00, g11), (w00, w11)))]
        for k, row in enumerate(self._rows):
            per_newton = self.theta.item(row.first) * row.velocity / row.force
            phi[k, -3] = per_newton * piece[2 * k]
            phi[k, -2] = per_newton * piece[2 * k + 1]
        self.sensitivities = transition @ self.sensitivities + forcing @ phi
        for k, way in enumerate(ways):
            for i, change in way:
                self.sensitivities[0, i] += piece[2 * k] * change
                self.sensitivities[1, i] += piece[2 * k + 1] * change
        moved = transition @ self.covariance @ transition.T
        self.covariance = 0.5 * (moved + moved.T)

    def _regressors(self, phi: Array, k: int, h: float,
                    given: tuple[Push, float, float, float], middle: tuple[float, float],
                    rate: float, couplings: Sequence[float]) -> list[tuple[int, float]]:
        """
        Fill in the derivatives of a row's acceleration by parameters and watched regressors.

        Return by how much more the path goes along with some of them, by their number, for it
        counts where in the step the force acts; see ``LinearisedFilter``.
        """
        row = self._rows[k]
        (impulse, moment, before, last, lag, reverse, cut), decay, s, b = given
        scale, alpha = row.velocity, self.theta.item(row.first)
        late = 2.0 * moment - before * h * h
        way = impulse - h * before + 0.5 * decay * late
        slope, delayed = alpha / s * (last - before + decay * way), alpha * way
        (push, way), (backwards, back_way), (small, small_way) = [
            felt(*one, h, decay, s) for one in ((impulse, moment), reverse, cut)]
        w = middle[k] / scale
        drag = w * abs(w)
        values = [push, drag, w, 1.0, *[0.0] * row.couplings, -slope]
        if row.turning >= 0:
            values[row.turning - row.first] = middle[1 - k] * rate
        for i, m in row.measured:
            values[i - row.first] = couplings[m]
        phi[row.first:row.end] = [scale * value for value in values]
        watched = self._p + k * (len(CANDIDATES) + self._rows[0].watched)
        phi[watched:watched + len(CANDIDATES) + row.watched] = [scale * value for value in (
            backwards, drag if w < 0.0 else 0.0, small, lag, *couplings[row.couplings:])]
        return [(row.first, scale * (way - b * push)),
                (row.end - 1, -scale * (delayed - b * slope)),
                (watched, scale * (back_way - b * backwards)),
                (watched + 2, scale * (small_way - b * small))]

    def innovation(self, looks: Array, value: float, variance: float) -> PlanarInnovation:
        """
        Compare a measurement with the state.

        Parameters
        ----------
        looks : ndarray, shape (8,)
            What is measured of the motion.
        value, variance : float
            Of the measurement.

        """
        psi = looks @ self.sensitivities
        gain = self.theta_covariance @ psi[:self._p]
        across = self.covariance @ looks
        given = float(looks @ across) + variance
        total = given + float(gain @ psi[:self._p])
        if not (given > 0.0 and 0.0 < total < math.inf):
            raise DivergenceError('the covariance is not positive')
        error = value - float(looks @ self.motion)
        return PlanarInnovation(error, given, total, psi, gain, across,
                                error + float(self.theta @ psi[:self._p]))

    def covariance_of(self, found: PlanarInnovation, looks: Array) -> float:
        """Return that of a measurement with another one."""
        return float(looks @ found.across) + float(
            found.gain @ (looks @ self.sensitivities)[:self._p])

    def update(self, found: PlanarInnovation, added: float, adapt: bool) -> None:
        """Take a measurement; see ``LinearisedFilter.update``."""
        error, given, total, psi, gain, across, _ = found
        given += added
        total += added
        p = self._p
        if adapt:
            change = gain * (error / total)
            self.theta = self.theta + change
            scaled = gain / math.sqrt(total)
            self.theta_covariance = self.theta_covariance - scaled[:, None] * scaled
            k = across / given
            self.motion = self.motion + self.sensitivities[:, :p] @ change + k * (
                error - float(psi[:p] @ change))
            scaled = across / math.sqrt(given)
            self.covariance = self.covariance - scaled[:, None] * scaled
        else:
            k = (across + self.sensitivities[:, :p] @ gain) / total
            self.motion = self.motion + k * error
            crossed = k[:, None] * across
            self.covariance = self.covariance - (crossed + crossed.T) + given * (k[:, None] * k)
        self.sensitivities = self.sensitivities - k[:, None] * psi

    def update_motion(self, found: PlanarInnovation, added: float) -> None:
        """Take a measurement for the motion alone, as if the parameters were exact."""
        given = found.given + added
        k = found.across / given
        self.motion = self.motion + k * found.error
        scaled = found.across / math.sqrt(given)
        self.covariance = self.covariance - scaled[:, None] * scaled
        self.sensitivities = self.sensitivities - k[:, None] * found.psi

    def set_theta(self, theta: Sequence[float] | Array) -> None:
        """Go to other parameters; the motion goes along."""
        new = np.array(theta, dtype=float)
        self.motion = self.motion + self.sensitivities[:, :self._p] @ (new - self.theta)
        self.theta = new

    def keep_inside(self, bounds: Bounds) -> None:
        """Move the parameters into their bounds, the others as theirs go with them."""
        values = self.theta.tolist()
        outside = [i for i, low, high in bounds if not low <= values[i] <= high]
        if outside:
            theta = self.theta.copy()
            for i, low, high in bounds:
                if low <= theta[i] <= high:
                    continue
                bound = low if theta[i] < low else high
                variance = self.theta_covariance[i, i]
                if variance > 0.0:
                    theta += self.theta_covariance[i] * ((bound - theta[i]) / variance)
                theta[i] = bound
            for i, low, high in bounds:
                theta[i] = min(max(theta[i], low), high)
            self.set_theta(theta)
        least = min(self.covariance.diagonal().min(), self.theta_covariance.diagonal().min())
        if not -1e-12 <= least < math.inf:
            raise DivergenceError('the covariance is not positive')

    def widen_motion(self, path: float, velocity: float) -> None:
        """Add variances to those of position and velocity."""
        for i, variance in enumerate((path, path, velocity, velocity)):
            self.covariance[i, i] += variance

    def current(self, of_theta: Array | None = None) -> tuple[Array, Array]:
        """Return the current [m/s] and its covariance, for one of the parameters."""
        spread = self.theta_covariance if of_theta is None else of_theta
        along = self.sensitivities[CURRENT, :self._p]
        return self.motion[CURRENT], (
            self.covariance[CURRENT, CURRENT] + along @ spread @ along.T)

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'theta': self.theta.tolist(), 'motion': self.motion.tolist(),
                'covariance': self.covariance.tolist(), 'lagged': list(self._lagged),
                'force': list(self._force),
                'sensitivities': self.sensitivities.tolist(),
                'theta_covariance': self.theta_covariance.tolist()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        p = self._p
        self.theta = np.array(floats(state['theta'], p))
        self.motion = np.array(floats(state['motion'], SIZE))
        self._lagged = floats(state['lagged'], 2)
        one, other = state['force']
        self._force = [None if x is None else float(x) for x in (one, other)]
        self.covariance = _matrix(state['covariance'], SIZE, SIZE)
        self.theta_covariance = _matrix(state['theta_covariance'], p, p)
        self.sensitivities = _matrix(
            state['sensitivities'], SIZE, self.sensitivities.shape[1])
        for square in (self.covariance, self.theta_covariance):
            if (square != square.T).any():
                raise ValueError('not a covariance')


def _matrix(values: Any, rows: int, columns: int) -> Array:
    found = np.array([floats(row, columns) for row in values])
    if found.shape != (rows, columns):
        raise ValueError('a matrix that does not fit')
    return found
