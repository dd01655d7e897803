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
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rovid_core.identify.ekf.planar.layout import (
    ALTERNATIVES,
    CURRENT,
    Looks,
    PlanarInnovation,
    Row,
    SIZE,
)
from rovid_core.identify.ekf.single.delayed_force import DelayedForce
from rovid_core.identify.ekf.single.linearised_filter import (
    Bounds,
    CANDIDATES,
    felt,
    FORCE_TIME,
    LARGEST_SPEED,
    LARGEST_SUBSTEPS,
    LONGEST,
)
from rovid_core.identify.ekf.single.watched_lag import WatchedLag
from rovid_core.identify.method import DivergenceError, floats
from rovid_core.model.plant import Array
from rovid_core.model.samples import PlanarPiece
from rovid_core.model.thrusters import AS_CONFIGURED, Thrusters

Law = tuple[float, float, float, float, float]
"""What moves a row: v' = push +- rise + (drag |v| + linear) v + turning w, in this order."""


class Push:
    """
    The force over the last step; see ``DelayedForce.over``, and ``LinearisedFilter``.

    Attributes
    ----------
    impulse, moment : float
        Of the force, in typical ones.
    before, last : float
        The force at the end of the step before and at that of the last one, NaN before the first.
    lag : WatchedLag
        What a lag would take of it.
    reverse, reverse_moment, cut, cut_moment : float
        Impulse and moment of the force in reverse, and of what a dead band takes of it.
    each : tuple of 5 floats
        As of ``DelayedForce.each``, where the row watches that.

    """

    __slots__ = ('impulse', 'moment', 'before', 'last', 'lag', 'reverse',
                 'reverse_moment', 'cut', 'cut_moment', 'each', '_shares', '_begins')

    def __init__(self, shares: bool, lag_at: float) -> None:
        self._shares, self.each = shares, (0.0, 0.0, 0.0, 0.0, 0.0)
        self._begins = False
        self.impulse = self.moment = self.before = 0.0
        self.lag = WatchedLag(lag_at)
        self.reverse = self.reverse_moment = self.cut = self.cut_moment = 0.0
        self.restart()

    def restart(self) -> None:
        """Begin anew."""
        self.last = math.nan

    def move(self, recent: DelayedForce, start: float, end: float, delay: float) -> None:
        """Go on from ``start`` to ``end`` [s] with a force that acts after a delay [s]."""
        before = self.last
        self.impulse, self.moment, first, self.last = recent.over(start, end, delay)
        self.before, self._begins = first if before != before else before, before != before
        (self.reverse, self.reverse_moment), (self.cut, self.cut_moment) = recent.bent(
            start, end, delay)
        if self._shares:
            self.each = recent.each(start, end, delay)

    def lag_behind(self, h: float, excess: float) -> None:
        """Let what lags go on, too; the force exceeds by so much what holds the velocity."""
        force = self.impulse / h
        if self._begins:
            self.lag.begin(force - excess, self.before)
        self.lag.move(force, h)


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
    force_std : float
        Stationary standard deviation of the unknown accelerations, in typical ones.
    current_change : float
        Spectral density of the current's change, per axis [m^2/s^3].

    Attributes
    ----------
    sensitivities : ndarray, shape (8, p + c)
        Derivatives of the motion by the parameters and the watched regressors.
    covariance : ndarray, shape (8, 8)
        Of the motion for given parameters.
    motion : ndarray, shape (8,)
        These three lie side by side in one array: what moves or corrects one, does so to all.
    theta_covariance : ndarray, shape (p, p)

    """

    def __init__(self, rows: tuple[Row, Row], theta: Sequence[float],
                 variances: Sequence[float], force_std: float = 0.0,
                 current_change: float = 0.0, thrusters: tuple[Thrusters, Thrusters] = (
                     AS_CONFIGURED, AS_CONFIGURED)) -> None:
        self._rows, self.thrusters = rows, thrusters
        self._pushes = [Push(row.shares, one.lag_at) for row, one in zip(rows, thrusters)]
        p = self._p = len(theta)
        self.theta = np.array(theta, dtype=float)
        self.theta_covariance: Array = np.diag(np.array(variances, dtype=float))
        self._force_std, self._current_change = force_std, current_change
        q = p + sum(len(CANDIDATES) + row.watched for row in rows) + len(ALTERNATIVES)
        # below: what each regressor pushes surge and sway by in a step, and by how much more they
        # go along with it
        self._stack: Array = np.zeros((SIZE + 4, q + SIZE + 1))
        self._all = self._stack[:SIZE]
        self.sensitivities = self._all[:, :q]
        self.covariance = self._all[:, q:-1]
        self.motion = self._all[:, -1]
        self._q = q
        self._flat = self._stack.reshape(-1)
        self._places = self._places_of_pushes()
        self._transition: Array = np.eye(SIZE)
        self.motion[CURRENT] = self.theta[-2:]
        self.sensitivities[4, p - 2] = self.sensitivities[5, p - 1] = 1.0
        self.set_motion((0.0, 0.0), (1.0, 0.0, 0.0, 1.0), 0.0, 0.0)

    def _places_of_pushes(self) -> NDArray[np.int64]:
        """Return where what ``_regressors`` says goes, in all of the stack."""
        places: list[int] = []
        q, width = self._q, self._stack.shape[1]
        for k, row in enumerate(self._rows):
            watched = self._watched(k)
            push, way = (SIZE + k) * width, (SIZE + 2 + k) * width
            places += [push + i for i in (
                *range(row.first, row.end),
                *range(watched, watched + len(CANDIDATES) + row.watched), q - 4, q - 3)]
            places += [way + i for i in (row.first, row.end - 1, watched, watched + 2)]
            if row.shares:
                first = watched + len(CANDIDATES)
                places += [way + first, way + first + 1]
            places += [way + i for i in row.own[:1] if i >= 0]
        return np.array(places)

    def _watched(self, k: int) -> int:
        """Return where the watched regressors of a row begin."""
        return self._p + k * (len(CANDIDATES) + self._rows[0].watched)

    @property
    def theta(self) -> Array:
        """Return the parameters; not to be changed in place."""
        return self._theta

    @theta.setter
    def theta(self, theta: Array) -> None:
        self._theta = theta
        self._values: list[float] = theta.tolist()  # one by one that is ten times faster

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
        spread = self.covariance[CURRENT, CURRENT] + self._current_change * gap * np.eye(2)
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
            self.covariance[6 + k, 6 + k] = (self._force_std * row.velocity)**2
        self.sensitivities[:] = 0.0
        self.sensitivities[2:4] = -back @ kept
        self.sensitivities[CURRENT] = kept
        for push in self._pushes:
            push.restart()

    def set_position(self, x: Sequence[float], variance: float) -> None:
        """Begin at a position [m] of some variance."""
        self.motion[:2] = x
        self.covariance[:2] = self.covariance[:, :2] = 0.0
        self.covariance[0, 0] = self.covariance[1, 1] = variance
        self.sensitivities[:2] = 0.0

    def move(self, recent: Sequence[DelayedForce], start: float, end: float,
             pieces: Sequence[PlanarPiece], couplings: Sequence[Sequence[float]],
             heading_noise: float, alone: bool = False) -> None:
        """
        Predict from ``start`` to ``end`` [s], in steps that resolve drag and turning.

        Parameters
        ----------
        recent : pair of DelayedForce
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
                beta, gamma = self._values[row.first + 1], self._values[row.first + 2]
                fastest = max(fastest, 2.0 * abs(
                    beta * self.motion.item(2 + i) / row.velocity) + abs(gamma))
            count = min(int(h * fastest * 0.999999), LARGEST_SUBSTEPS - 1) + 1
            for j in range(count):
                begin = start + (k + j / count) * h
                self._predict(recent, begin, begin + h / count,
                              piece if count == 1 else piece.turned(
                                  piece.rate * h * ((j + 0.5) / count - 0.5)),
                              couplings, heading_noise, alone)

    def _law(self, k: int, h: float, rate: float, force: float, velocity: float,
             couplings: Sequence[float]) -> Law:
        """Return what moves a row over a step under an unknown force, in m and s."""
        row, push, theta = self._rows[k], self._pushes[k], self._values
        alpha, scale = theta[row.first], row.velocity
        rest = alpha * push.impulse / h + theta[row.first + 3]
        for i, m in row.measured:
            rest += theta[i] * couplings[m]
        # a straight line with the same integral and the same way; this is half its rise
        rise = scale * alpha * (3.0 * push.impulse / h - 6.0 * push.moment / (h * h))
        beta, (own_thrust, own_drag) = theta[row.first + 1], row.own
        if own_thrust >= 0:
            weaker = theta[own_thrust]
            rest += weaker * push.reverse / h
            rise += scale * weaker * (
                3.0 * push.reverse / h - 6.0 * push.reverse_moment / (h * h))
        if own_drag >= 0 and velocity < 0.0:
            beta = min(beta + theta[own_drag], 0.0)
        slowing = self.thrusters[k].slowing(push.impulse / h)
        return (scale * rest + force, rise, beta / scale,
                theta[row.first + 2] - alpha * slowing,
                scale * theta[row.turning] * rate if row.turning >= 0 else 0.0)

    def _predict(self, recent: Sequence[DelayedForce], start: float, end: float,
                 piece: PlanarPiece, couplings: Sequence[Sequence[float]],
                 heading_noise: float, alone: bool) -> None:
        h, r = end - start, piece.rate
        x, y, u0, v0, cx, cy, fu, fv = self.motion.tolist()
        for row, one, push in zip(self._rows, recent, self._pushes):
            push.move(one, start, end, self._values[row.end - 1])
        law, other = (self._law(0, h, r, fu, u0, couplings[0]),
                      self._law(1, h, r, fv, v0, couplings[1]))
        a, da, ba, ga, ka = law
        b, db, bb, gb, kb = other
        k1 = a - da + (ba * abs(u0) + ga) * u0 + ka * v0
        l1 = b - db + (bb * abs(v0) + gb) * v0 + kb * u0
        um, vm = u0 + 0.5 * h * k1, v0 + 0.5 * h * l1
        k2 = a + (ba * abs(um) + ga) * um + ka * vm
        l2 = b + (bb * abs(vm) + gb) * vm + kb * um
        um, vm = u0 + 0.5 * h * k2, v0 + 0.5 * h * l2
        k3 = a + (ba * abs(um) + ga) * um + ka * vm
        l3 = b + (bb * abs(vm) + gb) * vm + kb * um
        u, v = u0 + h * k3, v0 + h * l3
        k4 = a + da + (ba * abs(u) + ga) * u + ka * v
        l4 = b + db + (bb * abs(v) + gb) * v + kb * u
        u = u0 + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        v = v0 + h / 6.0 * (l1 + 2.0 * (l2 + l3) + l4)
        if not abs(u) + abs(v) < LARGEST_SPEED:
            raise DivergenceError(f'a speed of {u}, {v}')
        # while it goes along, the body turns about the attitude of the middle
        shrunk = 1.0 - r * h * r * h / 24.0
        along = shrunk * h * (u0 + h / 6.0 * (k1 + k2 + k3)) - r * h * h / 12.0 * (v - v0)
        across = shrunk * h * (v0 + h / 6.0 * (l1 + l2 + l3)) + r * h * h / 12.0 * (u - u0)
        sx, sy, wx, wy, hx, hy, _ = piece
        dx, dy = sx * along + wx * across + h * hx, sy * along + wy * across + h * hy
        if not alone:
            for push, row, rate in zip(self._pushes, self._rows, (
                    a + (ba * abs(u0) + ga) * u0 + ka * v0,
                    b + (bb * abs(v0) + gb) * v0 + kb * u0)):
                alpha = row.velocity * self._values[row.first]
                push.lag_behind(h, rate / alpha if alpha > 0.0 else math.inf)
            self._spread(h, piece, law, other, um, vm, couplings)
        self.motion[:4] = x + dx + h * cx, y + dy + h * cy, u, v
        if alone:
            return
        # a sensor ahead swings round; headings that are off turn the path through the water; a
        # late fix shows where the vehicle was: behind by its velocity over ground, which has
        # changed by this
        du, dv, turn = u - u0 - r * h * vm, v - v0 + r * h * um, r * h
        self.sensitivities[0, -6:] += turn * wx, -turn * sx, 0.0, 0.0, -dy, -sx * du - wx * dv
        self.sensitivities[1, -6:] += turn * wy, -turn * sy, 0.0, 0.0, dx, -sy * du - wy * dv
        covariance, noise = self.covariance, heading_noise / h
        if noise:
            covariance[0, 0] += noise * dy * dy
            covariance[1, 1] += noise * dx * dx
            covariance[0, 1] -= noise * dx * dy
            covariance[1, 0] = covariance[0, 1]
        if self._current_change:
            covariance[4, 4] += self._current_change * h
            covariance[5, 5] += self._current_change * h
        if self._force_std:
            e = math.exp(-h / FORCE_TIME)
            for k, row in enumerate(self._rows):
                covariance[6 + k, 6 + k] += (
                    1.0 - e * e) * (self._force_std * row.velocity)**2

    def _spread(self, h: float, piece: PlanarPiece, law: Law, other: Law, u: float, v: float,
                couplings: Sequence[Sequence[float]]) -> None:
        """Move sensitivities and covariance over a step of ``h`` [s] about velocities."""
        sx, sy, wx, wy, _, _, _ = piece
        _, _, ba, ga, ka = law
        _, _, bb, gb, kb = other
        du, dv = 2.0 * ba * abs(u) + ga, 2.0 * bb * abs(v) + gb
        # integrals of the velocity's transition: once, and of that for a push all the time
        a00, a01, a10, a11 = (du * du + ka * kb, ka * (du + dv), kb * (du + dv),
                              dv * dv + ka * kb)
        two, three = 0.5 * h * h, h * h * h / 6.0
        g00, g01, g10, g11 = (h + two * du + three * a00, two * ka + three * a01,
                              two * kb + three * a10, h + two * dv + three * a11)
        w00, w01, w10, w11 = (two + three * du, three * ka, three * kb, two + three * dv)
        self._flat[self._places] = [
            *self._regressors(0, h, piece, du, g00, w00, u, v, couplings[0]),
            *self._regressors(1, h, piece, dv, g11, w11, v, u, couplings[1])]
        xu, xv, yu, yv = (sx * w00 + wx * w10, sx * w01 + wx * w11,
                          sy * w00 + wy * w10, sy * w01 + wy * w11)
        top = np.fromiter((
            1.0, 0.0, sx * g00 + wx * g10, sx * g01 + wx * g11, h, 0.0, xu, xv, xu, xv, sx, wx,
            0.0, 1.0, sy * g00 + wy * g10, sy * g01 + wy * g11, 0.0, h, yu, yv, yu, yv, sy, wy,
            0.0, 0.0, 1.0 + du * g00 + ka * g10, du * g01 + ka * g11, 0.0, 0.0,
            g00, g01, g00, g01, 0.0, 0.0,
            0.0, 0.0, kb * g00 + dv * g10, 1.0 + kb * g01 + dv * g11, 0.0, 0.0,
            g10, g11, g10, g11, 0.0, 0.0), float, 4 * (SIZE + 4)).reshape(4, SIZE + 4)
        self._stack[:4] = top @ self._stack
        transition = self._transition
        transition[:4] = top[:, :SIZE]
        if self._force_std:
            e = math.exp(-h / FORCE_TIME)
            self._stack[6:SIZE] *= e
            transition[6, 6] = transition[7, 7] = e
        moved = self.covariance @ transition.T  # which has moved from the left with all
        self.covariance[:] = 0.5 * (moved + moved.T)

    def _regressors(self, k: int, h: float, piece: PlanarPiece, decay: float, s: float, b: float,
                    along: float, across: float, couplings: Sequence[float]) -> list[float]:
        """
        Return what parameters and watched regressors do to a row, in the order of ``_places``.

        That is the derivatives of the acceleration, and by how much more the path goes along with
        some of them, for it counts where in the step the force acts; see ``LinearisedFilter``.
        """
        row, given = self._rows[k], self._pushes[k]
        scale, alpha, (own_thrust, own_drag) = row.velocity, self._values[row.first], row.own
        if own_thrust >= 0 and given.impulse < 0.0:
            alpha += self._values[own_thrust]  # as a delay feels it
        w, slowing = along / scale, self.thrusters[k].slowing
        rise = given.last - given.before - (slowing(given.last) - slowing(given.before)) * w
        late = 2.0 * given.moment - given.before * h * h
        way = given.impulse - h * given.before + 0.5 * decay * late
        slope, delayed = alpha / s * (rise + decay * way), alpha * way
        push, push_way = felt(given.impulse, given.moment, h, decay, s)
        force = given.impulse / h
        backwards, back_way = felt(given.reverse, given.reverse_moment, h, decay, s)
        small, small_way = felt(given.cut, given.cut_moment, h, decay, s)
        drag = w * abs(w)
        coupled = [0.0] * row.couplings
        if row.turning >= 0:
            coupled[row.turning - row.first - 4] = scale * across * piece.rate
        for i, m in row.measured:
            coupled[i - row.first - 4] = scale * couplings[m]
        if own_drag >= 0 and w < 0.0:
            coupled[own_drag - row.first - 4] = scale * drag
        own_way = []
        if own_thrust >= 0:
            coupled[own_thrust - row.first - 4] = scale * backwards
            own_way = [scale * (back_way - b * backwards)]
        watched = [scale * one for one in couplings[row.couplings:]] if row.watched else []
        each, each_way = [], []
        if row.shares:
            reverse, reverse_moment, cut, cut_moment, root = given.each
            one, one_way = felt(reverse, reverse_moment, h, decay, s)
            other, other_way = felt(cut, cut_moment, h, decay, s)
            each = [scale * one, scale * other, scale * root / h * w]
            each_way = [scale * (one_way - b * one), scale * (other_way - b * other)]
        per_newton = alpha * scale / row.force
        return [scale * (push - slowing(force) * w), scale * drag, scale * w, scale, *coupled,
                -scale * slope,
                scale * backwards, scale * drag if w < 0.0 else 0.0, scale * small,
                scale * given.lag.of_force, scale * given.lag.of_turns,
                scale * given.lag.of_second, scale * math.sqrt(abs(force)) * w, *each, *watched,
                per_newton * piece[2 * k], per_newton * piece[2 * k + 1],
                scale * (push_way - b * push), scale * (b * slope - delayed),
                scale * (back_way - b * backwards), scale * (small_way - b * small),
                *each_way, *own_way]

    def innovation(self, axis: int, looks: Looks, value: float, variance: float,
                   known: bool = False) -> PlanarInnovation:
        """
        Compare a measurement with the state.

        Parameters
        ----------
        axis : int
            Which of both values of a measurement it is.
        looks : ndarray, shape (2, 8), or None
            What they measure of the motion; None for the position.
        value, variance : float
            Of the measurement.
        known : bool
            Whether the parameters are taken to be exact.

        """
        p, q = self._p, self._q
        if looks is None:
            row = self._all[axis].copy()
            given = row.item(q + axis) + variance
        else:
            row = looks[axis] @ self._all
            given = float(row[q:-1] @ looks[axis]) + variance
        psi, error = row[:q], value - row.item(-1)
        gain, total = psi[:0], given
        if not known:
            gain = self.theta_covariance @ psi[:p]
            total = given + float(gain @ psi[:p])
        if not (given > 0.0 and 0.0 < total < math.inf):
            raise DivergenceError('the covariance is not positive')
        return PlanarInnovation(error, given, total, row, psi, gain,
                                error + float(self._theta @ psi[:p]))

    def beside(self, one: PlanarInnovation, looks: Looks, value: float, variance: float,
               known: bool) -> tuple[float, float, float]:
        """Return error and variance of the second value, and its covariance with the first."""
        p, q = self._p, self._q
        if looks is None:
            row = self._all[1]
            own, shared = row.item(q + 1), one.row.item(q + 1)
        else:
            row = looks[1] @ self._all
            own, shared = float(row[q:-1] @ looks[1]), float(looks[1] @ one.row[q:-1])
        psi = row[:p]
        if not known:
            own += float(psi @ self.theta_covariance @ psi)
            shared += float(one.gain @ psi)
        return value - row.item(-1), own + variance, shared

    def update(self, found: PlanarInnovation, added: float, adapt: bool) -> None:
        """Take a measurement; see ``LinearisedFilter.update``."""
        if not adapt:
            self._consider(found, added)
            return
        share = found.error / (found.total + added)
        change, scaled = share * found.gain, found.gain / math.sqrt(found.total + added)
        self.theta = self._theta + change
        self.theta_covariance = self.theta_covariance - outer(scaled, scaled)
        self.motion += self.sensitivities[:, :self._p] @ change
        self._correct(found, added, found.error - share * (found.total - found.given))

    def _consider(self, found: PlanarInnovation, added: float) -> None:
        """Take the parameters' uncertainty into account without a change, after S. F. Schmidt."""
        given, across = found.given + added, found.row[self._q:-1]
        k = (across + self.sensitivities[:, :self._p] @ found.gain) / (found.total + added)
        self.motion += k * found.error
        crossed = outer(k, across)
        self.covariance -= crossed + crossed.T - given * outer(k, k)
        self.sensitivities -= outer(k, found.psi)

    def update_motion(self, found: PlanarInnovation, added: float) -> None:
        """Take a measurement for the motion alone, as if the parameters were exact."""
        self._correct(found, added, found.error)

    def _correct(self, found: PlanarInnovation, added: float, error: float) -> None:
        """Correct the motion by what the parameters leave of an error."""
        found.row[-1] = -error
        scaled = found.row / math.sqrt(found.given + added)
        # the covariance stays symmetric to the last bit
        self._all -= outer(scaled[self._q:-1], scaled)

    def set_theta(self, theta: Sequence[float] | Array) -> None:
        """Go to other parameters; the motion goes along."""
        new = np.array(theta, dtype=float)
        self.motion += self.sensitivities[:, :self._p] @ (new - self._theta)
        self.theta = new

    def keep_inside(self, bounds: Bounds) -> None:
        """Move the parameters into their bounds, the others as theirs go with them."""
        values = self._values
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
        if not all(-1e-12 <= variance < math.inf for variance in (
                *self.covariance.diagonal().tolist(),
                *self.theta_covariance.diagonal().tolist())):
            raise DivergenceError('the covariance is not positive')

    def widen_motion(self, path: float, velocity: float) -> None:
        """Add variances to those of position and velocity."""
        for i, variance in enumerate((path, path, velocity, velocity)):
            self.covariance[i, i] += variance

    def current(self, of_theta: Array) -> tuple[Array, Array]:
        """Return the current [m/s] and its covariance, for one of the parameters."""
        along = self.sensitivities[CURRENT, :self._p]
        return self.motion[CURRENT].copy(), (
            self.covariance[CURRENT, CURRENT] + along @ of_theta @ along.T)

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'theta': self.theta.tolist(), 'motion': self.motion.tolist(),
                'covariance': self.covariance.tolist(),
                'lagged': [push.lag.state() for push in self._pushes],
                'force': [None if math.isnan(push.last) else push.last for push in self._pushes],
                'sensitivities': self.sensitivities.tolist(),
                'theta_covariance': self.theta_covariance.tolist()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        p = self._p
        self.theta = np.array(floats(state['theta'], p))
        self.motion[:] = floats(state['motion'], SIZE)
        forces = [math.nan if x is None else float(x) for x in state['force']]
        for push, lagged, force in zip(self._pushes, state['lagged'], forces):
            push.lag.restore(floats(lagged, 3))
            push.last = force
        self.covariance[:] = _matrix(state['covariance'], SIZE, SIZE)
        self.theta_covariance = _matrix(state['theta_covariance'], p, p)
        self.sensitivities[:] = _matrix(
            state['sensitivities'], SIZE, self._q)
        for square in (self.covariance, self.theta_covariance):
            if (square != square.T).any():
                raise ValueError('not a covariance')


def outer(column: Array, row: Array) -> Array:
    """Return what each number of a column makes with each of a row."""
    return column[:, None] @ row[None]


def _matrix(values: Any, rows: int, columns: int) -> Array:
    found = np.array([floats(row, columns) for row in values])
    if found.shape != (rows, columns):
        raise ValueError('a matrix that does not fit')
    return found
