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
small: every parameter is an object with numbers in attributes, which is what both Python and a
compiled filter read and write fastest. What all models have goes by its name, couplings by their
number.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, Final

from rovid_core.identify.ekf.single.delayed_force import DelayedForce
from rovid_core.identify.ekf.single.regressors import Parameter, Regressor
from rovid_core.identify.ekf.single.watched_lag import LAGS, SECOND_LAG, WatchedLag
from rovid_core.identify.method import DivergenceError, floats
from rovid_core.model.dofs import EACH, Three
from rovid_core.model.thrusters import AS_CONFIGURED, DEAD_BAND, Thrusters

ALPHA: Final = 0
BETA: Final = 1
GAMMA: Final = 2
DELTA: Final = 3
"""Where the parameters stand; the last one is the delay, before it come those of couplings."""

POSITION: Final = 0
VELOCITY: Final = 1
"""What can be measured."""

CANDIDATES = ('reverse_thrust', 'reverse_drag', 'dead_band', *LAGS, SECOND_LAG, 'thrust_loss')
"""Regressors that are watched: what a vehicle often has and the model has not."""

NONE_OWN: Final = (-1, -1)
"""No parameters of a DOF's own reverse thrust and drag."""

FORCE_TIME: Final = 3.0
"""[s] over which the unknown acceleration f goes on."""

LONGEST: Final = 0.3
"""[s] Longest step of the prediction."""

LARGEST_SUBSTEPS: Final = 50
INFINITE: Final = math.inf

STEADY: Final = 1e-9
"""Typical forces by which a force that stays the same may seem to differ from its mean."""

LARGEST_SPEED: Final = 1e4
"""Typical velocities beyond which the state means nothing."""

