"""The adaptive identifier online: Gamma from the data, and a running mean of the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, Final

import numpy as np
from rovid_core.identify.aid.adaptive_identifier import Gains
from rovid_core.identify.aid.full_gain import FullGainIdentifier, inverse_gram
from rovid_core.identify.excitation import (
    add_products,
    BATCH,
    MIN_EXCITATION,
    MIN_MOTION,
    NO_SUMS,
    Sums,
)
from rovid_core.model.samples import finite, Step
from rovid_core.settings.run import Scales

# Time under thrust [s] after which Gamma is first taken from the data; then whenever it doubles.
FIRST_LEARNED: Final = 20.0
# Least share of a mean square that the other regressors are taken to leave unexplained.
MIN_SHARE: Final = 0.03
# Least mean squares of the regressors, in typical ones; smaller ones are mostly noise.
MIN_SQUARES = (MIN_EXCITATION, MIN_MOTION**2, MIN_MOTION, 1.0)
MIN_COUPLED = MIN_MOTION**2  # the same of couplings, which are products of velocities
# Steps with more than so many typical forces or velocities are left out of Gamma.
MAX_TYPICAL: Final = 1000.0
MEAN_SHARE: Final = 0.3  # memory of the running mean, as a share of the time under thrust
# Longest memory of the running mean [s], so that it follows a vehicle that changes.
MAX_MEMORY: Final = 40.0


class SelfTuningIdentifier(FullGainIdentifier):
    """
    The adaptive identifier with gains from the data, which publishes a mean of theta_hat.

    *Gains.* Gamma is |a| / 2 T times the inverse of the mean of phi phi' over the data so far:
    the gain that T gives for a sinusoid of typical amplitude, whose mean square is 1/2. Thus
    every combination of parameters that the data show settles in about 2 T, whatever typical
    sizes were configured. The typical sizes determine Gamma for the first ``FIRST_LEARNED``
    seconds of thrust, and give the least mean squares later. Gamma is computed then and
    whenever the time under thrust has doubled, and is constant in between. While it is constant
    W never grows; a new Gamma redefines W. Data without thrust, while frozen, and of refused
    steps do not count.

    *Mean.* theta_hat never stops to follow the noise of the velocity. The published parameters
    and couplings are its running mean, with a memory of ``MEAN_SHARE`` of the time under
    thrust, at most ``MAX_MEMORY``. v_hat and W belong to ``theta_hat``.

    Parameters
    ----------
    adaptation_time : float
        T [s]; theta_hat settles (1/e) in about 2 T.

    """

    def __init__(self, scales: Scales, adaptation_time: float) -> None:
        gains = Gains.from_time(adaptation_time, scales)
        self._max_force = MAX_TYPICAL * scales.force
        self._max_velocity = MAX_TYPICAL * scales.velocity
        active = (*scales.active, *(True for _ in scales.couplings))
        self._start = np.diag([g if on else 0.0 for g, on in zip(gains.adaptation, active)])
        super().__init__(scales, -gains.feedback, self._start)
        self.adaptation_time = adaptation_time

    def reset(self) -> None:
        """Return to the initial values and gains."""
        super().reset()
        self._sums: Sums = (*NO_SUMS, *(
            0.0 for j in range(len(self._scales.couplings)) for _ in range(5 + j)))
        self._new: list[Step] = []  # steps that are not in the sums yet
        self._time = 0.0  # of all steps that count [s]
        self._next = FIRST_LEARNED
        self._set_gamma(self._start)

    def retune(self, adaptation_time: float) -> None:
        """Change T [s]; the data that Gamma comes from stay."""
        before = -self._a / self.adaptation_time
        self._a = Gains.from_time(adaptation_time, self._scales).feedback
        self.adaptation_time = adaptation_time
        factor = -self._a / adaptation_time / before  # Gamma goes with |a| / T
        self._start = factor * self._start
        self._set_gamma(factor * np.array(self._rows))

    def state(self) -> dict[str, Any]:
        """Return all that is needed to continue from here."""
        return {**super().state(), 'gamma': [list(row) for row in self._rows],
                'sums': list(self._add_new()), 'next': self._next}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``; raise ValueError if it does not fit."""
        gamma = np.array(state['gamma'], dtype=float)
        sums = tuple([float(x) for x in state['sums']])
        after = float(state['next'])
        if gamma.shape != self._start.shape or len(sums) != len(self._sums):
            raise ValueError('gamma or sums have the wrong length')
        if not (np.isfinite(gamma).all() and (gamma == gamma.T).all()
                and (np.diag(gamma) >= 0.0).all()):
            raise ValueError('gamma is not that of an identifier')
        if not (finite(sums) and 0.0 <= sums[9] < after < math.inf):
            raise ValueError('sums or next are out of range')
        super().restore(state)
        self._sums, self._new = sums, []
        self._time, self._next = sums[9], after
        self._set_gamma(gamma)

    def _publish(self, step: Step, idle: bool) -> None:
        if idle:
            return
        dt, time, new = step.dt, self._time, self._new
        if (abs(step.force[1]) <= self._max_force
                and abs(step.velocity[1]) <= self._max_velocity):
            time = self._time = time + dt
            new.append(step)
            if len(new) == BATCH:
                self._add_new()
        memory = MEAN_SHARE * (time if time > dt else dt)
        share = dt / (dt + (memory if memory < MAX_MEMORY else MAX_MEMORY))
        a, b, c, d = self.parameters
        p, q, r, s, *others = self.theta_hat
        self.parameters = (a + share * (p - a), b + share * (q - b), c + share * (r - c),
                           d + share * (s - d))
        if others:
            self.couplings = tuple([k + share * (x - k) for k, x in zip(self.couplings, others)])
        if time >= self._next:
            self._learn_gamma()

    def _add_new(self) -> Sums:
        self._sums = (*add_products(self._sums[:10], self._new),
                      *add_coupled_products(self._sums[10:], self._new))
        self._new.clear()
        return self._sums

    def _learn_gamma(self) -> None:
        """Compute Gamma from the data so far."""
        sums = np.array(self._add_new()) / self._time
        mean = np.zeros(self._start.shape)
        mean[np.triu_indices(4)] = sums[:10]
        # those of the couplings go column by column
        rows, columns = np.triu_indices(len(mean))
        order = np.lexsort((rows, columns))[10:]
        mean[rows[order], columns[order]] = sums[10:]
        mean += np.triu(mean, 1).T
        least = (*MIN_SQUARES, *(MIN_COUPLED for _ in self._scales.couplings))
        gamma = -0.5 * self._a / self.adaptation_time * inverse_gram(
            mean, self._scales, least, MIN_SHARE)
        self._set_gamma(0.5 * (gamma + gamma.T))
        self._next = 2.0 * self._time


def add_coupled_products(sums: Sums, steps: Sequence[Step]) -> Sums:
    """
    Return the sums of phi x dt with those of some steps added, of every coupling's x.

    Those of the first coupling are with tau, v|v|, v, 1 and itself, those of the second with
    these and itself, and so on.
    """
    if not sums:
        return sums
    total = list(sums)
    for step in steps:
        velocity, phi_dt, i = step.velocity[1], [], 0
        for y in (step.force[1], velocity * abs(velocity), velocity, 1.0,
                  *step.filtered_couplings):
            phi_dt.append(y * step.dt)
        for j, x in enumerate(step.filtered_couplings):
            for y in phi_dt[:5 + j]:
                total[i] += x * y
                i += 1
    return tuple(total)
