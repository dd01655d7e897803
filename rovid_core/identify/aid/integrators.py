"""One step of eq. 7 and 11 of the paper by Euler, Heun or Runge-Kutta, in plain floats."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from rovid_core.model.dofs import Three
from rovid_core.model.samples import Step

Five = tuple[float, float, float, float, float]
"""v_hat, alpha, beta, gamma, delta (or their rates)."""

Rates = Callable[[float, tuple[float, ...], Five, float, float], Five]
"""Feedback gain, Gamma, state, velocity and force to the right-hand sides of eq. 7 and 11."""


def rates(a: float, gamma: tuple[float, ...], state: Five, v: float, tau: float) -> Five:
    """Return the rates with the diagonal of Gamma, as in the paper."""
    v_hat, p0, p1, p2, p3 = state
    dv = v_hat - v
    drag = v_hat * abs(v_hat)
    return (
        a * dv + p0 * tau + p1 * drag + p2 * v_hat + p3,
        -gamma[0] * dv * tau, -gamma[1] * dv * drag, -gamma[2] * dv * v_hat, -gamma[3] * dv,
    )


def coupled_rates(a: float, gamma: tuple[float, ...], state: Five, v: float,
                  tau: float) -> Five:
    """Return the rates with the upper triangle of a symmetric Gamma, row by row."""
    v_hat, p0, p1, p2, p3 = state
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = gamma
    dv = v_hat - v
    drag = v_hat * abs(v_hat)
    return (
        a * dv + p0 * tau + p1 * drag + p2 * v_hat + p3,
        -dv * (g00 * tau + g01 * drag + g02 * v_hat + g03),
        -dv * (g01 * tau + g11 * drag + g12 * v_hat + g13),
        -dv * (g02 * tau + g12 * drag + g22 * v_hat + g23),
        -dv * (g03 * tau + g13 * drag + g23 * v_hat + g33),
    )


class Integrator(Protocol):
    """One step from a state to the next."""

    def __call__(self, a: float, gamma: tuple[float, ...], x: Five, step: Step,
                 f: Rates = rates) -> Five:
        """Return the state after ``step``."""


def _moved(x: Five, h: float, d: Five) -> Five:
    return (x[0] + h * d[0], x[1] + h * d[1], x[2] + h * d[2], x[3] + h * d[3],
            x[4] + h * d[4])


def _euler(a: float, gamma: tuple[float, ...], x: Five, step: Step, f: Rates = rates) -> Five:
    # the force of the middle, which the pipe makes the mean of the step: with the force of
    # the left end alone a part of the thrust is read as drag
    return _moved(x, step.dt, f(a, gamma, x, step.velocity[0], step.force[1]))


def _heun(a: float, gamma: tuple[float, ...], x: Five, step: Step, f: Rates = rates) -> Five:
    h = step.dt
    first = f(a, gamma, x, step.velocity[0], step.force[0])
    last = f(a, gamma, _moved(x, h, first), step.velocity[2], step.force[2])
    return _moved(_moved(x, 0.5 * h, first), 0.5 * h, last)


def _rk4(a: float, gamma: tuple[float, ...], x: Five, step: Step, f: Rates = rates) -> Five:
    h, v, tau = step.dt, step.velocity, step.force
    k1 = f(a, gamma, x, v[0], tau[0])
    k2 = f(a, gamma, _moved(x, 0.5 * h, k1), v[1], tau[1])
    k3 = f(a, gamma, _moved(x, 0.5 * h, k2), v[1], tau[1])
    k4 = f(a, gamma, _moved(x, h, k3), v[2], tau[2])
    x = _moved(_moved(x, h / 6.0, k1), h / 3.0, k2)
    return _moved(_moved(x, h / 3.0, k3), h / 6.0, k4)


INTEGRATORS: dict[str, Integrator] = {'euler': _euler, 'heun': _heun, 'rk4': _rk4}


def part(step: Step, k: int, pieces: int) -> Step:
    """Return piece ``k`` of a step, by the parabola through its three points."""

    def at(values: Three, x: float) -> float:
        start, middle, end = values
        return (start * (1.0 - x) * (1.0 - 2.0 * x) + 4.0 * middle * x * (1.0 - x)
                + end * x * (2.0 * x - 1.0))

    xs = (k / pieces, (k + 0.5) / pieces, (k + 1.0) / pieces)
    return Step(
        step.dt / pieces,
        (at(step.velocity, xs[0]), at(step.velocity, xs[1]), at(step.velocity, xs[2])),
        (at(step.force, xs[0]), at(step.force, xs[1]), at(step.force, xs[2])))
