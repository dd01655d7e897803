"""Other packages' filters on the same trials, as a competent user would set them up."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf
import sys
from time import process_time
from typing import Any

import numpy as np
from rovid_core.model.dofs import Four
from rovid_core.model.samples import Step
from rovid_core.settings.run import Scales

from test.support.online_runs import identifier, METHODS
from test.support.online_trials import Case, follow, prediction_error, Trial, trial
from test.support.surge import HEAVY, SURGE_TRUTH
from test.support.trials import Array, NOISE

GATE = 5.0
CORNER = 3.0  # [rad/s] of the filter on the regressors of least squares


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
    began = process_time()
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
    return Peer(tuple(filter.x[2:].tolist()), (process_time() - began) / len(dt))


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
    began = process_time()
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
    return Peer(tuple(parameters.tolist()), (process_time() - began) / len(steps))


def filterpy_ekf7(trial: Trial) -> float:
    """
    Return the time per step [s] of filterpy's filter with the states that ``ekf`` has.

    That is, with the delay of the thrust as the seventh. The prediction is of the same kind:
    Runge-Kutta, with a force that is a straight line over the step. It is given force and
    slope; ``ekf`` looks them up at the delay that it has found. Outliers are left out, and
    nothing is learned of the noise.
    """
    filter, fixes = _seven(trial)
    dt = np.diff(trial.time)
    impulse = trial.impulse(trial.time)
    force = np.diff(impulse) / dt
    middle = trial.impulse(0.5 * (trial.time[1:] + trial.time[:-1]))
    rise = 2.0 * (impulse[:-1] + impulse[1:] - 2.0 * middle) / dt
    began = process_time()
    for span, thrust, half, fix in zip(
            dt.tolist(), force.tolist(), rise.tolist(), fixes[1:]):
        transition = filter.F
        transition[:2] = _rows(filter.x, thrust, half, span)
        moved = _moved7(filter.x, thrust, half, span)
        filter.predict()
        filter.x = moved
        if (fix[0] - moved[0])**2 > GATE**2 * (filter.P[0, 0] + NOISE**2):
            continue
        filter.update(fix, _position_row, _position)
        filter.x[2] = max(filter.x[2], 1e-5)
        filter.x[3:5] = np.minimum(filter.x[3:5], 0.0)  # drags do not push
    return (process_time() - began) / len(dt)


def filterpy_update(trial: Trial) -> float:
    """Return the time [s] of the measurement update alone, with 7 states."""
    filter, fixes = _seven(trial)
    began = process_time()
    for fix in fixes:
        filter.update(fix, _position_row, _position)
    return (process_time() - began) / len(fixes)


def padasip_adapt(trial: Trial) -> float:
    """Return the time [s] of padasip's step alone, with regressors that are there already."""
    from padasip.filters import FilterRLS
    filter = FilterRLS(4, mu=1.0, eps=0.01)
    steps = [piece for piece in trial.pieces() if isinstance(piece, Step)]
    regressors = [np.array([step.force[1] / 100.0, v * abs(v), v, 1.0])
                  for step in steps for v in step.velocity[1:2]]
    change = [(step.velocity[2] - step.velocity[0]) / step.dt for step in steps]
    began = process_time()
    for value, regressor in zip(change, regressors):
        filter.adapt(value, regressor)
    return (process_time() - began) / len(steps)


def _seven(trial: Trial) -> tuple[Any, list[Array]]:
    """Return a filter at its initial values, and the fixes."""
    from filterpy.kalman import ExtendedKalmanFilter
    filter = ExtendedKalmanFilter(dim_x=7, dim_z=1)
    filter.x = np.array([trial.fixes[0], 0.0, 1.0 / 290.0, -1.0, -0.1, 0.0, 0.0])
    filter.P = np.diag(np.square([NOISE, 0.1, 1.0 / 290.0, 1.0, 0.1, 0.1, 0.05]))
    filter.R = np.array([[NOISE**2]])
    filter.Q = np.diag([0.0, 1e-8, 0.0, 0.0, 0.0, 0.0, 0.0])
    return filter, list(trial.fixes[:, None])


_ROW = np.eye(1, 7)


def _position_row(_: Array) -> Array:
    return _ROW


def _position(x: Array) -> Array:
    return x[:1]


def _moved7(x: Array, force: float, half: float, h: float) -> Array:
    """Return the state a step on, by Runge-Kutta; the force rises by twice ``half``."""
    position, v, alpha, beta, gamma, delta, delay = x.tolist()
    u, du = alpha * force + delta, alpha * half
    k1 = u - du + (beta * abs(v) + gamma) * v
    w = v + 0.5 * h * k1
    k2 = u + (beta * abs(w) + gamma) * w
    w = v + 0.5 * h * k2
    k3 = u + (beta * abs(w) + gamma) * w
    w = v + h * k3
    k4 = u + du + (beta * abs(w) + gamma) * w
    return np.array([position + h * v + h * h / 6 * (k1 + k2 + k3),
                     v + h / 6 * (k1 + 2 * (k2 + k3) + k4), alpha, beta, gamma, delta, delay])


def _rows(x: Array, force: float, half: float, h: float) -> tuple[tuple[float, ...], ...]:
    """Return the derivatives of position and velocity a step on."""
    _, v, alpha, beta, gamma, delta, _ = x.tolist()
    v += 0.5 * h * (alpha * force + (beta * abs(v) + gamma) * v + delta)
    decay = h * (2.0 * beta * abs(v) + gamma)
    share, bent = h * (1.0 + 0.5 * decay), 0.5 * h * h
    phi = (force, v * abs(v), v, 1.0, -2.0 * alpha * half / h)
    return ((1.0, share, *[bent * y for y in phi]),
            (0.0, 1.0 + decay * (1.0 + 0.5 * decay), *[share * y for y in phi]))


PEERS = {'filterpy ExtendedKalmanFilter': filterpy_ekf, 'padasip FilterRLS': padasip_rls}


def peer_errors(case: Case, seed: int) -> dict[str, list[float]]:
    """Return the model's error [m/s] and the parameters' relative ones of every method."""
    one = trial(case, seed)
    errors = {}
    for method in METHODS:
        found = follow(identifier(method), one.pieces())[0]
        errors[method] = _errors(found.parameters, found.delay, case)
    for name in PEERS:
        errors[name] = _errors(_of_peer(name, one), 0.0, case)
    return errors


def _of_peer(name: str, one: Trial) -> Four:
    try:
        return PEERS[name](one, Scales.of(HEAVY)).parameters
    except ValueError:  # its numbers are not finite any more
        return (inf,) * 4


def _errors(parameters: Four, delay: float, case: Case) -> list[float]:
    return [prediction_error(parameters, delay, case),
            *(p / true - 1.0 for p, true in zip(parameters, SURGE_TRUTH))]


def times(case: Case, seeds: int = 3) -> dict[str, float]:
    """Return the time per step [s] of every method, the best of some runs in turn."""
    best: dict[str, float] = {}
    for seed in range(seeds):
        one = trial(case, seed)
        first, *steps = one.pieces()
        for method in METHODS:
            new = identifier(method)
            new.restart(first)  # type: ignore[arg-type]
            began = process_time()
            for step in steps:
                assert isinstance(step, Step)
                new.step(step)
            best[method] = min(best.get(method, inf), (process_time() - began) / len(steps))
        for name, peer in PEERS.items():
            best[name] = min(best.get(name, inf), peer(one, Scales.of(HEAVY)).seconds)
    return best
