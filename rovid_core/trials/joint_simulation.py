"""
Several degrees of freedom simulated together, each driven by the velocities of the others.

A row's own score takes the velocities of the other DOFs as they were measured. A simulator or a
controller has none of these: it predicts all rows at once, and that is what is done here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import math
from typing import NamedTuple

from rovid_core.model.dofs import OWN, own_coefficients, velocity_factors
from rovid_core.model.plant import MAX_PIECES, MAX_VELOCITY, runge_kutta
from rovid_core.model.samples import NS

Rates = Callable[[Sequence[float]], list[float]]


class ForceSegment(NamedTuple):
    """
    A time over which thrust and measured regressors of one DOF are constant.

    Attributes
    ----------
    end : int
        [ns]; it begins at the end of the segment before.
    force : float
        [N or N m]
    regressors : tuple of float
        Measured ones of the DOF's couplings.
    begins : float or None
        The velocity [m/s or rad/s] with which a run begins at ``end``; the DOF is not known
        before that, and ``force`` and ``regressors`` mean nothing.
    slowing : float
        How much of the thrust is lost per velocity.

    """

    end: int
    force: float = 0.0
    regressors: tuple[float, ...] = ()
    begins: float | None = None
    slowing: float = 0.0


class JointModel:
    """
    The rows of all DOFs.

    A regressor is formed of simulated velocities while all of its factors are simulated;
    otherwise, and for the restoring terms of the attitude, the measured one is taken. Those of
    ``OWN`` are formed of the row's own force and velocity.

    Parameters
    ----------
    dofs : sequence of str
        Names of the rows.
    parameters : sequence
        alpha, beta, gamma, delta and the couplings of each row.
    couplings : sequence of tuple of str
        Names of the couplings of each row.

    """

    def __init__(self, dofs: Sequence[str], parameters: Sequence[Sequence[float]],
                 couplings: Sequence[tuple[str, ...]]) -> None:
        self._rows = [(row[0], row[1], row[2], row[3]) for row in parameters]
        # of every coupling of a row: kappa, and the rows whose velocities are its factors
        self._terms: list[list[tuple[float, tuple[int, ...]]]] = [
            [(0.0 if name in OWN else kappa, _rows_of(velocity_factors(name), dofs))
             for kappa, name in zip(row[4:], names)]
            for row, names in zip(parameters, couplings)]
        self._own = [own_coefficients(names, row[4:])
                     for row, names in zip(parameters, couplings)]
        self._lost = False

    def simulate(self, segments: Sequence[Iterator[ForceSegment]]) -> Iterator[tuple[int, float]]:
        """
        Yield the number of a row and its velocity at the end of each of its segments.

        Those of one row come in their order. After a divergence all of them are infinite.

        Parameters
        ----------
        segments : sequence of iterators
            Of each row, in the order of time.

        """
        count = len(segments)
        velocity = [0.0] * count
        known = [False] * count
        following = [next(row, None) for row in segments]
        now = 0
        while ends := [row.end for row in following if row is not None]:
            time = min(ends)
            if time > now and any(known):
                self._advance(velocity, known, following, (time - now) * NS)
            now = time
            for i, rows in enumerate(segments):
                segment = following[i]
                while segment is not None and segment.end == now:
                    if segment.begins is not None:
                        velocity[i] = segment.begins
                    else:
                        yield i, math.inf if self._lost else velocity[i]
                    segment = next(rows, None)
                    known[i] = segment is not None and segment.begins is None
                following[i] = segment

    def _advance(self, velocity: list[float], known: Sequence[bool],
                 segments: Sequence[ForceSegment | None], dt: float) -> None:
        """Move the known velocities on by classical Runge-Kutta."""
        if self._lost:
            return
        rates = self._rates(known, segments)
        fastest = max(2.0 * max(abs(beta), abs(beta + reverse)) * abs(v) + abs(gamma)
                      for (_, beta, gamma, _), (_, reverse), v, on in zip(
                          self._rows, self._own, velocity, known) if on)
        pieces = min(int(fastest * dt), MAX_PIECES) + 1
        v = velocity
        for _ in range(pieces):
            v = runge_kutta(rates, v, dt / pieces)
            if not all(abs(x) < MAX_VELOCITY for x in v):
                self._lost = True
                return
        velocity[:] = v

    def _rates(self, known: Sequence[bool], segments: Sequence[ForceSegment | None]) -> Rates:
        """Return the accelerations as a function of the velocities, 0 in rows not known."""
        rows: list[tuple[int, float, float, float, float]] = []
        products: list[tuple[int, float, tuple[int, ...]]] = []
        for i, segment in enumerate(segments):
            if segment is None or not known[i]:
                continue
            alpha, beta, gamma, delta = self._rows[i]
            weaker, reverse = self._own[i]
            drive = alpha * segment.force + weaker * min(segment.force, 0.0) + delta
            for (kappa, factors), measured in zip(self._terms[i], segment.regressors):
                if factors and all(known[j] for j in factors):
                    products.append((i, kappa, factors))
                else:
                    drive += kappa * measured
            rows.append((i, drive, beta, min(beta + reverse, 0.0) if reverse else beta,
                         gamma - alpha * segment.slowing))

        def rates(v: Sequence[float]) -> list[float]:
            found = [0.0] * len(v)
            for i, drive, ahead, astern, gamma in rows:
                found[i] = drive + ((astern if v[i] < 0.0 else ahead) * abs(v[i]) + gamma) * v[i]
            for i, kappa, factors in products:
                for j in factors:
                    kappa *= v[j]
                found[i] += kappa
            return found

        return rates


def _rows_of(needed: Sequence[str], dofs: Sequence[str]) -> tuple[int, ...]:
    """Return the numbers of some DOFs among the rows; () if not all of them are there."""
    return tuple([dofs.index(dof) for dof in needed]) if set(needed) <= set(dofs) else ()
