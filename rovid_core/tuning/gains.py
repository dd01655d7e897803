"""The adaptive identifier with a thousand settings at once, scored on the blocks ahead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from rovid_core.aid import Gains, MOST_PIECES
from rovid_core.excitation import LEAST_EXCITATION, LEAST_MOTION
from rovid_core.identifier import Scales, Step
from rovid_core.integrators import INTEGRATORS, part
from rovid_core.lowpass import filtered
from rovid_core.recurrence import Array
from rovid_core.tuning.log import Stretch

NS = 1e-9
DIVIDED = 0.005
"""A candidate that has to divide more of its steps than this is too fast for the data."""


@dataclass(frozen=True)
class Candidate:
    """Settings of the identifier on one DOF."""

    adaptation_time: float  # [s]
    force: float  # typical [N or N m]
    velocity: float  # typical [m/s or rad/s]


@dataclass(frozen=True)
class Steps:
    """
    A trial as the identifier steps through it, for each of some cutoffs.

    Attributes
    ----------
    dt : ndarray, shape (n,)
        [s]
    end : ndarray of int64, shape (n,)
        [ns]
    restarts : ndarray of bool, shape (n,)
        Whether v_hat is taken from the measurement before this step.
    before, after, force : ndarray, shape (rows, n)
        Filtered velocity at start and end, filtered mean force.

    """

    dt: Array
    end: Array
    restarts: Array
    before: Array
    after: Array
    force: Array


def steps(stretches: Sequence[Stretch], impulse: Sequence[Array],
          cutoffs: Sequence[float]) -> Steps:
    """
    Return the steps of a trial; ``impulse`` is that at the bounds of each stretch's steps.

    The low-pass is that of the pipe.
    """
    columns: list[tuple[NDArray[Any], ...]] = []
    for stretch, total in zip(stretches, impulse):
        dt = np.diff(stretch.bounds) * NS
        velocity = np.concatenate([[stretch.velocity], stretch.means])
        spans = np.concatenate([[0.0], dt])
        v = np.stack([filtered(f, spans, velocity) for f in cutoffs])
        force = np.stack([filtered(f, dt, np.diff(total) / dt) for f in cutoffs])
        columns.append((dt, stretch.ends, np.arange(len(dt)) == 0, v[:, :-1], v[:, 1:], force))
    return Steps(*(np.concatenate(column, axis=-1) for column in zip(*columns)))


class GainSweep:
    """
    ``AdaptiveIdentifier`` for many settings, in vectors over them.

    Parameters
    ----------
    scales : Scales
        Initial values and terms of the DOF.
    rows : int
        Number of rows of the ``Steps``, such as one per cutoff.
    candidates : sequence of Candidate
        Each is combined with each row; the first, which is in use, is always carried through.
    integrator : str
        Of the identifier.

    """

    def __init__(self, scales: Scales, rows: int, candidates: Sequence[Candidate],
                 integrator: str) -> None:
        shape = (rows, len(candidates))
        own = [Scales(c.force, c.velocity, scales.initial, scales.active) for c in candidates]
        gains = [Gains.from_time(c.adaptation_time, s) for c, s in zip(candidates, own)]

        def along(values: Sequence[float]) -> Array:
            return np.broadcast_to(np.array(values), shape).copy()

        self._a = along([g.feedback for g in gains])
        self._gamma = [along([g.adaptation[i] if on else 0.0 for g in gains])
                       for i, on in enumerate(scales.active)]
        self._scale = [along([s.regressor[i] for s in own]) for i in range(4)]
        bounds = [s.bounds() for s in own]
        self._low, self._high = ([along([b[side][i] for b in bounds]) for i in range(4)]
                                 for side in range(2))
        self._time = np.array([[c.adaptation_time for c in candidates]])
        self._force = max(c.force for c in candidates)
        self._advance = cast(Any, INTEGRATORS[integrator])
        self._state = [np.zeros(shape), *(along([p] * shape[1]) for p in scales.initial)]
        self._excitation = np.zeros(shape)
        self._divided = np.zeros(shape)
        self._most = np.full(shape, np.inf)  # steps that may be divided

    def run(self, trial: Steps, times: Sequence[float]) -> Array:
        """
        Go through a trial.

        Parameters
        ----------
        trial : Steps
            With as many rows.
        times : sequence of float
            When the parameters are noted [ns], increasing.

        Returns
        -------
        ndarray, shape (len(times), 4, rows, candidates)
            NaN for candidates that the steps are too long for.

        """
        noted = []
        self._most[:, 1:] = DIVIDED * len(trial.dt)
        marks = [int(k) for k in np.searchsorted(trial.end, np.array(times), 'right')]
        before, after, force = (np.ascontiguousarray(x.T)[:, :, None]
                                for x in (trial.before, trial.after, trial.force))
        middle = 0.5 * (before + after)
        with np.errstate(all='ignore'):  # what is left out may run away
            for k, dt in enumerate(trial.dt.tolist()):
                noted += [np.stack(self._state[1:])] * marks.count(k)
                if trial.restarts[k]:
                    self._state[0] = np.broadcast_to(before[k], self._a.shape).copy()
                self._step(dt, (before[k], middle[k], after[k]), force[k])
        noted += [np.stack(self._state[1:])] * (len(times) - len(noted))
        return np.where(self._divided <= self._most, np.stack(noted), np.nan)

    def _step(self, dt: float, velocity: tuple[Array, ...], force: Array) -> None:
        gamma = list(self._gamma)
        scaled = force * self._scale[0]
        square = scaled * scaled
        if float(np.abs(force).min()) ** 2 < LEAST_EXCITATION * self._force**2:
            rest = (self._excitation < LEAST_EXCITATION) & (square < LEAST_EXCITATION) & (
                (self._state[0] * self._scale[2]) ** 2 < LEAST_MOTION)
            gamma[1], gamma[2] = gamma[1] * ~rest, gamma[2] * ~rest
        turns = self._turns(dt, velocity, force, gamma)
        state = self._piece(self._a, gamma, self._state, self._low, self._high, Step(
            dt, cast(Any, velocity), cast(Any, (force,) * 3)))
        divided = (turns >= 1.0) & (self._divided <= self._most)
        noted = -np.expm1(-dt / self._time)
        if divided.any():
            self._divided += divided
            self._divide(divided, turns, dt, velocity, force, gamma, state)
            noted = np.where(turns > MOST_PIECES, 0.0, noted)
        self._excitation += noted * (square - self._excitation)
        self._state = state

    def _piece(self, a: Array, gamma: Sequence[Array], state: Sequence[Array],
               low: Sequence[Array], high: Sequence[Array], step: Step) -> list[Array]:
        v_hat, *parameters = self._advance(a, gamma, state, step)
        return [v_hat, *(np.minimum(np.maximum(p, bottom), top)
                         for p, bottom, top in zip(parameters, low, high))]

    def _turns(self, dt: float, velocity: Sequence[Array], force: Array,
               gamma: Sequence[Array]) -> Array:
        """Return how stiff a step is, as ``AdaptiveIdentifier`` does."""
        v_hat, alpha, beta, drag, delta = self._state
        gain = np.abs(alpha * force) + np.abs(delta)
        speed = dt * gain + np.maximum(
            np.abs(v_hat), np.maximum(np.abs(velocity[0]), np.abs(velocity[2])))
        square = speed * speed
        adaptation = (gamma[0] * (force * force) + (gamma[1] * square + gamma[2]) * square
                      + gamma[3])
        feedback = 2.0 * np.abs(beta) * speed + np.abs(drag) - self._a
        return np.asarray(dt * np.maximum(feedback, adaptation * (-2.0 / self._a)))

    def _divide(self, which: NDArray[np.bool_], turns: Array, dt: float, velocity: Sequence[Array],
                force: Array, gamma: Sequence[Array], state: Sequence[Array]) -> None:
        """Take the step again in pieces where it is too stiff."""
        def chosen(values: Sequence[Array]) -> list[Array]:
            return [np.broadcast_to(x, which.shape)[mask] for x in values]

        number = turns.astype(int) + 1
        for count in np.unique(number[which]).tolist():
            mask = number == count
            own, v, (f,) = chosen(self._state), chosen(velocity), chosen([force])
            if count > MOST_PIECES:
                own[0] = v[2]
            else:
                fixed = (chosen([self._a])[0], chosen(gamma))
                bounds = chosen(self._low), chosen(self._high)
                whole = Step(dt, cast(Any, v), cast(Any, (f,) * 3))
                for k in range(count):
                    own = self._piece(*fixed, own, *bounds, part(whole, k, count))
            for column, values in zip(state, own):
                column[mask] = values
