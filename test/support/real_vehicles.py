"""
Vehicles that are not exactly the model, simulated independently of ``rovid_core.simulation``.

A small vehicle of 17.6 kg whose thrust commands are held for 50 ms, with fixes of 5 mm at
10 Hz. Each kind adds one thing that the model of a single degree of freedom does not know.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import copysign, inf, pi, tanh

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.dofs import Four
from rovid_core.model.lowpass import filtered
from rovid_core.model.plant import lumped
from rovid_core.model.samples import Step
from rovid_core.settings.run import DofSettings

Array = NDArray[np.float64]

MASS, QUADRATIC, LINEAR, BIAS = 17.6, 34.0, 11.0, 0.4
TRUTH: Four = lumped(MASS, QUADRATIC, LINEAR, BIAS)
GUESS = DofSettings(MASS * 1.5, QUADRATIC / 1.6, LINEAR / 1.5, typical_force=37.0,
                    typical_velocity=0.6)
FORCE = 37.0  # [N] of a full command
STEP, HELD, FIX, NOISE, CUTOFF = 0.01, 5, 10, 0.005, 0.6  # [s], [steps], [steps], [m], [Hz]


@dataclass(frozen=True)
class Vehicle:
    """
    A plant and how it is driven.

    Attributes
    ----------
    thrust : callable
        The real thrust of a command [N].
    disturbance : str
        What else accelerates it: '', ``unknown`` (a force of 1 N rms), ``coupled`` (v r of
        sway and yaw that follow commands of their own), ``zigzag`` (v r that follows this
        command), or ``tether``.
    reverse_drag, lag, turns, torque, closed_loop, change
        Factor of the drag in reverse, time constant of the thruster [s], whether that is one of
        its turns, whose square is the force, whether a torque drives these, so that they lag so
        about a full command, whether a controller follows a lawn-mower track, and the time [s]
        and factor of a change of the mass.
    fades : float
        [m/s] Speed at which a full command pushes no more; lower ones lose it sooner.
    runs_down : float
        [1/s] Share of the thrust at the beginning that is lost per time.
    smoothing : float
        [s] Time constant of each of two low-passes behind each other on what is measured.
    swings : float
        [rad/s] Natural frequency with which the force swings in, damped by a half of what
        would keep it from that; 0 for none.
    piloted : bool
        Whether it is driven by commands that are held for 1 to 6 s.
    size : float
        Of a command that only changes its sign [N]; 0 for one that has all sizes.

    """

    thrust: Callable[[float], float] = float
    disturbance: str = ''
    reverse_drag: float = 1.0
    lag: float = 0.0
    turns: bool = False
    torque: bool = False
    closed_loop: bool = False
    change: tuple[float, float] = (inf, 1.0)
    size: float = 0.0
    fades: float = inf
    runs_down: float = 0.0
    smoothing: float = 0.0
    swings: float = 0.0
    piloted: bool = False


def _offset_dead(force: float) -> float:
    return max(abs(force) - 3.0, 0.0) * (1.0 if force > 0.0 else -1.0)


def _reverse(force: float) -> float:
    return force if force > 0.0 else 0.8 * force


VEHICLES = {
    'exact': Vehicle(),
    'dead-band 3 N': Vehicle(_offset_dead),
    'reverse thrust x 0.8': Vehicle(_reverse),
    'reverse drag x 1.3': Vehicle(reverse_drag=1.3),
    'unknown force 1 N': Vehicle(disturbance='unknown'),
    'lag 0.15 s': Vehicle(lag=0.15),
    'turns lag 0.15 s': Vehicle(lag=0.15, turns=True),
    'turns lag 0.3 s': Vehicle(lag=0.3, turns=True),
    'turns lag 0.2 s, closed loop': Vehicle(lag=0.2, turns=True, closed_loop=True),
    'torque, lag 0.1 s, piloted': Vehicle(lag=0.1, torque=True, piloted=True),
    'torque, lag 0.2 s': Vehicle(lag=0.2, torque=True),
    'thrust that swings in at 6 rad/s, piloted': Vehicle(swings=6.0, piloted=True),
    'thrust that fades at 3 m/s': Vehicle(fades=3.0),
    'battery: thrust -15 % in 300 s': Vehicle(runs_down=0.15 / 300.0),
    'coupled': Vehicle(disturbance='coupled'),
    'zig-zag': Vehicle(disturbance='zigzag'),
    'tether 1 N': Vehicle(disturbance='tether'),
    'closed loop': Vehicle(closed_loop=True),
    'dead-band, 20 N or -20 N': Vehicle(_offset_dead, size=20.0),
    'dead-band, 5 N or -5 N': Vehicle(_offset_dead, size=5.0),
    'mass +20 % at 200 s': Vehicle(change=(200.0, 1.2)),
    'the same, unknown force': Vehicle(disturbance='unknown', change=(200.0, 1.2)),
}


def _sines(random: np.random.Generator, time: Array, low: float, high: float) -> Array:
    """Return a mean square of 1 in five sinusoids between two frequencies [Hz]."""
    hz = np.exp(random.uniform(np.log(low), np.log(high), 5))
    return np.asarray(np.sqrt(0.4) * np.sin(
        2 * pi * hz * time[:, None] + random.uniform(0.0, 2 * pi, 5)).sum(axis=1))


def _piloted(random: np.random.Generator, count: int) -> Array:
    """Return commands of a pilot who holds each for some seconds [N]."""
    held = random.uniform(1.0, 6.0, count)
    forces = 0.8 * FORCE * random.choice([-1.0, -0.5, -0.3, 0.0, 0.0, 0.5, 0.7, 1.0], count)
    return np.repeat(forces, (held / STEP).astype(int))[:count]


def drive(vehicle: Vehicle, seed: int, duration: float) -> tuple[Array, Array, Array]:
    """Return the fixes [m], and per ``STEP`` the logged force [N] and v r [m/s rad/s]."""
    random = np.random.default_rng(seed)
    n = round(duration / STEP)
    time = np.arange(n) * STEP
    command = np.clip(17.0 * _sines(random, time, 0.02, 0.2), -FORCE, FORCE)
    if vehicle.piloted:
        command = _piloted(np.random.default_rng([seed, 1]), n)
    if vehicle.torque:
        command[:200] = 0.0  # at small forces it takes seconds until the turns are those asked for
    if vehicle.size:
        command = vehicle.size * np.sign(command)
    side = 0.25 * _sines(random, time, 0.02, 0.1) * 0.35 * _sines(random, time, 0.02, 0.1)
    white, noise = random.normal(size=n), random.normal(0.0, NOISE, n // FIX + 1)
    logged, path, turning = np.empty(n), np.empty(n + 1), np.array(side)
    x = v = force = rate = drift = 0.0
    mass, measured, last = MASS, float(noise[0]), float(noise[0])
    keep = np.exp(-STEP / 2.0)
    for k in range(n):
        path[k] = x
        if k % FIX == 0:
            last, measured = measured, x + noise[k // FIX]
        if k % HELD == 0:
            u = command[k]
            if vehicle.closed_loop:
                # there and back at 0.5 m/s, every 20 s, with a proportional-derivative law
                leg = time[k] % 40.0
                wanted, speed = (0.5 * leg, 0.5) if leg < 20.0 else (0.5 * (40.0 - leg), -0.5)
                u = 40.0 * (wanted - measured) + 25.0 * (speed - (measured - last) / 0.1)
                u = min(max(u, -FORCE), FORCE)
            held = float(u)
        logged[k] = held
        if vehicle.disturbance == 'zigzag':
            turning[k] = 0.2 * held / FORCE * abs(side[k])**0.5
        real = vehicle.thrust(held) * (1.0 - vehicle.runs_down * time[k])
        force, rate = _lagged(vehicle, force, rate, real)
        if time[k] >= vehicle.change[0]:
            mass = MASS * vehicle.change[1]
        drift = keep * drift + (1.0 - keep**2)**0.5 * white[k]
        extra = {'': 0.0, 'unknown': drift / MASS, 'coupled': 1.4 * turning[k],
                 'zigzag': 1.4 * turning[k], 'tether': -tanh(x) / MASS}[vehicle.disturbance]

        one = _rate(vehicle, v, force, mass) + extra
        two = _rate(vehicle, v + 0.5 * STEP * one, force, mass) + extra
        three = _rate(vehicle, v + 0.5 * STEP * two, force, mass) + extra
        four = _rate(vehicle, v + STEP * three, force, mass) + extra
        x += STEP * v + STEP * STEP * (one + two + three) / 6.0
        v += STEP * (one + 2.0 * (two + three) + four) / 6.0
    path[n] = x
    return _smooth(path[::FIX] + noise[:n // FIX + 1], vehicle.smoothing), logged, turning


def _lagged(vehicle: Vehicle, force: float, rate: float, real: float) -> tuple[float, float]:
    """
    Return the force after one ``STEP``, where there would be another one without a lag.

    Its rate [N/s] is needed, and returned, where it swings, and the turns [root of N] where a
    torque drives them.
    """
    if vehicle.torque:
        inertia = 2.0 * vehicle.lag * FORCE**0.5
        middle = rate + 0.5 * STEP * (real - rate * abs(rate)) / inertia
        force = middle * abs(middle)
        return force, rate + STEP * (real - force) / inertia
    if vehicle.swings:
        rate += STEP * vehicle.swings * (vehicle.swings * (real - force) - rate)
        return force + STEP * rate, rate
    if not vehicle.lag:
        return real, 0.0
    if not vehicle.turns:
        return force + (real - force) * STEP / vehicle.lag, 0.0
    turns = copysign(abs(force)**0.5, force)
    turns += (copysign(abs(real)**0.5, real) - turns) * STEP / vehicle.lag
    return turns * abs(turns), 0.0


def _smooth(fixes: Array, smoothing: float) -> Array:
    """Return fixes behind two low-passes."""
    keep = np.exp(-FIX * STEP / smoothing) if smoothing else 0.0
    for _ in range(2 if smoothing else 0):
        smooth = fixes[0]
        for k, fix in enumerate(fixes):
            smooth = keep * smooth + (1.0 - keep) * fix
            fixes[k] = smooth
    return fixes


def _rate(vehicle: Vehicle, v: float, force: float, mass: float) -> float:
    drag = QUADRATIC * (vehicle.reverse_drag if v < 0.0 else 1.0)
    force -= (FORCE * abs(force))**0.5 * v / vehicle.fades
    return (force - drag * v * abs(v) - LINEAR * v - BIAS) / mass


def couplings_of(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the couplings with which a vehicle is configured that is known."""
    return ('vr', 'reverse_drag') if vehicle.reverse_drag != 1.0 else ('vr',)


