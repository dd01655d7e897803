"""
Recursive least squares on filtered regressors, without an acceleration.

The model v' = theta . phi, phi = [tau, v|v|, v, 1], goes through w(s) = 1 / (s + c)^2 on both
sides (state-variable filter; P. C. Young, Automatica 17(1), 1981):

    z = s w(s) v = chi . theta        chi = w(s) phi
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, cast, NamedTuple

from rovid_core.identify.excitation import MIN_EXCITATION, MIN_MOTION
from rovid_core.identify.method import Identifier
from rovid_core.model.dofs import Four, Three
from rovid_core.model.plant import advance
from rovid_core.model.samples import Step
from rovid_core.settings.run import Scales

# c [rad/s]: faster than the vehicle, yet slow enough that noise of fixes at 10 Hz stays white
CORNER = 3.0
FEEDBACK = 2.0  # gain by which v_hat is pulled to the measured velocity [1/s]
# Steps shorter than this [s] may pull more: the difference of their fixes is noisier.
PULL_STEP = 0.1
SETTLING = 5.0  # filter time constants after which the noise of the first velocity has decayed
MEMORY = 100.0  # longest memory, in adaptation times; at first it is half of the time so far
PRIOR = 5.0  # standard deviation of the initial guess, in typical accelerations
STEADY = 3.0  # time [s] after which constant thrust and velocity add no information
MAX_STATE = 1e100  # limit of the numbers in a saved state; its square is finite
ZERO4: Four = (0.0,) * 4
MAX_TYPICAL = 1e6  # a larger velocity or force, in typical ones, is refused
NOISE_MEMORY = 20.0  # memory of the noise's variance [s]
# Only the innovations' spectrum below it counts [rad/s], where a vehicle moves.
NOISE_FREQUENCY = 0.5
HUBER = 3.0  # standard deviations of an innovation beyond which it counts linearly (Huber)
MIN_VARIANCE = 1e-10  # least variance of the noise, in squares of typical velocity x 1 s
MIN_WHITE = 0.02  # least share of the variance that counts, however little lies at low frequencies
# Least value of D, relative to its first: far below any data, far above underflow.
MIN_DIAGONAL = 1e-30
Six = tuple[float, float, float, float, float, float]


class RecursiveLeastSquares(Identifier):
    """
    Recursive least squares on one DOF.

    Parameters
    ----------
    adaptation_time : float
        A hundredth of the longest memory [s].

    Notes
    -----
    Both filters work on the increments of the unfiltered velocity,

        s += du,  then s *= exp(-c dt)         psi += phi dt
        z += s T                               chi += psi T

    with the same weights on both sides, so that z = chi . theta also for irregular steps. z is
    the high-passed path: the noise of the fixes stays nearly white in it, while the difference
    of two fixes would make it negatively correlated.

    phi is computed with v_hat, not with the noisy v (an instrumental variable). v_hat is the
    identified model driven by the thrust, as in ``aid``, pulled to the measured velocity by
    ``FEEDBACK``.

    Information is forgotten along the present chi only, and never more of it than the step
    adds, so a direction that is not excited keeps its covariance. Steps are weighted by the
    noise at the frequencies of the vehicle (``RegressionNoise``), and innovations beyond 3
    standard deviations count linearly (Huber). The estimate is not bounded; ``parameters`` are
    the best ones inside ``bounds`` in the metric of the covariance. Nothing is adapted at rest
    and under steady thrust, where v_hat changes by noise only.

    ``covariance`` regards forgotten information as lost. If the parameters are constant, the
    true covariance is smaller by a factor of up to 2.

    """

    filtered = False

    def __init__(self, scales: Scales, adaptation_time: float = 3.0) -> None:
        self._scales = scales
        # the regressor of a left-out term is 0
        self._on = cast(Four, tuple([1.0 if on else 0.0 for on in scales.active]))
        # theta / V per unit of the parameter
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
        """Return to the initial values."""
        initial = self._scales.initial
        typical = max(initial[0] * self._scales.force / self._scales.velocity, 1.0 / 3.0)
        self._theta = cast(Four, tuple([p * u for p, u in zip(initial, self._unit)]))
        self._p = FactoredCovariance((PRIOR * typical) ** 2)
        self._noise = RegressionNoise((0.1 / CORNER) ** 2)
        self._learned = 0.0  # time of all steps that were adapted to [s]
        self.excitation = 0.0
        # mean thrust, mean velocity and variance of the thrust
        self._steady: Three = (0.0, 0.0, 0.0)
        self.parameters: Four = initial
        self._publish()
        self._restart_filters(math.nan, math.nan)

    def retune(self, adaptation_time: float) -> None:
        """Change the longest memory to a hundred times ``adaptation_time`` [s]."""
        self.adaptation_time = adaptation_time

    def restart(self, velocity: float) -> None:
        """Set v_hat to a measured velocity [m/s or rad/s] and keep the parameters."""
        self._restart_filters(velocity, velocity)

    def step(self, step: Step, adapt: bool = True) -> str:
        """
        Process one step; return '', or ``out_of_range`` for values not finite or far too large.

        The unfiltered velocity and forces are used. With ``adapt`` False the parameters stay
        as they are.
        """
        dt, mean, size = step.dt, step.mean, self._scales.velocity
        (one, other), (first, second) = step.parts, step.forces
        force = (one * first + other * second) / dt
        f, u = force / self._scales.force, mean / size
        if math.isnan(self.v_hat):
            self.restart(step.velocity[0])
        before = self.v_hat
        if not (abs(f) <= MAX_TYPICAL and abs(u) <= MAX_TYPICAL
                and abs(before) <= MAX_TYPICAL * size):
            self._restart_filters(math.nan, math.nan)
            return 'out_of_range'
        ahead = advance(self.parameters, before, force, dt)
        pull = mean - ahead
        limit = size if dt >= PULL_STEP else size * PULL_STEP / dt
        if not -limit <= pull <= limit:  # a fix may be far off
            pull = math.copysign(limit, pull)
        self.v_hat = ahead - math.expm1(-FEEDBACK * dt) * pull
        self._update_filters(step, f, u, 0.5 * (before + ahead) / size)
        self.excitation -= math.expm1(-dt / self.adaptation_time) * (f * f - self.excitation)
        steady = self._is_steady(f, step)
        if adapt and self._age > SETTLING / CORNER and not steady:
            self._update_estimate(dt)
        return ''

    def state(self) -> dict[str, Any]:
        """Return all that is needed to continue from here."""
        return {'parameters': list(self.parameters),
                'v_hat': None if math.isnan(self.v_hat) else self.v_hat,
                'excitation': self.excitation, 'learned': self._learned,
                'theta': list(self._theta), 'u': list(self._p.u), 'd': list(self._p.d),
                'noise': self._noise.state(), 'steady': list(self._steady),
                'filters': [self._age, self._s, self._z, *self._psi, *self._chi],
                'velocity': None if math.isnan(self._velocity) else self._velocity}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``; raise ValueError if it does not fit."""
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
        if not all(abs(x) < MAX_STATE for x in numbers) \
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

    def _restart_filters(self, v_hat: float, velocity: float) -> None:
        """Empty the filters and set v_hat and the last measured velocity [m/s or rad/s]."""
        self.v_hat = v_hat
        self._velocity = velocity / self._scales.velocity  # last measured, not filtered
        self._age = self._s = self._z = 0.0
        self._psi = self._chi = ZERO4

    def _update_filters(self, step: Step, f: float, u: float, v: float) -> None:
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
        """Tell whether thrust and velocity have been constant for some time."""
        v = step.velocity[1] / self._scales.velocity
        if not -MAX_TYPICAL <= v <= MAX_TYPICAL:
            v = math.copysign(MAX_TYPICAL, v) if math.isfinite(v) else 0.0
        share = -math.expm1(-step.dt / STEADY)
        f_mean, v_mean, change = self._steady
        f_mean += share * (f - f_mean)
        v_mean += share * (v - v_mean)
        f -= f_mean
        v -= v_mean
        square = f * f
        change += share * (square - change)
        self._steady = (f_mean, v_mean, change)
        return square < MIN_EXCITATION and change < MIN_EXCITATION and v * v < MIN_MOTION

    def _update_estimate(self, dt: float) -> None:
        chi, noise = self._chi, self._noise
        (x0, x1, x2, x3), (p0, p1, p2, p3) = chi, self._theta
        error = self._z - (x0 * p0 + x1 * p1 + x2 * p2 + x3 * p3)
        prediction = self._p.prediction_variance(chi)
        weight = noise.weight(error, prediction)
        variance = noise.variance / weight
        self._learned += dt
        memory = min(MEMORY * self.adaptation_time, 2.0 + 0.5 * self._learned)
        self._p.forget(chi, min(-math.expm1(-dt / memory), prediction / (prediction + variance)))
        k0, k1, k2, k3 = self._p.update(chi, variance)
        self._theta = (p0 + k0 * error, p1 + k1 * error, p2 + k2 * error, p3 + k3 * error)
        noise.add_innovation(weight * error, prediction, dt)
        self._publish()

    def _publish(self) -> None:
        """Set parameters and uncertainty in their units."""
        self.uncertainty = FactoredUncertainty(
            self._p.u, self._p.d, self._unit, self._scales.active)
        theta, (i, j, k, m) = self._theta, self._unit
        (a, b, c, d), (e, f, g, h), (p, q, r, s) = self._low, self._high, theta
        if not (a <= p <= e and b <= q <= f and c <= r <= g and d <= s <= h):
            p, q, r, s = projected(theta, product(self._p.u, self._p.d), self._low, self._high)
        p, q, r, s = p / i, q / j, r / k, s / m
        (a, b, c, d), (e, f, g, h) = self.bounds
        if not (a <= p <= e and b <= q <= f and c <= r <= g and d <= s <= h):
            # rounding can leave them outside
            p, q, r, s = min(max(p, a), e), min(max(q, b), f), min(max(r, c), g), min(max(s, d), h)
        self.parameters = (p, q, r, s)