Bounds = list[tuple[int, float, float]]
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
    own : tuple of 2 ints
        Index of the parameter of each of ``OWN``, -1 for none. Their regressors are made here;
        among the measured ones they are 0.
    thrusters : Thrusters
        What they lose with speed; the force is what they give at rest.
    shares : bool
        Whether ``EACH`` is watched, too, behind ``CANDIDATES``.

    Attributes
    ----------
    motion : tuple of 3 floats
        Path, velocity and f.
    covariance : tuple of 6 floats
        Of the motion for given parameters, the upper triangle by rows.

    """

    def __init__(self, theta: Sequence[float], variances: Sequence[float],
                 force_std: float, watched: int = 0, own: tuple[int, int] = NONE_OWN,
                 thrusters: Thrusters = AS_CONFIGURED, shares: bool = False) -> None:
        self._parameters = [Parameter(value) for value in theta]
        self._alpha, self._beta, self._gamma, self._delta = self._parameters[:4]
        self._couplings, self._delay = self._parameters[4:-1], self._parameters[-1]
        known = len(CANDIDATES) + (len(EACH) if shares else 0)
        candidates = [Regressor() for _ in range(known + watched)]
        (self._reverse, self._reverse_drag, self._cut, self._lag, self._turns_lag,
         self._second_lag, self._loss) = candidates[:len(CANDIDATES)]
        self._each = candidates[len(CANDIDATES):known]
        self._watched = candidates[known:]
        self._always = len(theta) + known
        self._columns: list[Regressor] = [*self._parameters, *candidates]
        self._delta.push = 1.0
        # those that something has pushed: a watched regressor that no step has stays 0
        self._pushed = self._columns
        self._own_thrust, self._own_drag = own
        self._has_own = own != NONE_OWN
        self._thrusters = thrusters
        self._watched_lag = WatchedLag(thrusters.lag_at)
        p = len(theta)
        self.theta_covariance = [
            [variances[i] if i == j else 0.0 for j in range(p)] for i in range(p)]
        self.force_std = force_std
        self.set_motion(0.0, (0.0, 0.0))

    @property
    def theta(self) -> list[float]:
        """Return the p parameters."""
        return [one.value for one in self._parameters]

    @theta.setter
    def theta(self, values: Sequence[float]) -> None:
        for one, value in zip(self._parameters, values):
            one.value = value

    @property
    def theta_covariance(self) -> Matrix:
        """Return the covariance of the parameters, p lists of p floats."""
        return [one.row for one in self._parameters]

    @theta_covariance.setter
    def theta_covariance(self, rows: Matrix) -> None:
        for one, row in zip(self._parameters, rows):
            one.row = row

    @property
    def sensitivities(self) -> Matrix:
        """Return how path, velocity and f move with parameters and watched regressors."""
        return [[one.path for one in self._columns], [one.velocity for one in self._columns],
                [one.force for one in self._columns]]

    @sensitivities.setter
    def sensitivities(self, rows: Matrix) -> None:
        for one, path, velocity, force in zip(self._columns, *rows):
            one.path, one.velocity, one.force = path, velocity, force
        self._pushed = self._columns

    def set_motion(self, velocity: float, variances: tuple[float, float]) -> None:
        """Begin at path 0 with a velocity and their variances; the parameters stay."""
        f = self.force_std
        self.motion = (0.0, velocity, 0.0)
        self.covariance = (variances[0], 0.0, 0.0, variances[1], 0.0, f * f)
        for one in self._columns:
            one.path = one.velocity = one.force = 0.0
        self._pushed = self._columns[:self._always]
        self._force = math.nan  # at the end of the last step, where there was one

    def move(self, recent: DelayedForce, start: float, end: float,
             couplings: Sequence[float] = (), watched: Sequence[float] = (),
             rises: Sequence[float] = ()) -> None:
        """
        Predict from ``start`` to ``end`` [s], in steps that resolve the drag.

        Parameters
        ----------
        recent : DelayedForce
            Of the force.
        start, end : float
            [s]
        couplings : sequence of floats
            The means of the measured regressors over that time, one per parameter of a coupling.
        watched : sequence of floats
            Those that are only watched.
        rises : sequence of floats
            By how much those of ``couplings`` rise from the mean to the end; empty if by nothing.

        """
        if any(watched) or self._pushed is self._columns:
            self._pushed = self._columns
            for column, regressor in zip(self._watched, watched):
                column.push = regressor
        fastest = (2.0 * abs(self._beta.value * self.motion[1]) + abs(self._gamma.value)
                   + self._alpha.value * self._thrusters.loss)
        turn = (end - start) * max(fastest, 1.0 / LONGEST)
        if turn < 1.000001:
            self._predict(recent, start, end, couplings, rises)
            return
        pieces = min(int(turn), LARGEST_SUBSTEPS - 1) + 1
        means, each = couplings, [rise / pieces for rise in rises]
        for k in range(pieces):
            if each:
                means = [mean + (2 * k + 1 - pieces) * rise
                         for mean, rise in zip(couplings, each)]
            self._predict(recent, start + (end - start) * k / pieces,
                          start + (end - start) * (k + 1) / pieces, means, each)

    def _predict(self, recent: DelayedForce, start: float, end: float,
                 couplings: Sequence[float], rises: Sequence[float]) -> None:
        h = end - start
        x, v, f = self.motion
        alpha, beta, gamma = self._alpha.value, self._beta.value, self._gamma.value
        delay = self._delay.value
        impulse, moment, first, last = recent.over(start, end, delay)
        force = impulse / h
        # a straight line with the same integral and the same way; this is half its rise
        du = alpha * (3.0 * force - 6.0 * moment / (h * h))
        u = alpha * force + self._delta.value + f
        for one, regressor in zip(self._couplings, couplings):
            u += one.value * regressor
            one.push = regressor
        for one, regressor in zip(self._couplings, rises):
            du += one.value * regressor
        goes_back = v < 0.0
        slowing = self._thrusters.slowing
        gamma -= alpha * slowing(force)
        if self._has_own:
            astern, _ = recent.bent(start, end, delay)
            more = self._astern(astern[0] / h, astern[1] / (h * h), goes_back, force < 0.0)
            u, du, beta = u + more[0], du + more[1], min(beta + more[2], 0.0)
            alpha += more[3]  # as a delay feels it
        if self._force != self._force:
            excess = (u + (beta * abs(v) + gamma) * v) / self._alpha.value
            self._watched_lag.begin(force - excess, first)  # what holds the velocity
        gone, v, w = run(h, v, u, du, beta, gamma)
        x += gone
        if not abs(v) < LARGEST_SPEED:
            raise DivergenceError(f'a speed of {v}')
        size = abs(w)
        rate = 2.0 * beta * size + gamma
        decay = h * rate
        s, b = h * (1.0 + decay * (0.5 + decay / 6.0)), h * h * (0.5 + decay / 6.0)
        keep = 1.0 + decay * (1.0 + 0.5 * decay)
        # where in the step the force acts counts; a delay feels by how much it has risen since
        # the last step, which is all of its jumps, each of them once
        before = first if self._force != self._force else self._force
        self._force = last
        rise = last - before - (slowing(last) - slowing(before)) * w
        late = 2.0 * moment - before * h * h
        way = impulse - h * before + 0.5 * rate * late
        of_delay, delay_way = alpha / s * (rise + rate * way), alpha * way
        of_alpha, alpha_way = felt(impulse, moment, h, rate, s)
        if first == last and abs(force - first) < STEADY:
            backwards = (of_alpha, alpha_way) if force < 0.0 else (0.0, 0.0)
            share = DEAD_BAND / max(abs(force), recent.bend)
            small = share * of_alpha, share * alpha_way
        else:
            reverse, cut = recent.bent(start, end, delay)
            backwards = felt(reverse[0], reverse[1], h, rate, s)
            small = felt(cut[0], cut[1], h, rate, s)
        self._push_by_rises(rises, h, rate, (s, b))
        drag = w * size
        self._alpha.push = of_alpha - slowing(force) * w
        self._beta.push, self._gamma.push, self._delay.push = drag, w, -of_delay
        self._alpha.path += alpha_way - b * of_alpha
        self._delay.path -= delay_way - b * of_delay
        self._push_watched(h, b, force, w, backwards, small)
        if self._each:
            self._push_by_each(recent.each(start, end, delay), h, rate, (s, b), w)
        if self._has_own:
            self._push_by_own(backwards[0], backwards[1] - b * backwards[0],
                              drag if goes_back else 0.0)
        self._carry(h, (x, v, f), (s, b, keep))

    def _push_watched(self, h: float, b: float, force: float, w: float,
                      backwards: tuple[float, float], small: tuple[float, float]) -> None:
        """
        Let the regressors of ``CANDIDATES`` push over a step, under a mean force.

        Parameters
        ----------
        h, b : float
            Length of the step, and what a push makes of the path.
        force, w : float
            Mean force, and the velocity in the middle of the step.
        backwards, small : tuple of 2 floats
            What the force in reverse, and what a dead band takes, adds to velocity and path.

        """
        lag = self._watched_lag
        lag.move(force, h)
        self._lag.push, self._turns_lag.push = lag.of_force, lag.of_turns
        self._second_lag.push = lag.of_second
        self._reverse_drag.push = w * abs(w) if w < 0.0 else 0.0
        self._loss.push = math.sqrt(abs(force)) * w
        # what is told apart by where in a step it acts has to act where alpha's force does
        self._reverse.push, self._cut.push = backwards[0], small[0]
        self._reverse.path += backwards[1] - b * backwards[0]
        self._cut.path += small[1] - b * small[0]

    def _carry(self, h: float, motion: Three, transition: Three) -> None:
        """
        Go to a motion, and take sensitivities and covariance along over ``h`` [s].

        ``transition`` is what a push, and what a velocity, makes of the velocity and the path.
        """
        x, v, f = motion
        s, b, keep = transition
        p00, p01, p02, p11, p12, p22 = self.covariance
        if self.force_std:
            e = math.exp(-h / FORCE_TIME)
            self.motion = (x, v, e * f)
            for column in self._pushed:
                speed, slow = column.velocity, column.force
                push = column.push + slow
                column.path += s * speed + b * push
                column.velocity = keep * speed + s * push
                column.force = e * slow
            t1, t2 = p01 + s * p11 + b * p12, p02 + s * p12 + b * p22
            r1, r2 = keep * p11 + s * p12, keep * p12 + s * p22
            self.covariance = (
                p00 + s * (p01 + t1) + b * (p02 + t2), keep * t1 + s * t2, e * t2,
                keep * r1 + s * r2, e * r2,
                e * e * p22 + (1.0 - e * e) * self.force_std * self.force_std)
        else:
            self.motion = (x, v, 0.0)
            for column in self._pushed:
                speed, push = column.velocity, column.push
                column.path += s * speed + b * push
                column.velocity = keep * speed + s * push
            t1 = p01 + s * p11
            self.covariance = (
                p00 + s * (p01 + t1), keep * t1, 0.0, keep * keep * p11, 0.0, 0.0)

    def _astern(self, mean: float, moment: float, goes_back: bool,
                pushes_back: bool) -> tuple[float, float, float, float]:
        """
        Return what ``OWN`` adds over a step: acceleration and half its rise, beta, and alpha.

        ``mean`` and ``moment`` are of the force backwards.
        """
        i, k = self._own_thrust, self._own_drag
        weaker = self._parameters[i].value if i >= 0 else 0.0
        drag = self._parameters[k].value if k >= 0 and goes_back else 0.0
        return (weaker * mean, weaker * (3.0 * mean - 6.0 * moment), drag,
                weaker if pushes_back else 0.0)

    def _push_by_own(self, thrust: float, way: float, drag: float) -> None:
        """Let the parameters of ``OWN`` push; by the thrust they also go a way of their own."""
        i, k = self._own_thrust, self._own_drag
        if i >= 0:
            self._parameters[i].push = thrust
            self._parameters[i].path += way
        if k >= 0:
            self._parameters[k].push = drag

    def _push_by_rises(self, rises: Sequence[float], h: float, rate: float,
                       transition: tuple[float, float]) -> None:
        """Let couplings push later than their means would, by how much they rise over a step."""
        s, b = transition
        more, way = felt(0.0, -h * h / 6.0, h, rate, s)
        for one, rise in zip(self._couplings, rises):
            one.push += more * rise
            one.path += (way - b * more) * rise

    def _push_by_each(self, each: tuple[float, float, float, float, float], h: float,
                      rate: float, transition: tuple[float, float], w: float) -> None:
        """Let what ``DelayedForce.each`` gives push over a step, at a velocity."""
        s, b = transition
        backwards, cut, loss = self._each
        backwards.push, way = felt(each[0], each[1], h, rate, s)
        backwards.path += way - b * backwards.push
        cut.push, way = felt(each[2], each[3], h, rate, s)
        cut.path += way - b * cut.push
        loss.push = each[4] / h * w

    def innovation(self, i: int, value: float, variance: float,
                   known: bool = False) -> Innovation:
        """
        Compare a measurement with the state.

        Parameters
        ----------
        i : int
            ``POSITION`` or ``VELOCITY``.
        value, variance : float
            Of the measurement.
        known : bool
            Whether the parameters are taken to be exact.

        """
        psi = [one.path for one in self._columns] if i == POSITION else [
            one.velocity for one in self._columns]
        p00, _, _, p11, _, _ = self.covariance
        x, v, _ = self.motion
        if i == POSITION:
            error, given = value - x, p00 + variance
        else:
            error, given = value - v, p11 + variance
        told, spread = error, 0.0
        if known:
            # this ends with the parameters: those behind are only watched
            for one, slope in zip(self._parameters, psi):
                told += one.value * slope
        else:
            last = len(self._parameters) - 1
            a, b, c, d, e = psi[ALPHA], psi[BETA], psi[GAMMA], psi[DELTA], psi[last]
            for one, slope in zip(self._parameters, psi):
                gain = (one.alpha * a + one.beta * b + one.gamma * c + one.delta * d
                        + one.delay * e)
                if last > 4:
                    for covariance, other in zip(one.couplings, psi[4:last]):
                        gain += covariance * other
                one.gain = gain
                spread += gain * slope
                told += one.value * slope
        total = given + spread
        if not (given > 0.0 and 0.0 < total < INFINITE):
            raise DivergenceError('the covariance is not positive')
        return Innovation(error, given, total, psi, told, i)

    def update(self, found: Innovation, added: float, adapt: bool) -> None:
        """
        Take a measurement.

        Parameters
        ----------
        found : Innovation
            What it says; the last one that was asked for.
        added : float
            Variance that comes to the innovation's because it is large.
        adapt : bool
            False leaves the parameters as they are; the motion goes on with what their
            uncertainty makes of it.

        """
        error, total = found.error, found.total + added
        if not adapt:
            self._consider(found, added)
            return
        share, root = error / total, 1.0 / math.sqrt(total)
        path = velocity = force = 0.0
        for one in self._parameters:
            change = share * one.gain
            one.value += change
            path += change * one.path
            velocity += change * one.velocity
            force += change * one.force
            one.gain *= root
        self._know_more()
        x, v, f = self.motion
        self.motion = (x + path, v + velocity, f + force)
        self._correct(found, added, error - (velocity if found.i else path))

    def _know_more(self) -> None:
        """Lower the covariance of the parameters by the products of their gains."""
        p, q, r, s, u = self._alpha, self._beta, self._gamma, self._delta, self._delay
        a, b, c, d, e = p.gain, q.gain, r.gain, s.gain, u.gain
        # symmetric to the last bit
        p.alpha -= a * a
        p.beta = q.alpha = p.beta - a * b
        p.gamma = r.alpha = p.gamma - a * c
        p.delta = s.alpha = p.delta - a * d
        p.delay = u.alpha = p.delay - a * e
        q.beta -= b * b
        q.gamma = r.beta = q.gamma - b * c
        q.delta = s.beta = q.delta - b * d
        q.delay = u.beta = q.delay - b * e
        r.gamma -= c * c
        r.delta = s.gamma = r.delta - c * d
        r.delay = u.gamma = r.delay - c * e
        s.delta -= d * d
        s.delay = u.delta = s.delay - d * e
        u.delay -= e * e
        if not self._couplings:
            return
        coupled = [one.gain for one in self._couplings]
        for one in self._parameters:
            gain = one.gain
            one.couplings = [x - gain * g for x, g in zip(one.couplings, coupled)]
        for one in self._couplings:
            gain = one.gain
            one.alpha -= gain * a
            one.beta -= gain * b
            one.gamma -= gain * c
            one.delta -= gain * d
            one.delay -= gain * e

    def _consider(self, found: Innovation, added: float) -> None:
        """Take the parameters' uncertainty into account without a change, after S. F. Schmidt."""
        p00, p01, p02, p11, p12, p22 = self.covariance
        a, b, c = (p01, p11, p12) if found.i else (p00, p01, p02)
        k, m, n = a, b, c
        for one in self._parameters:
            k += one.gain * one.path
            m += one.gain * one.velocity
            n += one.gain * one.force
        given, total, error = found.given + added, found.total + added, found.error
        k, m, n = k / total, m / total, n / total
        x, v, f = self.motion
        self.motion = (x + k * error, v + m * error, f + n * error)
        self.covariance = (
            p00 - 2.0 * k * a + k * k * given, p01 - k * b - m * a + k * m * given,
            p02 - k * c - n * a + k * n * given, p11 - 2.0 * m * b + m * m * given,
            p12 - m * c - n * b + m * n * given, p22 - 2.0 * n * c + n * n * given)
        self._follow(found.i, k, m, n)

    def update_motion(self, found: Innovation, added: float) -> None:
        """Take a measurement for the motion alone, as if the parameters were exact."""
        self._correct(found, added, found.error)

    def _correct(self, found: Innovation, added: float, error: float) -> None:
        """Correct the motion by what the parameters leave of an error."""
        p00, p01, p02, p11, p12, p22 = self.covariance
        a, b, c = (p01, p11, p12) if found.i else (p00, p01, p02)
        given = found.given + added
        k, m, n = a / given, b / given, c / given
        x, v, f = self.motion
        self.motion = (x + k * error, v + m * error, f + n * error)
        p00, p11, p22 = p00 - k * a, p11 - m * b, p22 - n * c
        self.covariance = (p00 if p00 > 0.0 else 0.0, p01 - k * b, p02 - k * c,
                           p11 if p11 > 0.0 else 0.0, p12 - m * c, p22 if p22 > 0.0 else 0.0)
        self._follow(found.i, k, m, n)

    def _follow(self, i: int, k: float, m: float, n: float) -> None:
        """Let the sensitivities follow a correction of path, velocity and f by what ``i`` is."""
        for one in self._pushed:
            slope = one.velocity if i else one.path
            one.path -= k * slope
            one.velocity -= m * slope
            if n:
                one.force -= n * slope

    def set_theta(self, theta: Sequence[float]) -> None:
        """Go to other parameters; the motion goes along."""
        x, v, f = self.motion
        for one, value in zip(self._parameters, theta):
            change = value - one.value
            one.value = value
            x += change * one.path
            v += change * one.velocity
            f += change * one.force
        self.motion = (x, v, f)

    def keep_inside(self, bounds: Bounds) -> None:
        """Move the parameters into their bounds, the others as theirs go with them."""
        for i, low, high in bounds:
            if not low <= self._parameters[i].value <= high:
                self._move_inside(bounds)
                break
        if not (self.covariance[0] >= 0.0 <= self.covariance[3]
                and 0.0 <= self._alpha.alpha < INFINITE and 0.0 <= self._beta.beta < INFINITE
                and 0.0 <= self._gamma.gamma < INFINITE and 0.0 <= self._delta.delta < INFINITE
                and 0.0 <= self._delay.delay < INFINITE):
            raise DivergenceError('the covariance is not positive')
        for k, one in enumerate(self._couplings):
            if not 0.0 <= one.couplings[k] < INFINITE:
                raise DivergenceError('the covariance is not positive')

    def _move_inside(self, bounds: Bounds) -> None:
        theta = self.theta
        for i, low, high in bounds:
            if low <= theta[i] <= high:
                continue
            bound = low if theta[i] < low else high
            row = self._parameters[i].row
            # the others move with it, or they would contradict it
            share = (bound - theta[i]) / row[i] if row[i] > 0.0 else 0.0
            theta = [t + share * p for t, p in zip(theta, row)]
            theta[i] = bound
        self.set_theta(theta)
        # moving for one bound may lead out of another
        for i, low, high in bounds:
            one = self._parameters[i]
            one.value = min(max(one.value, low), high)

    def widen_motion(self, path: float, velocity: float = 0.0) -> None:
        """Add variances to those of path and velocity."""
        a, b, c, d, e, f = self.covariance
        self.covariance = (a + path, b, c, d + velocity, e, f)

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'theta': self.theta, 'motion': list(self.motion),
                'covariance': list(self.covariance), 'lagged': self._watched_lag.state(),
                'force': None if math.isnan(self._force) else self._force,
                'sensitivities': self.sensitivities, 'theta_covariance': self.theta_covariance}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        p, q = len(self._parameters), len(self._columns)
        self.theta = floats(state['theta'], p)
        x, v, f = floats(state['motion'], 3)
        self.motion = (x, v, f)
        a, b, c, d, e, f = floats(state['covariance'], 6)
        self.covariance = (a, b, c, d, e, f)
        self._watched_lag.restore(floats(state['lagged'], 3))
        self._force = math.nan if state['force'] is None else floats([state['force']], 1)[0]
        xs, vs, fs = state['sensitivities']
        self.sensitivities = [floats(x, q) for x in (xs, vs, fs)]
        rows = [floats(row, p) for row in state['theta_covariance']]
        if len(rows) != p or any(
                rows[i][j] != rows[j][i] for i in range(p) for j in range(i)):
            raise ValueError('not a covariance')
        self.theta_covariance = rows