def pieces(vehicle: Vehicle, seed: int, duration: float,
           known: bool = False) -> list[Step | float]:
    """
    Return what the pipe makes of a drive: the first velocity, then the steps.

    ``known`` is for a vehicle whose thrusters and ``couplings_of`` are configured.
    """
    fixes, logged, turning = drive(vehicle, seed, duration)
    if known:
        logged = _felt(vehicle, logged)
    dt = FIX * STEP
    mean = np.diff(fixes) / dt
    halves = logged.reshape(-1, FIX // 2).mean(axis=1)  # between fix, middle, fix
    forces = halves[1:-1].reshape(-1, 2)
    regressor = turning.reshape(-1, FIX).mean(axis=1)
    parts = turning.reshape(-1, FIX // 2).mean(axis=1)[1:-1].reshape(-1, 2)
    couplings = [parts]
    if vehicle.reverse_drag != 1.0:
        astern = np.minimum(mean, 0.0) * np.abs(mean)
        couplings.append(np.stack([astern[:-1], astern[1:]], axis=1))
    regressors = np.stack(couplings, axis=1)
    smooth = filtered(CUTOFF, np.full(len(regressors), dt), regressors.mean(axis=2).T).T
    velocity = filtered(CUTOFF, np.full(len(mean), dt), mean)
    force = filtered(CUTOFF, np.full(len(forces), dt), forces.mean(axis=1))
    return [float(mean[0]), *(
        Step(dt, (a, 0.5 * (a + b), b), (f, f, f), m, dt, (dt / 2, dt / 2), (p, q),
             pieces=((dt / 2, p), (dt / 2, q)),
             couplings=tuple(map(tuple, y)) if known else (),
             filtered_couplings=tuple(z) if known else (), watched=() if known else (x,))
        for a, b, f, m, (p, q), x, y, z in zip(
            velocity.tolist(), velocity[1:].tolist(), force.tolist(), mean[1:].tolist(),
            forces.tolist(), regressor.tolist(), regressors.tolist(), smooth.tolist()))]


def _felt(vehicle: Vehicle, logged: Array) -> Array:
    """Return the real force of the commands per ``STEP`` [N]."""
    force, rate, felt = 0.0, 0.0, np.empty(len(logged))
    for k, command in enumerate(logged):
        force, rate = _lagged(vehicle, force, rate, vehicle.thrust(float(command)))
        felt[k] = force
    return felt
