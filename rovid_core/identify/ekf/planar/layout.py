"""Where motion and parameters of surge and sway stand in their filter, and how they begin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from rovid_core.identify.ekf.normalised_model import CHANGE, NormalisedModel
from rovid_core.identify.ekf.single.linearised_filter import CANDIDATES, NONE_OWN
from rovid_core.model.dofs import EACH, OWN
from rovid_core.model.plant import Array
from rovid_core.settings.run import Scales

Looks = Array | None
"""What two values measure of the motion, an array of shape (2, 8); None for the position."""

DOFS = ('surge', 'sway')

SIZE = 8
"""Of the motion: X, Y, u, v, current x and y, unknown acceleration of surge and sway."""

CURRENT = slice(4, 6)
"""Where the current stands in the motion."""

AXES = 2

ALTERNATIVES = ('ahead', 'to_port', 'pull_x', 'pull_y', 'heading', 'late')
"""
What a current may be mistaken for, watched behind all other regressors.

Where the sensor of the fixes is in the body [m], a constant pull in the world along x and y [N],
an offset of the headings [rad], and how much later than they are stamped the fixes come [s].
"""

TURNING = {'surge': 'vr', 'sway': 'ur'}
"""The coupling of each with the velocity of the other one."""

LARGEST_CURRENT = 5.0
"""In standard deviations before anything is known."""


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
    shares : bool
        Whether ``EACH`` is watched, the first of these.
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
    shares: bool = False

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


class PlanarModel:
    """
    Parameters of surge, of sway, and the current in the beginning.

    Parameters
    ----------
    scales : mapping
        Of surge, sway or both. The one that is left out drifts: it has no thrust, but drag,
        and the other one needs its velocity.
    prior : float
        Standard deviation of the current [m/s].

    Attributes
    ----------
    scales : list of 2 Scales
    of : list of 2 NormalisedModel
        The models of surge and sway by themselves.
    rows : pair of Row
        Where their parameters stand.
    watched : list of str
        Names of all regressors that are watched.
    regressors : list of 2 ints
        How many a step brings along for each.
    box : list
        The bounds: index, lowest, highest value.
    size : int
        Number of parameters.
    initial, variances : list of floats
        Before any measurement.

    """

    def __init__(self, scales: Mapping[str, Scales], prior: float) -> None:
        self._prior = prior
        self.scales = [scales[dof] if dof in scales else _drifting(
            dof, next(iter(scales.values()))) for dof in DOFS]
        self.of = [NormalisedModel(one) for one in self.scales]
        self.rows = self._make_rows()
        self.watched = [f'{dof} {name}' for dof, one in zip(DOFS, self.scales)
                        for name in (*CANDIDATES, *(EACH if one.shares else ()), *one.watched)]
        self.regressors = [row.couplings + len(one.watched) if dof in scales else 0
                           for dof, row, one in zip(DOFS, self.rows, self.scales)]
        self.box = [(row.first + i, low, high) for row, model in zip(self.rows, self.of)
                    for i, low, high in model.box]
        self.size = self.rows[1].end + AXES
        c = LARGEST_CURRENT * prior
        self.box += [(self.size - 2, -c, c), (self.size - 1, -c, c)]
        self.initial = [*self.of[0].initial, *self.of[1].initial, 0.0, 0.0]
        self.variances: list[float] = []
        for dof, model in zip(DOFS, self.of):
            self.variances += model.prior if dof in scales else (*model.prior[:-1], 0.0)
        self.variances += [prior * prior] * AXES

    def _make_rows(self) -> tuple[Row, Row]:
        rows, first = [], 0
        for dof, scales, model in zip(DOFS, self.scales, self.of):
            names = scales.couplings
            turning, (thrust, drag) = TURNING[dof], model.own
            rows.append(Row(
                first, first + 5 + len(names), scales.velocity,
                first + 4 + names.index(turning) if turning in names else -1,
                tuple([(first + 4 + k, k) for k, name in enumerate(names)
                       if name != turning and name not in OWN]),
                len(scales.watched) + (len(EACH) if scales.shares else 0), scales.force,
                (thrust + first if thrust >= 0 else -1, drag + first if drag >= 0 else -1),
                scales.shares))
            first = rows[-1].end
        return rows[0], rows[1]

    def variances_after_change(self, theta: Sequence[float]) -> list[float]:
        """Return those of parameters around what they were before the vehicle changed."""
        # a parameter that a fault has led to 0 must find its way back, too
        found = [(CHANGE * max(abs(p), abs(initial)))**2 if variance else 0.0
                 for p, initial, variance in zip(theta, self.initial, self.variances)]
        for row in self.rows:
            # the wrong model has moved the delay by more than it was uncertain
            found[row.end - 1] = self.variances[row.end - 1]
        # the water has not changed, but the wrong model has misled it
        found[-AXES:] = [(CHANGE * self._prior)**2] * AXES
        return found


def _drifting(dof: str, other: Scales) -> Scales:
    """Return the scales of one without thrust, like the other one's."""
    return replace(other, active=(False, True, True, True), couplings=(TURNING[dof],),
                   watched=(), shares=False)
