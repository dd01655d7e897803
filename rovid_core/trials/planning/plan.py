"""
The next thrust profile of a degree of freedom: what tells most within its limits.

The parameters that are to be found decide how well a profile finds them, so it is chosen for
a few vehicles around the model. Best is the profile whose largest relative uncertainty, of
mass, drags and bias and of all those vehicles, is smallest: the worst number of a table is
what its reader minds, and a determinant (D-optimality) can hide it behind a good one.

More thrust always tells more. So a profile is a shape, which is searched for, and a size,
which is the largest that keeps all the vehicles within the limits.

Each DOF is planned by itself. What tells of its couplings are the profiles of all DOFs that are in
them, driven at once: the regressor of a coupling is a product of velocities, which are those of
their own models.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
import math

import numpy as np
from rovid_core.identify.intervals import Z95
from rovid_core.model.dofs import OWN, RESTORING, THRUSTS, velocity_factors
from rovid_core.model.plant import Array
from rovid_core.settings.run import Scales
from rovid_core.simulation.profiles import Sinusoid, Steps
from rovid_core.trials.output_error import Residuals
from rovid_core.trials.planning.information import (
    bounds,
    disturbance,
    Limits,
    paths,
    reach,
    Sensor,
    Vehicles,
)
from rovid_core.trials.record import Record

Part = Sinusoid | Steps
Shape = tuple[Part, ...]  # sinusoids, or one sequence of steps

# [s] A longer trial is searched for as if it were this long; it then tells more of the same
SEARCH_DURATION = 300.0
STEP = 0.1  # [s] of the integration; longer in the search, for all of which there are MAX_STEPS
MAX_STEPS = 1000
FINER = (1.3, 1.15, 1.06)  # by how much the search changes a shape, round by round
# Forces that no model knows: of the largest thrust, and for how long [s]. They are added in the
# choice of a shape. By the bare bound a few newtons would do, held for minutes: it takes every
# millimetre of slow drift for drag, and in water much else drifts.
DISTURBANCE, DISTURBANCE_TIME = 0.01, 1.0
MARGIN = 0.98  # of the limits of speed and room: commands are held, and thrusters lag
NAIVE = 0.25  # [Hz] of the sinusoid to compare with, which is that of eq. 13 of the paper

FREQUENCIES = 0.01, 1.0  # [Hz] from the slowest to the fastest motion that is considered
RATIOS = 2.0, 3.0, 4.4
# Of the second sinusoid to the first. With twice the frequency the thrust is strong one way and
# long the other, and the slow drift that quadratic drag makes of that tells it from linear drag.
SHARES = 1.0, 0.5, -0.5, -1.0

# Levels of steps, without a mean. Two speeds, or two ways, tell the drags apart.
PATTERNS: tuple[tuple[float, ...], ...] = (
    (1.0, -1.0), (1.0, -1.0, -1.0, 1.0), (1.0, 0.0, -1.0, 0.0), (1.0, -1.0, 0.4, -0.4),
    (1.0, -0.5, -0.5), (-1.0, 0.5, 0.5), (1.0, -1.0, -1.0, 1.0, 0.5, -0.5, -0.5, 0.5))

SHORTEST = 0.2  # [s] that a level is held


class PlanError(ValueError):
    """What can not be planned; the text says which limit is at fault."""


@dataclass(frozen=True)
class Prospect:
    """What a profile would cost and give."""

    waveforms: Shape  # the profile
    force: float  # its largest thrust [N or N m]
    # shape (v,); how fast [m/s or rad/s] and how far from the start [m or rad] each vehicle gets
    speed: Array
    room: Array
    # shape (v, 4, 4); Cramer-Rao bound of the parameters of each vehicle; 0 for terms that are
    # left out
    lumped: Array
    physical: Array

    def uncertainty(self, physical: bool) -> Array:
        """Return half the width of the 95 % intervals, shape (v, 4)."""
        covariance = self.physical if physical else self.lumped
        return np.asarray(Z95 * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)))


@dataclass(frozen=True)
class Plan:
    """The profile that is proposed for a DOF."""

    limits: Limits  # what it keeps to
    vehicles: Vehicles  # the model and the others, that the arrays of a prospect are about
    # of the profile, and of one sinusoid with the same largest thrust
    planned: Prospect
    naive: Prospect

    @property
    def used(self) -> dict[str, float]:
        """Return which share of each limit is used, by the vehicle that uses most."""
        return {'room': float(self.planned.room.max()) / self.limits.room,
                'max_speed': float(self.planned.speed.max()) / self.limits.speed,
                'max_force': self.planned.force / self.limits.force}


def plan(vehicles: Vehicles, sensor: Sensor, limits: Limits) -> Plan:
    """
    Plan the profile of one DOF; it keeps the limits with all the vehicles, each from rest.

    Raises PlanError if the bias needs all the thrust, or nothing can be identified within the
    limits.
    """
    offset = rounded(vehicles.bias, 5)
    if not abs(offset) < 0.9 * limits.force:
        raise PlanError(f'max_force: {limits.force:g} leaves nothing beside the bias of '
                        f'{offset:g}, which it has to cancel: give more, or leave this DOF out')
    shape, size = _searched(vehicles.hardest(), sensor, limits, offset)
    planned = _sized(shape, size, offset, vehicles, sensor, limits)
    peak = rounded(planned.force - abs(offset), 3)
    naive = prospect((Sinusoid(peak, NAIVE), *_constant(offset)), vehicles, sensor,
                     limits.duration)
    found = Plan(limits, vehicles, planned, naive)
    force = samples(planned.waveforms, times(limits.duration, STEP))[:, None]
    unknown = disturbance(vehicles, force, STEP, _density(limits))[0, 0] + planned.physical[0]
    if Z95 * math.sqrt(unknown[0, 0]) * vehicles.parameters[0, 0] > 1.0:
        name = max(found.used, key=lambda key: found.used[key])
        raise PlanError(f'{name}: {getattr(limits, name.removeprefix("max_")):g} in '
                        f'{limits.duration:g} s is too little to identify anything: not even '
                        'the mass would be known to 100 %')
    return found


def _searched(vehicles: Vehicles, sensor: Sensor, limits: Limits,
              offset: float) -> tuple[Shape, float]:
    """Return the best shape and its size [N or N m]."""
    limits = replace(limits, duration=min(limits.duration, SEARCH_DURATION))
    dt = max(STEP, limits.duration / MAX_STEPS)
    t = times(limits.duration, dt)
    scales = vehicles.scales(limits)
    low = max(FREQUENCIES[0], 1.0 / limits.duration)
    high = max(min(FREQUENCIES[1], sensor.rate / 5.0, 0.1 / dt), 2.0 * low)
    grid = [rounded(f, 3) for f in np.geomspace(low, high, 12).tolist()]
    judged: dict[Shape, tuple[float, float]] = {}
    best: list[Shape] = []
    for change in (math.nan, *FINER):
        candidates = ([near for shape in best for near in near_shapes(shape, change)] if best
                      else first_shapes(grid))
        # two sinusoids of one frequency are one, or none
        new = [shape for shape in dict.fromkeys(candidates) if shape not in judged
               and len({w.max_frequency for w in shape}) == len(shape)]
        force = np.stack([samples(shape, t) for shape in new], axis=1)
        force /= np.abs(force).max(axis=0)
        sizes = _largest(vehicles, limits, force, offset, dt)
        force = force * sizes + offset
        covariance = (bounds(vehicles, sensor, force, dt)[1]
                      + disturbance(vehicles, force, dt, _density(limits)))
        errors = np.sqrt(np.diagonal(covariance, axis1=2, axis2=3)) / scales
        costs = errors.max(axis=(1, 2))
        judged.update(zip(new, zip(costs.tolist(), sizes.tolist())))
        ranked = sorted(judged, key=lambda shape: judged[shape][0])
        # both kinds go on: the better one at first is not always the better one in the end
        best = [shape for kind in (Sinusoid, Steps)
                for shape in [s for s in ranked if isinstance(s[0], kind)][:2]]
    return ranked[0], judged[ranked[0]][1]


def _density(limits: Limits) -> float:
    return 2.0 * DISTURBANCE_TIME * (DISTURBANCE * limits.force) ** 2


def _largest(vehicles: Vehicles, limits: Limits, force: Array, offset: float, dt: float) -> Array:
    """Return the sizes of profiles of size 1 that keep within the limits, nearly."""
    most = limits.force - abs(offset)
    sizes = np.full(force.shape[1], most)
    for _ in range(4):
        # speed and room grow in proportion without drag, with the root in much drag
        excess = np.maximum(_excess(vehicles, limits, force * sizes + offset, dt), 1e-3)
        sizes = np.minimum(sizes * excess ** -1.2, most)
    return sizes


def _excess(vehicles: Vehicles, limits: Limits, force: Array, dt: float) -> Array:
    speed, room = reach(vehicles.parameters, force, dt)
    most = np.maximum(speed / limits.speed, room / limits.room).max(axis=1)
    return np.asarray(most / MARGIN)


def _sized(shape: Shape, size: float, offset: float, vehicles: Vehicles, sensor: Sensor,
           limits: Limits) -> Prospect:
    """Return a shape with round numbers that keeps all limits for the whole trial."""
    # commands come at any time: the peak is taken on a grid that misses nothing
    unit = float(np.abs(samples(shape, times(limits.duration, 0.01))).max())
    size = min(1.1 * size, limits.force - abs(offset))
    t = times(limits.duration, STEP)
    while True:
        waveforms = _scaled(shape, size / unit, offset)
        excess = float(_excess(vehicles, limits, samples(waveforms, t)[:, None], STEP)[0])
        if excess <= 1.0:
            return prospect(waveforms, vehicles, sensor, limits.duration)
        size *= min(0.985, 1.0 / excess)


def _scaled(shape: Shape, factor: float, offset: float) -> Shape:
    """Return a shape times a factor, towards 0 rounded, and the thrust against the bias."""
    scaled: list[Sinusoid | Steps] = []
    for w in shape:
        if isinstance(w, Steps):
            levels = [rounded(factor * x, 3) + offset for x in w.levels]
            return (Steps(tuple(float(f'{x:.6g}') for x in levels), w.hold),)
        scaled.append(Sinusoid(rounded(factor * w.amplitude, 3), w.frequency))
    return (*scaled, *_constant(offset))


def _constant(force: float) -> Shape:
    return (Steps((force, force), 60.0),) if force else ()


def prospect(waveforms: Shape, vehicles: Vehicles, sensor: Sensor, duration: float) -> Prospect:
    """Return what a profile would cost and give."""
    force = samples(waveforms, times(duration, STEP))[:, None]
    speed, room = reach(vehicles.parameters, force, STEP)
    lumped_bound, physical_bound = bounds(vehicles, sensor, force, STEP)
    return Prospect(waveforms, float(np.abs(force).max()), speed[0], room[0],
                    lumped_bound[0], physical_bound[0])


def first_shapes(grid: Sequence[float]) -> Iterator[Shape]:
    """Yield one or two sinusoids, and steps back and forth, all of size about 1."""
    for f in grid:
        yield (Sinusoid(1.0, f),)
        for times_f, share in product(RATIOS, SHARES):
            yield Sinusoid(1.0, f), _sinusoid(share, times_f * f)
        for levels in PATTERNS:
            yield (Steps(levels, _held(0.5 / f)),)


def near_shapes(shape: Shape, change: float) -> Iterator[Shape]:
    """Yield shapes that differ a little."""
    for by in (change, 1.0 / change):
        for i, w in enumerate(shape):
            for other in _changed(w, by):
                yield *shape[:i], other, *shape[i + 1:]
        if isinstance(shape[0], Sinusoid):  # all slower or all faster
            yield tuple([next(_changed(w, by)) for w in shape])
    if isinstance(shape[0], Sinusoid) and len(shape) < 3:
        for times_f, share in product(RATIOS, SHARES):
            third = _sinusoid(0.5 * share * shape[0].amplitude, times_f * shape[0].frequency)
            yield *shape, third


def _changed(w: Part, by: float) -> Iterator[Part]:
    """Yield a part, first with another frequency, then with another amplitude."""
    if isinstance(w, Sinusoid):
        yield _sinusoid(w.amplitude, w.frequency * by)
        yield _sinusoid(w.amplitude * by * by, w.frequency)
    else:
        yield Steps(w.levels, _held(w.hold / by))
        for k, level in enumerate(w.levels):
            yield Steps((*w.levels[:k], rounded(level * by, 3), *w.levels[k + 1:]), w.hold)


def _sinusoid(amplitude: float, frequency: float) -> Sinusoid:
    return Sinusoid(rounded(amplitude, 3), rounded(min(frequency, FREQUENCIES[1]), 3))


def _held(seconds: float) -> float:
    return round(max(seconds, SHORTEST), 1)


def rounded(value: float, digits: int) -> float:
    """Return a value towards 0 with so many digits."""
    if value == 0.0:
        return 0.0
    unit = 10.0 ** (digits - 1 - math.floor(math.log10(abs(value))))
    return float(f'{math.trunc(value * unit * (1.0 + 1e-12)) / unit:.{digits}g}')


def samples(shape: Shape, t: Array) -> Array:
    """Return the thrust of a shape at many times at once [N or N m]."""
    total = np.zeros(len(t))
    for w in shape:
        if isinstance(w, Sinusoid):
            total += w.amplitude * np.sin(2.0 * math.pi * w.frequency * t)
        else:
            which = np.floor(t / w.hold + 1e-9).astype(int) % len(w.levels)
            total += np.array(w.levels)[which]
    return total


def times(duration: float, dt: float) -> Array:
    """Return the middles of the steps of a trial [s]."""
    return np.asarray((np.arange(max(round(duration / dt), 1)) + 0.5) * dt, dtype=np.float64)


@dataclass(frozen=True)
class CoupledProspect:
    """What the profiles tell of the couplings of a DOF, driven at once."""

    # half the width of the 95 % interval of kappa, infinite for one that they do not tell
    kappas: Mapping[str, float]
    alpha: float  # the same of alpha, relative, with the couplings unknown
    partners: tuple[str, ...]  # whose profiles are needed


def coupled_prospect(dof: str, plans: Mapping[str, Plan], scales: Scales, sensor: Sensor,
                     kappas: Sequence[float]) -> CoupledProspect:
    """
    Return what the profiles of all plans tell of a DOF with couplings (``scales.couplings``).

    ``kappas`` are what is known of them; they take part in the motion of this DOF alone. A
    coupling with the attitude, with a force, or with a DOF that is not planned, is not told.
    """
    told = tuple([name for name in scales.couplings
                  if name not in RESTORING and name not in THRUSTS
                  and all(other in plans for other in velocity_factors(name))])
    partners = tuple(dict.fromkeys(
        other for name in told for other in velocity_factors(name) if other != dof))
    dt = STEP if sensor.of_velocity else 0.5 * STEP
    moved = {d: _mean_velocity(plans[d], dt) for d in {dof, *partners}}
    force = samples(plans[dof].planned.waveforms, times(plans[dof].limits.duration, dt))
    regressors = np.array([
        # that of the drag is made where the motion is
        np.minimum(force, 0.0) if name in OWN else
        np.prod([moved[other] for other in velocity_factors(name)], axis=0)
        for name in told]).reshape(-1, len(force))
    known = [kappa for name, kappa in zip(scales.couplings, kappas) if name in told]
    model = (*plans[dof].vehicles.parameters[:, 0].tolist(), *known)
    information = Residuals(
        [_record(moved[dof], force, regressors, dt, sensor.of_velocity)],
        replace(scales, couplings=told), not sensor.of_velocity).information(
            model, sensor.noise / math.sqrt(STEP * sensor.rate))
    half = Z95 * np.sqrt(np.diag(information.covariance))
    found = dict(zip(told, half[4:].tolist()))
    return CoupledProspect({name: found.get(name, math.inf) for name in scales.couplings},
                           float(half[0]) / model[0], partners)


def _mean_velocity(plan: Plan, dt: float) -> Array:
    """Return the mean velocity of the model over each step of its profile."""
    force = samples(plan.planned.waveforms, times(plan.limits.duration, dt))[:, None]
    path = paths(plan.vehicles.parameters[:, :1], force, dt)[:, 0, 0]
    return np.asarray(np.diff(path, prepend=0.0) / dt)


def _record(velocity: Array, force: Array, regressors: Array, dt: float,
            of_velocity: bool) -> Record:
    """Return a trial without noise, with a measurement after every ``STEP``."""
    path = np.concatenate([[0.0], np.cumsum(velocity * dt)])
    if of_velocity:
        speed = np.concatenate([[0.0], 0.5 * (velocity[1:] + velocity[:-1]), velocity[-1:]])
        return Record(_grid(len(path)), np.empty(0), speed, np.full(len(force), dt), force,
                      regressors)
    path = path[:len(path) // 2 * 2 + 1:2]
    count = 2 * (len(path) - 1)
    return Record(_grid(len(path)), path, np.diff(path) / STEP, np.full(count, dt),
                  force[:count], regressors[:, :count])


def _grid(count: int) -> Array:
    return np.asarray(np.arange(count) * STEP, dtype=np.float64)
