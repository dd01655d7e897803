"""
How far and how fast vehicles move under thrust profiles, and what that tells of them.

All vehicles are stepped side by side under all profiles: a search needs thousands of short
trials, not a long one. What a trial can tell of the parameters is the Cramer-Rao bound.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, product, repeat
import math

import numpy as np
from rovid_core.identify.ekf.normalised_model import DELAY_STD
from rovid_core.model.dofs import Four
from rovid_core.model.plant import Array, lumped, midpoint_steps, physical
from rovid_core.settings.run import Settings, SettingsError

# A term that takes less than this share of the thrust at top speed is as good as known once it is
# known to that share: a drag of 0 can not be known to any percentage.
SHARE = 0.05
WITH_DELAY = ('ekf',)  # methods that find the delay of the thrust with the parameters
TURN, SIDES = 0.5 * math.pi, 4  # [rad] the vehicle drives a box where there may be a current
CHUNK = 32  # measurements that are squared together, which is quicker than one by one


@dataclass(frozen=True)
class Limits:
    """What a profile must keep to: [N or N m], [m/s or rad/s], [m or rad] and [s]."""

    force: float
    speed: float
    room: float
    duration: float


@dataclass(frozen=True)
class Sensor:
    """White noise of one standard deviation [m, rad, m/s or rad/s] at a rate [Hz]."""

    rate: float
    noise: float
    of_velocity: bool
    # standard deviations before the trial of what is found with the parameters, 0 where it is
    # known: the delay of the thrust [s], and the current on each axis of the world [m/s]
    delay: float = 0.0
    current: float = 0.0

    @property
    def priors(self) -> tuple[float, ...]:
        """Return the standard deviations of what else is found."""
        return tuple([x for x in (self.delay, self.current, self.current) if x])

    @staticmethod
    def of(settings: Settings, dof: str) -> Sensor:
        """Return the sensor that measures a DOF; SettingsError if it has no noise."""
        simulation, name = settings.simulation, settings.source(dof)
        noise = float(getattr(simulation, f'{name}_noise'))
        if not noise > 0.0:
            raise SettingsError(f'simulation.{name}_noise', 'has to be above 0 to plan')
        topic = settings.input(name).topic
        rate = min(float(getattr(simulation, f'{other}_rate'))
                   for other in settings.used_inputs()
                   if other not in ('thrusters', 'reference', 'sign')
                   and settings.input(other).topic == topic)
        over_ground = settings.estimates_current and dof in ('surge', 'sway')
        return Sensor(rate, noise, name in ('velocity', 'angular_velocity'),
                      DELAY_STD if settings.identifier.method in WITH_DELAY else 0.0,
                      settings.current.prior if over_ground else 0.0)


@dataclass(frozen=True)
class Vehicles:
    """The model, and the vehicles that could be there in its place."""

    # shape (4, v); lumped parameters; the first vehicle is the model. The others have mass and
    # drags up to a factor off, in all directions; the bias is the model's, which thrust cancels.
    parameters: Array
    active: tuple[bool, bool, bool, bool]  # terms that are identified

    @staticmethod
    def around(model: Four, active: tuple[bool, bool, bool, bool], factor: float) -> Vehicles:
        """Return a model and those whose mass and drags are up to ``factor`` off."""
        mass, quadratic, linear, bias = physical(model)
        corners = product((factor, 1.0 / factor), repeat=3) if factor > 1.0 else ()
        all_of_them = [model, *(lumped(mass * m, quadratic * q, linear * d, bias)
                                for m, q, d in corners)]
        return Vehicles(np.array(all_of_them).T, active)

    def hardest(self) -> Vehicles:
        """Return the model and those that ask most of a profile, for a quick search."""
        # one drag low, the other high, of heavy and light vehicles; and the fastest
        return Vehicles(self.parameters[:, [0, 2, 3, 6, 8][:self.parameters.shape[1]]],
                        self.active)

    @property
    def bias(self) -> float:
        """Return the bias of all of them [N or N m]."""
        return physical(self.parameters[:, 0].tolist())[3] + 0.0

    def scales(self, limits: Limits) -> Array:
        """Return the size of each physical parameter, shape (v, 4), to compare errors with."""
        values = np.abs(np.array([physical(p) for p in self.parameters.T.tolist()]))
        _, quadratic, linear, _ = values.T
        # where drag is all of the thrust, or where the limit is
        root = np.sqrt(linear**2 + 4.0 * quadratic * limits.force) + linear
        speed = np.minimum(2.0 * limits.force / np.maximum(root, 1e-300), limits.speed)
        least = SHARE * limits.force * np.stack(
            [0.0 * speed, 1.0 / speed**2, 1.0 / speed, 1.0 + 0.0 * speed], axis=1)
        return np.asarray(np.maximum(values, least))


def reach(parameters: Array, force: Array, dt: float) -> tuple[Array, Array]:
    """
    Return how fast and how far vehicles get, from rest.

    Parameters
    ----------
    parameters : ndarray, shape (4, v)
        alpha, beta, gamma, delta with beta, gamma <= 0, of each vehicle.
    force : ndarray, shape (n, p)
        Mean force of each profile over each step [N or N m].
    dt : float
        Length of the steps [s].

    Returns
    -------
    speed, room : ndarray, shape (p, v)
        Largest ``|v|`` [m/s or rad/s] and ``|x - x0|`` [m or rad].

    """
    shape = force.shape[1], parameters.shape[1]
    speed, room, path = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for mean, v in _steps(parameters, force, dt):
        path += dt * mean
        np.maximum(speed, np.abs(v), out=speed)
        np.maximum(room, np.abs(path), out=room)
    return speed, room


def paths(parameters: Array, force: Array, dt: float) -> Array:
    """Return the position of each vehicle after each step, shape (n, p, v) [m or rad]."""
    steps = [dt * mean for mean, _ in _steps(parameters, force, dt)]
    return np.asarray(np.cumsum(steps, axis=0))


def bounds(vehicles: Vehicles, sensor: Sensor, force: Array, dt: float) -> tuple[Array, Array]:
    """
    Return the Cramer-Rao bound of the lumped and of the physical parameters.

    Parameters
    ----------
    vehicles, sensor
        What moves, and what measures it.
    force : ndarray, shape (n, p)
        Each profile at ``times`` [N or N m].
    dt : float
        Length of the steps [s]; the noise is spread over them evenly.

    Returns
    -------
    lumped, physical : ndarray, shape (p, v, 4, 4)
        0 for terms that are left out. Velocity and position at the start are unknown too, and
        so are delay and current, as far as ``sensor`` says so.

    """
    raw = _sum_of_squares(_slopes(vehicles.parameters, force, dt, sensor))
    raw *= dt * sensor.rate / sensor.noise**2
    for k, prior in enumerate(reversed(sensor.priors), 1):
        raw[..., -k, -k] += 1.0 / prior**2
    covariance = _inverse(raw, vehicles)
    # mass = 1 / alpha, the others = -theta / alpha
    alpha = vehicles.parameters[0]
    slopes = np.zeros((len(alpha), 4, 4))
    slopes[:, range(4), range(4)] = -1.0 / alpha[:, None]
    slopes[:, :, 0] = vehicles.parameters.T / alpha[:, None]**2
    slopes[:, 0, 0] = -1.0 / alpha**2
    slopes[:, ~np.array(vehicles.active)] = 0.0
    return covariance, slopes @ covariance @ slopes.transpose(0, 2, 1)


def disturbance(vehicles: Vehicles, force: Array, dt: float, density: float) -> Array:
    """
    Return the covariance of the physical parameters that unknown forces cause, (p, v, 4, 4).

    ``density`` is that of the forces, which are white noise [N^2 s or N^2 m^2 s]. With one of 1
    the information of exact measurements is the integral of the squared regressors of
    m v' + d_Q v|v| + d_L v + b = tau.
    """
    def regressors() -> Iterator[Array]:
        before = np.zeros((force.shape[1], vehicles.parameters.shape[1]))
        for mean, v in _steps(vehicles.parameters, force, dt):
            yield np.stack([(v - before) / dt, mean * np.abs(mean), mean, np.ones(v.shape)], -1)
            before = v

    return density * _inverse(dt * _sum_of_squares(regressors()), vehicles)


def _inverse(raw: Array, vehicles: Vehicles) -> Array:
    """Return the covariance of the parameters from an information, whose rest is unknown too."""
    used = [*np.flatnonzero(vehicles.active), *range(4, raw.shape[-1])]
    raw = raw[..., used, :][..., used]
    size = np.sqrt(np.maximum(np.diagonal(raw, axis1=-2, axis2=-1), 1e-300))
    even = raw / (size[..., :, None] * size[..., None, :])
    # what the data do not tell at all becomes very uncertain, not a failure
    inverse = np.linalg.inv(even + 1e-13 * np.eye(len(used)))
    inverse /= size[..., :, None] * size[..., None, :]
    count = sum(vehicles.active)
    own = np.ix_(used[:count], used[:count])
    covariance = np.zeros((*raw.shape[:2], 4, 4))
    covariance[..., own[0], own[1]] = inverse[..., :count, :count]
    return covariance


def _slopes(parameters: Array, force: Array, dt: float, sensor: Sensor) -> Iterator[Array]:
    """
    Yield the derivatives of the velocity or of the position after each step, shape (p, v, n).

    They are by alpha, beta, gamma, delta, the velocity at the start, and, unless the sensor is
    ``of_velocity``, the position at the start; then by delay and current, as far as they are
    unknown. The vehicle turns by ``TURN`` after each quarter of the trial; without a turn nothing
    tells the current from drag and bias.
    """
    alpha, beta, gamma, _ = parameters
    count = 6 if sensor.delay else 5
    shape = force.shape[1], parameters.shape[1]
    of_speed, of_path = np.zeros((*shape, count)), np.zeros((*shape, count))
    start, water = np.ones((*shape, 1)), np.zeros((*shape, 2))
    of_speed[..., 4] = 1.0
    right = np.zeros((*shape, count))
    right[..., 3] = dt
    rise = np.gradient(force, axis=0) if len(force) > 1 else 0.0 * force
    for k, (mean, _) in enumerate(_steps(parameters, force, dt)):
        size = np.abs(mean)
        half = 0.5 * dt * (2.0 * beta * size + gamma)
        right[..., 0] = dt * force[k][:, None]
        right[..., 1] = dt * mean * size
        right[..., 2] = dt * mean
        if sensor.delay:  # a delay takes back what the force has risen by
            right[..., 5] = -alpha * rise[k][:, None]
        after = (of_speed * (1.0 + half)[..., None] + right) / (1.0 - half)[..., None]
        of_path = of_path + 0.5 * dt * (of_speed + after)
        of_speed = after
        heading = TURN * (SIDES * k // len(force))
        along = np.broadcast_to([math.cos(heading), math.sin(heading)], (*shape, 2))
        water = water + dt * along
        slopes = [of_speed] if sensor.of_velocity else [
            of_path[..., :5], start, of_path[..., 5:]]
        if sensor.current:
            slopes.append(along if sensor.of_velocity else water)
        yield np.concatenate(slopes, axis=-1)


def _sum_of_squares(rows: Iterator[Array]) -> Array:
    """Return the sum of the outer products of rows, shape (..., n, n) of rows (..., n)."""
    total: Array | float = 0.0
    while chunk := list(islice(rows, CHUNK)):
        block = np.stack(chunk, axis=-1)
        total = total + block @ block.swapaxes(-1, -2)
    return np.asarray(total)


def _steps(parameters: Array, force: Array, dt: float) -> Iterator[tuple[Array, Array]]:
    """Yield the mean velocity over each step and that at its end, shape (p, v), from rest."""
    start = np.zeros((force.shape[1], parameters.shape[1]))
    return midpoint_steps(parameters, start, repeat(dt), force[:, :, None])
