"""
How well a force explains a motion whose velocity is noisy.

The velocity that drag goes with is as noisy as the changes that it is to explain, so least squares
take less drag and another delay for the better explanation. Regressors are therefore seen through
instruments, which have none of that noise: the force and its past. With the right delay and
latency nothing is left that hangs together with them (L. P. Hansen, Econometrica 50(4), 1982).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from rovid_ros.discovery.motion import Motion, scaled, STEP, Windows
from rovid_ros.discovery.signals import Array

_PASTS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # [s] over which means of the force are instruments
_APART = 1e-3  # of the largest singular value: instruments below are the others again
_SPAN = 3  # windows over which what is left may hang together by itself
_ROUNDS = 2  # in which the noise is found
LIKELY = 3.84  # chi-squared that chance exceeds once in twenty times
_SMALLEST = 1e-6  # of the largest variance, so that none is taken for exact


class Moments:
    """What forces say of the motion of a DOF, seen through the instruments."""

    def __init__(self, windows: Windows, force: Array) -> None:
        velocity, beside = windows.velocity, windows.beside
        past = np.column_stack([force, *[_mean_before(force, span) for span in _PASTS], beside])
        expected = past @ _solved(past[windows.known], velocity[windows.known])
        instruments = windows.integrals(np.column_stack([past, expected * np.abs(expected)]))
        axes, sizes, _ = np.linalg.svd(scaled(instruments)[0], full_matrices=False)
        self._axes = axes[:, sizes > _APART * sizes[0]]
        self._regressors = windows.integrals(
            np.column_stack([force, velocity * np.abs(velocity), velocity, beside]))
        self._changes, self._span = windows.changes, _SPAN * windows.width

    def fit(self, noise: Array | None = None) -> Fit:
        """Return the fit where the noise has this autocovariance; white if not given."""
        seen, changes = self._axes.T @ self._regressors, self._axes.T @ self._changes
        weight = np.eye(len(changes)) if noise is None else self._weight(noise)
        solution = _solved(weight @ seen, weight @ changes)
        left = weight @ (changes - seen @ solution)
        force, others = (weight @ seen)[:, 0], (weight @ seen)[:, 1:]
        alone = float(np.linalg.norm(force - others @ _solved(others, force)))
        return Fit(float(solution[0]) * alone, float(left @ left),
                   max(len(changes) - len(solution), 1),
                   self._noise(self._changes - self._regressors @ solution))

    def _noise(self, left: Array) -> Array:
        """Return the autocovariance of what is left (W. Newey and K. West, 1987)."""
        spectrum = np.fft.rfft(left, 2 * len(left))
        near = np.fft.irfft(spectrum * np.conj(spectrum))[:self._span + 1] / len(left)
        near *= 1.0 - np.arange(self._span + 1) / (self._span + 1)
        return np.concatenate([near[:0:-1], near])

    def _weight(self, noise: Array) -> Array:
        """Return the inverse root of the covariance of moments."""
        spread = np.column_stack([np.convolve(axis, noise, 'same') for axis in self._axes.T])
        variances, turned = np.linalg.eigh(self._axes.T @ spread)
        return np.asarray(
            turned / np.sqrt(np.maximum(variances, _SMALLEST * variances[-1])) @ turned.T)


class Fit(NamedTuple):
    """How a force explains a motion."""

    push: float  # of the force, in standard errors
    left: float  # chi-squared of ``freedom`` where the model and the noise are right
    freedom: int
    noise: Array  # autocovariance of what is left


class Misfit(NamedTuple):
    """What forces leave of the motion of several DOFs."""

    push: float  # the smallest
    left: float
    freedom: int

    def and_of(self, one: Fit) -> Misfit:
        """Return that of one DOF more."""
        return Misfit(min(self.push, one.push), self.left + one.left, self.freedom + one.freedom)

    def by_chance(self, most: float = LIKELY) -> float:
        """Return by how much more another that is as right may leave, if no more is chance."""
        return most * max(self.left / max(self.freedom, 1), 1.0)


def moments_of(moved: Motion, dof: str, force: Array) -> Moments | None:
    """Return what a force says of the motion of a DOF; None where the log says nothing."""
    windows = Windows(moved, dof)
    return Moments(windows, force) if np.ptp(force) > 1e-9 and windows.are_enough() else None


def misfits(cases: Sequence[Moments]) -> list[Fit]:
    """
    Return the fits of cases that are to be compared: with the noise of the best of them.

    Each with its own noise would find that a bad one explains what it leaves as noise.
    """
    fits = [case.fit() for case in cases]
    for _ in range(_ROUNDS):
        noise = min(fits, key=lambda one: one.left).noise
        fits = [case.fit(noise) for case in cases]
    return fits


def _mean_before(values: Array, span: float) -> Array:
    """Return the means over a span [s] before each time."""
    count = round(span / STEP)
    sums = np.concatenate([np.full(count, 0.0), np.cumsum(values)])
    return np.asarray((sums[count:] - sums[:-count]) / count)


def _solved(regressors: Array, values: Array) -> Array:
    """Return the least squares of regressors of any size."""
    alike, sizes = scaled(regressors)
    return np.asarray(np.linalg.lstsq(alike, values, rcond=1e-4)[0] / sizes)