class RegressionNoise:
    """
    The variance of the innovations, and of white noise that disturbs the estimate as much.

    The estimate is disturbed by the noise's spectrum at the frequencies of the regressors. A
    low-pass measures it: y += h (e - y) of white noise has h / (2 - h) of its variance.
    """

    def __init__(self, variance: float) -> None:
        self._all = self._slow = variance
        self._y = 0.0
        self._time = 0.0

    @property
    def variance(self) -> float:
        """Return the variance of white noise that disturbs the estimate as much."""
        return max(self._slow, MIN_WHITE * self._all, MIN_VARIANCE)

    def weight(self, innovation: float, prediction: float) -> float:
        """Return Huber's weight of an innovation, 1 or less."""
        limit = HUBER * math.sqrt(self._all + prediction)
        return limit / abs(innovation) if abs(innovation) > limit else 1.0

    def add_innovation(self, innovation: float, prediction: float, dt: float) -> None:
        """Add a weighted innovation, with the variance of its prediction."""
        e = innovation * math.sqrt(self._all / (self._all + prediction))
        self._time += dt
        share = min(dt / min(self._time + 3.0, NOISE_MEMORY), 1.0)
        h = -math.expm1(-NOISE_FREQUENCY * dt)
        self._y += h * (e - self._y)
        self._all = max(self._all + share * (e * e - self._all), MIN_VARIANCE)
        self._slow += share * (self._y * self._y * (2.0 - h) / h - self._slow)
        self._slow = max(self._slow, MIN_WHITE * MIN_VARIANCE)

    def state(self) -> list[float]:
        """Return all that is needed to continue from here."""
        return [self._all, self._slow, self._y, self._time]

    def restore(self, state: Sequence[float]) -> None:
        """Continue from ``state``."""
        self._all, self._slow, self._y, self._time = state


