"""Where motion, parameters and regressors of surge and sway stand in their filter."""

from __future__ import annotations

from typing import NamedTuple

from rovid_core.identify.ekf.single.linearised_filter import NONE_OWN
from rovid_core.model.trajectory import Array

Looks = Array | None
"""What two values measure of the motion, an array of shape (2, 8); None for the position."""

DOFS = ('surge', 'sway')

SIZE = 8
"""Of the motion: X, Y, u, v, current x and y, unknown acceleration of surge and sway."""

CURRENT = slice(4, 6)
"""Where the current stands in the motion."""

AXES = 2

ALTERNATIVES = ('pull_x', 'pull_y', 'heading', 'late')
"""
What a current may be mistaken for, watched behind all other regressors.

A constant pull in the world along x and y [N], an offset of the headings [rad], and how much later
than they are stamped the fixes come [s].
"""


class Row(NamedTuple):
    """
    Where the parameters of surge or sway stand, and what its couplings are.

    Attributes
    ----------
    first : int
        Index of alpha; delay stands at ``end - 1``.
    end : int
        Index behind its parameters.
    velocity : float
        Typical one [m/s]: the parameters are accelerations in it per second.
    turning : int
        Index of the coupling with the other one's velocity and the yaw rate, -1 for none.
    measured : tuple of (int, int)
        Index of each other coupling, and its number among the regressors, but for ``OWN``.
    watched : int
        Regressors that are watched besides ``CANDIDATES``; they stand behind the others.
    force : float
        Typical one [N].
    own : tuple of 2 ints
        Index of the coupling of each of ``OWN``, -1 for none.

    """

    first: int
    end: int
    velocity: float
    turning: int
    measured: tuple[tuple[int, int], ...]
    watched: int = 0
    force: float = 1.0
    own: tuple[int, int] = NONE_OWN

    @property
    def couplings(self) -> int:
        """Return how many couplings it has."""
        return self.end - self.first - 5


class PlanarInnovation(NamedTuple):
    """
    A measurement against what was predicted.

    Attributes
    ----------
    error : float
        By how much it is off.
    given, total : float
        The variance of that, for given parameters and altogether.
    row : ndarray, shape (p + c + 9,)
        Its derivatives by the parameters and the watched regressors, its covariance with the
        motion for given parameters, and a number that the filter needs.
    psi : ndarray, shape (p + c,)
        The derivatives of these.
    gain : ndarray, shape (p,)
        Covariance of the parameters with it; empty where they are taken to be exact.
    told : float
        What it says of the parameters, psi theta: the error, and what they predicted.

    """

    error: float
    given: float
    total: float
    row: Array
    psi: Array
    gain: Array
    told: float
