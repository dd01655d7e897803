"""
A linearised Kalman filter for one degree of freedom, in the form with sensitivities.

    x' = v        v' = alpha tau(t - d) + beta v|v| + gamma v + delta + sum kappa_j x_j + f
                  f' = -f / T + white noise

All in units in which the typical force and velocity are 1: alpha to delta are accelerations
in typical velocities per second; f is an acceleration that the model does not know. The motion
[path, v, f] has a covariance for given parameters; how it would move with each parameter are
its sensitivities. Together with the covariance of the parameters that is an extended Kalman
filter for all of them, with any number of parameters, and a regressor that is only watched
costs three numbers. Plain floats take a tenth of the time that numpy needs for sizes this
small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from operator import add, mul
from typing import Any, NamedTuple

from rovid_core.identify.ekf.divergence import DivergenceError
from rovid_core.identify.ekf.recent_force import RecentForce

ALPHA, BETA, GAMMA, DELTA = range(4)
"""Where the parameters stand; the last one is the delay, before it come those of couplings."""

POSITION, VELOCITY = range(2)
"""What can be measured."""

CANDIDATES = ('reverse_thrust', 'reverse_drag', 'dead_band', 'lag')
"""Regressors that are watched: what a vehicle often has and the model has not."""

DEAD_BAND = 0.2
"""Thrust up to which a dead-band is looked for, in typical forces."""

LAG = 0.15
"""[s] of the thruster lag that is looked for."""

FORCE_TIME = 3.0
"""[s] over which the unknown acceleration f goes on."""

LONGEST = 0.3
"""[s] Longest step of the prediction."""

LARGEST_SUBSTEPS = 50

STEADY = 1e-9
"""Typical forces by which a force that stays the same may seem to differ from its mean."""

LARGEST_SPEED = 1e4
"""Typical velocities beyond which the state means nothing."""

Bounds = Sequence[tuple[int, float, float]]
"""Index, lowest and highest value of the parameters that are bounded."""

Matrix = list[list[float]]


class LinearisedFilter:
    """
    Motion, parameters and their uncertainty, moved from measurement to measurement.

    Parameters
    ----------
    theta : sequence of p floats
        alpha to delta, those of the couplings, delay [s].
    variances : sequence of p floats
        Of the parameters; 0 for those that stay as they are.
    force_std : float
        Stationary standard deviation of the unknown acceleration f; 0 for none.
    watched : int
        Regressors that are watched besides ``CANDIDATES``.

    Attributes
    ----------
    motion : list of 3 floats
        Path, velocity and f.
    covariance : tuple of 6 floats
        Of the motion for given parameters, the upper triangle by rows.
    sensitivities : three lists of p + c floats
        Derivatives of path, velocity and f by the parameters and the c watched regressors.
    theta_covariance : list of p lists of p floats
        Of the parameters.

    """

    def __init__(self, theta: Sequence[float], variances: Sequence[float],
                 force_std: float, watched: int = 0) -> None:
        self.theta = list(theta)
        self._count = len(theta) + len(CANDIDATES) + watched
        p = len(self.theta)
        self.theta_covariance: Matrix = [
            [variances[i] if i == j else 0.0 for j in range(p)] for i in range(p)]
        self.force_std = force_std
        self.motion = [0.0, 0.0, 0.0]
        self.set_motion(0.0, (0.0, 0.0))

    def set_motion(self, velocity: float, variances: tuple[float, float]) -> None:
        """Begin at path 0 with a velocity and their variances; the parameters stay."""
        f = self.force_std
        self.motion = [0.0, velocity, 0.0]
        self.covariance = (variances[0], 0.0, 0.0, variances[1], 0.0, f * f)
        q = self._count
        self.sensitivities: Matrix = [[0.0] * q, [0.0] * q, [0.0] * q]
        self._lagged = 0.0
        self._force: float | None = None  # at the end of the last step

    def move(self, recent: RecentForce, start: float, end: float,
             couplings: Sequence[float] = (), watched: Sequence[float] = ()) -> None:
        """
        Predict from ``start`` to ``end`` [s], in steps that resolve the drag.

        Parameters
        ----------
        recent : RecentForce
            Of the force.
        start, end : float
            [s]
        couplings : sequence of floats
            The measured regressors over that time, one per parameter of a coupling.
        watched : sequence of floats
            Those that are only watched.

        """
        turn = (end - start) * max(
            2.0 * abs(self.theta[BETA] * self.motion[1]) + abs(self.theta[GAMMA]), 1.0 / LONGEST)
        if turn < 1.000001:
            self._predict(recent, start, end, couplings, watched)
            return
        pieces = min(int(turn), LARGEST_SUBSTEPS - 1) + 1
        for k in range(pieces):
            self._predict(recent, start + (end - start) * k / pieces,
                          start + (end - start) * (k + 1) / pieces, couplings, watched)

    def _predict(self, recent: RecentForce, start: float, end: float,
                 couplings: Sequence[float], watched: Sequence[float]) -> None:
        h = end - start
        theta = self.theta
        x, v, f = self.motion
        alpha, beta, gamma, delta, delay = (
            theta[0], theta[1], theta[2], theta[3], theta[-1])
        impulse, moment, first, last = recent.over(start - delay, end - delay)
        force = impulse / h
        # a straight line with the same integral and the same way; this is half its rise
        du = alpha * (3.0 * force - 6.0 * moment / (h * h))
        u = alpha * force + delta + f
        for kappa, regressor in zip(theta[4:], couplings):
            u += kappa * regressor
        k1 = u - du + (beta * abs(v) + gamma) * v
        w = v + 0.5 * h * k1
        k2 = u + (beta * abs(w) + gamma) * w
        w = v + 0.5 * h * k2
        size = abs(w)
        k3 = u + (beta * size + gamma) * w
        z = v + h * k3
        k4 = u + du + (beta * abs(z) + gamma) * z
        v += h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        if not abs(v) < LARGEST_SPEED:
            raise DivergenceError(f'a speed of {v}')
        rate = 2.0 * beta * size + gamma
        decay = h * rate
        s, b = h * (1.0 + decay * (0.5 + decay / 6.0)), h * h * (0.5 + decay / 6.0)
        keep = 1.0 + decay * (1.0 + 0.5 * decay)
        # where in the step the force acts counts; a delay feels by how much it has risen since
        # the last step, which is all of its jumps, each of them once
        before = first if self._force is None else self._force
        self._force = last
        late = 2.0 * moment - before * h * h
        way = impulse - h * before + 0.5 * rate * late
        of_delay = alpha / s * (last - before + rate * way), alpha * way
        of_alpha = felt(impulse, moment, h, rate, s)
        if first == last and abs(force - first) < STEADY:
            of_reverse = of_alpha if force < 0.0 else (0.0, 0.0)
            share = DEAD_BAND / max(abs(force), DEAD_BAND)
            of_cut = share * of_alpha[0], share * of_alpha[1]
        else:
            reverse, cut = recent.bent(start - delay, end - delay, DEAD_BAND)
            of_reverse = felt(reverse[0], reverse[1], h, rate, s)
            of_cut = felt(cut[0], cut[1], h, rate, s)
        drag = w * size
        gone = -math.expm1(-h / LAG)
        lag = (force - self._lagged) * gone * LAG / h
        self._lagged += gone * (force - self._lagged)
        phi = [of_alpha[0], drag, w, 1.0, *couplings, -of_delay[0],
               of_reverse[0], drag if w < 0.0 else 0.0, of_cut[0], lag, *watched]
        xs, vs, fs = self.sensitivities
        d = len(theta) - 1
        xs = [*xs]
        xs[ALPHA] += of_alpha[1] - b * of_alpha[0]
        xs[d] -= of_delay[1] - b * of_delay[0]
        # what is told apart by where in a step it acts has to act where alpha's force does
        xs[d + 1] += of_reverse[1] - b * of_reverse[0]
        xs[d + 3] += of_cut[1] - b * of_cut[0]
        if self.force_std:
            e = math.exp(-h / FORCE_TIME)
            self.motion = [x + h * (self.motion[1] + h / 6.0 * (k1 + k2 + k3)), v, e * f]
            both = [c + d for c, d in zip(phi, fs)]
            self.sensitivities = [
                [m + s * n + b * o for m, n, o in zip(xs, vs, both)],
                [keep * n + s * o for n, o in zip(vs, both)], [e * o for o in fs]]
            p00, p01, p02, p11, p12, p22 = self.covariance
            t1, t2 = p01 + s * p11 + b * p12, p02 + s * p12 + b * p22
            r1, r2 = keep * p11 + s * p12, keep * p12 + s * p22
            self.covariance = (
                p00 + s * (p01 + t1) + b * (p02 + t2), keep * t1 + s * t2, e * t2,
                keep * r1 + s * r2, e * r2,
                e * e * p22 + (1.0 - e * e) * self.force_std * self.force_std)
        else:
            self.motion = [x + h * (self.motion[1] + h / 6.0 * (k1 + k2 + k3)), v, 0.0]
            self.sensitivities = [
                [m + s * n + b * o for m, n, o in zip(xs, vs, phi)],
                [keep * n + s * o for n, o in zip(vs, phi)], fs]
            p00, p01, _, p11, _, _ = self.covariance
            t1 = p01 + s * p11
            self.covariance = (
                p00 + s * (p01 + t1), keep * t1, 0.0, keep * keep * p11, 0.0, 0.0)

    def innovation(self, i: int, value: float, variance: float) -> Innovation:
        """Compare a measurement of path or velocity, of this variance, with the state."""
        psi = self.sensitivities[i]
        # a product ends with the parameters: those behind are only watched
        gain = [sum(map(mul, row, psi)) for row in self.theta_covariance]
        given = self.covariance[3 if i else 0] + variance
        total = given + sum(map(mul, gain, psi))
        if not (given > 0.0 and 0.0 < total < math.inf):
            raise DivergenceError('the covariance is not positive')
        return Innovation(i, value - self.motion[i], given, total, psi, gain)

    def update(self, found: Innovation, added: float, adapt: bool) -> None:
        """
        Take a measurement.

        Parameters
        ----------
        found : Innovation
            What it says.
        added : float
            Variance that comes to the innovation's because it is large.
        adapt : bool
            False leaves the parameters as they are; the motion goes on with what their
            uncertainty makes of it.

        """
        i, error, given, total, psi, gain = found
        given += added
        total += added
        p00, p01, p02, p11, p12, p22 = self.covariance
        a, b, c = (p01, p11, p12) if i else (p00, p01, p02)
        xs, vs, fs = self.sensitivities
        if not adapt:
            # the parameters are only taken into account, after S. F. Schmidt
            k, m, n = [(p + sum(map(mul, gain, us))) / total
                       for p, us in ((a, xs), (b, vs), (c, fs))]
            x, v, f = self.motion
            self.motion = [x + k * error, v + m * error, f + n * error]
            self.covariance = (
                p00 - 2.0 * k * a + k * k * given, p01 - k * b - m * a + k * m * given,
                p02 - k * c - n * a + k * n * given, p11 - 2.0 * m * b + m * m * given,
                p12 - m * c - n * b + m * n * given, p22 - 2.0 * n * c + n * n * given)
        else:
            share, root = error / total, 1.0 / math.sqrt(total)
            change = [share * g for g in gain]
            self.theta = list(map(add, self.theta, change))
            scaled = [root * g for g in gain]
            # symmetric to the last bit
            self.theta_covariance = [
                [p - h * g for p, g in zip(row, scaled)]
                for row, h in zip(self.theta_covariance, scaled)]
            x, v, f = self.motion
            k, m, n = a / given, b / given, c / given
            along = sum(map(mul, change, psi))
            rest = error - along
            self.motion = [
                x + (sum(map(mul, change, xs)) if i else along) + k * rest,
                v + (along if i else sum(map(mul, change, vs))) + m * rest,
                f + (sum(map(mul, change, fs)) + n * rest if n else 0.0)]
            self.covariance = (max(p00 - k * a, 0.0), p01 - k * b, p02 - k * c,
                               max(p11 - m * b, 0.0), p12 - m * c, max(p22 - n * c, 0.0))
        self.sensitivities = [
            [u - k * w for u, w in zip(xs, psi)], [u - m * w for u, w in zip(vs, psi)],
            [u - n * w for u, w in zip(fs, psi)] if n else fs]

    def update_motion(self, found: Innovation, added: float) -> None:
        """Take a measurement for the motion alone, as if the parameters were exact."""
        i, error, given, _, psi, _ = found
        p00, p01, p02, p11, p12, p22 = self.covariance
        a, b, c = (p01, p11, p12) if i else (p00, p01, p02)
        given += added
        k, m, n = a / given, b / given, c / given
        x, v, f = self.motion
        self.motion = [x + k * error, v + m * error, f + n * error]
        self.covariance = (max(p00 - k * a, 0.0), p01 - k * b, p02 - k * c,
                           max(p11 - m * b, 0.0), p12 - m * c, max(p22 - n * c, 0.0))
        xs, vs, fs = self.sensitivities
        self.sensitivities = [
            [u - k * w for u, w in zip(xs, psi)], [u - m * w for u, w in zip(vs, psi)],
            [u - n * w for u, w in zip(fs, psi)] if n else fs]

    def set_theta(self, theta: Sequence[float]) -> None:
        """Go to other parameters; the motion goes along."""
        change = [new - old for new, old in zip(theta, self.theta)]
        self.theta = list(theta)
        self.motion = [x + sum(map(mul, change, us))
                       for x, us in zip(self.motion, self.sensitivities)]

    def keep_inside(self, bounds: Bounds) -> None:
        """Move the parameters into their bounds, the others as theirs go with them."""
        theta = self.theta
        for i, low, high in bounds:
            if low <= theta[i] <= high:
                continue
            bound = low if theta[i] < low else high
            row = self.theta_covariance[i]
            # the others move with it, or they would contradict it
            share = (bound - theta[i]) / row[i] if row[i] > 0.0 else 0.0
            theta = [t + share * p for t, p in zip(theta, row)]
            theta[i] = bound
        if theta is not self.theta:
            self.set_theta(theta)
            # moving for one bound may lead out of another
            self.theta = [*self.theta]
            for i, low, high in bounds:
                self.theta[i] = min(max(self.theta[i], low), high)
        least = min(self.covariance[0], self.covariance[3], *[
            row[k] for k, row in enumerate(self.theta_covariance)])
        if not 0.0 <= least < math.inf:
            raise DivergenceError('the covariance is not positive')

    def widen_motion(self, path: float, velocity: float = 0.0) -> None:
        """Add variances to those of path and velocity."""
        a, b, c, d, e, f = self.covariance
        self.covariance = (a + path, b, c, d + velocity, e, f)

    def widen_parameters(self, variances: Sequence[float]) -> None:
        """Add variances to those of the parameters, from the first on."""
        for k, variance in enumerate(variances):
            self.theta_covariance[k][k] += variance

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'theta': list(self.theta), 'motion': list(self.motion),
                'covariance': list(self.covariance), 'lagged': self._lagged, 'force': self._force,
                'sensitivities': [list(x) for x in self.sensitivities],
                'theta_covariance': [list(x) for x in self.theta_covariance]}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        p, q = len(self.theta), self._count
        self.theta = floats(state['theta'], p)
        self.motion = floats(state['motion'], 3)
        a, b, c, d, e, f = floats(state['covariance'], 6)
        self.covariance = (a, b, c, d, e, f)
        self._lagged, = floats([state['lagged']], 1)
        self._force = None if state['force'] is None else floats([state['force']], 1)[0]
        xs, vs, fs = state['sensitivities']
        self.sensitivities = [floats(x, q) for x in (xs, vs, fs)]
        rows = [floats(row, p) for row in state['theta_covariance']]
        if len(rows) != p or any(
                rows[i][j] != rows[j][i] for i in range(p) for j in range(i)):
            raise ValueError('not a covariance')
        self.theta_covariance = rows


def felt(impulse: float, moment: float, h: float, rate: float,
          s: float) -> tuple[float, float]:
    """Return what a force adds to the velocity over ``s``, and to the path, in a step of ``h``."""
    way = moment + rate * h * (0.5 * moment - h * impulse / 12.0)
    return (impulse + rate * way) / s, way


class Innovation(NamedTuple):
    """
    A measurement against what was predicted.

    Attributes
    ----------
    i : int
        ``POSITION`` or ``VELOCITY``.
    error : float
        By how much it is off.
    given, total : float
        The variance of that, for given parameters and altogether.
    psi : list of p + c floats
        Its derivatives by the parameters and the watched regressors.
    gain : list of p floats
        Covariance of the parameters with it.

    """

    i: int
    error: float
    given: float
    total: float
    psi: list[float]
    gain: list[float]


def floats(values: Any, count: int) -> list[float]:
    """Return a list of finite floats; raises ValueError unless there are that many."""
    found = [float(x) for x in values]
    if len(found) != count or not all(map(math.isfinite, found)):
        raise ValueError(f'{len(found)} numbers that do not fit')
    return found