def run(h: float, v: float, u: float, du: float, beta: float,
        gamma: float) -> tuple[float, float, float]:
    """
    Return the way of a step of ``h``, and the velocities at its end and in its middle (RK4).

    What pushes goes in a straight line from ``u - du`` to ``u + du``.
    """
    k1 = u - du + (beta * abs(v) + gamma) * v
    w = v + 0.5 * h * k1
    k2 = u + (beta * abs(w) + gamma) * w
    w = v + 0.5 * h * k2
    k3 = u + (beta * abs(w) + gamma) * w
    z = v + h * k3
    k4 = u + du + (beta * abs(z) + gamma) * z
    return h * (v + h / 6.0 * (k1 + k2 + k3)), v + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4), w


def felt(impulse: float, moment: float, h: float, rate: float,
          s: float) -> tuple[float, float]:
    """Return what a force adds to the velocity over ``s``, and to the path, in a step of ``h``."""
    way = moment + rate * h * (0.5 * moment - h * impulse / 12.0)
    return (impulse + rate * way) / s, way


class Innovation:
    """
    A measurement against what was predicted.

    Attributes
    ----------
    error : float
        By how much it is off.
    given, total : float
        The variance of that, for given parameters and altogether.
    psi : list of p + c floats
        Its derivatives by the parameters and the watched regressors.
    told : float
        What it says of the parameters, psi theta: the error, and what they predicted.
    i : int
        ``POSITION`` or ``VELOCITY``.

    """

    __slots__ = ('error', 'given', 'total', 'psi', 'told', 'i')

    def __init__(self, error: float, given: float, total: float, psi: list[float],
                 told: float, i: int) -> None:
        self.error, self.given, self.total = error, given, total
        self.psi, self.told, self.i = psi, told, i
