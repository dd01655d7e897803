"""
What a model predicts of the last minute without corrections, and what its errors follow.

A method that has no covariance and looks at no residuals is judged by this. The path of the last
minute is predicted in blocks, each from its best start, with the parameters that were published
before it. The errors are white noise of the fixes where the model is right. Where it is wrong,
they follow what it lacks: the response of the model to a further force explains them. By the same
least squares the minute says by itself what the parameters are (output error, one Gauss-Newton
step).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Final

import numpy as np
from rovid_core.model.dofs import OWN, own_coefficients
from rovid_core.model.plant import Array
from rovid_core.model.samples import Step
from rovid_core.model.thrusters import DEAD_BAND
from rovid_core.settings.run import Scales

BLOCK: Final = 10.0  # length of a block [s]
BLOCKS: Final = 6  # how many count
# The share of the motion that has to be predicted, to become converged and while it is.
PREDICTS = (0.9, 0.85)
# What a vehicle often has and the model has not, each an acceleration with one regressor.
CANDIDATES = {
    'dead_band': 'a dead band of the thrusters', 'reverse_thrust': 'reverse thrust',
    'reverse_drag': 'reverse drag', 'lag': 'a lag of the thrusters',
    'thrust_loss': 'thrust that falls with speed'}
# Where it can be told to the model, if it can, as the end of a sentence.
KEYS = {'dead_band': ': see thrusters.dead_zone', 'reverse_thrust': ': see thrusters.reverse',
        'dead_band_of_each': ': see thrusters.dead_zone',
        'reverse_of_each': ': see thrusters.reverse',
        'thrust_loss_of_each': ': drive one axis at a time',
        'lag': ': see thrusters.time_constant', 'turns_lag': ': see thrusters.lag_of_turns',
        'torque': ': see thrusters.lag_at',
        'thrust_loss': '',
        'current': ': see current.prior'}
LAG: Final = 0.15  # [s] of the thruster lag that is looked for
# A candidate is named from this share of the squared error that it explains, and from this share
# of the model's acceleration that it is.
EXPLAINS, MATTERS = 0.3, 0.05
KNOWN: Final = 0.05  # relative standard deviation of alpha up to which the minute shows the mass
MASS_OFF: Final = 0.1  # relative difference from the minute's own mass that is too much
SIGNIFICANT: Final = 2.0  # standard deviations of that mass that are left to chance
NEAR: Final = 0.5  # relative change of alpha up to which one step of Gauss-Newton is a good one
TINY: Final = 1e-300  # variance of a path without any errors
ALONE: Final = 1e-6  # least share of a candidate's square that the parameters must not explain

UNTOLD_DEAD_BAND = (
    'a dead band of the thrusters cannot be told from the mass yet: push at several sizes')


def lacking(share: float, name: str, said: str, couplings: Sequence[str]) -> str:
    """
    Return that a share of the error follows one of ``CANDIDATES``, and what to do.

    ``couplings`` are those that the DOF has.
    """
    advice = KEYS.get(name, f': add couplings: [{", ".join([*couplings, name])}]')
    return (f'{share_of_error(share)} of the error follows {said}, which the model does not '
            f'have{advice}')


def share_of_error(share: float) -> str:
    """Return a share of the squared errors in words: a small one may be of what matters."""
    return f'{100.0 * min(share, 1.0):.0f} %' if share >= 0.01 else 'less than 1 %'


@dataclass(frozen=True)
class Block:
    """Sums over the fixes of a block, with its start fitted; unknowns are accelerations."""

    normal: Array  # shape (k, k), k = 4 + m + candidates
    right: Array  # shape (k,)
    error: float  # squared error of the path [m^2 or rad^2]
    path: float  # square of the path itself about a straight line
    squares: Array  # shape (k,), of each regressor
    acceleration: float  # square of the model's
    count: int


class LastMinute:
    """The blocks of the last minute of one DOF."""

    def __init__(self, scales: Scales) -> None:
        self._scales = scales
        self._size = (*scales.regressor, *scales.coupling_regressor)
        self._end = math.nan  # filtered velocity at the end of the last step
        self._steps: list[tuple[float, float, float, tuple[float, ...]]] = []
        self._blocks: list[Block] = []
        self._time = self._measured = self._start = 0.0
        self._model: tuple[float, ...] = ()

    def add_step(self, step: Step, model: tuple[float, ...]) -> None:
        """Add a step, and the parameters and couplings that are published now."""
        start, _, end = step.velocity
        if start != self._end:  # the first step, or one after an interruption
            self._begin(start, model)
        h, (lead, tail) = step.dt, step.parts
        before, after = self._measured, step.mean
        path = lead * before + tail * after if step.interval else 0.5 * h * (before + after)
        force = (lead * step.forces[0] + tail * step.forces[1]) / h
        others = tuple([(lead * x + tail * y) / h for x, y in step.couplings]) if (
            step.couplings) else ()
        self._steps.append((h, path, force, others))
        self._measured, self._end = after, end
        self._time += h
        if self._time >= BLOCK:
            self._blocks = [*self._blocks, self._block()][-BLOCKS:]
            self._begin(after, model)

    def _begin(self, velocity: float, model: tuple[float, ...]) -> None:
        self._steps, self._time = [], 0.0
        self._start = self._measured = velocity
        self._model = model
        self._doubts: dict[bool, str] = {}  # of these blocks and this model

    @property
    def fit(self) -> float:
        """Return the share of the motion that is predicted: 1 - rms(error) / rms(path)."""
        error, path = (math.fsum([b.error for b in self._blocks]),
                       math.fsum([b.path for b in self._blocks]))
        return 1.0 - math.sqrt(error / path) if path > 0.0 else math.nan

    def doubt(self, converged: bool) -> str:
        """Return why the model must not be used yet (or any more), '' if it may."""
        if converged not in self._doubts:
            self._doubts[converged] = self._doubt(converged)
        return self._doubts[converged]

    def _doubt(self, converged: bool) -> str:
        if len(self._blocks) < BLOCKS:
            return 'the model has not predicted a minute yet'
        error, acceleration = (math.fsum([b.error for b in self._blocks]),
                               math.fsum([b.acceleration for b in self._blocks]))
        normal, right, squares = (
            sum(getattr(b, name) for b in self._blocks) for name in ('normal', 'right', 'squares'))
        on = np.append(np.flatnonzero(self._scales.active), np.arange(4, len(self._size)))
        own, given = normal[np.ix_(on, on)], right[on]
        inverse = np.linalg.inv(own + 1e-12 * np.trace(own) * np.eye(len(on)))
        moved = inverse @ given
        left = max(error - float(moved @ given), 0.0)
        alpha = self._model[0] / self._size[0]
        off = moved[0] / alpha
        most, name = 0.0, ''
        for i, candidate in enumerate(CANDIDATES, start=len(self._size)):
            by_own = inverse @ normal[on, i]
            alone = normal[i, i] - normal[on, i] @ by_own
            if candidate in self._scales.couplings or not alone > ALONE * normal[i, i]:
                continue
            size = (right[i] - by_own @ given) / alone
            share = size * size * alone / left if left > 0.0 else 0.0
            matters = size * size * squares[i] > MATTERS**2 * acceleration
            if matters and share > max(most, EXPLAINS):
                most, name = share, candidate
        if name and abs(off) < NEAR:
            return lacking(most, name, CANDIDATES[name], self._scales.couplings)
        fit = self.fit
        if not fit >= PREDICTS[converged]:  # True for NaN
            return ('without corrections it predicts '
                    f'{100.0 * fit if fit > 0.0 else 0.0:.0f} % of the motion')
        variance = left / max(sum(b.count for b in self._blocks) - len(on), 1)
        std = math.sqrt(variance * inverse[0, 0]) / alpha
        if not std < KNOWN:
            return 'the mass does not show'
        # a dead band that may be there as far as the minute tells; before it, as wide as the one
        # that is looked for
        i = len(self._size)
        by_own = inverse @ normal[on, i]
        told = max(float(normal[i, i] - normal[on, i] @ by_own), 0.0)
        if by_own[0] > MASS_OFF * math.sqrt(1.0 + alpha * alpha * told / max(variance, TINY)):
            return UNTOLD_DEAD_BAND
        if abs(off) <= MASS_OFF + SIGNIFICANT * std:
            return ''
        other = 'smaller' if off > 0.0 else 'larger'
        return f'the last minute by itself asks for a {other} mass'

    def _thrust(self) -> float:
        """Return the size of the force over the block, which counts by its square; never 0."""
        total = cubes = 0.0
        for h, _, force, _ in self._steps:
            square = h * force * force
            total += square
            cubes += square * abs(force)
        # a force that fades away with the lag of its thrusters has cubes too small for a float
        return cubes / total if cubes > 0.0 else self._scales.force

    def _block(self) -> Block:
        """Simulate the model over the block and return the sums of its errors."""
        alpha, beta, gamma, delta = self._model[:4]
        names = self._scales.couplings
        _, reverse_drag = own_coefficients(names, self._model[4:])
        kappas = [0.0 if name == OWN[1] else p for name, p in zip(names, self._model[4:])]
        # over each step: mean velocity of the model, late part of the force, and by what the mean
        # of a change of the velocity is divided
        speeds: list[float] = []
        lates: list[float] = []
        rests: list[float] = []
        v, lagged = self._start, self._steps[0][2]
        acceleration = 0.0
        for h, _, force, others in self._steps:
            half, coupled = 0.5 * h, 0.0
            for p, x in zip(kappas, others):
                coupled += p * x
            target, linear = v + half * (alpha * force + delta + coupled), 1.0 - half * gamma
            slope = min(beta + reverse_drag, 0.0) if target < 0.0 else beta  # w has its sign
            quadratic = -half * slope
            w = 2.0 * target / (
                linear + math.sqrt(linear * linear + 4.0 * quadratic * abs(target)))
            gone = -math.expm1(-h / LAG)
            lates.append((force - lagged) * gone * LAG / h)
            lagged += gone * (force - lagged)
            rests.append(1.0 - half * (2.0 * slope * abs(w) + gamma))
            speeds.append(w)
            rate = 2.0 * (w - v) / h
            acceleration += rate * rate
            v = 2.0 * w - v
        lengths, paths, forces = np.array([step[:3] for step in self._steps]).T
        regressors = self._regressors(forces, np.array(speeds), np.array(lates))
        # derivatives of the path with respect to its start, to the velocity there, and to the
        # accelerations
        halves = 0.5 * lengths
        means = [mean_changes(1.0, np.zeros_like(halves), rests)] + [
            mean_changes(0.0, halves * phi, rests) for phi in regressors.T]
        table = np.ones((len(halves), 1 + len(means)))
        table[:, 1:] = np.cumsum(lengths * np.array(means), axis=1).T
        way = np.cumsum(paths)
        error = way - np.cumsum(lengths * np.array(speeds))
        starts, _ = np.linalg.qr(table[:, :2])
        table = table[:, 2:] - starts @ (starts.T @ table[:, 2:])
        error -= starts @ (starts.T @ error)
        # a straight line in time would be a constant velocity
        line, _ = np.linalg.qr(np.stack([np.ones(len(way)), np.cumsum(lengths)], axis=1))
        way = way - line @ (line.T @ way)
        return Block(table.T @ table, table.T @ error, float(error @ error), float(way @ way),
                     np.square(regressors).sum(axis=0), acceleration, len(way) - 2)

    def _regressors(self, forces: Array, speeds: Array, lates: Array) -> Array:
        """Return those of the model and of ``CANDIDATES`` over each step, shape (n, k)."""
        names, force_scale = self._scales.couplings, self._scales.force
        dead = DEAD_BAND * min(self._thrust(), force_scale)
        drags = speeds * np.abs(speeds)
        backwards = np.minimum(drags, 0.0)
        others = np.array([one[3] for one in self._steps])
        own = (forces, drags, speeds, np.ones(len(speeds)), *[
            backwards if name == OWN[1] else others[:, i] for i, name in enumerate(names)])
        return np.stack([
            *[x * size for x, size in zip(own, self._size)],
            DEAD_BAND * forces / np.maximum(np.abs(forces), dead),
            np.minimum(forces, 0.0) / force_scale, backwards / self._scales.velocity**2,
            lates / force_scale,
            np.sqrt(np.abs(forces) / force_scale) * speeds / self._scales.velocity], axis=1)


def mean_changes(start: float, drive: Array, rests: Sequence[float]) -> list[float]:
    """
    Return the mean change of the velocity over each step, by the midpoint rule.

    ``start`` is the change at the first one's start, ``drive`` half the step times the
    acceleration that is added. Plain floats take a fraction of the time that numpy needs.
    """
    v, found = start, []
    for u, rest in zip(drive.tolist(), rests):
        mean = (v + u) / rest
        v = 2.0 * mean - v
        found.append(mean)
    return found
