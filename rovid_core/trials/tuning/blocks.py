"""A trial of one DOF in blocks of time that are simulated side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.lowpass import MOST_TURN
from rovid_core.model.trajectory import Array
from rovid_core.trials.tuning.commanded import Commanded
from rovid_core.trials.tuning.log import Stretch

NS = 1e-9
FOLDS = 8
"""Blocks of time of equal length; each is held out once."""

STEP = 0.2
"""[s] Shorter steps are joined: a vehicle's velocity hardly bends in this time, and the
impulse over it is exact whatever the delay."""

LEAST_STEPS = 8
"""A piece with fewer says nothing."""


@dataclass(frozen=True)
class Blocks:
    """
    Pieces of a trial without interruption, each in one fold, padded to one length.

    Attributes
    ----------
    nodes : ndarray of int64, shape (steps + 1, pieces)
        Bounds of the steps [ns]; the padding has length 0.
    measured : ndarray, shape (steps, pieces)
        Mean velocity of each step [m/s or rad/s].
    fold : ndarray of int, shape (pieces,)
        Which fold each piece is in.

    """

    nodes: NDArray[np.int64]
    measured: Array
    fold: NDArray[np.intp]

    @property
    def dt(self) -> Array:
        """Return the lengths of the steps [s]."""
        return np.asarray(np.diff(self.nodes, axis=0) * NS)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Tell which steps are no padding."""
        return np.asarray(np.diff(self.nodes, axis=0) > 0)

    def force(self, commanded: Commanded, dof: int, delay: float, lag: float) -> Array:
        """Return the mean force of every step, 0 in the padding [N or N m]."""
        impulse = commanded.impulse(dof, self.nodes.ravel(), delay, lag)
        dt = self.dt
        return np.asarray(np.diff(impulse.reshape(self.nodes.shape), axis=0)
                          / np.where(dt > 0.0, dt, np.inf))

    def weights(self, cutoff: float) -> Array:
        """Return the weight of each step in the low-pass with ``cutoff`` [Hz]."""
        weight = -np.expm1(-np.minimum(2.0 * math.pi * cutoff * self.dt, MOST_TURN))
        weight[0] = 1.0
        return np.asarray(weight)

    def by_fold(self, values: Array, which: NDArray[np.bool_] | None = None) -> Array:
        """
        Return the mean over the steps of each fold.

        Parameters
        ----------
        values : ndarray, shape (steps, ..., pieces)
        which : ndarray of bool, shape (pieces,), optional
            Of all pieces those that there are values of.

        Returns
        -------
        ndarray, shape (..., FOLDS)
            NaN for a fold without a step.

        """
        valid, fold = self.valid, self.fold
        if which is not None:
            valid, fold = valid[:, which], fold[which]
        total = np.einsum('k...p,kp->...p', values, valid.astype(float))
        member = fold[:, None] == np.arange(FOLDS)
        with np.errstate(invalid='ignore'):
            return np.asarray(total @ member / (valid.sum(axis=0) @ member))


def edges(stretches: Sequence[Stretch]) -> Array:
    """Return the bounds of the folds [ns], with as much time in steps each; (FOLDS + 1,)."""
    first = stretches[0].start
    times, so_far = [], [0]
    for stretch in stretches:
        start, end = stretch.start - first, stretch.ends[-1] + 1 - first
        times += [start, end]
        so_far += [so_far[-1] + end - start] * 2
    shares = np.linspace(0, so_far[-1], FOLDS + 1)
    return np.asarray(first + np.interp(shares, so_far[:-1], times))


def blocks(stretches: Sequence[Stretch], bounds: Array) -> Blocks | None:
    """
    Divide a trial into blocks.

    Parameters
    ----------
    stretches : sequence of Stretch
        The trial of one DOF.
    bounds : ndarray, shape (FOLDS + 1,)
        Of the folds [ns].

    Returns
    -------
    Blocks or None
        None if some fold has no piece.

    """
    pieces: list[tuple[int, NDArray[np.int64], Array]] = []
    for stretch in stretches:
        nodes, means = _joined(*_intervals(stretch))
        of_step = np.searchsorted(bounds, nodes[:-1], 'right') - 1
        for fold in range(FOLDS):
            own = np.flatnonzero(of_step == fold)
            if len(own) >= LEAST_STEPS:
                pieces.append((fold, nodes[own[0]:own[-1] + 2], means[own]))
    if {fold for fold, _, _ in pieces} != set(range(FOLDS)):
        return None
    longest = max(len(means) for _, _, means in pieces)
    return Blocks(
        np.stack([np.pad(nodes, (0, longest + 1 - len(nodes)), mode='edge')
                  for _, nodes, _ in pieces], axis=1),
        np.stack([np.pad(means, (0, longest - len(means))) for _, _, means in pieces], axis=1),
        np.array([fold for fold, _, _ in pieces]))


def _intervals(stretch: Stretch) -> tuple[NDArray[np.int64], Array]:
    """Return times and the mean velocities between them."""
    if stretch.fixes[-1] != stretch.ends[-1]:
        return stretch.fixes, stretch.means[:-1]
    samples = np.concatenate([[stretch.velocity], stretch.means])
    return stretch.bounds, 0.5 * (samples[:-1] + samples[1:])


def _joined(nodes: NDArray[np.int64], means: Array) -> tuple[NDArray[np.int64], Array]:
    """Join steps to about ``STEP``."""
    if not len(means):
        return nodes, means
    dt = np.diff(nodes) * NS
    size = max(1, round(STEP / float(np.median(dt))))
    count = len(means) // size * size
    path = np.concatenate([[0.0], np.cumsum(means * dt)])[:count + 1:size]
    nodes = nodes[:count + 1:size]
    return nodes, np.diff(path) / (np.diff(nodes) * NS)
