"""What a model predicts without corrections, from the beginning of each block of data."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any, Final

from rovid_core.identify.ekf.single.delayed_force import DelayedForce
from rovid_core.identify.ekf.single.linearised_filter import floats, LinearisedFilter, NONE_OWN
from rovid_core.identify.ekf.single.measurements import Measurement

SPAN: Final = 1.0
"""[s] over which velocities are taken from the path."""

LEAST_STEP: Final = 0.15
"""[s] The model does not need smaller ones."""

KEPT: Final = 6
"""Blocks that the fit is taken over."""


def predicted(fit: float) -> str:
    """Return what is said of a fit that does not suffice."""
    if fit == -math.inf:
        return 'the motion is less than the noise of its measurements: push harder and longer'
    return f'without corrections it predicts {100.0 * max(fit, 0.0):.0f} % of the motion'


def fit_of(count: float, error: float, total: float, square: float) -> float:
    """
    Return 1 - rms(error) / std(measured) of velocities, -inf where they do not vary.

    ``error`` is the sum of the squared errors, ``total`` and ``square`` are those of what was
    measured and of its squares.
    """
    variance = square - total * total / count if count else 0.0
    return 1.0 - math.sqrt(max(error, 0.0) / variance) if variance > 0.0 else -math.inf


class FreePrediction:
    """
    A model that runs beside the filter and is set to its state at the end of each block.

    Parameters
    ----------
    own : tuple of 2 ints
        As of a ``LinearisedFilter``.

    Attributes
    ----------
    fit : float
        1 - rms(error) / std(measured) of the velocity over the last blocks.

    """

    def __init__(self, own: tuple[int, int]) -> None:
        self._thrust, self._drag = own
        self._has_own = own != NONE_OWN
        self.fit = -math.inf
        self._theta: list[float] = []
        self._time = -1.0  # [s] of the last comparison
        self._motion = (0.0, 0.0)
        self._mark: list[float] = []  # time, path of the model, measured path
        self._sums = [0.0] * 4
        self._blocks: list[list[float]] = []

    def interrupt(self) -> None:
        """Wait for the end of the block: the path begins anew."""
        self._theta, self._mark, self._time = [], [], -1.0

    def move(self, recent: DelayedForce, span: Measurement) -> None:
        """Go on to the next measurement and compare."""
        if not self._theta:
            return
        if self._time < 0.0:
            self._time = span.start
        h = span.end - self._time
        if h < LEAST_STEP:
            return
        start, self._time = self._time, span.end
        push = self._theta[3]
        if span.couplings:
            push += math.fsum([kappa * one for kappa, one in zip(self._theta[4:], span.couplings)])
        self._motion = x, v = self._moved(recent, start, h, push)
        if not abs(v) < 1e6:
            self.interrupt()
            return
        if span.value is None:
            return
        if span.i:
            self._add(v, span.value)
        elif not self._mark:
            self._mark = [span.end, x, span.value]
        elif span.end - self._mark[0] >= SPAN:
            time, model, measured = self._mark
            dt = span.end - time
            self._add((x - model) / dt, (span.value - measured) / dt)
            self._mark = [span.end, x, span.value]

    def _moved(self, recent: DelayedForce, start: float, h: float,
               push: float) -> tuple[float, float]:
        """Return path and velocity after ``h`` [s] of the force and of a constant push."""
        theta = self._theta
        alpha, beta, gamma, delay = theta[0], theta[1], theta[2], theta[-1]
        x, v = self._motion
        pieces = min(int(h * max(2.0 * abs(beta * v) + abs(gamma), 3.0)), 50) + 1
        h /= pieces
        for k in range(pieces):
            begin, end = start + k * h, start + (k + 1) * h
            impulse, _, _, _ = recent.over(begin, end, delay)
            u = alpha * impulse / h + push
            drag = beta
            if self._has_own:
                astern, _ = recent.bent(begin, end, delay)
                u += self._of(self._thrust) * astern[0] / h
                drag = min(beta + self._of(self._drag if v < 0.0 else -1), 0.0)
            w = v + 0.5 * h * (u + (drag * abs(v) + gamma) * v)
            x += h * w
            v += h * (u + (drag * abs(w) + gamma) * w)
        return x, v

    def _of(self, i: int) -> float:
        return self._theta[i] if i >= 0 else 0.0

    def _add(self, model: float, measured: float) -> None:
        sums, error = self._sums, model - measured
        sums[0] += 1.0
        sums[1] += error * error
        sums[2] += measured
        sums[3] += measured * measured

    def end_block(self, filter: LinearisedFilter) -> None:
        """Take the fit of the block and begin the next one at the state of a filter."""
        self._blocks = [*self._blocks, self._sums][-KEPT:]
        self._sums = [0.0] * 4
        self._compare()
        self._theta, self._motion = filter.theta, filter.motion[:2]
        self._mark, self._time = [], -1.0

    def _compare(self) -> None:
        self.fit = fit_of(*[math.fsum(column) for column in zip(*self._blocks)])

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'theta': self._theta, 'motion': list(self._motion), 'mark': self._mark,
                'at': self._time, 'sums': list(self._sums), 'blocks': self._blocks}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        self._theta = floats(state['theta'], len(state['theta']))
        x, v = floats(state['motion'], 2)
        self._motion, self._sums = (x, v), floats(state['sums'], 4)
        self._mark = floats(state['mark'], len(state['mark']))
        self._time, = floats([state['at']], 1)
        self._blocks = [floats(row, 4) for row in state['blocks']]
        if 0 < len(self._theta) < 5 or len(self._mark) not in (0, 3):
            raise ValueError('a prediction that does not fit')
        if self._blocks:
            self._compare()
