"""The first seconds of the extended Kalman filter again, from a better linearisation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import fsum, sqrt
from statistics import median
from typing import Any

from rovid_core.identify.ekf.innovations import CLIP, CLIPPED, CORRELATED, HUBER, Innovations
from rovid_core.identify.ekf.linearised_filter import ALPHA, Bounds, DivergenceError
from rovid_core.identify.ekf.step_filter import StepFilter
from rovid_core.model.samples import Step

DURATION = 20.0
"""[s] of motion that are gone through again."""

LONGEST = 3.0 * DURATION
"""[s] after which they are given up, and later ones taken."""

KNOWN = 0.2
"""Relative std of alpha that they have to reach; before, there was too little thrust."""

PASSES = 3

LARGEST_NUMBER = 1e18
"""Far more than any force, velocity or time of a step."""


class BatchStart:
    """
    What was measured since the filter began.

    Each pass over it is linearised where the last one ended: a step of Gauss-Newton.
    """

    def __init__(self) -> None:
        self.duration = 0.0  # [s]
        self._pieces: list[tuple[Step | float, bool]] = []

    def add(self, piece: Step | float, outlier: bool = False) -> None:
        """Take a step, or the velocity at which the filter takes up."""
        self._pieces.append((piece, outlier))
        if isinstance(piece, Step):
            self.duration += piece.dt

    def solve(self, new: Callable[[Sequence[float]], StepFilter], bounds: Bounds,
              estimate: Sequence[float], noise: float) -> tuple[StepFilter, Innovations]:
        """
        Return a filter that went through all this, and what its innovations say.

        Parameters
        ----------
        new : callable
            Makes a filter at the initial values, linearised at the parameters it is given.
        bounds : Bounds
            Of the state.
        estimate : sequence of 5 floats
            Parameters and delay to begin with.
        noise : float
            Of a measurement, so far.

        Raises
        ------
        DivergenceError
            If that leads nowhere.

        """
        try:
            found = self._passes(new, bounds, estimate, noise, False)
            if found[1].correlation <= CORRELATED:
                return found
        except DivergenceError:
            pass
        return self._passes(new, bounds, estimate, noise, True)

    def _passes(self, new: Callable[[Sequence[float]], StepFilter], bounds: Bounds,
                estimate: Sequence[float], noise: float, model_error: bool
                ) -> tuple[StepFilter, Innovations]:
        for _ in range(PASSES):
            step_filter, innovations = new(estimate), Innovations(noise, model_error)
            sizes = self._pass(step_filter, innovations)
            step_filter.filter.relinearise(bounds)
            estimate = step_filter.filter.nominal[ALPHA:]
            noise = innovations.noise = max(noise * _level(sizes), 1e-9)
        return step_filter, innovations

    def _pass(self, step_filter: StepFilter, innovations: Innovations) -> list[float]:
        noise, began = innovations.noise, -1
        sizes: list[float] = []
        for k, (piece, outlier) in enumerate(self._pieces):
            if not isinstance(piece, Step):
                self._note_beginning(began, step_filter)
                step_filter.restart(piece, noise)
                step_filter.filter.estimate_initial_velocity()
                began = k
                continue
            measured = step_filter.move(piece, innovations.model_noise(piece), noise)
            if measured is None or outlier:
                continue
            i, value = measured
            error, variance = step_filter.filter.innovation(i, value, noise * noise)
            normalised = error / sqrt(variance)
            innovations.add_to_correlation(normalised, piece.dt)
            step_filter.filter.update(i, error, variance * max(1.0, abs(normalised) / HUBER))
            sizes.append(abs(normalised))
        self._note_beginning(began, step_filter)
        return sizes

    def _note_beginning(self, k: int, step_filter: StepFilter) -> None:
        """Let the next pass begin at the velocity that this one found."""
        if k >= 0:
            self._pieces[k] = (step_filter.initial_velocity, False)

    def state(self) -> list[list[Any]]:
        """Return all that is needed to go on from here."""
        return [[list(piece) if isinstance(piece, Step) else piece, outlier]
                for piece, outlier in self._pieces]

    def restore(self, state: Sequence[Sequence[Any]]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        pieces = [(_step(piece) if isinstance(piece, list) else _finite(piece), bool(outlier))
                  for piece, outlier in state]
        self.duration, self._pieces = 0.0, []
        for piece, outlier in pieces:
            self.add(piece, outlier)


def _level(sizes: Sequence[float]) -> float:
    """Return the standard deviation of normalised innovations without the outliers."""
    if not sizes:  # fixes that each begin anew, after a gap
        raise DivergenceError('nothing was measured')
    level = max(median(sizes) / 0.6745, 1e-9)
    squares = [min(size / level, CLIP)**2 for size in sizes]
    return level * sqrt(fsum(squares) / len(squares) / CLIPPED)


def _step(values: Sequence[Any]) -> Step:
    numbers = [
        tuple(map(_finite, x)) if isinstance(x, (list, tuple)) else _finite(x) for x in values]
    if _sizes(numbers) != _sizes(Step(0.0, (0.0,) * 3, (0.0,) * 3)):
        raise ValueError('a step does not fit')
    step = Step(*numbers)  # type: ignore[arg-type]
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
