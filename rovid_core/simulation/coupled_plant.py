"""
A vehicle whose degrees of freedom act on each other, in water that moves.

    M nu_r' = tau - C(M, nu_r) nu_r - D(nu_r) nu_r - g(R) - b + w

M is the whole mass matrix with the added mass, nu_r the velocity relative to the water, and C
follows from M alone by Kirchhoff's equations (Fossen, Handbook of Marine Craft, 2011, eq. 6.43).
It is what the identifiers do not assume, and so what they are tested on.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.dofs import DOFS, Quaternion, Vector
from rovid_core.settings.run import Settings, SettingsError
from rovid_core.velocity.attitude_history import rotate_back

Array = NDArray[np.float64]

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
    velocity : ndarray, shape (6,)
        nu_r [m/s, rad/s].
    current : tuple of 3 floats
        Velocity of the water in the world [m/s].

    Raises
    ------
    SettingsError
        If the mass matrix is not symmetric and positive definite.

    """

    def __init__(self, settings: Settings, random: np.random.Generator) -> None:
        s = settings.simulation
        self.dofs = tuple(d for d in DOFS if d in s.dofs)
        self._free = [DOFS.index(d) for d in self.dofs]
        self._mass = self._mass_matrix(settings)
        self._inverse = np.linalg.inv(self._mass[np.ix_(self._free, self._free)])
        truth = [s.dofs[d] for d in self.dofs]
        self._quadratic = np.array([t.quadratic_drag for t in truth])
        self._reverse = np.array([t.reverse_drag for t in truth])
        self._linear = np.array([t.linear_drag for t in truth])
        self._bias = np.array([t.bias for t in truth])
        self._disturbance = np.array([t.disturbance for t in truth])
        self._coriolis = s.coriolis
        self._moments = s.righting
        self.current: Vector = (*s.current, 0.0)
        self.velocity = np.zeros(6)
        self._random = random
        self._unknown = self._disturbance * random.standard_normal(len(truth))

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

    def advance(self, attitude: Quaternion, force: Sequence[float], dt: float) -> Array:
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
        mean : ndarray, shape (6,)
            The mean of the velocity before and after.

        """
        before = self.velocity.copy()
        v = before[self._free]
        up = rotate_back(attitude, (0.0, 0.0, 1.0))
        given = np.asarray(force) - self._bias + self._unknown
        given = given + self._righting(up)
        drag = (2.0 * self._quadratic * self._reverse * abs(v) + self._linear)
        fastest = float(np.max(drag * np.diag(self._inverse), initial=0.0))
        pieces = min(int(fastest * dt), MAX_PIECES - 1) + 1
        h = dt / pieces
        for _ in range(pieces):
            k1 = self._acceleration(v, given)
            k2 = self._acceleration(v + 0.5 * h * k1, given)
            k3 = self._acceleration(v + 0.5 * h * k2, given)
            k4 = self._acceleration(v + h * k3, given)
            v = v + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        self.velocity[self._free] = v
        self._change_unknown_force(dt)
        return 0.5 * (before + self.velocity)

    def _acceleration(self, v: Array, given: Array) -> Array:
        quadratic = self._quadratic * np.where(v < 0.0, self._reverse, 1.0)
        force = given - (quadratic * abs(v) + self._linear) * v
        if self._coriolis:
            force = force + self._coriolis_force(v)
        return np.asarray(self._inverse @ force)

    def _coriolis_force(self, velocity: Array) -> Array:
        """Return -C(M, nu) nu, by Kirchhoff from the momentum M nu."""
        full = np.zeros(6)
        full[self._free] = velocity
        x, y, z, k, m, n = (self._mass @ full).tolist()
        u, v, w, p, q, r = full.tolist()
        forces = (y * r - z * q, z * p - x * r, x * q - y * p,
                  m * r - n * q + y * w - z * v, n * p - k * r + z * u - x * w,
                  k * q - m * p + x * v - y * u)
        return np.array([forces[i] for i in self._free])

    def _righting(self, up: Vector) -> Array:
        """Return the moments [N m] of a centre of buoyancy above that of gravity."""
        moments = np.zeros(6)
        moments[3], moments[4] = -self._moments[0] * up[1], self._moments[1] * up[0]
        return moments[self._free]

    def _change_unknown_force(self, dt: float) -> None:
        """Let the unknown force wander: a first-order Gauss-Markov process."""
        if not self._disturbance.any():
            return
        kept = math.exp(-dt / FORCE_CORRELATION)
        self._unknown = kept * self._unknown + math.sqrt(
            1.0 - kept * kept) * self._disturbance * self._random.standard_normal(len(self._free))
