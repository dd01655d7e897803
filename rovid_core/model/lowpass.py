"""The one low-pass that velocity and thrust both go through."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from rovid_core.model.plant import Array, linear_recurrence

MOST_TURN: Final = 2.0 * math.pi * 0.4
"""A cutoff above 0.4 of the sample rate means nothing any more."""


class LowPass:
    """
    First-order low-pass for irregular sampling, several signals at once.

    Exact for an input held over the step, ``y += (1 - exp(-2 pi f dt)) (u - y)``: it can
    not overflow at any step size. A short step gives a noisy difference quotient little
    weight, so bursts of messages do no harm.

    Parameters
    ----------
    cutoff : float
        [Hz]; 0 passes everything. Steps longer than 0.4 / cutoff use 0.4 / dt.

    """

    def __init__(self, cutoff: float) -> None:
        self._rate = 2.0 * math.pi * cutoff
        self.value: tuple[float, ...] | None = None
        self._last = (0.0, 1.0)  # length [s] and weight of the last step
        self.steps = 0
        self.clamped = 0

    def step(self, dt: float, signals: tuple[float, ...]) -> tuple[float, ...]:
        """Take the signals of a step of ``dt`` [s]; the first ones are the start."""
        if self.value is None or self._rate == 0.0:
            self.value = signals
        else:
            turn = self._rate * dt
            self.steps += 1
            if turn > MOST_TURN:
                turn = MOST_TURN
                self.clamped += 1
            weight = -math.expm1(-turn)
            self._last = dt, weight
            self.value = tuple(
                [y + weight * (u - y) for y, u in zip(self.value, signals)])
        return self.value

    @property
    def delay(self) -> float:
        """Return by how much [s] the value lags behind a slow signal, at the last step's rate."""
        dt, weight = self._last
        return dt * (1.0 - weight) / weight if weight else math.inf

    def retune(self, cutoff: float) -> None:
        """Take another cutoff [Hz] from the next step on."""
        self._rate = 2.0 * math.pi * cutoff

    def restart(self) -> None:
        """Forget; the next signals are the start."""
        self.value = None


def weights(cutoff: float | Array, dt: Array) -> Array:
    """
    Return the weights that ``LowPass`` gives steps of ``dt`` [s], 1 for the first ones.

    ``cutoff`` [Hz] is above 0. ``dt`` has shape (n,), or (n, ...) for one cutoff of all.
    """
    found = -np.expm1(-np.minimum(2.0 * math.pi * cutoff * dt, MOST_TURN))
    found[:1] = 1.0
    return np.asarray(found)


def filtered(cutoff: float | Array, dt: Array, signals: Array) -> Array:
    """
    Return what ``LowPass`` gives for a whole trial.

    Parameters
    ----------
    cutoff : float or ndarray, shape (n,)
        [Hz], of each step where it changes; 0 passes everything.
    dt : ndarray, shape (n,)
        Length of the step before each sample [s]; the first is not used.
    signals : ndarray, shape (..., n)
        One or more signals; the first samples are the start.

    Returns
    -------
    ndarray, shape (..., n)

    """
    if isinstance(cutoff, float) and cutoff == 0.0:
        return signals
    weight = weights(cutoff, dt)
    return linear_recurrence(1.0 - weight, weight * signals)
