"""
The model of one degree of freedom, fitted by output error for many candidates at once.

The blocks of a trial are simulated side by side, the velocity is compared after one low-pass,
and each candidate is scored on the blocks that it was not fitted to.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.dofs import OWN, PARAMETERS
from rovid_core.model.lowpass import weights
from rovid_core.model.plant import Array, drag_at, midpoint_steps
from rovid_core.settings.run import DofSettings, Scales, Settings
from rovid_core.trials.tuning.cross_validation import (
    Blocks,
    blocks,
    FOLDS,
    part_bounds,
    time_of,
)
from rovid_core.trials.tuning.log import CommandedForce, Segment, TuningLog

ITERATIONS, FROM_NEAR = 30, 6  # of Gauss and Newton at most; from what was found before, fewer
SETTLED = 1e-4  # relative change of the cost after which an iteration ends
HUBER_LIMIT = 2.0  # residuals beyond this many median ones count less and less (Huber)
MIN_INFORMATION = 1e-6  # of the largest: what the data do not show stays where it was
MIN_TIME = 60.0  # [s] of steps, for less the blocks are too short to be predicted
T95 = 2.4  # standard errors of a mean over 8 folds, for 95 % (Student's t)
MIN_GAIN = 0.05  # a model has to be this much better than a constant velocity for a DOF to count


@dataclass(frozen=True)
class Fit:
    """The models of all candidates."""

    theta: Array  # shape (candidates, 4 + k); scaled parameters, from all folds
    # shape (candidates, FOLDS, 4 + k); the same from all folds but one
    without: Array
    # shape (candidates, FOLDS, parts); mean absolute error on each part of a fold of the model of
    # the others [m/s or rad/s]
    errors: Array

    @property
    def masses(self) -> Array:
        """Return the masses, shape (candidates,), in a unit that is the same for all."""
        return np.asarray(1.0 / self.theta[:, 0])

    @property
    def mass_widths(self) -> Array:
        """Return half the widths of the masses' 95 % intervals, as the folds tell them."""
        masses = 1.0 / self.without[:, :, 0]  # the jackknife
        return np.asarray(T95 * (FOLDS - 1) / math.sqrt(FOLDS) * masses.std(axis=1, ddof=1))


@dataclass
class NormalEquations:
    """Errors of the candidates, and normal equations per piece without the start's velocity."""

    limit: Array  # shape (candidates,); beyond which residuals count less
    # shape (candidates,); with this limit, and with the one before
    cost: Array
    before: Array
    # shape (candidates, pieces, n, n) and (candidates, pieces, n); matrix and right-hand side
    inside: Array
    slope: Array
    # shape (candidates, pieces, n) and (candidates, pieces); how the start's velocity follows the
    # parameters, and its own step
    cross: Array
    right: Array

    def replace(self, which: NDArray[np.bool_], other: NormalEquations) -> None:
        """Replace the candidates ``which`` by those of another."""
        for mine, new in zip(vars(self).values(), vars(other).values()):
            mine[which] = new[which]