class FactoredCovariance:
    """
    Covariance P = U D U' of a linear regression with 4 parameters, in plain floats.

    U is upper triangular with ones on its diagonal, D is diagonal and above 0 (Bierman,
    Factorization Methods for Discrete Sequential Estimation, 1977), so that P is symmetric
    and positive definite after any number of updates. A parameter whose regressor is always 0
    keeps its value and its variance.
    """

    def __init__(self, variance: float) -> None:
        self.u: Six = (0.0,) * 6  # U above the diagonal, column by column
        self.d: Four = (variance,) * 4
        self._smallest = MIN_DIAGONAL * variance

    def prediction_variance(self, x: Four) -> float:
        """Return x' P x, the variance of the prediction."""
        x0, x1, x2, x3 = x
        u01, u02, u12, u03, u13, u23 = self.u
        d0, d1, d2, d3 = self.d
        x3 += u03 * x0 + u13 * x1 + u23 * x2
        x2 += u02 * x0 + u12 * x1
        x1 += u01 * x0
        return d0 * x0 * x0 + d1 * x1 * x1 + d2 * x2 * x2 + d3 * x3 * x3

    def forget(self, x: Four, share: float) -> None:
        """
        Remove a share of the information along ``x``, and nothing across it.

        P + x x' share / (1 - share) / (x' inv(P) x): the directional forgetting of Cao &
        Schwartz, Automatica 36(11), 2000.
        """
        x0, x1, x2, x3 = x
        u01, u02, u12, u03, u13, u23 = self.u
        d0, d1, d2, d3 = self.d
        # solve U y = x from below; the remainders of x on the way are needed again
        y2, r1, q0 = x2 - u23 * x3, x1 - u13 * x3, x0 - u03 * x3
        y1, r0 = r1 - u12 * y2, q0 - u02 * y2
        y0 = r0 - u01 * y1
        information = x3 * x3 / d3 + y2 * y2 / d2 + y1 * y1 / d1 + y0 * y0 / d0
        if not 0.0 < information < math.inf:
            return
        c = share / (1.0 - share) / information
        # Agee & Turner's update of rank one, column by column from the last
        e3 = d3 + c * x3 * x3
        k = c * x3 / e3
        u03, u13, u23 = u03 + k * q0, u13 + k * r1, u23 + k * y2
        c *= d3 / e3
        e2 = d2 + c * y2 * y2
        k = c * y2 / e2
        u02, u12 = u02 + k * r0, u12 + k * y1
        c *= d2 / e2
        e1 = d1 + c * y1 * y1
        u01 += c * y1 / e1 * y0
        c *= d1 / e1
        self.u = (u01, u02, u12, u03, u13, u23)
        self.d = (d0 + c * y0 * y0, e1, e2, e3)

    def update(self, x: Four, variance: float) -> Four:
        """Update by a measurement of x' theta with a noise variance above 0; return its gain."""
        x0, x1, x2, x3 = x
        u01, u02, u12, u03, u13, u23 = self.u
        d0, d1, d2, d3 = self.d
        smallest = self._smallest
        f1 = x1 + u01 * x0
        f2 = x2 + u02 * x0 + u12 * x1
        f3 = x3 + u03 * x0 + u13 * x1 + u23 * x2
        v0, v1, v2, v3 = d0 * x0, d1 * f1, d2 * f2, d3 * f3
        t0 = variance + v0 * x0
        t1 = t0 + v1 * f1
        t2 = t1 + v2 * f2
        t3 = t2 + v3 * f3
        # each column needs the gain of the columns before it
        k = f1 / t0
        g0, u01 = v0 + u01 * v1, u01 - k * v0
        k = f2 / t1
        a, b = u02, u12
        u02, u12 = a - k * g0, b - k * v1
        g0, g1 = g0 + a * v2, v1 + b * v2
        k = f3 / t2
        a, b, c = u03, u13, u23
        u03, u13, u23 = a - k * g0, b - k * g1, c - k * v2
        self.u = (u01, u02, u12, u03, u13, u23)
        d0, d1, d2, d3 = d0 * (variance / t0), d1 * (t0 / t1), d2 * (t1 / t2), d3 * (t2 / t3)
        self.d = (d0 if d0 > smallest else smallest, d1 if d1 > smallest else smallest,
                  d2 if d2 > smallest else smallest, d3 if d3 > smallest else smallest)
        return ((g0 + a * v3) / t3, (g1 + b * v3) / t3, (v2 + c * v3) / t3, v3 / t3)


