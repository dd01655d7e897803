"""
The plant of Smallwood & Whitcomb (2003), eq. 2 and 3: its parameters, and how it moves.

physical  m v' + d_Q v|v| + d_L v + b = tau
lumped    v' = alpha tau + beta v|v| + gamma v + delta

``advance`` makes one step, ``trajectory`` all of a trial. Newton's method solves these at once:
with ``v[k + 1] = F_k(v[k])`` the corrections of v follow a linear recurrence with the slopes of
F, so that hours of log take milliseconds. ``midpoint_steps`` moves many vehicles side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import repeat
import math

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.dofs import Four, NAN4

Array = NDArray[np.float64]

MAX_PIECES = 1000
"""A step that needs more pieces, because the drag is very fast, is made by backward Euler."""

BLOCK_LENGTH = 32
"""Steps of a recurrence that are computed one after another; the blocks run side by side."""

TOLERANCE = 1e-13
"""Largest correction of the last Newton iteration, relative to the largest velocity."""

MAX_ITERATIONS = 30

MAX_PIECES_AT_ONCE = 20
"""A segment that needs more pieces, because the drag is too fast, is computed by ``advance``."""

MAX_VELOCITY = 1e6
"""A model that exceeds this velocity is unstable and has no velocity from there on."""


def lumped(mass: float, quadratic_drag: float, linear_drag: float, bias: float) -> Four:
    """Return alpha, beta, gamma, delta (Table II of the paper); ``mass`` above 0 [kg]."""
    return (1.0 / mass, -quadratic_drag / mass, -linear_drag / mass, -bias / mass)


def physical(parameters: Sequence[float]) -> Four:
    """
    Return mass, quadratic drag, linear drag and bias of lumped parameters.

    The mass is the effective one, added mass included. All are NaN unless alpha > 0.
    """
    alpha, beta, gamma, delta = parameters
    if not alpha > 0.0:
        return NAN4
    return (1.0 / alpha, -beta / alpha, -gamma / alpha, -delta / alpha)


def advance(parameters: Sequence[float], velocity: float, force: float, dt: float,
            reverse_drag: float = 0.0) -> float:
    """
    Return the velocity after ``dt`` [s] of constant force.

    Classical Runge-Kutta, with the step divided until the drag's time constant is well
    resolved, so that any finite parameters with beta, gamma <= 0 give a bounded answer.
    ``reverse_drag`` comes to beta while the velocity is below 0 as the step begins.
    """
    alpha, beta, gamma, delta = parameters
    if velocity < 0.0 and reverse_drag:
        beta = min(beta + reverse_drag, 0.0)
    u = alpha * force + delta
    # drag is fastest at the highest speed: the present one, or the one that the thrust leads to
    fastest = abs(velocity) + min(abs(u) * dt, math.sqrt(abs(u / beta)) if beta else math.inf)
    stiffness = (2.0 * abs(beta) * fastest + abs(gamma)) * dt
    if not stiffness < MAX_PIECES:
        return _backward_euler(u, beta, gamma, velocity, dt)
    pieces = int(stiffness) + 1
    h = dt / pieces
    v = velocity
    for _ in range(pieces):
        k1 = u + beta * v * abs(v) + gamma * v
        w = v + 0.5 * h * k1
        k2 = u + beta * w * abs(w) + gamma * w
        w = v + 0.5 * h * k2
        k3 = u + beta * w * abs(w) + gamma * w
        w = v + h * k3
        k4 = u + beta * w * abs(w) + gamma * w
        v += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return v


def runge_kutta(rates: Callable[[Sequence[float]], list[float]], velocities: Sequence[float],
                dt: float) -> list[float]:
    """Return coupled velocities after one step of ``dt`` [s] with accelerations ``rates``."""
    k1 = rates(velocities)
    k2 = rates([v + 0.5 * dt * k for v, k in zip(velocities, k1)])
    k3 = rates([v + 0.5 * dt * k for v, k in zip(velocities, k2)])
    k4 = rates([v + dt * k for v, k in zip(velocities, k3)])
    return [v + dt / 6.0 * (a + 2.0 * (b + c) + d)
            for v, a, b, c, d in zip(velocities, k1, k2, k3, k4)]


def _backward_euler(u: float, beta: float, gamma: float, velocity: float, dt: float) -> float:
    """Return the end of a step on which the drag settles at once, in closed form."""
    target = velocity + dt * u
    linear, quadratic = 1.0 - dt * gamma, -dt * beta
    # linear w + quadratic w^2 = |target|, in the form without cancellation
    root = math.sqrt(linear * linear + 4.0 * quadratic * abs(target))
    return 2.0 * target / (linear + root)


def trajectory(parameters: Sequence[float] | Array, start: float, dt: Array, force: Array,
               reverse_drag: float = 0.0, slowing: Array | None = None) -> Array:
    """
    Return the velocity at the start and after each segment of constant force.

    Parameters
    ----------
    parameters : sequence of 4 floats
        alpha, beta, gamma, delta.
    start : float
        Velocity at the start [m/s or rad/s].
    dt, force : ndarray, shape (n,)
        Length [s] and mean force [N or N m] of each segment.
    reverse_drag : float
        What comes to beta where the velocity is below 0; the sum counts up to 0.
    slowing : ndarray, shape (n,), optional
        What is taken from gamma in each segment, 0 or more.

    Returns
    -------
    velocity : ndarray, shape (n + 1,)
        [m/s or rad/s]; infinite after a model with the wrong sign of drag has run away.

    """
    alpha, beta, gamma, delta = map(float, parameters)
    drive = alpha * force + delta
    linear = np.full(len(dt), gamma) if slowing is None else gamma - slowing
    largest = float(np.abs(drive).max(initial=0.0))
    least, most = sorted((-beta, max(-beta - reverse_drag, 0.0)))
    # at this speed drag exceeds all thrust (Appendix of the paper)
    fastest = max(abs(start), math.sqrt(largest / most)) if most > 0.0 else 0.0
    with np.errstate(all='ignore'):
        pieces = (2.0 * most * fastest + np.abs(linear)) * dt + 1.0
        if min(least, -gamma) >= 0.0 and pieces.max(initial=1.0) < MAX_PIECES_AT_ONCE:
            number = pieces.astype(int)
            h, u = np.repeat(dt / number, number), np.repeat(drive, number)
            g = np.repeat(linear, number)
            found, converged = _newton(
                lambda v: _runge_kutta(drag_at(v, beta, reverse_drag), g, v, h, u), start,
                len(h))
            if converged:
                return np.asarray(found[np.concatenate([[0], np.cumsum(number)])])
    return _step_by_step((alpha, beta, delta), linear, start, dt, force, reverse_drag)


def midpoint_trajectory(parameters: Array, start: float, dt: Array, force: Array,
                        reverse_drag: float = 0.0) -> Array:
    """
    Return the trajectory by the implicit midpoint rule, one step per segment.

    It is quick and stable for drag of any size, as a search for parameters needs it, and of
    second order. Parameters and result are those of ``trajectory``, with beta, gamma <= 0.
    """
    _, beta, gamma, delta = parameters
    drive = parameters[0] * force + delta

    def step(v: Array) -> tuple[Array, Array]:
        w = mean_velocity(v, 0.5 * dt, drive, beta, gamma, reverse_drag)
        half = _half_slope(parameters, w, dt, reverse_drag)
        return 2.0 * w - v, (1.0 + half) / (1.0 - half)

    return _newton(step, start, len(dt))[0]


def midpoint_steps(parameters: Array, start: Array, dt: Iterable[float | Array],
                   force: Iterable[float | Array],
                   others: Iterable[Sequence[Array] | Array] = repeat(()),
                   reverse_drag: Array | float = 0.0) -> Iterator[tuple[Array, Array]]:
    """
    Step many vehicles side by side by the implicit midpoint rule.

    Parameters
    ----------
    parameters : ndarray, shape (4 + k, ...)
        alpha, beta <= 0, gamma <= 0, delta and k couplings of each vehicle.
    start : ndarray, shape (...)
        Velocities at the start [m/s or rad/s].
    dt, force : iterable
        Length [s] and mean force [N or N m] of each step; numbers, or arrays over vehicles.
    others : iterable, optional
        The k regressors of the couplings in each step, arrays over vehicles.
    reverse_drag : ndarray, shape (...), optional
        What comes to beta where the velocity is below 0.

    Yields
    ------
    mean, end : ndarray, shape (...)
        Velocities over each step and at its end.

    """
    alpha, beta, gamma, delta = parameters[:4]
    v = start
    for h, f, coupled in zip(dt, force, others):
        drive = alpha * f + delta
        for kappa, x in zip(parameters[4:], coupled):
            drive = drive + kappa * x
        mean = mean_velocity(v, 0.5 * h, drive, beta, gamma, reverse_drag)
        v = 2.0 * mean - v
        yield mean, v


def sensitivities(parameters: Array, velocity: Array, dt: Array, force: Array,
                  accelerations: Array | None = None, reverse_drag: float = 0.0) -> Array:
    """
    Return the derivatives of ``midpoint_trajectory``.

    Parameters
    ----------
    parameters, dt, force, reverse_drag
        As in ``midpoint_trajectory``.
    velocity : ndarray, shape (n + 1,)
        The trajectory.
    accelerations : ndarray, shape (k, n), optional
        What other parameters, in which the acceleration is linear, are multiplied by.

    Returns
    -------
    derivatives : ndarray, shape (n + 1, 5 + k)
        By alpha, beta, gamma, delta, the other parameters and the velocity at the start.

    """
    w = 0.5 * (velocity[:-1] + velocity[1:])
    half = _half_slope(parameters, w, dt, reverse_drag)
    others = [] if accelerations is None else [dt * x for x in accelerations]
    inputs = np.stack([
        dt * force, dt * w * np.abs(w), dt * w, dt, *others, np.zeros_like(dt)])
    inputs[-1, 0] = 1.0 + half[0]
    derivatives = np.zeros((len(dt) + 1, len(inputs)))
    derivatives[0, -1] = 1.0
    derivatives[1:] = linear_recurrence(
        (1.0 + half) / (1.0 - half), inputs / (1.0 - half)).T
    return derivatives


def integral(values: Array, dt: Array) -> Array:
    """Return the integral of values at the nodes, shape (n + 1, ...), from the start."""
    steps = (0.5 * (values[:-1] + values[1:]).T * dt).T
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(steps, axis=0)])


def mean_velocity(start: Array, half_step: Array | float, drive: Array,
                  beta: Array | float, gamma: Array | float,
                  reverse_drag: Array | float = 0.0) -> Array:
    """
    Return the mean velocities over one step each, by the implicit midpoint rule.

    ``w = v + h/2 (u + beta w|w| + gamma w)`` is a quadratic equation with one root of the right
    sign, so drag of any size is stable. The step ends at ``2 w - v``.

    Parameters
    ----------
    start : ndarray
        Velocities v at the start [m/s or rad/s], of any shape.
    half_step : float or ndarray
        Half the length h of the step [s].
    drive : ndarray
        u = alpha tau + delta [m/s^2 or rad/s^2].
    beta, gamma : float or ndarray
        Drag, not above 0.
    reverse_drag : float or ndarray
        What comes to beta where the mean velocity is below 0.

    """
    c, b = start + half_step * drive, 1.0 - half_step * gamma
    beta = drag_at(c, beta, reverse_drag)  # the mean has the sign of c
    return np.asarray(2.0 * c / (b + np.sqrt(b * b - 4.0 * half_step * beta * np.abs(c))))


def drag_at(velocity: Array, beta: Array | float, reverse_drag: Array | float) -> Array | float:
    """Return beta for velocities of some sign."""
    if isinstance(reverse_drag, float) and not reverse_drag:
        return beta
    return np.where(velocity < 0.0, np.minimum(beta + reverse_drag, 0.0), beta)


def linear_recurrence(factor: Array, added: Array) -> Array:
    """
    Return ``x[k] = factor[k] x[k - 1] + added[k]``, with 0 before the first.

    All blocks of a trial are solved side by side, as if each began at 0. Their true initial
    values follow a recurrence of the same kind over the ends of the blocks.

    Parameters
    ----------
    factor : ndarray, shape (n,)
        At most 1 in size for a bounded result.
    added : ndarray, shape (..., n)
        One or more series.

    Returns
    -------
    x : ndarray, shape (..., n)

    """
    series, count = added.shape[:-1], len(factor)
    blocks = -(-count // BLOCK_LENGTH)
    padded = np.zeros(blocks * BLOCK_LENGTH)
    padded[:count] = factor
    x = np.zeros((*series, blocks * BLOCK_LENGTH))
    x[..., :count] = added
    # the values of all blocks at one step are adjacent in memory
    gain = padded.reshape(blocks, BLOCK_LENGTH).T.copy()
    x = np.moveaxis(x.reshape(*series, blocks, BLOCK_LENGTH), -1, 0).copy()
    for k in range(1, BLOCK_LENGTH):
        x[k] += gain[k] * x[k - 1]
        gain[k] *= gain[k - 1]
    if blocks > 1:
        before = linear_recurrence(gain[-1], x[-1])[..., :-1]
        x[..., 1:] += gain.reshape(
            BLOCK_LENGTH, *[1] * len(series), blocks)[..., 1:] * before
    return np.moveaxis(x, 0, -1).reshape(*series, blocks * BLOCK_LENGTH)[..., :count]


def _half_slope(parameters: Array, w: Array, dt: Array, reverse_drag: float) -> Array:
    """Return half the step times the derivative of the acceleration at velocity ``w``."""
    beta = drag_at(w, parameters[1], reverse_drag)
    return np.asarray(0.5 * dt * (2.0 * beta * np.abs(w) + parameters[2]))


def _newton(step: Callable[[Array], tuple[Array, Array]], start: float,
            count: int) -> tuple[Array, bool]:
    """
    Return the velocities of so many steps, and whether Newton's method converged.

    ``step`` returns the velocities after all steps and their slopes by those before.
    """
    v = np.full(count + 1, start)
    for _ in range(MAX_ITERATIONS):
        after, slope = step(v[:-1])
        change = linear_recurrence(slope, after - v[1:])
        v[1:] += change
        largest = float(np.abs(change).max(initial=0.0))
        if largest <= TOLERANCE * max(float(np.abs(v).max()), 1e-3):
            return v, True
    return v, False


def _runge_kutta(beta: Array | float, gamma: Array, v: Array, dt: Array,
                 drive: Array) -> tuple[Array, Array]:
    """Return the velocities after one step from each of ``v``, and their slopes by it."""
    rate = slope = rates = slopes = np.zeros_like(v)
    for share, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
        w = v + share * dt * rate
        speed = beta * np.abs(w)
        slope = (2.0 * speed + gamma) * (1.0 + share * dt * slope)
        rate = drive + (speed + gamma) * w
        rates, slopes = rates + weight * rate, slopes + weight * slope
    return v + dt / 6.0 * rates, 1.0 + dt / 6.0 * slopes


def _step_by_step(parameters: tuple[float, float, float], gamma: Array, start: float, dt: Array,
                  force: Array, reverse_drag: float) -> Array:
    alpha, beta, delta = parameters
    velocity = np.full(len(dt) + 1, math.inf)
    velocity[0] = v = start
    for k, (h, f, linear) in enumerate(zip(dt.tolist(), force.tolist(), gamma.tolist()), 1):
        try:
            v = advance((alpha, beta, linear, delta), v, f, h, reverse_drag)
        except (ValueError, ArithmeticError):  # no finite speed: drag of the wrong sign
            break
        if not abs(v) < MAX_VELOCITY:
            break
        velocity[k] = v
    return velocity