class OutputError:
    """
    The fit of one DOF's model, which compares velocities through a low-pass [Hz].

    ``possible`` are the names of the couplings whose regressors the blocks have.
    """

    def __init__(self, blocks: Blocks, scales: Scales, cutoff: float,
                 possible: Sequence[str]) -> None:
        self.blocks, self.scales = blocks, scales
        self.weights = weights(cutoff, blocks.dt)
        self._valid = blocks.valid[:, None, :]
        self._dt = np.repeat(blocks.dt / blocks.parts, blocks.parts, axis=0)
        coupled = scales.coupling_regressor
        others = np.array(coupled)[:, None, None] * blocks.regressors[
            :, [possible.index(name) for name in scales.couplings], None]
        self._others = np.repeat(others, blocks.parts, axis=0)
        # where those of ``OWN`` stand, which are made of what is simulated
        self._thrust, self._drag = (
            [scales.couplings.index(name)] if name in scales.couplings else [] for name in OWN)
        self._active = np.array([*scales.active, *[True for _ in coupled]])
        self._units = scales.velocity * np.array([*scales.regressor, *coupled])
        self._first = np.array([*scales.initial, *[0.0 for _ in coupled]]) / self._units
        self._low, self._high = (np.array([*own, *others]) / self._units for own, others in zip(
            scales.bounds(), scales.coupling_bounds()))

    def fit(self, force: Array, measured: Array | None = None,
            begin: Array | None = None,
            active: NDArray[np.bool_] | None = None) -> Fit:
        """
        Fit and score all candidates.

        Parameters
        ----------
        force : ndarray, shape (steps * parts, candidates, pieces)
            [N or N m]
        measured : ndarray, shape (steps, candidates, pieces), optional
            Where the candidates differ in it.
        begin : ndarray, shape (4 + k,), optional
            Scaled parameters to begin with.
        active : ndarray of bool, shape (candidates, 4 + k), optional
            Where the candidates differ in what they have of them.

        """
        force = force / self.scales.force
        target = (self.blocks.measured[:, None, :] if measured is None else measured)
        target = np.broadcast_to(
            target / self.scales.velocity, (len(target), *force.shape[1:]))
        count = force.shape[1]
        free = np.broadcast_to(self._active if active is None else active, (
            count, len(self._active)))
        theta = np.where(free, self._first if begin is None else begin, 0.0)
        start = target[:5].mean(axis=0)
        damping = np.full(count, 1e-2)
        kept = self._normal(theta, start, force, target, np.full(count, np.inf))
        for _ in range(ITERATIONS if begin is None else FROM_NEAR):
            step, begins = self._step(theta, free, kept, damping)
            trial = self._normal(theta + step, start + begins, force, target, kept.limit)
            better = trial.before <= kept.cost * (1.0 + SETTLED)
            settled = better & (trial.before >= kept.cost * (1.0 - SETTLED))
            damping = np.where(better, damping * 0.1, damping * 10.0)
            theta[better] += step[better]
            start[better] += begins[better]
            kept.replace(better, trial)
            if settled.all():
                break
        without = self._without_each(theta, free, kept)
        of_piece = without[:, self.blocks.fold].transpose(2, 0, 1)
        return Fit(theta, without, self.score(of_piece, start, force, target))

    def score(self, theta: Array, start: Array, force: Array, target: Array) -> Array:
        """
        Return the mean absolute error on each part of a fold [m/s or rad/s].

        It has shape (candidates, FOLDS, parts). All is in typical sizes: ``theta`` of shape
        (4 + k, candidates, pieces or 1), ``start`` of (candidates or 1, pieces), ``target`` of
        (steps, candidates or 1, pieces), and ``force`` likewise for each part of a step.
        """
        errors, error = np.empty(target.shape), np.zeros(target.shape[1:])
        steps = self._steps(theta, start, force)
        for k in range(len(target)):
            mean = sum(next(steps)[0] for _ in range(self.blocks.parts)) / self.blocks.parts
            errors[k] = error = error + self.weights[k] * (mean - target[k] - error)
        return self.blocks.by_part(np.abs(errors)) * self.scales.velocity

    def _steps(self, theta: Array, start: Array, force: Array) -> Iterator[tuple[Array, Array]]:
        """Return the mean and the last velocity of each part of a step."""
        reverse: Array | float = 0.0
        for i in self._drag:
            # as a coupling it is 0, for there it would be of the measured velocity
            theta, reverse = theta.copy(), theta[4 + i]
            theta[4 + i] = 0.0
        others: Iterable[Sequence[Array] | Array] = self._others
        if self._thrust:
            others = (self._own_thrust(row, one) for row, one in zip(self._others, force))
        return midpoint_steps(theta, start, self._dt, force, others, reverse)

    def _own_thrust(self, regressors: Array, force: Array) -> list[Array]:
        """Return the regressors of a step with that of reverse thrust of its own force."""
        found = list(regressors)
        for i in self._thrust:
            found[i] = np.minimum(force, 0.0)
        return found

    def _without_each(self, theta: Array, free: NDArray[np.bool_],
                      normal: NormalEquations) -> Array:
        """Take each fold out by a Newton step, for sums over pieces can be taken apart."""
        rest = (self.blocks.fold[:, None] != np.arange(FOLDS)).astype(float)  # (pieces, FOLDS)
        found = np.empty((len(theta), FOLDS, theta.shape[1]))
        for fold in range(FOLDS):
            found[:, fold] = theta + self._solved(
                theta, free, np.einsum('cpij,p->cij', normal.inside, rest[:, fold]),
                np.einsum('cpi,p->ci', normal.slope, rest[:, fold]), np.full(len(theta), 1e-9))
        return found

    def _normal(self, theta: Array, start: Array, force: Array, target: Array,
                limit: Array) -> NormalEquations:
        errors, slopes = self._residuals(theta, start, force, target)
        size = np.abs(errors)
        own_limit = HUBER_LIMIT * np.maximum(1e-9, np.array(
            [np.median(size[:, c][self._valid[:, 0]]) for c in range(len(theta))]))
        weight = self._valid * np.minimum(
            1.0, own_limit[:, None] / np.maximum(size, 1e-300))
        full = np.einsum('kicp,kjcp->cpij', slopes, slopes * weight[:, None], optimize=True)
        right = np.einsum('kicp,kcp->cpi', slopes, weight * errors, optimize=True)
        own = np.maximum(full[..., -1, -1], 1e-12)
        cross = full[..., :-1, -1] / own[..., None]
        return NormalEquations(
            own_limit, self._huber(size, own_limit), self._huber(size, limit),
            full[..., :-1, :-1] - cross[..., :, None] * full[..., None, :-1, -1],
            right[..., :-1] - cross * right[..., -1:], cross, right[..., -1] / own)

    def _huber(self, size: Array, limit: Array) -> Array:
        inner = np.minimum(size, limit[:, None])
        return np.asarray((self._valid * inner * (2.0 * size - inner)).sum(axis=(0, 2)))

    def _residuals(self, theta: Array, start: Array, force: Array,
                   target: Array) -> tuple[Array, Array]:
        """Return the errors and their derivatives by theta and start, after the low-pass."""
        parameters = theta.T[:, :, None]
        _, beta, gamma, _ = parameters[:4]
        reverse: Array | float = parameters[4 + self._drag[0]] if self._drag else 0.0
        slope = np.zeros((1 + theta.shape[1], *start.shape))
        slope[-1] = 1.0
        errors, slopes = np.empty(target.shape), np.empty((len(target), *slope.shape))
        error, filtered = np.zeros_like(start), np.zeros_like(slope)
        regressor = np.zeros_like(slope)
        regressor[3] = 1.0
        parts, whole, of_whole = self.blocks.parts, np.zeros_like(start), np.zeros_like(slope)
        for k, (mean, _) in enumerate(self._steps(parameters, start, force)):
            size, half = np.abs(mean), 0.5 * self._dt[k]
            regressor[0], regressor[1], regressor[2] = force[k], mean * size, mean
            regressor[4:-1] = self._others[k]
            for i in self._thrust:
                regressor[4 + i] = np.minimum(force[k], 0.0)
            for i in self._drag:
                regressor[4 + i] = np.minimum(mean, 0.0) * size
            of_mean = (slope + half * regressor) / (
                1.0 - half * (gamma + 2.0 * drag_at(mean, beta, reverse) * size))
            slope = 2.0 * of_mean - slope
            whole, of_whole = whole + mean / parts, of_whole + of_mean / parts
            if (k + 1) % parts == 0:
                i = k // parts
                errors[i] = error = error + self.weights[i] * (whole - target[i] - error)
                slopes[i] = filtered = filtered + self.weights[i] * (of_whole - filtered)
                whole, of_whole = np.zeros_like(start), np.zeros_like(slope)
        return errors, slopes

    def _step(self, theta: Array, free: NDArray[np.bool_], normal: NormalEquations,
              damping: Array) -> tuple[Array, Array]:
        step = self._solved(
            theta, free, normal.inside.sum(axis=1), normal.slope.sum(axis=1), damping)
        return step, -normal.right - np.einsum('cpi,ci->cp', normal.cross, step)

    def _solved(self, theta: Array, free: NDArray[np.bool_], inside: Array, slope: Array,
                damping: Array) -> Array:
        """Return the Newton step inside the bounds, of the parameters that are ``free``."""
        diagonal = np.einsum('cii->ci', inside)
        most = diagonal.max(axis=1, keepdims=True)
        extra = damping[:, None] * diagonal + MIN_INFORMATION * most + 1e-12
        step = np.zeros_like(theta)
        for _ in range(3):  # again with what would leave the bounds at its bound
            pair = free[:, :, None] & free[:, None, :]
            diagonals = np.eye(len(self._units)) * np.where(free, extra, 1.0)[:, None, :]
            matrix = np.where(pair, inside, 0.0) + diagonals
            right = slope + np.einsum('cij,cj->ci', inside, np.where(free, 0.0, step))
            solved = np.linalg.solve(matrix, np.where(free, right, 0.0)[..., None])[..., 0]
            step = np.clip(theta + np.where(free, -solved, step), self._low,
                           self._high) - theta
            free = free & (theta - solved > self._low) & (theta - solved < self._high)
        return np.asarray(step)


