"""
Output error for many candidates at once, each scored on the blocks that it was not fitted to.

The model is simulated from block to block side by side, the velocity is compared after one
low-pass, and what is fitted is what is scored.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from rovid_core.model.trajectory import Array, mean_velocity
from rovid_core.settings.run import Scales
from rovid_core.trials.tuning.blocks import Blocks, FOLDS
from rovid_core.trials.tuning.simulation import Normal, simulate, smoothed

ITERATIONS = 10
SETTLED = 1e-4
"""Relative change of the cost after which an iteration ends."""

ROBUST = 2.0
"""Residuals beyond this many median ones count less and less (Huber)."""

LEAST_INFORMATION = 1e-6
"""Of the largest: what the data do not show stays where it was."""


@dataclass(frozen=True)
class Models:
    """
    What was found for the candidates.

    Attributes
    ----------
    theta : ndarray, shape (candidates, 4)
        From all blocks, in units of typical force and velocity.
    start : ndarray, shape (candidates, pieces)
        Velocity at each piece's start, in typical ones.
    scores : ndarray, shape (candidates, FOLDS)
        Mean absolute error on each block of the model of the others [m/s or rad/s].

    """

    theta: Array
    start: Array
    scores: Array


class OutputError:
    """
    The fit of one DOF's model.

    Parameters
    ----------
    blocks : Blocks
        The trial; its measured velocities may be replaced in ``fit``.
    scales : Scales
        Typical sizes and terms.
    cutoff : float
        Of the low-pass through which velocities are compared [Hz].

    """

    def __init__(self, blocks: Blocks, scales: Scales, cutoff: float) -> None:
        self.blocks, self.scales = blocks, scales
        self.weights = blocks.weights(cutoff)
        self._dt, self._valid = blocks.dt, blocks.valid[:, None, :]
        self._active = np.array(scales.active)
        self._units = scales.velocity * np.array(scales.regressor)
        self.first = self.scaled(np.array(scales.initial))
        self._low, self._high = (self.scaled(np.array(bound)) for bound in scales.bounds())

    def physical(self, theta: Array) -> Array:
        """Return lumped parameters of scaled ones, shape (..., 4)."""
        return np.asarray(theta * self._units)

    def scaled(self, parameters: Array) -> Array:
        """Return scaled parameters of lumped ones, shape (..., 4)."""
        return np.asarray(parameters / self._units)

    def fit(self, force: Array, measured: Array | None = None, begin: Array | None = None,
            iterations: int = ITERATIONS) -> Models:
        """
        Fit and score all candidates.

        Parameters
        ----------
        force : ndarray, shape (steps, candidates, pieces)
            [N or N m]
        measured : ndarray, shape (steps, candidates, pieces), optional
            Where the candidates differ in it.
        begin : ndarray, shape (4,), optional
            Scaled parameters to begin with.
        iterations : int
            Of Gauss and Newton.

        """
        force = force / self.scales.force
        target = (self.blocks.measured[:, None, :] if measured is None else measured)
        target = np.broadcast_to(target / self.scales.velocity, force.shape)
        count = force.shape[1]
        theta = np.tile(self.first if begin is None else begin, (count, 1))
        start = target[:5].mean(axis=0)
        damping = np.full(count, 1e-2)
        kept = self._normal(theta, start, force, target, np.full(count, np.inf))
        for _ in range(iterations):
            step, begins = self._step(theta, kept, damping)
            trial = self._normal(theta + step, start + begins, force, target, kept.limit)
            better = trial.before <= kept.cost * (1.0 + SETTLED)
            settled = better & (trial.before >= kept.cost * (1.0 - SETTLED))
            damping = np.where(better, damping * 0.1, damping * 10.0)
            theta[better] += step[better]
            start[better] += begins[better]
            kept.take(better, trial)
            if settled.all():
                break
        return Models(theta, start, self._held_out(theta, start, kept, force, target))

    def score(self, theta: Array, start: Array, force: Array, target: Array,
              first: int = 0) -> Array:
        """
        Return the error on each fold.

        Parameters
        ----------
        theta : ndarray, shape (4, candidates, pieces or 1)
        start : ndarray, shape (candidates or 1, pieces)
        force, target : ndarray, shape (steps, candidates or 1, pieces)
            All in typical sizes.
        first : int
            The first fold that is asked for.

        Returns
        -------
        ndarray, shape (candidates, FOLDS)
            [m/s or rad/s]; NaN for what is not asked for.

        """
        own = self.blocks.fold >= first
        if theta.shape[-1] > 1:
            theta = theta[..., own]
        errors = smoothed(self.weights[:, own], simulate(
            theta, start[..., own], self._dt[:, own], force[..., own]) - target[..., own])
        return self.blocks.by_fold(np.abs(errors), own) * self.scales.velocity

    def _held_out(self, theta: Array, start: Array, normal: Normal, force: Array,
                  target: Array) -> Array:
        """Take each block out by a Newton step, for sums over blocks can be taken apart."""
        member = (self.blocks.fold[:, None] == np.arange(FOLDS)).astype(float)
        rest = 1.0 - member  # (pieces, FOLDS)
        own = np.empty((len(theta), FOLDS, 4))
        for fold in range(FOLDS):
            own[:, fold] = theta + self._solved(
                theta, np.einsum('cpij,p->cij', normal.inside, rest[:, fold]),
                np.einsum('cpi,p->ci', normal.slope, rest[:, fold]), np.full(len(theta), 1e-9))
        of_piece = own[:, self.blocks.fold].transpose(2, 0, 1)
        return self.score(of_piece, start, force, target)

    def _normal(self, theta: Array, start: Array, force: Array, target: Array,
                limit: Array) -> Normal:
        errors, slopes = self._residuals(theta, start, force, target)
        size = np.abs(errors)
        own_limit = ROBUST * np.maximum(1e-9, np.array(
            [np.median(size[:, c][self._valid[:, 0]]) for c in range(len(theta))]))
        weight = self._valid * np.minimum(
            1.0, own_limit[:, None] / np.maximum(size, 1e-300))
        full = np.einsum('kicp,kjcp->cpij', slopes, slopes * weight[:, None], optimize=True)
        right = np.einsum('kicp,kcp->cpi', slopes, weight * errors, optimize=True)
        own = np.maximum(full[..., 4, 4], 1e-12)
        cross = full[..., :4, 4] / own[..., None]
        return Normal(
            own_limit, self._huber(size, own_limit), self._huber(size, limit),
            full[..., :4, :4] - cross[..., :, None] * full[..., None, :4, 4],
            right[..., :4] - cross * right[..., 4:], cross, right[..., 4] / own)

    def _huber(self, size: Array, limit: Array) -> Array:
        inner = np.minimum(size, limit[:, None])
        return np.asarray((self._valid * inner * (2.0 * size - inner)).sum(axis=(0, 2)))

    def _residuals(self, theta: Array, start: Array, force: Array,
                   target: Array) -> tuple[Array, Array]:
        """Return the errors and their derivatives by theta and start, after the low-pass."""
        alpha, beta, gamma, delta = theta.T[:, :, None]
        v, slope = start, np.zeros((5, *start.shape))
        slope[4] = 1.0
        errors, slopes = np.empty(force.shape), np.empty((len(force), *slope.shape))
        e, s = np.zeros_like(start), np.zeros_like(slope)
        phi = np.zeros_like(slope)
        phi[3] = 1.0
        for k, h in enumerate(0.5 * self._dt):
            w = mean_velocity(v, h, alpha * force[k] + delta, beta, gamma)
            size = np.abs(w)
            phi[0], phi[1], phi[2] = force[k], w * size, w
            inner = (slope + h * phi) / (1.0 - h * (gamma + 2.0 * beta * size))
            v, slope = 2.0 * w - v, 2.0 * inner - slope
            e = e + self.weights[k] * (w - target[k] - e)
            s = s + self.weights[k] * (inner - s)
            errors[k], slopes[k] = e, s
        return errors, slopes

    def _step(self, theta: Array, normal: Normal, damping: Array) -> tuple[Array, Array]:
        step = self._solved(
            theta, normal.inside.sum(axis=1), normal.slope.sum(axis=1), damping)
        return step, -normal.right - np.einsum('cpi,ci->cp', normal.cross, step)

    def _solved(self, theta: Array, inside: Array, slope: Array, damping: Array) -> Array:
        """Return the Newton step inside the bounds."""
        free = np.broadcast_to(self._active, theta.shape)
        diagonal = np.einsum('cii->ci', inside)
        most = diagonal.max(axis=1, keepdims=True)
        extra = damping[:, None] * diagonal + LEAST_INFORMATION * most + 1e-12
        step = np.zeros_like(theta)
        for _ in range(3):  # again with what would leave the bounds at its bound
            pair = free[:, :, None] & free[:, None, :]
            matrix = np.where(pair, inside, 0.0) + np.eye(4) * np.where(free, extra, 1.0)[
                :, None, :]
            right = slope + np.einsum('cij,cj->ci', inside, np.where(free, 0.0, step))
            solved = np.linalg.solve(matrix, np.where(free, right, 0.0)[..., None])[..., 0]
            step = np.clip(theta + np.where(free, -solved, step), self._low,
                           self._high) - theta
            free = free & (theta - solved > self._low) & (theta - solved < self._high)
        return np.asarray(step)
