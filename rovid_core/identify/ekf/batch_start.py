"""The first seconds of the extended Kalman filter again, in steps of Gauss-Newton."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from math import fsum, inf, log, sqrt
from statistics import median
from typing import Any

from rovid_core.identify.ekf.filter_bank import Member
from rovid_core.identify.ekf.innovations import CLIP, CLIPPED, HUBER
from rovid_core.identify.ekf.linearised_filter import Bounds, DivergenceError
from rovid_core.identify.ekf.measurements import MeasurementClock
from rovid_core.model.samples import Step

PERIOD = 20.0
"""[s] of motion after which all of it is gone through again."""

LONGEST, LONGEST_UNKNOWN = 2.9 * PERIOD, 5.9 * PERIOD
"""[s] after which the filter goes on by itself, if it knows alpha and if it does not."""

KNOWN = 0.2
"""Relative std of alpha that is knowing it."""

USED, OUTLIER, UNLEARNED = range(3)
"""What a step is: a measurement, one that does not count, one that tells the motion alone."""

PASSES = 5

SETTLED = 0.3
"""Standard deviations that the parameters still move by when no pass is needed any more."""

BUDGET = 6_000
"""Steps that are gone through at once; where fixes come fast there are fewer passes."""

LARGEST_NUMBER = 1e18
"""Far more than any force, velocity or time of a step."""


class BatchStart:
    """
    What was measured since the filter began; nothing of it is thrown away.

    Each pass over it is linearised at fixed parameters, and ends with those that fit it all.

    Parameters
    ----------
    new : callable
        Makes a member at some parameters, for a size of the unknown acceleration.
    new_clock : callable
        Makes what turns steps into measurements.
    velocity : float
        The unit.
    bounds : Bounds
        Of the parameters.

    """

    def __init__(self, new: Callable[[float, Sequence[float]], Member],
                 new_clock: Callable[[], MeasurementClock], velocity: float,
                 bounds: Bounds) -> None:
        self._new, self._new_clock, self._velocity = new, new_clock, velocity
        self._bounds = bounds
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self.duration, self.next = 0.0, PERIOD  # [s]
        self._pieces: list[tuple[Step | float, int]] = []

    def add(self, piece: Step | float, use: int = USED) -> None:
        """Add a step, or the velocity at which the filter takes up."""
        self._pieces.append((piece, use))
        if isinstance(piece, Step) and use != UNLEARNED:
            self.duration += piece.dt

    def accept_last_outliers(self, count: int) -> None:
        """Let the last outliers count: they were the vehicle."""
        for k in range(max(len(self._pieces) - count, 0), len(self._pieces)):
            self._pieces[k] = (self._pieces[k][0], USED)

    def solve(self, member: Member, guesses: Sequence[Sequence[float]],
              most: int = PASSES) -> Member:
        """
        Return a member that went through all this at the parameters that fit it best.

        Parameters
        ----------
        member : Member
            As it went through it so far.
        guesses : sequence of sequences of p floats
            Parameters to begin with; the best end counts.
        most : int
            Passes at most.

        Raises
        ------
        DivergenceError
            If that leads nowhere.

        """
        count = len(guesses) * max(len(self._pieces), 1)
        passes = min(max(BUDGET // count, 1), most)
        best, least = None, inf
        for theta in guesses:
            with suppress(ArithmeticError):
                found, value = self._iterate(member, theta, passes)
                if value < least:
                    best, least = found, value
        if best is None:
            raise DivergenceError('no pass came to an end')
        return best

    def _iterate(self, member: Member, theta: Sequence[float],
                 passes: int) -> tuple[Member, float]:
        noise, force_std = member.innovations.noise, member.filter.force_std
        for _ in range(passes):
            found = self._new(force_std, theta)
            found.innovations.noise = noise
            sizes = self._pass(found)
            level = _level(sizes)
            # what it would have been at the level of noise that is right
            found.innovations.likelihood += 2.0 * len(sizes) * log(level) + fsum([
                min(size / level, HUBER)**2 - min(size, HUBER)**2 for size in sizes])
            value = found.innovations.likelihood + found.blocks.misfit(theta)
            noise = max(noise * level, 1e-9)
            filter = found.filter
            solution, filter.theta_covariance = found.blocks.solution()
            filter.set_theta(solution)
            filter.keep_inside(self._bounds)
            last, theta = theta, filter.theta
            moved = [abs(a - b) - SETTLED * sqrt(row[i]) for i, (a, b, row) in enumerate(
                zip(last, theta, filter.theta_covariance))]
            if abs(level - 1.0) < SETTLED and max(moved) <= 0.0:
                break
        found.innovations.noise = noise
        return found, value

    def _pass(self, member: Member) -> list[float]:
        clock = self._new_clock()
        filter, innovations, variance = member.filter, member.innovations, 0.0
        sizes: list[float] = []
        for piece, use in self._pieces:
            if not isinstance(piece, Step):
                clock.restart()
                member.restart(piece / self._velocity)
                continue
            span = clock.add_step(piece)
            member.move(clock.recent, span)
            if span.value is None or use == OUTLIER:
                continue
            variance = innovations.noise**2
            found = filter.innovation(span.i, span.value, variance)
            normalised = found.error / sqrt(found.given)
            if innovations.is_outlier(normalised) and innovations.is_lost(False):
                filter.widen_motion(found.error**2, found.error**2)
                continue
            size = abs(normalised)
            sizes.append(size)
            innovations.add(normalised, found.given)
            added = found.given * (size / HUBER - 1.0) if size > HUBER else 0.0
            filter.update_motion(found, added)
            if use == USED:
                member.blocks.add(found, added, filter.theta, span.dt)
        return sizes

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'next': self.next, 'pieces': [
            [list(piece) if isinstance(piece, Step) else piece, use]
            for piece, use in self._pieces]}

    def restore(self, state: Any) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        clock = self._new_clock()
        pieces = [(_step(piece, clock.couplings, clock.watched) if isinstance(piece, list)
                   else _finite(piece), int(use)) for piece, use in state['pieces']]
        self.clear()
        self.next = _finite(state['next'])
        for piece, use in pieces:
            self.add(piece, use)


def _level(sizes: Sequence[float]) -> float:
    """Return the standard deviation of normalised innovations without the outliers."""
    if not sizes:  # fixes that each begin anew, after a gap
        raise DivergenceError('nothing was measured')
    level = max(median(sizes) / 0.6745, 1e-9)
    squares = [min(size / level, CLIP)**2 for size in sizes]
    return level * sqrt(fsum(squares) / len(squares) / CLIPPED)


def _step(values: Sequence[Any], couplings: int, watched: int) -> Step:
    *plain, pairs, filtered, pieces, also = values
    numbers = [
        tuple(map(_finite, x)) if isinstance(x, (list, tuple)) else _finite(x) for x in plain]
    regressors = (tuple([(_finite(a), _finite(b)) for a, b in pairs]),
                  tuple(map(_finite, filtered)), tuple(map(_finite, also)))
    if _sizes(numbers) != _sizes(Step(0.0, (0.0,) * 3, (0.0,) * 3)[:-4]) or (
            _sizes(regressors) not in (
                [0, 0, 0], [0, 0, watched], [couplings, couplings, watched])):
        raise ValueError('a step does not fit')
    held = tuple([(_finite(a), _finite(b)) for a, b in pieces])
    step = Step._make([*numbers, *regressors[:2], held, regressors[2]])
    if not step.dt > 0.0:
        raise ValueError('a step takes no time')
    return step


def _sizes(values: Sequence[Any]) -> list[int]:
    return [len(x) if isinstance(x, tuple) else -1 for x in values]


def _finite(value: Any) -> float:
    number = float(value)
    if not abs(number) < LARGEST_NUMBER:
        raise ValueError(f'{number} in a step')
    return number
