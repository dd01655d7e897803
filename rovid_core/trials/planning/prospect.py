"""What a thrust profile would cost, and what it would tell: the Cramer-Rao bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
import math

import numpy as np
from rovid_core.identify.intervals import Z95
from rovid_core.model.dofs import Four
from rovid_core.model.plant import lumped, physical
from rovid_core.model.trajectory import Array
from rovid_core.settings.run import Settings, SettingsError
from rovid_core.simulation.profiles import Sinusoid, Steps, Waveform
from rovid_core.trials.planning import fleet

SHARE = 0.05
"""
A term that takes less than this share of the thrust at top speed is as good as known once it
is known to that share: a drag of 0 can not be known to any percentage.
"""


class PlanError(ValueError):
    """What can not be planned; the text says which limit is at fault."""


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

    @staticmethod
    def of(settings: Settings, dof: str) -> Sensor:
        """
        Return the sensor that measures a DOF; one message has one rate.

        Raises
        ------
        SettingsError
            If it has no noise, for then there is no bound.

        """
        simulation, name = settings.simulation, settings.source(dof)
        noise = float(getattr(simulation, f'{name}_noise'))
        if not noise > 0.0:
            raise SettingsError(f'simulation.{name}_noise', 'has to be above 0 to plan')
        topic = settings.input(name).topic
        rate = min(float(getattr(simulation, f'{other}_rate'))
                   for other in settings.used_inputs()
                   if other not in ('thrusters', 'reference', 'sign')
                   and settings.input(other).topic == topic)
        return Sensor(rate, noise, name in ('velocity', 'angular_velocity'))


@dataclass(frozen=True)
class Vehicles:
    """
    The model, and the vehicles that could be there in its place.

    Attributes
    ----------
    parameters : ndarray, shape (4, v)
        Lumped parameters; the first vehicle is the model. The others have mass and drags up
        to a factor off, in all directions; the bias is the model's, which thrust cancels.
    active : tuple of 4 bools
        Terms that are identified.

    """

    parameters: Array
    active: tuple[bool, bool, bool, bool]

    @staticmethod
    def around(model: Four, active: tuple[bool, bool, bool, bool], factor: float) -> Vehicles:
        """Return a model and those whose mass and drags are up to ``factor`` off."""
        mass, quadratic, linear, bias = physical(model)
        corners = product((factor, 1.0 / factor), repeat=3) if factor > 1.0 else ()
        all_of_them = [model, *(lumped(mass * m, quadratic * q, linear * d, bias)
                                for m, q, d in corners)]
        return Vehicles(np.array(all_of_them).T, active)

    def few(self) -> Vehicles:
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


@dataclass(frozen=True)
class Prospect:
    """
    What a profile would cost and give.

    Attributes
    ----------
    waveforms : tuple of Waveform
        The profile.
    force : float
        Its largest thrust [N or N m].
    speed, room : ndarray, shape (v,)
        How fast [m/s or rad/s] and how far from the start [m or rad] each vehicle gets.
    lumped, physical : ndarray, shape (v, 4, 4)
        Cramer-Rao bound of the parameters of each vehicle; 0 for terms that are left out.

    """

    waveforms: tuple[Waveform, ...]
    force: float
    speed: Array
    room: Array
    lumped: Array
    physical: Array

    def uncertainty(self, physical: bool) -> Array:
        """Return half the width of the 95 % intervals, shape (v, 4)."""
        covariance = self.physical if physical else self.lumped
        return np.asarray(Z95 * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)))


def samples(waveforms: Sequence[Waveform], t: Array) -> Array:
    """Return the thrust of waveforms at many times at once [N or N m]."""
    total = np.zeros(len(t))
    for w in waveforms:
        if isinstance(w, Sinusoid):
            total += w.amplitude * np.sin(2.0 * math.pi * w.frequency * t)
        elif isinstance(w, Steps):
            which = np.floor(t / w.hold + 1e-9).astype(int) % len(w.levels)
            total += np.array(w.levels)[which]
        else:
            total += [w.at(x) for x in t.tolist()]
    return total


def times(duration: float, dt: float) -> Array:
    """Return the middles of the steps of a trial [s]."""
    return np.asarray((np.arange(max(round(duration / dt), 1)) + 0.5) * dt, dtype=np.float64)


def bounds(vehicles: Vehicles, sensor: Sensor, force: Array,
           dt: float) -> tuple[Array, Array]:
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
        0 for terms that are left out. Velocity and position at the start are unknown too.

    """
    raw = fleet.information(vehicles.parameters, force, dt, sensor.of_velocity)
    raw *= dt * sensor.rate / sensor.noise**2
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
    Return the covariance of the physical parameters that unknown forces cause.

    Parameters
    ----------
    vehicles, force, dt
        As in ``bounds``.
    density : float
        Of the unknown forces, white noise [N^2 s or N^2 m^2 s].

    Returns
    -------
    covariance : ndarray, shape (p, v, 4, 4)

    """
    raw = fleet.regression(vehicles.parameters, force, dt)
    return density * _inverse(raw, vehicles)


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


def prospect(waveforms: Sequence[Waveform], vehicles: Vehicles, sensor: Sensor,
             duration: float, dt: float) -> Prospect:
    """Return what a profile would cost and give."""
    force = samples(waveforms, times(duration, dt))[:, None]
    speed, room = fleet.reach(vehicles.parameters, force, dt)
    lumped_bound, physical_bound = bounds(vehicles, sensor, force, dt)
    return Prospect(tuple(waveforms), float(np.abs(force).max()), speed[0], room[0],
                    lumped_bound[0], physical_bound[0])
