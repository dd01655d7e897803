"""
Recursive least squares on filtered regressors, without an acceleration.

The model v' = theta . phi, phi = [tau, v|v|, v, 1], goes through w(s) = 1 / (s + c)^2 on both
sides (state-variable filter; P. C. Young, Automatica 17(1), 1981):

    z = s w(s) v = chi . theta        chi = w(s) phi
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any, cast

from rovid_core.dofs import Four
from rovid_core.excitation import LEAST_EXCITATION, LEAST_MOTION
from rovid_core.factored import FactoredCovariance
from rovid_core.identifier import finite, Identifier, Scales, Step
from rovid_core.plant import advance
from rovid_core.regression_noise import RegressionNoise
from rovid_core.uncertainty import Stated

CORNER = 3.0
"""c [rad/s]: faster than the vehicle, and slow enough to leave fixes of 10 Hz white noise."""

FEEDBACK = 2.0
"""Of the measured velocity to v_hat [1/s]."""

SETTLING = 5.0
"""Filter time constants after which the noise of the first velocity is forgotten."""

MEMORY = 100.0
"""Adaptation times that are remembered, at most; at first half of the time so far."""

PRIOR = 5.0
"""Standard deviation of the initial guess, in typical accelerations."""

STEADY = 3.0
"""Time [s] after which thrust and velocity that do not change tell nothing new."""

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
        self._active = [i for i in range(4) if scales.active[i]]
        # of theta / V per unit of parameter
        self._unit = [1.0 / (scales.regressor[i] * scales.velocity) for i in self._active]
        self.bounds = scales.bounds()
        self._low, self._high = (
            [b[i] * u for i, u in zip(self._active, self._unit)] for b in self.bounds)
        self.adaptation_time = adaptation_time
        self.v_hat = math.nan
        self._age = 0.0  # of the filters [s]
        self.reset()

    def reset(self) -> None:
        """Go back to the initial values."""
        initial, n = self._scales.initial, len(self._active)
        typical = max(initial[0] * self._scales.force / self._scales.velocity, 1.0 / 3.0)
        self._theta = [initial[i] * u for i, u in zip(self._active, self._unit)]
        self._p = FactoredCovariance(n, (PRIOR * typical) ** 2)
        self._noise = RegressionNoise((0.1 / CORNER) ** 2)
        self._learned = 0.0  # time that was learned from [s]
        self.excitation = 0.0
        self._steady = [0.0, 0.0, 0.0]  # mean thrust and velocity, and the thrust's variance
        self.parameters: Four = initial
        self._publish()
        self._begin(math.nan, math.nan)

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
        dt = step.dt
        force = (step.parts[0] * step.forces[0] + step.parts[1] * step.forces[1]) / dt
        f, u = force / self._scales.force, step.mean / self._scales.velocity
        if math.isnan(self.v_hat):
            self.restart(step.velocity[0])
        if not (abs(f) <= MOST and abs(u) <= MOST
                and abs(self.v_hat) <= MOST * self._scales.velocity):
            self._begin(math.nan, math.nan)
            return 'out_of_range'
        before = self.v_hat
        ahead = advance(self.parameters, before, force, dt)
        most = self._scales.velocity  # of the pull, for a fix may be far off
        pull = min(max(step.mean - ahead, -most), most)
        self.v_hat = ahead - math.expm1(-FEEDBACK * dt) * pull
        self._filter(step, f, 0.5 * (before + ahead) / self._scales.velocity)
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
                'theta': list(self._theta), 'u': [list(c) for c in self._p.u],
                'd': list(self._p.d), 'noise': self._noise.state(),
                'steady': list(self._steady),
                'filters': [self._age, self._s, self._z, *self._psi, *self._chi],
                'velocity': None if math.isnan(self._velocity) else self._velocity}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        n = len(self._active)
        parameters, theta, d, filters, noise, steady = (
            [float(x) for x in state[key]]
            for key in ('parameters', 'theta', 'd', 'filters', 'noise', 'steady'))
        u = [[float(x) for x in column] for column in state['u']]
        excitation, learned = float(state['excitation']), float(state['learned'])
        v_hat, velocity = (
            math.nan if state[key] is None else float(state[key])
            for key in ('v_hat', 'velocity'))
        sizes = [len(parameters), len(theta), len(d), len(filters), len(noise), len(steady),
                 len(u)]
        if sizes != [4, n, n, 3 + 2 * n, 4, 3, n] or {len(column) for column in u} != {n}:
            raise ValueError('the state is not one of these terms')
        if not all(low <= p <= high for low, p, high in zip(
                self.bounds[0], parameters, self.bounds[1])):
            raise ValueError(f'parameters {parameters} are out of bounds')
        if not finite((*theta, *d, *filters, *noise, *steady, *sum(u, []), excitation, learned)) \
                or min(*d, *noise[:2]) <= 0.0 or math.isinf(v_hat) or math.isinf(velocity):
            raise ValueError('the state holds numbers that are out of range')
        self.parameters = cast(Four, tuple(parameters))
        self.v_hat, self._velocity, self.excitation = v_hat, velocity, excitation
        self._learned, self._theta, self._steady = learned, theta, steady
        self._p.u, self._p.d = u, d
        self._noise.restore(noise)
        self._age, self._s, self._z = filters[:3]
        self._psi, self._chi = filters[3:3 + n], filters[3 + n:]
        self._publish()

    def _begin(self, v_hat: float, velocity: float) -> None:
        """Empty the filters, from a measured velocity [m/s or rad/s]."""
        self.v_hat = v_hat
        self._velocity = velocity / self._scales.velocity  # measured last, not filtered
        self._age = self._s = self._z = 0.0
        self._psi = [0.0] * len(self._active)
        self._chi = [0.0] * len(self._active)

    def _filter(self, step: Step, f: float, v: float) -> None:
        dt, u = step.dt, step.mean / self._scales.velocity
        keep, t = math.exp(-CORNER * dt), step.interval or step.dt
        phi = (f, v * abs(v), v, 1.0)
        self._s = keep * self._s + u - self._velocity
        self._z = keep * self._z + t * self._s
        self._psi = [keep * p + dt * phi[i] for p, i in zip(self._psi, self._active)]
        self._chi = [keep * x + t * p for x, p in zip(self._chi, self._psi)]
        self._velocity = u
        self._age += dt

    def _is_steady(self, f: float, step: Step) -> bool:
        """Tell whether neither thrust nor velocity have changed for some time."""
        v = min(max(step.velocity[1] / self._scales.velocity, -MOST), MOST)
        v = v if math.isfinite(v) else 0.0
        share = -math.expm1(-step.dt / STEADY)
        f_mean, v_mean, change = self._steady
        f_mean += share * (f - f_mean)
        v_mean += share * (v - v_mean)
        square = (f - f_mean) ** 2
        change += share * (square - change)
        self._steady = [f_mean, v_mean, change]
        return (max(square, change) < LEAST_EXCITATION
                and (v - v_mean) ** 2 < LEAST_MOTION)

    def _learn(self, dt: float) -> None:
        chi, noise = self._chi, self._noise
        error = self._z - math.fsum(x * p for x, p in zip(chi, self._theta))
        prediction = self._p.along(chi)
        weight = noise.weight(error, prediction)
        variance = noise.variance / weight
        self._learned += dt
        memory = min(MEMORY * self.adaptation_time, 2.0 + 0.5 * self._learned)
        self._p.forget(chi, min(-math.expm1(-dt / memory), prediction / (prediction + variance)))
        gain = self._p.update(chi, variance)
        self._theta = [p + k * error for p, k in zip(self._theta, gain)]
        noise.add(weight * error, prediction, dt)
        self._publish()

    def _publish(self) -> None:
        """Give parameters and covariance in their units."""
        p, unit = self._p.matrix(), self._unit
        covariance, std, values = [0.0] * 16, [math.nan] * 4, [0.0] * 4
        theta = self._inside(p)
        for j, i in enumerate(self._active):
            low, high = self.bounds[0][i], self.bounds[1][i]
            values[i] = min(max(theta[j] / unit[j], low), high)
            std[i] = math.sqrt(p[j][j]) / unit[j]
            for k, m in enumerate(self._active):
                covariance[4 * i + m] = p[j][k] / unit[j] / unit[k]
        self.parameters = cast(Four, tuple(values))
        self.uncertainty = Stated(tuple(covariance), cast(Four, tuple(std)))

    def _inside(self, p: list[list[float]]) -> list[float]:
        """Return the estimate, given that what is out of bounds lies on them."""
        theta = self._theta
        for _ in theta:
            beyond = [max(low - x, x - high) for low, x, high in zip(
                self._low, theta, self._high)]
            if max(beyond) <= 0.0:
                break
            j = max(range(len(theta)), key=lambda j: beyond[j] / math.sqrt(p[j][j])
                    if beyond[j] > 0.0 < p[j][j] else 0.0)
            if not p[j][j] > 0.0:
                break
            shift = (min(max(theta[j], self._low[j]), self._high[j]) - theta[j]) / p[j][j]
            column = [row[j] for row in p]
            theta = [x + c * shift for x, c in zip(theta, column)]
            p = [[x - a * b / p[j][j] for x, b in zip(row, column)] for row, a in zip(p, column)]
            p[j][j] = 0.0
        return theta
