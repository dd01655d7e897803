"""
A vehicle whose degrees of freedom act on each other, in water that moves, and that water.

    M nu_r' = tau - C(M, nu_r) nu_r - D(nu_r) nu_r - g(R) - b + w

M is the whole mass matrix with the added mass, nu_r the velocity relative to the water, and C
follows from M alone by Kirchhoff's equations (Fossen, Handbook of Marine Craft, 2011, eq. 6.43).
It is what the identifiers do not assume, and so what they are tested on.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
import math

import numpy as np
from rovid_core.model.dofs import DOFS, Quaternion, Vector
from rovid_core.model.plant import Array, runge_kutta
from rovid_core.settings.run import Settings, SettingsError, SimulationSettings
from rovid_core.velocity.attitude_history import rotate_back

Rows = list[list[tuple[int, float]]]

FORCE_CORRELATION = 3.0
"""[s] over which the unknown force changes."""

MAX_PIECES = 1000
"""Into which an integration step is divided where the drag is fast."""


def is_coupled(settings: Settings) -> bool:
    """Tell whether the simulation asks for more than decoupled DOFs in still water."""
    s = settings.simulation
    return bool(s.coriolis or s.mass_matrix or any(s.current) or any(s.righting) or any(
        t.reverse_drag != 1.0 or t.disturbance for t in s.dofs.values()))


class CoupledPlant:
    """
    The velocity through the water under forces.

    Water that moves faster or slower takes a vehicle that is neutral in it along with it, as it
    does its own, so the law is the same in a current that changes.

    Parameters
    ----------
    settings : Settings
        Its simulation has the truth; DOFs without a truth stand still.
    random : numpy.random.Generator
        For the unknown force.

    Attributes
    ----------
    dofs : tuple of str
        The simulated DOFs.
    velocity : list of 6 floats
        nu_r [m/s, rad/s].

    Raises
    ------
    SettingsError
        If the mass matrix is not symmetric and positive definite.

    """

    # Sums of single floats: on so few of them numpy takes several times as long.

    def __init__(self, settings: Settings, random: np.random.Generator) -> None:
        s = settings.simulation
        self.dofs = tuple(d for d in DOFS if d in s.dofs)
        self._free = [DOFS.index(d) for d in self.dofs]
        mass = self._mass_matrix(settings)
        inverse = np.zeros((6, 6))
        inverse[np.ix_(self._free, self._free)] = np.linalg.inv(
            mass[np.ix_(self._free, self._free)])
        self._mass, self._inverse = _entries(mass), _entries(inverse)
        truth = [s.dofs[d] for d in self.dofs]
        # of each DOF: its number, quadratic drag ahead and astern, linear drag, 1 / mass
        self._drag = [
            (i, t.quadratic_drag, t.quadratic_drag * t.reverse_drag, t.linear_drag,
             float(inverse[i, i])) for i, t in zip(self._free, truth)]
        self._bias = [t.bias for t in truth]
        self._disturbance = [t.disturbance for t in truth]
        self._coriolis = s.coriolis
        self._moments = s.righting
        self.velocity = [0.0] * 6
        self._random = random
        self._unknown = [
            f * x for f, x in zip(self._disturbance, random.standard_normal(len(truth)).tolist())]

    def _mass_matrix(self, settings: Settings) -> Array:
        s = settings.simulation
        masses = [s.dofs[d].mass if d in s.dofs else 0.0 for d in DOFS]
        if not s.mass_matrix:
            return np.diag(masses)
        if len(s.mass_matrix) != 36:
            raise SettingsError('simulation.mass_matrix',
                                f'got {len(s.mass_matrix)} numbers, takes 6 rows of 6')
        mass = np.array(s.mass_matrix).reshape(6, 6)
        free = mass[np.ix_(self._free, self._free)]
        if not np.array_equal(mass, mass.T) or np.linalg.eigvalsh(free).min() <= 0.0:
            raise SettingsError('simulation.mass_matrix',
                                'takes a symmetric matrix that is positive definite in the '
                                'simulated DOFs')
        return mass

    def advance(self, attitude: Quaternion, force: Sequence[float], dt: float) -> list[float]:
        """
        Move on by ``dt`` [s] under a constant force, by classical Runge-Kutta.

        Parameters
        ----------
        attitude : tuple of 4 floats
            Body to world.
        force : sequence of float, length len(dofs)
            [N or N m]

        Returns
        -------
        mean : list of 6 floats
            The mean of the velocity before and after.

        """
        before = v = self.velocity
        given = [0.0] * 6
        for i, f, bias, unknown in zip(self._free, force, self._bias, self._unknown):
            given[i] = f - bias + unknown
        if any(self._moments):
            self._add_righting(given, rotate_back(attitude, (0.0, 0.0, 1.0)))
        fastest = max([(2.0 * max(ahead, astern) * abs(v[i]) + linear) * inverse
                       for i, ahead, astern, linear, inverse in self._drag], default=0.0)
        pieces = min(int(fastest * dt), MAX_PIECES - 1) + 1
        rates = partial(self._acceleration, given)
        for _ in range(pieces):
            v = runge_kutta(rates, v, dt / pieces)
        self.velocity = v
        self._change_unknown_force(dt)
        return [0.5 * (a + b) for a, b in zip(before, v)]

    def _acceleration(self, given: Sequence[float], v: Sequence[float]) -> list[float]:
        force = self._coriolis_force(v) if self._coriolis else [0.0] * 6
        for i, ahead, astern, linear, _ in self._drag:
            x = v[i]
            force[i] += given[i] - (ahead * x if x >= 0.0 else -astern * x) * x - linear * x
        return _times(self._inverse, force)

    def _coriolis_force(self, velocity: Sequence[float]) -> list[float]:
        """Return -C(M, nu) nu, by Kirchhoff from the momentum M nu."""
        x, y, z, k, m, n = _times(self._mass, velocity)
        u, v, w, p, q, r = velocity
        return [y * r - z * q, z * p - x * r, x * q - y * p,
                m * r - n * q + y * w - z * v, n * p - k * r + z * u - x * w,
                k * q - m * p + x * v - y * u]

    def _add_righting(self, given: list[float], up: Vector) -> None:
        """Add the moments [N m] of a centre of buoyancy above that of gravity."""
        given[3] -= self._moments[0] * up[1]
        given[4] += self._moments[1] * up[0]

    def _change_unknown_force(self, dt: float) -> None:
        """Let the unknown force wander: a first-order Gauss-Markov process."""
        if not any(self._disturbance):
            return
        kept = math.exp(-dt / FORCE_CORRELATION)
        share = math.sqrt(1.0 - kept * kept)
        self._unknown = [
            kept * f + share * size * x for f, size, x in zip(
                self._unknown, self._disturbance,
                self._random.standard_normal(len(self._free)).tolist())]


def _entries(matrix: Array) -> Rows:
    """Return the columns and values of the entries of each row that are not 0."""
    return [[(j, x) for j, x in enumerate(row) if x] for row in matrix.tolist()]


def _times(matrix: Rows, vector: Sequence[float]) -> list[float]:
    """Return the product of a matrix and a vector."""
    found = []
    for row in matrix:
        total = 0.0
        for j, x in row:
            total += x * vector[j]
        found.append(total)
    return found


class Water:
    """
    A horizontal current that is the same everywhere.

    It turns once in ``current_turn`` [s], from x of the world to y, and comes and goes once in
    ``current_tide`` [s]; 0 for never.
    """

    def __init__(self, settings: SimulationSettings) -> None:
        self._start = settings.current
        self._turn = _frequency(settings.current_turn)
        self._tide = _frequency(settings.current_tide)

    def at(self, t: float) -> tuple[float, float]:
        """Return the velocity of the water in the ENU world [m/s] at ``t`` [s]."""
        x, y = self._start
        if self._tide:
            strength = math.cos(self._tide * t)
            x, y = strength * x, strength * y
        if self._turn:
            c, s = math.cos(self._turn * t), math.sin(self._turn * t)
            x, y = c * x - s * y, s * x + c * y
        return x, y


def _frequency(period: float) -> float:
    """Return the angular frequency [rad/s] of a period [s], 0 for none."""
    return 2.0 * math.pi / period if period else 0.0
