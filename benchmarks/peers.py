"""Other packages' filters on the same trials, as a competent user would set them up."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
import sys
from time import perf_counter

import numpy as np
from rovid_core.dofs import Four
from rovid_core.identifier import Scales, Step
from rovid_core.rls import CORNER

from benchmarks.online_cases import Trial
from benchmarks.trials import Array, NOISE

GATE = 5.0


@dataclass(frozen=True)
class Peer:
    """What a peer finds, and its time per step [s]."""

    parameters: Four
    seconds: float


def installed() -> bool:
    """Tell whether the peers are there; say how to get them if not."""
    try:
        import filterpy.kalman
        import padasip  # noqa: F401
    except ImportError:
        print('peers left out: python -m pip install -r benchmarks/requirements.txt',
              file=sys.stderr)
        return False
    return bool(filterpy.kalman)


def filterpy_ekf(trial: Trial, scales: Scales) -> Peer:
    """
    Run filterpy's extended Kalman filter on x, v, alpha, beta, gamma, delta.

    R is that of the fixes; Q lets the velocity err by 0.1 mm/s in a step, the parameters not
    at all; fixes beyond 5 standard deviations are left out. The parameters are known to about
    their own size and kept physical.
    """
    from filterpy.kalman import ExtendedKalmanFilter
    filter = ExtendedKalmanFilter(dim_x=6, dim_z=1)
    alpha, beta, gamma, _ = scales.initial
    std = (NOISE, 0.1, alpha, beta, gamma, 0.1 * alpha * scales.force)
    filter.x = np.array([trial.fixes[0], 0.0, *scales.initial])
    filter.P = np.diag(np.square(std))
    filter.R = np.array([[NOISE**2]])
    filter.Q = np.diag([0.0, 1e-8, 0.0, 0.0, 0.0, 0.0])
    h = np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    dt = np.diff(trial.time)
    force = np.diff(trial.impulse(trial.time)) / dt
    began = perf_counter()
    for span, thrust, fix in zip(dt.tolist(), force.tolist(), trial.fixes[1:].tolist()):
        filter.F = _jacobian(filter.x, thrust, span)
        moved = _moved(filter.x, thrust, span)
        filter.predict()
        filter.x = moved
        if (fix - moved[0])**2 > GATE**2 * (filter.P[0, 0] + NOISE**2):
            continue
        filter.update(np.array([fix]), lambda _: h, lambda x: x[:1])
        filter.x[2] = max(filter.x[2], 0.01 * alpha)
        filter.x[3:5] = np.minimum(filter.x[3:5], 0.0)  # drags do not push
    return Peer(tuple(filter.x[2:].tolist()), (perf_counter() - began) / len(dt))


def _moved(x: Array, force: float, h: float) -> Array:
    """Return the state a step on, by Runge-Kutta."""
    position, v, alpha, beta, gamma, delta = x.tolist()

    def rate(v: float) -> float:
        return float(alpha * force + (beta * abs(v) + gamma) * v + delta)

    k1 = rate(v)
    k2 = rate(v + 0.5 * h * k1)
    k3 = rate(v + 0.5 * h * k2)
    k4 = rate(v + h * k3)
    return np.array([position + h * v + h * h / 6 * (k1 + k2 + k3),
                     v + h / 6 * (k1 + 2 * (k2 + k3) + k4), alpha, beta, gamma, delta])


def _jacobian(x: Array, force: float, h: float) -> Array:
    v = x[1] + 0.5 * h * (x[2] * force + (x[3] * abs(x[1]) + x[4]) * x[1] + x[5])
    decay = h * (2.0 * x[3] * abs(v) + x[4])
    share = h * (1.0 + 0.5 * decay)
    phi = np.array([force, v * abs(v), v, 1.0])
    matrix = np.eye(6)
    matrix[0, 1], matrix[0, 2:] = share, 0.5 * h * h * phi
    matrix[1, 1], matrix[1, 2:] = 1.0 + decay * (1.0 + 0.5 * decay), share * phi
    return matrix


def padasip_rls(trial: Trial, scales: Scales) -> Peer:
    """
    Run padasip's recursive least squares on filtered regressors.

    Thrust and velocity come from the same low-pass, as the pipe gives them; both sides then
    go through 1 / (s + c)^2, so that there is no acceleration. Nothing is forgotten.
    """
    from padasip.filters import FilterRLS
    unit = np.array([x / scales.velocity for x in (
        scales.force, scales.velocity**2, scales.velocity, 1.0)])
    filter = FilterRLS(4, mu=1.0, eps=0.01, w=np.array(scales.initial) * unit)
    steps = [piece for piece in trial.pieces() if isinstance(piece, Step)]
    s, z, psi, chi, age = 0.0, 0.0, np.zeros(4), np.zeros(4), 0.0
    began = perf_counter()
    for step in steps:
        before, middle, after = (v / scales.velocity for v in step.velocity)
        keep = exp(-CORNER * step.dt)
        phi = np.array([step.force[1] / scales.force, middle * abs(middle), middle, 1.0])
        s = keep * (s + after - before)
        z = keep * z + step.dt * s
        psi = keep * (psi + step.dt * phi)
        chi = keep * chi + step.dt * psi
        age += step.dt
        if age > 5.0 / CORNER:
            filter.adapt(z, chi)
    parameters = filter.w / unit
    return Peer(tuple(parameters.tolist()), (perf_counter() - began) / len(steps))


PEERS = {'filterpy ExtendedKalmanFilter': filterpy_ekf, 'padasip FilterRLS': padasip_rls}
