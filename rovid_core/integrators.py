"""One step of eq. 7 and 11 of the paper by Euler, Heun or Runge-Kutta, in plain floats."""

from __future__ import annotations

from collections.abc import Callable

from rovid_core.dofs import Four
from rovid_core.identifier import Step

Five = tuple[float, float, float, float, float]
"""v_hat, alpha, beta, gamma, delta (or their rates)."""

Integrator = Callable[[float, Four, Five, Step], Five]
"""Feedback gain, diagonal of Gamma, state and step to the state after it."""


def _rates(a: float, gamma: Four, state: Five, v: float, tau: float) -> Five:
    """Return the right-hand sides of eq. 7 and 11."""
    v_hat, p0, p1, p2, p3 = state
    dv = v_hat - v
    drag = v_hat * abs(v_hat)
    return (
        a * dv + p0 * tau + p1 * drag + p2 * v_hat + p3,
        -gamma[0] * dv * tau, -gamma[1] * dv * drag, -gamma[2] * dv * v_hat, -gamma[3] * dv,
    )


def _moved(x: Five, h: float, d: Five) -> Five:
    return (x[0] + h * d[0], x[1] + h * d[1], x[2] + h * d[2], x[3] + h * d[3],
            x[4] + h * d[4])


def _euler(a: float, gamma: Four, x: Five, step: Step) -> Five:
    # the force of the middle, which the pipe makes the mean of the step: with the force of
    # the left end alone a part of the thrust is read as drag
    return _moved(x, step.dt, _rates(a, gamma, x, step.velocity[0], step.force[1]))


def _heun(a: float, gamma: Four, x: Five, step: Step) -> Five:
    h = step.dt
    first = _rates(a, gamma, x, step.velocity[0], step.force[0])
    last = _rates(a, gamma, _moved(x, h, first), step.velocity[2], step.force[2])
    return _moved(_moved(x, 0.5 * h, first), 0.5 * h, last)


def _rk4(a: float, gamma: Four, x: Five, step: Step) -> Five:
    h, v, tau = step.dt, step.velocity, step.force
    k1 = _rates(a, gamma, x, v[0], tau[0])
    k2 = _rates(a, gamma, _moved(x, 0.5 * h, k1), v[1], tau[1])
    k3 = _rates(a, gamma, _moved(x, 0.5 * h, k2), v[1], tau[1])
    k4 = _rates(a, gamma, _moved(x, h, k3), v[2], tau[2])
    x = _moved(_moved(x, h / 6.0, k1), h / 3.0, k2)
    return _moved(_moved(x, h / 3.0, k3), h / 6.0, k4)


INTEGRATORS: dict[str, Integrator] = {'euler': _euler, 'heun': _heun, 'rk4': _rk4}
