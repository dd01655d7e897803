"""
Recursive least squares on filtered regressors, without an acceleration.

The model v' = theta . phi, phi = [tau, v|v|, v, 1], goes through w(s) = 1 / (s + c)^2 on both
sides (state-variable filter; P. C. Young, Automatica 17(1), 1981):

    z = s w(s) v = chi . theta        chi = w(s) phi
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, cast

from rovid_core.identify.excitation import LEAST_EXCITATION, LEAST_MOTION
from rovid_core.identify.method import Identifier
from rovid_core.identify.rls.factored_covariance import (
    FactoredCovariance,
    FactoredUncertainty,
    projected,
    Six,
)
from rovid_core.model.dofs import Four, Three
from rovid_core.model.plant import advance
from rovid_core.model.samples import Step
from rovid_core.settings.scales import Scales

CORNER = 3.0
"""c [rad/s]: faster than the vehicle, and slow enough to leave fixes of 10 Hz white noise."""

FEEDBACK = 2.0
"""Of the measured velocity to v_hat [1/s]."""

USUAL = 0.1
"""[s] Of shorter steps a pull may be larger: the difference of two fixes is as much noisier."""

SETTLING = 5.0
"""Filter time constants after which the noise of the first velocity is forgotten."""

MEMORY = 100.0
"""Adaptation times that are remembered, at most; at first half of the time so far."""

PRIOR = 5.0
"""Standard deviation of the initial guess, in typical accelerations."""

STEADY = 3.0
"""Time [s] after which thrust and velocity that do not change tell nothing new."""

ABSURD = 1e100
"""No number of a state comes near it, and its square is finite."""

NONE: Four = (0.0,) * 4

MOST = 1e6
"""A larger velocity or force, in typical ones, is refused."""


class RecursiveLeastSquares(Identifier):
    """
    Recursive least squares on one DOF.

    Parameters
    ----------
    scales : Scales
        Initial parameters, terms and typical sizes.
    adaptation_time : float
        A hundredth of the memory [s].

    Notes
    -----
    The two filters work on the increments of the unfiltered velocity,

        s += du,  then s *= exp(-c dt)         psi += phi dt
        z += s T                               chi += psi T

    with the same weights on both sides, so that z = chi . theta also at irregular steps. z is
    the high-passed path: the noise of the fixes comes through as nearly white, where a
    difference of fixes would have it in opposite pairs.

    phi takes v_hat and not the noisy v: an instrument. v_hat is the identified model driven
    by the thrust, as in ``aid``, pulled towards the measured velocity by ``FEEDBACK``.

    Information is forgotten along the present chi only, and never more of it than this step
    brings: a direction that is not excited keeps its covariance. What is left of the noise at
    the frequencies of the vehicle weighs a step (``RegressionNoise``), beyond 3 standard
    deviations it counts linearly (Huber). The estimate goes free; ``parameters`` is the best
    one inside ``bounds``, in the metric of the covariance. It stays at rest and under
    steady thrust, where v_hat changes by nothing but noise.

    ``covariance`` takes what is forgotten as lost. With parameters that do stay the true one
    is smaller, by up to 2.

    """

    def __init__(self, scales: Scales, adaptation_time: float = 3.0) -> None:
        self._scales = scales
        # a term that is left out has a regressor of 0
        self._on = cast(Four, tuple([1.0 if on else 0.0 for on in scales.active]))
        # of theta / V per unit of parameter
        self._unit = cast(Four, tuple([1.0 / (x * scales.velocity) for x in scales.regressor]))
        self.bounds = scales.bounds()
        self._low, self._high = (
            cast(Four, tuple([b * u for b, u in zip(bound, self._unit)]))
            for bound in self.bounds)
        self.adaptation_time = adaptation_time
        self.v_hat = math.nan
        self._age = 0.0  # of the filters [s]
        self.reset()

    def reset(self) -> None:
        """Go back to the initial values."""
        initial = self._scales.initial
        typical = max(initial[0] * self._scales.force / self._scales.velocity, 1.0 / 3.0)
        self._theta = cast(Four, tuple([p * u for p, u in zip(initial, self._unit)]))
        self._p = FactoredCovariance((PRIOR * typical) ** 2)
        self._noise = RegressionNoise((0.1 / CORNER) ** 2)
        self._learned = 0.0  # time that was learned from [s]
        self.excitation = 0.0
        # mean thrust and velocity, and the thrust's variance
        self._steady: Three = (0.0, 0.0, 0.0)
        self.parameters: Four = initial
        self._publish()
        self._begin(math.nan, math.nan)

    def retune(self, adaptation_time: float) -> None:
        """Take another memory: a hundred times ``adaptation_time`` [s]."""
        self.adaptation_time = adaptation_time

    def restart(self, velocity: float) -> None:
        """Take up from a measured velocity [m/s or rad/s], keeping the parameters."""
        self._begin(velocity, velocity)

    def step(self, step: Step, adapt: bool = True) -> str:
        """
        Take one step; return '' or why it was refused.

        Parameters
        ----------
        step : Step
            What was measured; its unfiltered part is used.
        adapt : bool
            False leaves the parameters as they are.

        Returns
        -------
        str
            '' or the reason: ``out_of_range`` for what is not finite or absurd.

        """
        dt, mean, size = step.dt, step.mean, self._scales.velocity
        (one, other), (first, second) = step.parts, step.forces
        force = (one * first + other * second) / dt
        f, u = force / self._scales.force, mean / size
        if math.isnan(self.v_hat):
            self.restart(step.velocity[0])
        before = self.v_hat
        if not (abs(f) <= MOST and abs(u) <= MOST and abs(before) <= MOST * size):
            self._begin(math.nan, math.nan)
            return 'out_of_range'
        ahead = advance(self.parameters, before, force, dt)
        pull = mean - ahead
        most = size if dt >= USUAL else size * USUAL / dt
        if not -most <= pull <= most:  # a fix may be far off
            pull = math.copysign(most, pull)
        self.v_hat = ahead - math.expm1(-FEEDBACK * dt) * pull
        self._filter(step, f, u, 0.5 * (before + ahead) / size)
        self.excitation -= math.expm1(-dt / self.adaptation_time) * (f * f - self.excitation)
        steady = self._is_steady(f, step)
        if adapt and self._age > SETTLING / CORNER and not steady:
            self._learn(dt)
        return ''

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'parameters': list(self.parameters),
                'v_hat': None if math.isnan(self.v_hat) else self.v_hat,
                'excitation': self.excitation, 'learned': self._learned,
                'theta': list(self._theta), 'u': list(self._p.u), 'd': list(self._p.d),
                'noise': self._noise.state(), 'steady': list(self._steady),
                'filters': [self._age, self._s, self._z, *self._psi, *self._chi],
                'velocity': None if math.isnan(self._velocity) else self._velocity}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        parameters, theta, u, d, filters, noise, steady = (
            tuple([float(x) for x in state[key]])
            for key in ('parameters', 'theta', 'u', 'd', 'filters', 'noise', 'steady'))
        excitation, learned = float(state['excitation']), float(state['learned'])
        v_hat, velocity = (
            math.nan if state[key] is None else float(state[key])
            for key in ('v_hat', 'velocity'))
        if list(map(len, (parameters, theta, u, d, filters, noise, steady))) != [
                4, 4, 6, 4, 11, 4, 3]:
            raise ValueError('the state is not one of least squares')
        if not all(low <= p <= high for low, p, high in zip(
                self.bounds[0], parameters, self.bounds[1])):
            raise ValueError(f'parameters {parameters} are out of bounds')
        numbers = (*theta, *u, *d, *filters, *noise, *steady, excitation, learned)
        if not all(abs(x) < ABSURD for x in numbers) \
                or min(*d, *noise[:2]) <= 0.0 or math.isinf(v_hat) or math.isinf(velocity):
            raise ValueError('the state holds numbers that are out of range')
        self.parameters, self._theta = cast(Four, parameters), cast(Four, theta)
        self.v_hat, self._velocity, self.excitation = v_hat, velocity, excitation
        self._learned, self._steady = learned, cast(Three, steady)
        self._p.u, self._p.d = cast(Six, u), cast(Four, d)
        self._noise.restore(noise)
        self._age, self._s, self._z = filters[:3]
        self._psi, self._chi = cast(Four, filters[3:7]), cast(Four, filters[7:])
        self._publish()

    def _begin(self, v_hat: float, velocity: float) -> None:
        """Empty the filters, from a measured velocity [m/s or rad/s]."""
        self.v_hat = v_hat
        self._velocity = velocity / self._scales.velocity  # measured last, not filtered
        self._age = self._s = self._z = 0.0
        self._psi = self._chi = NONE

    def _filter(self, step: Step, f: float, u: float, v: float) -> None:
        dt = step.dt
        keep, t = math.exp(-CORNER * dt), step.interval or dt
        on, (i, j, k, m), (p, q, r, s) = self._on, self._psi, self._chi
        self._s = keep * self._s + u - self._velocity
        self._z = keep * self._z + t * self._s
        i = keep * i + dt * (on[0] * f)
        j = keep * j + dt * (on[1] * (v * abs(v)))
        k = keep * k + dt * (on[2] * v)
        m = keep * m + dt * on[3]
        self._psi = (i, j, k, m)
        self._chi = (keep * p + t * i, keep * q + t * j, keep * r + t * k, keep * s + t * m)
        self._velocity = u
        self._age += dt

    def _is_steady(self, f: float, step: Step) -> bool:
        """Tell whether neither thrust nor velocity have changed for some time."""
        v = step.velocity[1] / self._scales.velocity
        if not -MOST <= v <= MOST:
            v = math.copysign(MOST, v) if math.isfinite(v) else 0.0
        share = -math.expm1(-step.dt / STEADY)
        f_mean, v_mean, change = self._steady
        f_mean += share * (f - f_mean)
        v_mean += share * (v - v_mean)
        f -= f_mean
        v -= v_mean
        square = f * f
        change += share * (square - change)
        self._steady = (f_mean, v_mean, change)
        return square < LEAST_EXCITATION and change < LEAST_EXCITATION and v * v < LEAST_MOTION

    def _learn(self, dt: float) -> None:
        chi, noise = self._chi, self._noise
        (x0, x1, x2, x3), (p0, p1, p2, p3) = chi, self._theta
        error = self._z - (x0 * p0 + x1 * p1 + x2 * p2 + x3 * p3)
        prediction = self._p.along(chi)
        weight = noise.weight(error, prediction)
        variance = noise.variance / weight
        self._learned += dt
        memory = min(MEMORY * self.adaptation_time, 2.0 + 0.5 * self._learned)
        self._p.forget(chi, min(-math.expm1(-dt / memory), prediction / (prediction + variance)))
        k0, k1, k2, k3 = self._p.update(chi, variance)
        self._theta = (p0 + k0 * error, p1 + k1 * error, p2 + k2 * error, p3 + k3 * error)
        noise.add(weight * error, prediction, dt)
        self._publish()

    def _publish(self) -> None:
        """Give parameters and uncertainty in their units."""
        self.uncertainty = FactoredUncertainty(
            self._p.u, self._p.d, self._unit, self._scales.active)
        theta, (i, j, k, m) = self._theta, self._unit
        (a, b, c, d), (e, f, g, h), (p, q, r, s) = self._low, self._high, theta
        if not (a <= p <= e and b <= q <= f and c <= r <= g and d <= s <= h):
            p, q, r, s = projected(theta, self._p.matrix(), self._low, self._high)
        p, q, r, s = p / i, q / j, r / k, s / m
        (a, b, c, d), (e, f, g, h) = self.bounds
        if not (a <= p <= e and b <= q <= f and c <= r <= g and d <= s <= h):
            # by a last bit
            p, q, r, s = min(max(p, a), e), min(max(q, b), f), min(max(r, c), g), min(max(s, d), h)
        self.parameters = (p, q, r, s)


REGRESSION_NOISE_MEMORY = 20.0
"""[s]"""

FREQUENCY = 0.5
"""[rad/s] below which the innovations' spectrum counts, for that is where a vehicle moves."""

