"""The simulated cases whose figures are shown: the paper's eq. 13 vehicle and a surge trial."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import cos, pi, sin

from rovid_core.identify.aid.adaptive_identifier import AdaptiveIdentifier, Gains
from rovid_core.identify.estimate import Estimate
from rovid_core.model.dofs import Four
from rovid_core.model.plant import advance, lumped
from rovid_core.model.samples import Event, Sample, Step
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import (
    CurrentSettings,
    DofSettings,
    IdentifierSettings,
    InputSettings,
    Scales,
    Settings,
    SimulatedDof,
    SimulationSettings,
    ThrusterSettings,
)
from rovid_core.simulation.sensors import Measurement, simulate
from rovid_core.trials.score import Score

# eq. 13: 250 kg, quadratic drag 200, 100 N at 1/4 Hz
EXACT_TRUTH: Four = (1 / 250, -200 / 250, 0.0, 0.0)
EXACT_SCALES = Scales(100.0, 0.25, (1 / 400, -0.4, 0.0, 0.0), (True, True, False, False))
EXACT_GAINS = Gains.from_time(3.0, EXACT_SCALES)
OMEGA = 2 * pi / 4

SURGE_TRUTH = lumped(290.0, 290.0, 43.5, 2.9)
TRAINING = ((150.0, 1 / 18), (80.0, 1 / 7.3))
VALIDATION = ((120.0, 1 / 12), (60.0, 1 / 25))
# mass and drags off by 1.6 to 2, one way and the other
HEAVY = DofSettings(290 * 1.6, 290 / 1.8, 43.5 / 2)
LIGHT = DofSettings(290 / 1.6, 290 * 1.8, 43.5 * 2)


def exact_velocities(step: float, duration: float) -> list[float]:
    """Return the eq. 13 velocity at 0, h/2, h, ... by Runge-Kutta at h/40."""
    v, t, out, dt = 0.0, 0.0, [0.0], step / 40
    for _ in range(2 * round(duration / step)):
        for _ in range(20):
            k1 = _exact(v, t)
            k2 = _exact(v + dt / 2 * k1, t + dt / 2)
            k3 = _exact(v + dt / 2 * k2, t + dt / 2)
            k4 = _exact(v + dt * k3, t + dt)
            v += dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            t += dt
        out.append(v)
    return out


def _exact(v: float, t: float) -> float:
    alpha, beta, gamma, delta = EXACT_TRUTH
    return alpha * 100.0 * sin(OMEGA * t) + beta * v * abs(v) + gamma * v + delta


def exact_case(integrator: str, thrust: str, step: float = 0.01,
               duration: float = 60.0) -> tuple[list[float], float]:
    """
    Identify the eq. 13 vehicle from exact data.

    Parameters
    ----------
    integrator : str
        ``euler``, ``heun`` or ``rk4``.
    thrust : str
        ``stage`` (exact at each stage), ``mean`` (over the step) or ``left`` (textbook).
    step, duration : float
        [s]

    Returns
    -------
    errors : list of 2 floats
        Relative errors of alpha and beta at the end.
    growth : float
        Largest growth of W at any step, in W(0).

    """
    identifier = AdaptiveIdentifier(EXACT_SCALES, EXACT_GAINS, integrator)
    v = exact_velocities(step, duration)
    identifier.restart(v[0])
    start = w = identifier.lyapunov(v[0], EXACT_TRUTH)
    growth = -1.0
    for k in range(len(v) // 2):
        a, b = k * step, (k + 1) * step
        force = {
            'stage': (100 * sin(OMEGA * a), 100 * sin(OMEGA * (a + b) / 2), 100 * sin(OMEGA * b)),
            'mean': (100 * (cos(OMEGA * a) - cos(OMEGA * b)) / (OMEGA * step),) * 3,
            'left': (100 * sin(OMEGA * a),) * 3,
        }[thrust]
        assert not identifier.step(Step(step, (v[2 * k], v[2 * k + 1], v[2 * k + 2]), force))
        now = identifier.lyapunov(v[2 * k + 2], EXACT_TRUTH)
        growth, w = max(growth, (now - w) / start), now
    return [p / t - 1 for p, t in zip(identifier.parameters[:2], EXACT_TRUTH)], growth


def surge_settings(initial: DofSettings = HEAVY, **identifier: object) -> Settings:
    """Return a surge-only vehicle with 10 Hz fixes of 5 mm and otherwise default settings."""
    none = (0.0,)
    return Settings(
        dofs=('surge',), dof={'surge': initial},
        thrusters=ThrusterSettings(
            topics=('/thrusters',), gain=(40.0,),
            allocation=((1.0,), none, none, none, none, none)),
        position=InputSettings('/position'), attitude=InputSettings('/attitude'),
        identifier=replace(IdentifierSettings(), **identifier),  # type: ignore[arg-type]
        current=CurrentSettings(prior=0.0),  # it never turns
        simulation=SimulationSettings(dofs={'surge': SimulatedDof(
            290.0, 290.0, 43.5, 2.9, *map(tuple, zip(*TRAINING)))}))


def run(stream: Stream, measurements: Iterable[Measurement]) -> list[Estimate]:
    """Feed measurements one by one and return every estimate."""
    estimates = []
    for time, name, value in measurements:
        estimates += stream.receive(Event(time, (Sample(name, value),)))
    return estimates + stream.finish()


def surge_log(seed: int, duration: float = 300.0) -> list[Measurement]:
    """Return what the sensors of the surge case measure."""
    return list(simulate(surge_settings(), duration, seed))


def prediction(parameters: Sequence[float], waves: Sequence[tuple[float, float]] = VALIDATION,
               duration: float = 300.0) -> Score:
    """Return the score of a surge model on a thrust profile, from rest, against the truth."""
    true, model, dt = [0.0], [0.0], 0.02
    for k in range(round(duration / dt)):
        t = (k + 0.5) * dt
        force = sum(f * sin(2 * pi * hz * t) for f, hz in waves)
        true.append(advance(SURGE_TRUTH, true[-1], force, dt))
        model.append(advance(parameters, model[-1], force, dt))
    return Score.of(model, true)
