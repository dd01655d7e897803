"""The adaptive identifier online: gains from the data, and a mean of what it finds."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

import numpy as np
from rovid_core.identify.aid.adaptive_identifier import Gains
from rovid_core.identify.aid.full_gain import CoupledIdentifier, inverse
from rovid_core.identify.excitation import (
    LEAST_EXCITATION,
    LEAST_MOTION,
    LOT,
    NO_SUMS,
    summed,
    Sums,
)
from rovid_core.model.samples import finite, Step
from rovid_core.settings.scales import Scales

FIRST = 20.0
"""[s] of motion after which Gamma is taken from the data; then whenever that has doubled."""

LEAST_SHARE = 0.03
"""Of a mean square, that the others leave of it: a direction with less is slower."""

LEAST_SQUARES = (LEAST_EXCITATION, LEAST_MOTION**2, LEAST_MOTION, 1.0)
"""Of the regressors, in typical ones: what is smaller is mostly noise."""

REFUSED = 5
"""Steps refused in a row after which what Gamma was learned from is forgotten."""

FAR_OFF = 1000.0
"""A force or velocity of so many typical ones says nothing about what is usual."""

SHARE = 0.3
"""Memory of the mean, in times adapted so far."""

MEMORY = 40.0
"""Longest memory of the mean [s], so that a vehicle that changes is followed."""


class AveragedIdentifier(CoupledIdentifier):
    """
    The adaptive identifier with gains from the data, which publishes a mean of theta_hat.

    *Gains.* Gamma is |a| / 2 T times the inverse of the mean phi phi' of the data so far: the
    gain that T gives a sinusoid of typical amplitude, whose mean square is 1/2. So every
    combination of the parameters that the data show settles alike, in about 2 T, whatever
    typical sizes were given. These count until ``FIRST`` seconds of motion are known, and as the
    least that a mean square is taken for. Gamma is learned then and whenever that time has
    doubled, and held between. While it is held W never grows; a new Gamma measures W anew.
    Data at rest, while frozen and of refused steps are not learned from. Thrust far beyond all
    that Gamma was learned from makes steps unstable; then the typical sizes stand in again.

    *Mean.* theta_hat follows the noise of the velocity for ever. What is published,
    ``parameters``, is its running mean, with a memory of ``SHARE`` of the time in motion, at
    most ``MEMORY``. v_hat and W are those of ``theta_hat``. At rest only delta is seen, so
    the mean of the others stays.

    Parameters
    ----------
    scales : Scales
        Initial parameters, terms and typical sizes.
    adaptation_time : float
        T [s]; theta_hat settles (1/e) in about 2 T.
    integrator : str
        As in ``AdaptiveIdentifier``.

    """

    def __init__(self, scales: Scales, adaptation_time: float, integrator: str) -> None:
        gains = Gains.from_time(adaptation_time, scales)
        self._most_force, self._most_velocity = FAR_OFF * scales.force, FAR_OFF * scales.velocity
        self._start = np.diag([
            g if on else 0.0 for g, on in zip(gains.adaptation, scales.active)])
        super().__init__(scales, -gains.feedback, self._start, integrator)
        g = self._start.diagonal().tolist()
        self._resting = (g[0], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, g[3])
        self.adaptation_time = adaptation_time

    def reset(self) -> None:
        """Go back to the initial values and gains."""
        super().reset()
        self._refused = 0  # in a row
        self._forget()

    def _forget(self) -> None:
        """Begin to learn Gamma."""
        self._sums: Sums = NO_SUMS  # of phi phi' dt
        self._new: list[Step] = []  # steps that are not in there yet
        self._time = 0.0  # of all of them [s]
        self._next = FIRST
        self._couple(self._start)

    def step(self, step: Step, adapt: bool = True) -> str:
        """Take one step; see ``AdaptiveIdentifier``."""
        refused = super().step(step, adapt)
        if not refused:
            self._refused = 0
        elif adapt:
            self._refused += 1
            if self._refused == REFUSED:
                self._forget()
        return refused

    def retune(self, adaptation_time: float) -> None:
        """Take another T [s]; what Gamma has learned of the data stays."""
        before = -self._a / self.adaptation_time
        self._a = Gains.from_time(adaptation_time, self._scales).feedback
        self.adaptation_time = adaptation_time
        factor = -self._a / adaptation_time / before  # Gamma goes with |a| / T
        self._start = factor * self._start
        self._resting = tuple([factor * g for g in self._resting])
        self._couple(factor * np.array(self._rows))

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {**super().state(), 'parameters': list(self.parameters),
                'theta_hat': list(self.theta_hat), 'gamma': [list(row) for row in self._rows],
                'sums': list(self._summed()), 'next': self._next}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        gamma = np.array(state['gamma'], dtype=float)
        sums = [float(x) for x in state['sums']]
        after = float(state['next'])
        if gamma.shape != (4, 4) or len(sums) != 10:
            raise ValueError('gamma or sums have the wrong length')
        if not (np.isfinite(gamma).all() and (gamma == gamma.T).all()
                and (np.diag(gamma) >= 0.0).all()):
            raise ValueError('gamma is not that of an identifier')
        if not (finite(tuple(sums)) and 0.0 <= sums[9] < after < math.inf):
            raise ValueError('sums or next are out of range')
        published = self._allowed(state['parameters'])
        super().restore({**state, 'parameters': state['theta_hat']})
        self.parameters = published
        self._sums, self._new = tuple(sums), []
        self._time, self._next = sums[9], after
        self._couple(gamma)

    def _adapted(self, step: Step, rest: bool) -> None:
        dt, velocity, force = step[:3]
        time, new = self._time, self._new
        if not rest and (abs(force[1]) <= self._most_force
                         and abs(velocity[1]) <= self._most_velocity):
            time = self._time = time + dt
            new.append(step)
            if len(new) == LOT:
                self._summed()
        memory = SHARE * (time if time > dt else dt)
        share = dt / (dt + (memory if memory < MEMORY else MEMORY))
        a, b, c, d = self.parameters
        p, q, r, s = self.theta_hat
        d += share * (s - d)
        self.parameters = (a, b, c, d) if rest else (
            a + share * (p - a), b + share * (q - b), c + share * (r - c), d)
        if time >= self._next:
            self._learn()

    def _summed(self) -> Sums:
        self._sums = summed(self._sums, self._new)
        self._new.clear()
        return self._sums

    def _learn(self) -> None:
        """Take Gamma from the data so far."""
        mean = np.zeros((4, 4))
        mean[np.triu_indices(4)] = np.array(self._summed()) / self._time
        mean += np.triu(mean, 1).T
        gamma = -0.5 * self._a / self.adaptation_time * inverse(
            mean, self._scales, LEAST_SQUARES, LEAST_SHARE)
        self._couple(0.5 * (gamma + gamma.T))
        self._next = 2.0 * self._time