def product(u: Six, d: Four) -> list[list[float]]:
    """Return U D U', exactly symmetric."""
    u01, u02, u12, u03, u13, u23 = u
    d0, d1, d2, d3 = d
    p03, p13, p23 = u03 * d3, u13 * d3, u23 * d3
    w02, w12 = u02 * d2, u12 * d2
    w01 = u01 * d1
    p02, p12 = w02 + u03 * p23, w12 + u13 * p23
    p01 = w01 + u02 * w12 + u03 * p13
    return [[d0 + u01 * w01 + u02 * w02 + u03 * p03, p01, p02, p03],
            [p01, d1 + u12 * w12 + u13 * p13, p12, p13],
            [p02, p12, d2 + u23 * p23, p23],
            [p03, p13, p23, d3]]


def projected(estimate: Four, p: list[list[float]], low: Four, high: Four) -> list[float]:
    """Return an estimate with covariance ``p``, moved into the bounds in the metric of ``p``."""
    theta = list(estimate)
    for _ in theta:
        beyond = [max(bottom - x, x - top) for bottom, x, top in zip(low, theta, high)]
        if max(beyond) <= 0.0:
            break
        j = max(range(len(theta)), key=lambda j: beyond[j] / math.sqrt(p[j][j])
                if beyond[j] > 0.0 < p[j][j] else 0.0)
        if not p[j][j] > 0.0:
            break
        shift = (min(max(theta[j], low[j]), high[j]) - theta[j]) / p[j][j]
        column = [row[j] for row in p]
        theta = [x + c * shift for x, c in zip(theta, column)]
        p = [[x - a * b / p[j][j] for x, b in zip(row, column)] for row, a in zip(p, column)]
        p[j][j] = 0.0
    return theta


class FactoredUncertainty(NamedTuple):
    """The uncertainty of the lumped parameters from U D U'; ``unit`` scales them."""

    u: Six
    d: Four
    unit: Four
    active: tuple[bool, bool, bool, bool]
    delay_std: float = math.nan
    couplings_std: tuple[float, ...] = ()

    @property
    def covariance(self) -> tuple[float, ...]:
        """Return the covariance of the lumped parameters, 16 floats, row-major."""
        return tuple([p / u / v if on and here else 0.0
                      for row, u, on in zip(product(self.u, self.d), self.unit, self.active)
                      for p, v, here in zip(row, self.unit, self.active)])

    @property
    def std(self) -> Four:
        """Return the standard deviations, NaN for left-out terms."""
        p = product(self.u, self.d)
        return cast(Four, tuple([
            math.sqrt(p[i][i]) / self.unit[i] if on else math.nan
            for i, on in enumerate(self.active)]))