ROBUST = 3.0
"""Standard deviations of an innovation beyond which it is an outlier."""

LEAST = 1e-10
"""Of the variance, in squares of typical velocity x 1 s."""

LEAST_SHARE = 0.02
"""Of the variance that white noise would need, however blue the innovations are."""


class RegressionNoise:
    """
    Variance of the innovations, and of white noise that would disturb the estimate as much.

    What disturbs an estimate is the noise's spectrum at the frequencies of the regressors.
    A low-pass gives it: y += h (e - y) of white noise has h / (2 - h) of its variance.

    Parameters
    ----------
    variance : float
        At first.

    """

    def __init__(self, variance: float) -> None:
        self._all = self._slow = variance
        self._y = 0.0
        self._time = 0.0

    @property
    def variance(self) -> float:
        """Return the variance that white noise would need to disturb as much."""
        return max(self._slow, LEAST_SHARE * self._all, LEAST)

    def weight(self, innovation: float, prediction: float) -> float:
        """Return Huber's weight of an innovation, 1 or less."""
        most = ROBUST * math.sqrt(self._all + prediction)
        return most / abs(innovation) if abs(innovation) > most else 1.0

    def add(self, innovation: float, prediction: float, dt: float) -> None:
        """Take an innovation, already weighted, with the variance of the prediction."""
        e = innovation * math.sqrt(self._all / (self._all + prediction))
        self._time += dt
        share = min(dt / min(self._time + 3.0, REGRESSION_NOISE_MEMORY), 1.0)
        h = -math.expm1(-FREQUENCY * dt)
        self._y += h * (e - self._y)
        self._all = max(self._all + share * (e * e - self._all), LEAST)
        self._slow += share * (self._y * self._y * (2.0 - h) / h - self._slow)
        self._slow = max(self._slow, LEAST_SHARE * LEAST)

    def state(self) -> list[float]:
        """Return all that is needed to go on from here."""
        return [self._all, self._slow, self._y, self._time]

    def restore(self, state: Sequence[float]) -> None:
        """Go on from ``state``."""
        self._all, self._slow, self._y, self._time = state