class Dof:
    """
    One DOF that is tuned with: ``settings`` have typical sizes from the data.

    Predictions are compared through a low-pass of ``cutoff`` [Hz]. ``possible`` are the names of
    the couplings whose regressors are measured. Errors are mean absolute ones on parts of
    held-out folds, shape (candidates, FOLDS, parts) [m/s or rad/s].
    """

    def __init__(self, name: str, row: int, segments: list[Segment], blocks: Blocks,
                 settings: DofSettings, cutoff: float, possible: Sequence[str]) -> None:
        self.name, self.row, self.segments, self.blocks = name, row, segments, blocks
        self.settings, self.cutoff, self.possible = settings, cutoff, possible
        self.problem = OutputError(blocks, Scales.of(settings), cutoff, possible)
        self.error = math.nan  # with delay and lag in use, where that is known [m/s or rad/s]
        self._begin: Array | None = None  # scaled parameters to begin with

    def with_settings(self, settings: DofSettings) -> Dof:
        """Return the same with another model."""
        return Dof(self.name, self.row, self.segments, self.blocks, settings, self.cutoff,
                   self.possible)

    def fit_commands(self, candidates: Sequence[CommandedForce],
                     pair: tuple[float, float]) -> Array:
        """Return the errors of a model for each way in which commands become a force."""
        return self._fit([self.blocks.force(one, self.row, *pair) for one in candidates]).errors

    def fit_models(self, commanded: CommandedForce, pair: tuple[float, float],
                   models: Sequence[DofSettings]) -> Array:
        """Return the errors of models with other terms or couplings."""
        names = tuple(dict.fromkeys(name for model in models for name in model.couplings))
        active = np.array([[*[name in model.terms for name in PARAMETERS],
                            *[name in model.couplings for name in names]] for model in models])
        whole = self.with_settings(replace(self.settings, terms=PARAMETERS, couplings=names))
        force = self.blocks.force(commanded, self.row, *pair)[:, None]
        return whole.problem.fit(np.broadcast_to(
            force, (len(force), len(models), force.shape[2])), active=active).errors

    def fit(self, commanded: CommandedForce, pairs: Sequence[tuple[float, float]],
            measured: Array | None = None) -> Fit:
        """Return a model for each pair of delay and lag."""
        return self._fit(
            [self.blocks.force(commanded, self.row, *pair) for pair in pairs], measured)

    def _fit(self, forces: Sequence[Array], measured: Array | None = None) -> Fit:
        """Return a model for each force; what a fit begins with is found once."""
        if self._begin is None:
            self._begin = self.problem.fit(forces[0][:, None]).theta[0]
        force = np.stack(forces, 1)
        if measured is not None:
            force = np.broadcast_to(force, (len(force), *measured.shape[1:]))
        return self.problem.fit(force, measured, self._begin)


