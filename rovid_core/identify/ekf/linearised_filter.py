"""
A linearised Kalman filter for position, velocity, parameters and delay of one DOF.

    x' = v        v' = alpha tau(t - d) + beta v|v| + gamma v + delta

All in units in which the typical force and velocity are 1: alpha to delta are accelerations
in typical velocities per second. The state is predicted by Runge-Kutta. A covariance is its
upper triangle by rows, 28 plain floats, and so symmetric to the last bit; written out it takes
a tenth of the time that numpy needs for matrices this small.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
import math

from rovid_core.model.dofs import Four

SIZE = 7
Packed = tuple[float, ...]
Seven = tuple[float, float, float, float, float, float, float]
Five = tuple[float, float, float, float, float]

INDICES = tuple([tuple([SIZE * min(i, j) - min(i, j) * (min(i, j) + 1) // 2 + max(i, j)
                        for j in range(SIZE)]) for i in range(SIZE)])
"""Where row i has its columns."""

DIAGONAL = tuple([INDICES[i][i] for i in range(SIZE)])


def diagonal(variances: Sequence[float]) -> Packed:
    """Return a covariance of 7 variances alone."""
    return widened((0.0,) * (SIZE * (SIZE + 1) // 2), variances)


def packed(rows: Sequence[Sequence[float]]) -> Packed:
    """Return a covariance from its rows; raises ValueError unless it is symmetric."""
    if [len(row) for row in rows] != [SIZE] * SIZE or any(
            rows[i][j] != rows[j][i] for i in range(SIZE) for j in range(i)):
        raise ValueError('not a covariance')
    return tuple([float(x) for i, row in enumerate(rows) for x in row[i:]])


def row(p: Packed, i: int) -> Seven:
    """Return row ``i``."""
    return p[:SIZE] if i == 0 else tuple([p[k] for k in INDICES[i]])  # type: ignore[return-value]


def widened(p: Packed, added: Sequence[float]) -> Packed:
    """Return it with variances added, from the first state on."""
    entries = list(p)
    for k, variance in zip(DIAGONAL, added):
        entries[k] += variance
    return tuple(entries)


def with_motion(p: Packed, variance: tuple[float, float]) -> Packed:
    """Return it with new variances of position and velocity, which hang together with nothing."""
    none = (0.0,) * 5
    return (variance[0], 0.0, *none, variance[1], *none, *p[13:])


def updated(p: Packed, r: Seven, adapt: bool) -> Packed:
    """
    Return it less r r', which is what a measurement tells.

    Parameters
    ----------
    p : Packed
        The covariance.
    r : tuple of 7 floats
        Row of what was measured, over the standard deviation of the innovation.
    adapt : bool
        False leaves the constants as uncertain as they are.

    """
    (p00, p01, p02, p03, p04, p05, p06,
     p11, p12, p13, p14, p15, p16,
     p22, p23, p24, p25, p26,
     p33, p34, p35, p36,
     p44, p45, p46,
     p55, p56,
     p66) = p
    a, b, c, d, e, f, g = r
    motion = (
        p00 - a * a, p01 - a * b, p02 - a * c, p03 - a * d, p04 - a * e, p05 - a * f, p06 - a * g,
        p11 - b * b, p12 - b * c, p13 - b * d, p14 - b * e, p15 - b * f, p16 - b * g)
    if not adapt:
        return (*motion, *p[13:])
    return (
        *motion,
        p22 - c * c, p23 - c * d, p24 - c * e, p25 - c * f, p26 - c * g,
        p33 - d * d, p34 - d * e, p35 - d * f, p36 - d * g,
        p44 - e * e, p45 - e * f, p46 - e * g,
        p55 - f * f, p56 - f * g,
        p66 - g * g)


class Transition:
    """
    How position and velocity after a step follow the state before it.

    x + share v + bend phi . c   and   keep v + share phi . c   for constants c.

    Parameters
    ----------
    share, bend : float
        [s], [s^2]
    keep : float
        What is left of a velocity.
    phi : tuple of 4 floats
        Derivatives of the acceleration by the constants: the third but last is 1 and not
        given.

    """

    def __init__(self, share: float, bend: float, keep: float, phi: Four) -> None:
        self._share, self._bend, self._keep, self._phi = share, bend, keep, phi

    def of(self, x: Seven) -> Seven:
        """Return a state, or a row of a covariance, after the step."""
        a, b, c, d, e, f, g = x
        s, t, u, w = self._phi
        moved = s * c + t * d + u * e + f + w * g
        return (a + self._share * b + self._bend * moved, self._keep * b + self._share * moved,
                c, d, e, f, g)

    def covariance(self, p: Packed, noise: tuple[float, float, float]) -> Packed:
        """Return a covariance after the step; ``noise`` comes to that of the motion."""
        (p00, p01, p02, p03, p04, p05, p06,
         p11, p12, p13, p14, p15, p16,
         p22, p23, p24, p25, p26,
         p33, p34, p35, p36,
         p44, p45, p46,
         p55, p56,
         p66) = p
        share, bend, keep, (s, t, u, w) = self._share, self._bend, self._keep, self._phi
        # phi . c with every state
        a0 = s * p02 + t * p03 + u * p04 + p05 + w * p06
        a1 = s * p12 + t * p13 + u * p14 + p15 + w * p16
        a2 = s * p22 + t * p23 + u * p24 + p25 + w * p26
        a3 = s * p23 + t * p33 + u * p34 + p35 + w * p36
        a4 = s * p24 + t * p34 + u * p44 + p45 + w * p46
        a5 = s * p25 + t * p35 + u * p45 + p55 + w * p56
        a6 = s * p26 + t * p36 + u * p46 + p56 + w * p66
        # the new position and velocity with every state of before, or the constants
        x0 = p00 + share * p01 + bend * a0
        x1 = p01 + share * p11 + bend * a1
        x2 = p02 + share * p12 + bend * a2
        x3 = p03 + share * p13 + bend * a3
        x4 = p04 + share * p14 + bend * a4
        x5 = p05 + share * p15 + bend * a5
        x6 = p06 + share * p16 + bend * a6
        v1 = keep * p11 + share * a1
        v2 = keep * p12 + share * a2
        v3 = keep * p13 + share * a3
        v4 = keep * p14 + share * a4
        v5 = keep * p15 + share * a5
        v6 = keep * p16 + share * a6
        x = s * x2 + t * x3 + u * x4 + x5 + w * x6
        v = s * v2 + t * v3 + u * v4 + v5 + w * v6
        return (
            x0 + share * x1 + bend * x + noise[0], keep * x1 + share * x + noise[1],
            x2, x3, x4, x5, x6,
            keep * v1 + share * v + noise[2], v2, v3, v4, v5, v6,
            *p[13:])


KEPT = 4.0
"""[s] that are kept, at least."""


class ForceImpulse:
    """
    The integral of a force from spans of known mean.

    Between the nodes it is interpolated by a parabola, for a force that changes smoothly is
    not constant over a span; after the newest the force stays as it is.
    """

    def __init__(self) -> None:
        self._begin(0.0, 0.0)

    def _begin(self, time: float, value: float) -> None:
        self._times, self._values = [time], [value]
        self._slopes: list[float] = []  # of the spans
        self._bends: list[float] = []  # of the parabolas

    @property
    def end(self) -> float:
        """Return the newest time that is known [s]."""
        return self._times[-1]

    def add(self, spans: Sequence[float], forces: Sequence[float]) -> None:
        """Take the lengths of the next spans [s] and the mean force over each."""
        for span, force in zip(spans, forces):
            time = self._times[-1] + span
            if time > self._times[-1]:
                self._append(time, self._values[-1] + span * force)
        times = self._times
        if times[-1] - times[0] > 2.0 * KEPT:
            cut = bisect_right(times, times[-1] - KEPT)
            for nodes in (times, self._values, self._slopes, self._bends):
                del nodes[:cut]
            if len(times) > 2:  # there is nothing any more before the first span
                self._bends[0] = (self._slopes[1] - self._slopes[0]) / (times[2] - times[0])

    def _append(self, time: float, value: float) -> None:
        times, values, slopes, bends = self._times, self._values, self._slopes, self._bends
        slope = (value - values[-1]) / (time - times[-1])
        bend = 0.0
        if slopes:
            # the parabola of a span is the mean of those through three nodes on either side
            bend = (slope - slopes[-1]) / (time - times[-2])
            bends[-1] = 0.5 * (bends[-1] + bend) if len(slopes) > 1 else bend
        times.append(time)
        values.append(value)
        slopes.append(slope)
        bends.append(bend)

    def _restart(self, times: Sequence[float], values: Sequence[float]) -> None:
        """Take nodes anew."""
        self._begin(times[0], values[0])
        for time, value in zip(times[1:], values[1:]):
            self._append(time, value)

    def at(self, time: float) -> float:
        """Return the impulse up to ``time`` [s]."""
        times = self._times
        last = len(times) - 1
        if last == 0:
            return 0.0
        i = bisect_right(times, time) - 1
        if i < 0:
            i = 0
        elif i >= last:
            i = last - 1
        a, b = times[i], times[i + 1]
        past = time - a
        line = self._values[i] + self._slopes[i] * past
        return line + self._bends[i] * past * (time - b) if a <= time <= b else line

    def state(self) -> list[list[float]]:
        """Return all that is needed to go on from here."""
        return [list(self._times), list(self._values)]

    def restore(self, state: Sequence[Sequence[float]]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        times, values = ([float(x) for x in column] for column in state)
        if not len(times) == len(values) > 0 or sorted(set(times)) != times or not all(
                map(math.isfinite, (*times, *values))):
            raise ValueError('the impulse do not fit')
        self._restart(times, values)


POSITION, VELOCITY, ALPHA, BETA, GAMMA, DELTA, DELAY = range(7)

LEAST_SHIFT = 1e-6
"""[s] Least shift that a slope of the force is told from."""

NO_DEVIATION: Seven = (0.0,) * 7
"""No deviation."""

LARGEST_SPEED = 1e4
"""Typical velocities beyond which the state means nothing."""

Bounds = Sequence[tuple[int, float, float]]
"""Index, lowest and highest value of what is bounded."""


class DivergenceError(ArithmeticError):
    """The state of a filter means nothing any more."""


class LinearisedFilter:
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
    initial_velocity : float
        Velocity at ``estimate_initial_velocity``.

    """

    def __init__(self, nominal: Sequence[float], covariance: Packed) -> None:
        self.nominal = list(nominal)
        self.deviation = NO_DEVIATION
        self.covariance = covariance
        self._cross: Seven | None = None
        self.initial_velocity = 0.0

    def variance(self, i: int) -> float:
        """Return the variance of state ``i``."""
        return self.covariance[DIAGONAL[i]]

    def deviate(self, initial: Sequence[float]) -> None:
        """Let the estimate of parameters and delay be ``initial``, wherever it is linearised."""
        a, b, c, d, e = (p - n for p, n in zip(initial, self.nominal[ALPHA:]))
        self.deviation = (*self.deviation[:2], a, b, c, d, e)

    def set_motion(self, velocity: float, variance: tuple[float, float]) -> None:
        """Take position 0 and a velocity with their variances; the parameters stay."""
        self.covariance = with_motion(self.covariance, variance)
        self.nominal[:2] = 0.0, velocity
        self.deviation = (0.0, 0.0, *self.deviation[2:])

    def estimate_initial_velocity(self) -> None:
        """Estimate the present velocity from all that follows, as ``initial_velocity``."""
        self.initial_velocity = self.nominal[VELOCITY]
        self._cross = row(self.covariance, VELOCITY)

    def predict(self, impulse: ForceImpulse, start: float, end: float, noise: float) -> None:
        """
        Move from ``start`` to ``end`` [s].

        Parameters
        ----------
        impulse : ForceImpulse
            Of the force.
        start, end : float
            [s]
        noise : float
            Spectral density of the acceleration that the model does not know.

        """
        h = end - start
        x, v, alpha, beta, gamma, delta, delay = self.nominal
        at = impulse.at
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
        if not abs(v) < LARGEST_SPEED:
            raise DivergenceError(f'a speed of {v}')
        # held commands are a staircase: its slope inside a step says nothing of the delay
        top = min(end + h, impulse.end + delay)
        later = (at(top - delay) - at(top - h - delay)) - (begin - at(start - h - delay))
        shift = top - start
        # where the newest command came that late there is nothing to tell a slope from
        slope = later / (h * shift) if abs(shift) > LEAST_SHIFT else 0.0
        decay = h * (2.0 * beta * size + gamma)
        transition = Transition(
            h * (1.0 + 0.5 * decay), 0.5 * h * h, 1.0 + decay * (1.0 + 0.5 * decay),
            (force, w * size, w, -alpha * slope))
        if self.deviation is not NO_DEVIATION:
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
            self.initial_velocity += share * normalised
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
        self.deviation = NO_DEVIATION
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
