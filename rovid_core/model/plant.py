"""
The plant of Smallwood & Whitcomb (2003), eq. 2 and 3, and its two parameter forms.

physical  m v' + d_Q v|v| + d_L v + b = tau
lumped    v' = alpha tau + beta v|v| + gamma v + delta
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math

from rovid_core.model.dofs import Four, NAN4

MAX_PIECES = 1000
"""A step that needs more pieces, because the drag is very fast, is made by backward Euler."""


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
