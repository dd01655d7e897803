"""The steps of surge and sway together, with what the attitude does between measurements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
import math

from rovid_core.identify.ekf.between_fixes import is_long
from rovid_core.identify.ekf.planar.layout import DOFS
from rovid_core.identify.ekf.planar_kalman import PlanarKalman
from rovid_core.model.dofs import HEADING
from rovid_core.model.samples import (
    equal_parts,
    Motion,
    NS,
    PlanarPiece,
    PlanarStart,
    PlanarStep,
    Step,
)
from rovid_core.settings.run import Scales, Settings
from rovid_core.velocity.attitude_history import AttitudeHistory, rotate
from rovid_core.velocity.couplings import CouplingRegressors

LONGEST_PIECE = 300_000_000
"""[ns] over which the axes are taken as turning evenly."""


STILL = Step(0.0, (0.0,) * 3, (0.0,) * 3)
"""A step of a DOF that is not identified."""


class PlanarSteps:
    """
    Give the filter of surge and sway its steps.

    Parameters
    ----------
    settings : Settings
        The run, which estimates the current.
    attitude : AttitudeHistory
        The attitudes that were accepted.
    couplings : CouplingRegressors
        Which know how fast the vehicle turns.

    Attributes
    ----------
    filter : PlanarKalman
        Of surge and sway.

    """

    def __init__(self, settings: Settings, attitude: AttitudeHistory,
                 couplings: CouplingRegressors) -> None:
        self._attitude, self._couplings = attitude, couplings
        self.input = next(settings.source(dof) for dof in settings.dofs if dof in DOFS)
        scales = {dof: replace(Scales.of(settings.dof[dof]), watched=tuple([
            name for name in settings.watched(dof) if name not in HEADING]),
            shares=dof in settings.sharing)
            for dof in settings.dofs if dof in DOFS}
        self._watched = {dof: len(one.watched) for dof, one in scales.items()}
        self.filter = PlanarKalman(scales, settings.current)
        self._at = 0  # time of the last measurement [ns]
        # after so long [s] nothing is known of a current any more
        change = settings.current.change
        self._forgotten = settings.current.prior**2 / change if change else math.inf

    def missing(self, motion: Motion) -> str:
        """Return '' if the attitudes of a motion are known, 'later' if they may become so."""
        missing = self._attitude.missing
        for begin, _ in _parts(motion.start, motion.end):
            why = missing(begin)
            if why:
                return why
        return missing(motion.end)

    def begin(self, motion: Motion) -> None:
        """Take up from a measurement."""
        newest = self.filter.newest
        gap = 0.0 if newest is None else max((motion.time - newest) * NS, 0.0)
        self._at = self.filter.newest = motion.time
        self.filter.restart(PlanarStart(
            motion.body[:2], self._axes(motion.time), min(gap, self._forgotten)))

    def add(self, span: tuple[int, int, int], last: Motion, motion: Motion,
            steps: Mapping[str, Step], adapt: bool) -> None:
        """
        Take one step.

        Parameters
        ----------
        span : tuple of 3 ints
            Times of its start, the measurement and its end [ns].
        last, motion : Motion
            At whose middles it begins and ends.
        steps : mapping
            Those of surge and sway, as far as they are identified.
        adapt : bool
            Whether the parameters are adapted.

        """
        any_step = next(iter(steps.values()))
        surge, sway = [steps.get(dof, STILL) for dof in DOFS]
        interval = any_step.interval
        heave = last.body[2] if interval else 0.5 * (last.body[2] + motion.body[2])
        # in the order of the fields: by their names it would take three times as long
        self.filter.step(PlanarStep(
            any_step.dt, last.body[:2], interval, any_step.parts, (surge.forces, sway.forces),
            motion.fix if interval else motion.body[:2],
            self._pieces(self._at, span[1], heave), self._axes(span[2]),
            self._attitude.noise_density,
            (self._regressors('surge', surge), self._regressors('sway', sway)),
            (surge.pieces, sway.pieces), (surge.each, sway.each)), adapt,
            self._pieces(span[1], span[2], heave) if is_long(any_step.parts[1]) else ())
        self._at, self.filter.newest = span[1], span[2]

    def _regressors(self, dof: str, step: Step) -> tuple[float, ...]:
        # the heading stands behind the others
        return (*[x for x, _ in step.couplings], *step.watched[:self._watched.get(dof, 0)])

    def _axes(self, time: int) -> tuple[float, float, float, float]:
        q = self._attitude.at(time)
        (a, b, _), (c, d, _) = rotate(q, (1.0, 0.0, 0.0)), rotate(q, (0.0, 1.0, 0.0))
        return a, b, c, d

    def _pieces(self, start: int, end: int, heave: float) -> tuple[PlanarPiece, ...]:
        """Return the attitude over equal parts of a span [ns]."""
        found = []
        for a, b in _parts(start, end):
            x, y, _ = rotate(self._attitude.at((a + b) // 2), (0.0, 0.0, heave))
            found.append(PlanarPiece(
                *self._axes((a + b) // 2), x, y,
                self._couplings.mean_rates(a, b)[2] if b > a else 0.0))
        return tuple(found)


def _parts(start: int, end: int) -> list[tuple[int, int]]:
    """Return equal parts of a span [ns], of at most ``LONGEST_PIECE`` each."""
    return equal_parts(start, end, max(math.ceil((end - start) / LONGEST_PIECE), 1))
