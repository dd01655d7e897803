"""The adaptive identifier with a thousand settings at once, scored on the blocks ahead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from rovid_core.identify.aid.adaptive_identifier import (
    Gains,
    INTEGRATORS,
    MAX_PIECES,
    piece_of_step,
    rates,
)
from rovid_core.identify.excitation import MIN_EXCITATION, MIN_MOTION
from rovid_core.model.lowpass import filtered
from rovid_core.model.samples import Step
from rovid_core.model.trajectory import Array
from rovid_core.settings.run import Scales
from rovid_core.trials.tuning.log import Stretch

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


def heun(a: Array, gamma: Sequence[Array], x: Sequence[Array], h: float,
         velocity: Sequence[Array], force: Array) -> list[Array]:
    """
    Return v_hat and parameters after a step of constant force.

    It is that of ``integrators``, with the terms that the two evaluations share taken once.
    """
    v, p0, p1, p2, p3 = x
    g0, g1, g2, g3 = gamma
    push, drag, dv = p0 * force + p3, v * np.abs(v), v - velocity[0]
    rate = a * dv + push + p1 * drag + p2 * v
    w = v + h * rate
    drag_w, dw = w * np.abs(w), w - velocity[2]
    pushed, dragged, moved = g0 * force, g1 * drag, g2 * v
    rate_w = a * dw + push + p1 * drag_w + p2 * w - h * dv * (
        pushed * force + dragged * drag_w + moved * w + g3)
    half = 0.5 * h
    e, f = half * dv, half * dw
    both = e + f
    return [v + half * (rate + rate_w), p0 - pushed * both,
            p1 - dragged * e - g1 * drag_w * f, p2 - moved * e - g2 * w * f, p3 - g3 * both]


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
        self._per_a = -2.0 / self._a
        self._gamma = [along([g.adaptation[i] if on else 0.0 for g in gains])
                       for i, on in enumerate(scales.active)]
        self._scale = [along([s.regressor[i] for s in own]) for i in range(4)]
        bounds = [s.bounds() for s in own]
        self._low, self._high = ([along([b[side][i] for b in bounds]) for i in range(4)]
                                 for side in range(2))
        self._time = np.array([[c.adaptation_time for c in candidates]])
        self._force = max(c.force for c in candidates)
        self._integrator = integrator
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
        noted: list[Array] = []
        self._most[:, 1:] = DIVIDED * len(trial.dt)
        marks = [int(k) for k in np.searchsorted(trial.end, np.array(times), 'right')]
        before, after, force = (np.ascontiguousarray(x.T)[:, :, None]
                                for x in (trial.before, trial.after, trial.force))
        middle, fastest = 0.5 * (before + after), np.maximum(np.abs(before), np.abs(after))
        with np.errstate(all='ignore'):  # what is left out may run away
            for k, dt in enumerate(trial.dt.tolist()):
                if k in marks:
                    noted += [np.stack(self._state[1:])] * marks.count(k)
                if trial.restarts[k]:
                    self._state[0] = np.broadcast_to(before[k], self._a.shape).copy()
                self._step(dt, (before[k], middle[k], after[k]), force[k], fastest[k])
        noted += [np.stack(self._state[1:])] * (len(times) - len(noted))
        return np.where(self._divided <= self._most, np.stack(noted), np.nan)

    def _step(self, dt: float, velocity: tuple[Array, ...], force: Array,
              fastest: Array) -> None:
        gamma = list(self._gamma)
        scaled = force * self._scale[0]
        square = scaled * scaled
        if float(np.abs(force).min()) ** 2 < MIN_EXCITATION * self._force**2:
            rest = (self._excitation < MIN_EXCITATION) & (square < MIN_EXCITATION) & (
                (self._state[0] * self._scale[2]) ** 2 < MIN_MOTION)
            gamma[1], gamma[2] = gamma[1] * ~rest, gamma[2] * ~rest
        turns = self._turns(dt, fastest, force, gamma)
        state = self._piece(
            self._a, gamma, self._state, self._low, self._high, dt, velocity, force)
        divided = (turns >= 1.0) & (self._divided <= self._most)
        noted = -np.expm1(-dt / self._time)
        if divided.any():
            self._divided += divided
            self._divide(divided, turns, dt, velocity, force, gamma, state)
            noted = np.where(turns > MAX_PIECES, 0.0, noted)
        self._excitation += noted * (square - self._excitation)
        self._state = state

    def _piece(self, a: Array, gamma: Sequence[Array], state: Sequence[Array],
               low: Sequence[Array], high: Sequence[Array], dt: float,
               velocity: Sequence[Array], force: Array) -> list[Array]:
        if self._integrator == 'heun':
            v_hat, *parameters = heun(a, gamma, state, dt, velocity, force)
        else:
            v_hat, *parameters = cast(Any, INTEGRATORS[self._integrator])(
                a, gamma, state, Step(dt, cast(Any, velocity), cast(Any, (force,) * 3)), rates)
        return [v_hat, *(np.minimum(np.maximum(p, bottom), top)
                         for p, bottom, top in zip(parameters, low, high))]

    def _turns(self, dt: float, fastest: Array, force: Array, gamma: Sequence[Array]) -> Array:
        """Return how stiff a step is, as ``AdaptiveIdentifier`` does."""
        v_hat, alpha, beta, drag, delta = self._state
        speed = dt * (alpha * np.abs(force) + np.abs(delta)) + np.maximum(
            np.abs(v_hat), fastest)
        square = speed * speed
        adaptation = (gamma[0] * (force * force) + (gamma[1] * square + gamma[2]) * square
                      + gamma[3])
        # alpha is above 0, and beta and gamma are not
        feedback = -2.0 * beta * speed - drag - self._a
        return np.asarray(dt * np.maximum(feedback, adaptation * self._per_a))

    def _divide(self, which: NDArray[np.bool_], turns: Array, dt: float, velocity: Sequence[Array],
                force: Array, gamma: Sequence[Array], state: Sequence[Array]) -> None:
        """Take the step again in pieces where it is too stiff."""
        def chosen(values: Sequence[Array]) -> list[Array]:
            return [np.broadcast_to(x, which.shape)[mask] for x in values]

        number = turns.astype(int) + 1
        for count in np.unique(number[which]).tolist():
            mask = number == count
            own, v, (f,) = chosen(self._state), chosen(velocity), chosen([force])
            if count > MAX_PIECES:
                own[0] = v[2]
            else:
                fixed = (chosen([self._a])[0], chosen(gamma))
                bounds = chosen(self._low), chosen(self._high)
                whole = Step(dt, cast(Any, v), cast(Any, (f,) * 3))
                for k in range(count):
                    piece = piece_of_step(whole, k, count)
                    own = self._piece(
                        *fixed, own, *bounds, piece.dt, cast(Any, piece.velocity), f)
            for column, values in zip(state, own):
                column[mask] = values
