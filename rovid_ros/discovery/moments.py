"""
How well a force explains a motion whose velocity is noisy.

The velocity that drag goes with is as noisy as the changes that it is to explain, so least squares
take less drag and another delay for the better explanation. Regressors are therefore seen through
instruments, which have none of that noise: the force and its past. With the right delay and
latency nothing is left that hangs together with them (L. P. Hansen, Econometrica 50(4), 1982).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from rovid_ros.discovery.motion import Motion, STEP, Windows
from rovid_ros.discovery.signals import Array

_PASTS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # [s] over which means of the force are instruments
_APART = 1e-3  # of the largest singular value: instruments below are the others again
_SPAN = 3  # windows over which what is left may hang together by itself
_SMALLEST = 1e-6  # of the largest variance, so that none is taken for exact


class Misfit(NamedTuple):
    """What a force leaves unexplained, in the units of chance."""

    alpha: float  # the smallest, of several DOFs
    left: float  # chi-squared of ``freedom`` where the model is right
    freedom: int


def misfit(moved: Motion, dof: str, force: Array) -> Misfit | None:
    """Return what a force leaves of the motion of a DOF; None where the log does not say."""
    windows = Windows(moved, dof)
    if not windows.are_enough():
        return None
    velocity, beside = windows.velocity, windows.beside
    past = np.column_stack([force, *[_mean_before(force, span) for span in _PASTS], beside])
    expected = past @ _solved(past[windows.known], velocity[windows.known])
    regressors = windows.integrals(
        np.column_stack([force, velocity * np.abs(velocity), velocity, beside]))
    instruments = windows.integrals(np.column_stack([past, expected * np.abs(expected)]))
    axes, sizes, _ = np.linalg.svd(_scaled(instruments), full_matrices=False)
    axes = axes[:, sizes > _APART * sizes[0]]
    seen, changes = axes.T @ regressors, axes.T @ windows.changes
    weight = np.eye(len(changes))
    for _ in range(2):  # how noisy each moment is follows from what is left
        solution = _solved(weight @ seen, weight @ changes)
        weight = _weight(axes, windows.changes - regressors @ solution, _SPAN * windows.width)
    solution = _solved(weight @ seen, weight @ changes)
    left = weight @ (changes - seen @ solution)
    return Misfit(float(solution[0]), float(left @ left),
                  max(len(changes) - len(solution), 1))


def _mean_before(values: Array, span: float) -> Array:
    """Return the means over a span [s] before each time."""
    count = round(span / STEP)
    sums = np.concatenate([np.full(count, 0.0), np.cumsum(values)])
    return np.asarray((sums[count:] - sums[:-count]) / count)


def _scaled(columns: Array) -> Array:
    scale = np.sqrt(np.mean(columns * columns, axis=0))
    return np.asarray(columns / np.where(scale > 0.0, scale, 1.0))


def _solved(regressors: Array, values: Array) -> Array:
    """Return the least squares of regressors of any size."""
    scale = np.sqrt(np.mean(regressors * regressors, axis=0))
    scale[scale == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(regressors / scale, values, rcond=1e-4)[0] / scale)


def _weight(axes: Array, left: Array, span: int) -> Array:
    """Return the inverse root of the covariance of moments (W. Newey and K. West, 1987)."""
    spectrum = np.fft.rfft(left, 2 * len(left))
    near = np.fft.irfft(spectrum * np.conj(spectrum))[:span + 1] / len(left)
    near *= 1.0 - np.arange(span + 1) / (span + 1)
    around = np.concatenate([near[:0:-1], near])
    spread = np.column_stack([np.convolve(axis, around, 'same') for axis in axes.T])
    variances, turned = np.linalg.eigh(axes.T @ spread)
    return np.asarray(
        turned / np.sqrt(np.maximum(variances, _SMALLEST * variances[-1])) @ turned.T)
