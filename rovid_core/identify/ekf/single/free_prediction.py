"""What a model predicts without corrections, from the beginning of each block of data."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any, Final

from rovid_core.identify.ekf.single.delayed_force import DelayedForce
from rovid_core.identify.ekf.single.linearised_filter import LinearisedFilter, NONE_OWN
from rovid_core.identify.ekf.single.measurements import Measurement
from rovid_core.identify.method import floats
from rovid_core.model.thrusters import AS_CONFIGURED, Thrusters

SPAN: Final = 1.0
"""[s] over which velocities are taken from the path."""

LEAST_STEP: Final = 0.15
"""[s] The model does not need smaller ones."""

KEPT: Final = 6
"""Blocks that the fit is taken over."""

HELD_FIT = (0.5, 0.35)  # mypyc would take a Final tuple of floats to be missing
"""Fit above which a model comes into use, and above which it stays in use."""


def predicted(fit: float) -> str:
    """Return what is said of a model that was not to be used when that was judged last."""
    if fit > HELD_FIT[0]:
        return 'what spoke against it some seconds ago does no more: drive on'
    if fit == -math.inf:
        return 'the motion is less than the noise of its measurements: push harder and longer'
    return f'without corrections it predicts {100.0 * max(fit, 0.0):.0f} % of the motion'


class BlockFits:
    """
    How well velocities are predicted over the last blocks in which there was any motion.

    Parameters
    ----------
    clean : bool
        Whether what the noise of the measurements has in errors and velocities is taken off.

    Attributes
    ----------
    fit : float
        1 - rms(error) / std(measured), -inf where there was no motion yet.

    """

    def __init__(self, clean: bool) -> None:
        self._clean = clean
        self.fit = -math.inf
        self._sums = [0.0] * 5
        self._blocks: list[list[float]] = []

    def add(self, model: float, measured: float, noise: float) -> None:
        """Compare a velocity with the measured one, whose noise has a variance."""
        sums, error = self._sums, model - measured
        sums[0] += 1.0
        sums[1] += error * error
        sums[2] += measured
        sums[3] += measured * measured
        sums[4] += noise

    def end_block(self) -> None:
        """Take the fit; what tells nothing of it is left out."""
        # where noise is taken off, to keep the blocks that it made large would leave some of it in
        if self._clean or self._tells(self._sums):
            self._blocks = [*self._blocks, self._sums][-KEPT:]
            total = [math.fsum(column) for column in zip(*self._blocks)]
            if self._tells(total):
                self.fit = self._fit(*total)
        self._sums = [0.0] * 5

    def _tells(self, sums: list[float]) -> bool:
        """Tell whether there is a motion, or one was predicted."""
        count, error, _, square, noise = sums
        # noise leaves the square of a still vehicle within two standard deviations, and a model
        # that is perfect with less fit than is asked
        most = 1.0 + 2.0 * math.sqrt(2.0 / count) if self._clean and count else (
            1.0 / (1.0 - HELD_FIT[0])**2)
        return max(error, square) > most * noise

    def _fit(self, count: float, error: float, total: float, square: float,
             noise: float) -> float:
        if self._clean:
            error, square = max(error - noise, 0.0), square - noise
        variance = square - total * total / count
        return 1.0 - math.sqrt(error / variance) if variance > 0.0 else -math.inf

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'fit': self.fit if math.isfinite(self.fit) else None, 'sums': list(self._sums),
                'blocks': [list(sums) for sums in self._blocks]}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        self.fit, = [-math.inf] if state['fit'] is None else floats([state['fit']], 1)
        self._sums = floats(state['sums'], 5)
        self._blocks = [floats(row, 5) for row in state['blocks']]
        for count, error, _, square, noise in (self._sums, *self._blocks):
            if min(count, error, square, noise) < 0.0 or count == 0.0 < max(error, square):
                raise ValueError('a prediction that does not fit')


class FreePrediction:
    """
    A model that runs beside the filter and is set to its state at the end of each block.

    Parameters
    ----------
    own, thrusters
        As of a ``LinearisedFilter``.

    Attributes
    ----------
    fit : float
        1 - rms(error) / std(measured) of the velocity over the last blocks with motion.

    """

    def __init__(self, own: tuple[int, int], thrusters: Thrusters = AS_CONFIGURED) -> None:
        self._thrusters = thrusters
        self._thrust, self._drag = own
        self._has_own = own != NONE_OWN
        self._fits, self._noise = BlockFits(clean=False), 0.0
        self._theta: list[float] = []
        self._time = -1.0  # [s] of the last comparison
        self._motion = (0.0, 0.0)
        self._mark: list[float] = []  # time, path of the model, measured path

    @property
    def fit(self) -> float:
        """Return how well the model predicts."""
        return self._fits.fit

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
            self._fits.add(v, span.value, self._noise * self._noise)
        elif not self._mark:
            self._mark = [span.end, x, span.value]
        elif span.end - self._mark[0] >= SPAN:
            time, model, measured = self._mark
            dt = span.end - time
            noise = self._noise / dt
            self._fits.add((x - model) / dt, (span.value - measured) / dt, 2.0 * noise * noise)
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
            linear = gamma - alpha * self._thrusters.slowing(impulse / h)
            w = v + 0.5 * h * (u + (drag * abs(v) + linear) * v)
            x += h * w
            v += h * (u + (drag * abs(w) + linear) * w)
        return x, v

    def _of(self, i: int) -> float:
        return self._theta[i] if i >= 0 else 0.0

    def end_block(self, filter: LinearisedFilter, noise: float) -> None:
        """Take the fit of the block and begin the next one at the state of a filter."""
        self._fits.end_block()
        self._noise = noise
        self._theta, self._motion = filter.theta, filter.motion[:2]
        self._mark, self._time = [], -1.0

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'theta': self._theta, 'motion': list(self._motion), 'mark': self._mark,
                'at': self._time, 'noise': self._noise, 'fits': self._fits.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        self._theta = floats(state['theta'], len(state['theta']))
        x, v = floats(state['motion'], 2)
        self._motion = (x, v)
        self._mark = floats(state['mark'], len(state['mark']))
        self._time, self._noise = floats([state['at'], state['noise']], 2)
        self._fits.restore(state['fits'])
        if 0 < len(self._theta) < 5 or len(self._mark) not in (0, 3):
            raise ValueError('a prediction that does not fit')
