"""
A linearised filter for position, velocity and parameters of one degree of freedom.

    x' = v        v' = alpha tau(t - d) + beta v|v| + gamma v + delta

All in units in which the typical force and velocity are 1: alpha to delta are accelerations
in typical velocities per second. The state is predicted by Runge-Kutta.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

from rovid_core.identify.ekf.covariance import (
    DIAGONAL,
    Packed,
    row,
    Seven,
    still,
    Transition,
    updated,
    widened,
)
from rovid_core.identify.ekf.force_impulses import Impulses

POSITION, VELOCITY, ALPHA, BETA, GAMMA, DELTA, DELAY = range(7)

NOTHING = 1e-6
"""[s] Least shift that a slope of the force is told from."""

NOWHERE: Seven = (0.0,) * 7
"""No deviation."""

FASTEST = 1e4
"""Typical velocities beyond which the state means nothing."""

Bounds = Sequence[tuple[int, float, float]]
"""Index, lowest and highest value of what is bounded."""


class DivergenceError(ArithmeticError):
    """The state of a filter means nothing any more."""


class Linearised:
    """
    A Kalman filter around a nominal motion.

    The estimate is the nominal state plus a deviation. ``relinearise`` moves the nominal
    state there: after each measurement that makes an extended Kalman filter, once at the
    end of a trial a step of Gauss-Newton.

    Parameters
    ----------
    nominal : sequence of 7 floats
        Position, velocity, the four parameters, delay [s].
    covariance : Packed
        Of the estimate.

    Attributes
    ----------
    begun : float
        Velocity at ``remember_beginning``.

    """

    def __init__(self, nominal: Sequence[float], covariance: Packed) -> None:
        self.nominal = list(nominal)
        self.deviation = NOWHERE
        self.covariance = covariance
        self._cross: Seven | None = None
        self.begun = 0.0

    def variance(self, i: int) -> float:
        """Return the variance of state ``i``."""
        return self.covariance[DIAGONAL[i]]

    def deviate(self, initial: Sequence[float]) -> None:
        """Let the estimate of parameters and delay be ``initial``, wherever it is linearised."""
        a, b, c, d, e = (p - n for p, n in zip(initial, self.nominal[ALPHA:]))
        self.deviation = (*self.deviation[:2], a, b, c, d, e)

    def set_motion(self, velocity: float, variance: tuple[float, float]) -> None:
        """Take position 0 and a velocity with their variances; the parameters stay."""
        self.covariance = still(self.covariance, variance)
        self.nominal[:2] = 0.0, velocity
        self.deviation = (0.0, 0.0, *self.deviation[2:])

    def remember_beginning(self) -> None:
        """Estimate the present velocity from all that follows, as ``begun``."""
        self.begun = self.nominal[VELOCITY]
        self._cross = row(self.covariance, VELOCITY)

    def predict(self, impulses: Impulses, start: float, end: float, noise: float) -> None:
        """
        Move from ``start`` to ``end`` [s].

        Parameters
        ----------
        impulses : Impulses
            Of the force.
        start, end : float
            [s]
        noise : float
            Spectral density of the acceleration that the model does not know.

        """
        h = end - start
        x, v, alpha, beta, gamma, delta, delay = self.nominal
        at = impulses.at
        begin, half, last = at(start - delay), at(start + 0.5 * h - delay), at(end - delay)
        force = (last - begin) / h
        # the force is taken as a straight line over the step; this is half its rise
        rise = 2.0 * (begin + last - 2.0 * half) / h
        u, du = alpha * force + delta, alpha * rise
        k1 = u - du + (beta * abs(v) + gamma) * v
        w = v + 0.5 * h * k1
        k2 = u + (beta * abs(w) + gamma) * w
        w = v + 0.5 * h * k2
        size = abs(w)
        k3 = u + (beta * size + gamma) * w
        z = v + h * k3
        k4 = u + du + (beta * abs(z) + gamma) * z
        self.nominal[0] = x + h * v + h * h / 6.0 * (k1 + k2 + k3)
        self.nominal[1] = v = v + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        if not abs(v) < FASTEST:
            raise DivergenceError(f'a speed of {v}')
        # held commands are a staircase: its slope inside a step says nothing of the delay
        top = min(end + h, impulses.end + delay)
        later = (at(top - delay) - at(top - h - delay)) - (begin - at(start - h - delay))
        shift = top - start
        # where the newest command came that late there is nothing to tell a slope from
        slope = later / (h * shift) if abs(shift) > NOTHING else 0.0
        decay = h * (2.0 * beta * size + gamma)
        transition = Transition(
            h * (1.0 + 0.5 * decay), 0.5 * h * h, 1.0 + decay * (1.0 + 0.5 * decay),
            (force, w * size, w, -alpha * slope))
        if self.deviation is not NOWHERE:
            self.deviation = transition.of(self.deviation)
        if self._cross is not None:
            self._cross = transition.of(self._cross)
        self.covariance = transition.covariance(
            self.covariance, (noise * h * h * h / 3.0, noise * h * h / 2.0, noise * h))

    def innovation(self, i: int, value: float, variance: float) -> tuple[float, float]:
        """Return by how much a measurement of state ``i`` is off, and the variance of that."""
        return (value - self.nominal[i] - self.deviation[i],
                self.covariance[DIAGONAL[i]] + variance)

    def update(self, i: int, error: float, variance: float, adapt: bool = True) -> None:
        """Take an innovation of state ``i``; the parameters stay if not ``adapt``."""
        root = math.sqrt(variance)
        a, b, c, d, e, f, g = row(self.covariance, i)
        r = (a / root, b / root, c / root, d / root, e / root, f / root, g / root)
        self.covariance = updated(self.covariance, r, adapt)
        normalised = error / root
        if self._cross is not None:
            share = self._cross[i] / root
            self.begun += share * normalised
            self._cross = _moved(self._cross, r, -share)
        self.deviation = _moved(
            self.deviation, r if adapt else (r[0], r[1], 0.0, 0.0, 0.0, 0.0, 0.0), normalised)

    def widen(self, variances: Sequence[float]) -> None:
        """Let the states change by these variances, from the first one on."""
        self.covariance = widened(self.covariance, variances)

    def loosen_parameters(self, share: float) -> None:
        """Forget the parameters by this share of each."""
        self.widen((0.0, 0.0, *[(share * p) ** 2 for p in self.nominal[ALPHA:DELAY]]))

    def relinearise(self, bounds: Bounds) -> None:
        """Move the nominal state to the estimate, inside the bounds."""
        nominal = [x + d for x, d in zip(self.nominal, self.deviation)]
        self.deviation = NOWHERE
        for i, low, high in bounds:
            if low <= nominal[i] <= high:
                continue
            bound = low if nominal[i] < low else high
            variance = self.variance(i)
            if variance > 0.0:
                # the others move with it, or they would contradict it
                share = (bound - nominal[i]) / variance
                nominal = [x + share * p for x, p in zip(nominal, row(self.covariance, i))]
            nominal[i] = bound
        self.nominal = nominal
        for k in DIAGONAL:
            if not 0.0 <= self.covariance[k] < math.inf:
                raise DivergenceError('the covariance is not positive')


def _moved(x: Seven, direction: Seven, share: float) -> Seven:
    a, b, c, d, e, f, g = x
    h, i, j, k, m, n, o = direction
    return (a + share * h, b + share * i, c + share * j, d + share * k, e + share * m,
            f + share * n, g + share * o)