def typical(blocks: Blocks, force: Array, settings: DofSettings) -> DofSettings:
    """Return a DOF with the amplitudes of sinusoids as large as its force and velocity."""
    rms = [math.sqrt(2.0 * float(np.mean(x ** 2)))
           for x in (blocks.moved(force), blocks.measured[blocks.valid])]
    return replace(settings, typical_force=rms[0], typical_velocity=rms[1])


def dof_or_reason(log: TuningLog, seen: Settings, name: str, settings: DofSettings,
                  commanded: CommandedForce, count: int) -> Dof | str:
    """
    Return a DOF of a log that was read with ``seen``, or why nothing can be tuned with it.

    Each fold has ``count`` parts.
    """
    segments = log.segments(name)
    time = time_of(segments)
    if time < MIN_TIME:
        # rounded down: of a minute the first fixes make no step
        return f'{math.floor(10.0 * time) / 10.0:g} s of steps, takes {MIN_TIME:.0f} s'
    parts = blocks(segments, part_bounds(segments, count))
    if parts is None:
        return f'an eighth of the log without steps, takes steps in each of {FOLDS} parts'
    row = seen.dofs.index(name)
    thrusters = seen.thrusters
    pair = (thrusters.delay, thrusters.time_constant)
    force = parts.force(commanded, row, *pair)
    if np.ptp(parts.moved(force)) <= 1e-9 * max(1.0, float(np.abs(force).max())):
        return 'no thrust that changes'
    if not np.ptp(parts.measured[parts.valid]):
        return 'no motion'
    dof = Dof(name, row, segments, parts, typical(parts, force, settings), seen.cutoff,
              seen.couplings(name))
    dof.error = float(np.nanmean(dof.fit(commanded, [pair]).errors))
    level = parts.measured - np.nanmean(parts.by_part(parts.measured))
    still = float(np.abs(np.where(parts.valid, level, 0.0)).sum() / parts.valid.sum())
    if not dof.error < (1.0 - MIN_GAIN) * still:
        return 'a motion that its thrust does not explain'
    return dof
