"""
One step of eq. 7 and 11 with a full Gamma, written out.

To rounding it is what ``integrators`` give with ``coupled_rates``. Written out, and with the
force of a step constant, Heun takes one product of Gamma and phi instead of three.
"""

from __future__ import annotations

from collections.abc import Callable

from rovid_core.model.dofs import Four
from rovid_core.model.samples import Step

Moved = tuple[float, Four] | None
"""v_hat and theta_hat after a step; None where it has to be divided, or leaves the bounds."""

Bounds = tuple[Four, Four]


def euler(a: float, gamma: tuple[float, ...], v: float, theta: Four, step: Step,
          bounds: Bounds) -> Moved:
    """
    Return v_hat and theta_hat after a step.

    Parameters
    ----------
    a : float
        Feedback gain [1/s].
    gamma : tuple of 10 floats
        Upper triangle of Gamma, by rows.
    v : float
        v_hat [m/s or rad/s].
    theta : tuple of 4 floats
        theta_hat.
    step : Step
        What was measured.
    bounds : tuple of 2 tuples
        Lowest and highest parameters.

    """
    h, tau, dv = step.dt, step.force[1], v - step.velocity[0]
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = gamma
    p0, p1, p2, p3 = theta
    size = abs(v)
    drag = v * size
    # Gamma phi, phi = [tau, drag, v, 1]
    q0 = g00 * tau + g01 * drag + g02 * v + g03
    q1 = g01 * tau + g11 * drag + g12 * v + g13
    q2 = g02 * tau + g12 * drag + g22 * v + g23
    q3 = g03 * tau + g13 * drag + g23 * v + g33
    if not (h * (q0 * tau + q1 * drag + q2 * v + q3) < -0.5 * a
            and h * (-a - 2.0 * p1 * size - p2) < 1.0):  # p1 and p2 are drag: not above 0
        return None
    e = h * dv
    v += h * (a * dv + p0 * tau + p1 * drag + p2 * v + p3)
    p0 -= e * q0
    p1 -= e * q1
    p2 -= e * q2
    p3 -= e * q3
    (l0, l1, l2, l3), (h0, h1, h2, h3) = bounds
    if l0 <= p0 <= h0 and l1 <= p1 <= h1 and l2 <= p2 <= h2 and l3 <= p3 <= h3 and v - v == 0.0:
        return v, (p0, p1, p2, p3)
    return None


def heun(a: float, gamma: tuple[float, ...], v: float, theta: Four, step: Step,
         bounds: Bounds) -> Moved:
    """Return v_hat and theta_hat after a step of constant force; as ``euler``."""
    h, (start, _, end), (tau, _, last) = step[:3]
    g00, g01, g02, g03, g11, g12, g13, g22, g23, g33 = gamma
    p0, p1, p2, p3 = theta
    size = abs(v)
    drag = v * size
    q0 = g00 * tau + g01 * drag + g02 * v + g03
    q1 = g01 * tau + g11 * drag + g12 * v + g13
    q2 = g02 * tau + g12 * drag + g22 * v + g23
    q3 = g03 * tau + g13 * drag + g23 * v + g33
    # what does not change within the step, of theta . phi and of phi' Gamma phi
    push, gain = p0 * tau + p3, q0 * tau + q3
    if not (tau == last and h * (gain + q1 * drag + q2 * v) < -0.5 * a
            and h * (-a - 2.0 * p1 * size - p2) < 1.0):
        return None
    dv = v - start
    rate = a * dv + push + p1 * drag + p2 * v
    # the end of a step of Euler, and the rate there with the parameters there
    w = v + h * rate
    drag_w = w * abs(w)
    dw = w - end
    rate_w = (a * dw + push + p1 * drag_w + p2 * w
              - h * dv * (gain + q1 * drag_w + q2 * w))
    # Gamma phi there is q and Gamma times what phi has changed by
    half = 0.5 * h
    e, f = half * (dv + dw), half * dw
    b, c = f * (drag_w - drag), f * (w - v)
    v += half * (rate + rate_w)
    p0 -= e * q0 + b * g01 + c * g02
    p1 -= e * q1 + b * g11 + c * g12
    p2 -= e * q2 + b * g12 + c * g22
    p3 -= e * q3 + b * g13 + c * g23
    (l0, l1, l2, l3), (h0, h1, h2, h3) = bounds
    if l0 <= p0 <= h0 and l1 <= p1 <= h1 and l2 <= p2 <= h2 and l3 <= p3 <= h3 and v - v == 0.0:
        return v, (p0, p1, p2, p3)
    return None


def general(a: float, gamma: tuple[float, ...], v: float, theta: Four, step: Step,
            bounds: Bounds) -> Moved:
    """Leave a step to ``integrators``."""
    return None


Unrolled = Callable[[float, tuple[float, ...], float, Four, Step, Bounds], Moved]
UNROLLED: dict[str, Unrolled] = {'euler': euler, 'heun': heun}
