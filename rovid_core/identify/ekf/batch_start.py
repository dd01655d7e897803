"""
The first seconds of the extended Kalman filter again, in steps of Gauss-Newton.

The steps are kept for that, in a saved state too, which may have anything for numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from math import fsum, inf, log, sqrt
from statistics import median
from typing import Any, Final, Generic, Protocol, TypeVar

from rovid_core.identify.ekf.evidence.innovations import CLIPPED, HUBER, Innovations
from rovid_core.identify.ekf.evidence.score_blocks import ScoreBlocks
from rovid_core.identify.ekf.normalised_model import Unmodelled
from rovid_core.identify.method import DivergenceError, floats
from rovid_core.model.dofs import Three
from rovid_core.model.samples import PlanarPiece, PlanarStart, PlanarStep, Step

PERIOD: Final = 20.0
"""[s] of motion after which all of it is gone through again."""

LONGEST: Final = 5.9 * PERIOD
"""[s] after which the filter goes on by itself, once it knows what the thrust does."""

MANY: Final = 500
"""
Steps without which that time tells next to nothing: a filter that was linearised at what a few
slow fixes say does not find the truth any more.
"""

GROWTH: Final = 1.0 / 12.0
"""Share by which what is kept grows, at least, before all of it is gone through again."""

NEVER: Final = 1e9
"""[s] of motion that it never takes."""

KNOWN = 0.2
"""Relative std of alpha that is knowing it: what is kept is gone through half as often."""

KNOWN_WELL = 0.05
"""
The same of every parameter, relative to alpha, from which a pass that leads to where the filter
was is the last one: it follows the data as well as a pass over all of them does.
"""

USED: Final = 0
OUTLIER: Final = 1
UNLEARNED: Final = 2
"""What a step is: a measurement, one that does not count, one that tells the motion alone."""

PASSES = 5

SETTLED = 0.3
"""Standard deviations that the parameters still move by when no pass is needed any more."""

BUDGET = 6_000
"""Measurements that are gone through at once; of more there are fewer passes."""

PART: Final = 50
"""Measurements that are gone through between two places where a pass may be left to wait."""


STEPS = (Step, PlanarStep)
"""What is not a velocity at which the filter takes up."""

LARGEST_NUMBER = 1e18
"""Far more than any force, velocity or time of a step."""


class AnyFilter(Protocol):
    """What the start needs of a filter."""

    theta: Any
    theta_covariance: Any


class Learner(Protocol):
    """A filter that can go through what was measured."""

    innovations: Innovations
    blocks: ScoreBlocks
    unmodelled: Unmodelled

    @property
    def filter(self) -> AnyFilter:
        """Return the filter."""

    def restart(self, start: Any) -> None:
        """Take up from a measured velocity."""

    def move(self, recent: Any, span: Any) -> None:
        """Predict to the time of a measurement under what force there was."""

    def learn(self, span: Any, used: bool) -> list[float]:
        """Take a measurement at fixed parameters; return its sizes in standard deviations."""

    def settle(self) -> None:
        """Go to the parameters that fit best what was learned."""


class Clock(Protocol):
    """What turns steps into measurements."""

    @property
    def recent(self) -> Any:
        """Return the force since the path began."""

    def restart(self) -> None:
        """Begin a new path."""

    def add_step(self, step: Any) -> Any:
        """Return what a step measures."""


M = TypeVar('M', bound=Learner)
T = TypeVar('T')


def finish(parts: Generator[int, None, T]) -> T:
    """Go on with what is done in parts until it is done; return what comes of it."""
    while True:
        try:
            next(parts)
        except StopIteration as end:
            result: T = end.value
            return result


class BatchStart(Generic[M]):
    """
    What was measured since the filter began; nothing of it is thrown away.

    Each pass over it is linearised at fixed parameters, and ends with those that fit it all.

    Parameters
    ----------
    new : callable
        Makes a member at some parameters, for what moves the vehicle besides its model.
    new_clock : callable
        Makes what turns steps into measurements and forgets no force.
    read : callable
        Makes a piece from its numbers; raises ValueError if they do not fit.
    budget : int
        Steps that are gone through at once; where fixes come fast there are fewer passes.

    Attributes
    ----------
    failed : float
        [s] of motion after which other thrusters were looked for the last time, if in vain.
    was_there : bool
        Whether the last solution is where its guess was: one pass settled it.

    """

    def __init__(self, new: Callable[[Unmodelled, Sequence[float]], M],
                 new_clock: Callable[[], Clock], read: Callable[[Any], Any],
                 budget: int = BUDGET) -> None:
        self._new, self._new_clock, self._read = new, new_clock, read
        self._budget = budget
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self.duration, self.next, self.failed = 0.0, PERIOD, 0.0  # [s]
        self.was_there = False
        self._pieces: list[tuple[Any, int]] = []
        self._measured: list[tuple[Any, Any, int]] = []

    def add(self, piece: Any, use: int = USED) -> None:
        """Add a step, or the velocity at which the filter takes up, as a member wants it."""
        self._pieces.append((piece, use))
        self._measured = []
        if isinstance(piece, STEPS) and use != UNLEARNED:
            self.duration += piece.dt

    @property
    def may_search(self) -> bool:
        """Tell whether there is enough new since other thrusters were looked for in vain."""
        return self.duration >= self.failed + PERIOD

    def is_much(self, times: float = 1.0) -> bool:
        """Tell whether there is so many times what tells of a vehicle that is driven well."""
        return self.duration > times * LONGEST and len(self._pieces) > times * MANY

    def is_enough(self, known: bool) -> bool:
        """Tell whether the filter may go on by itself; ``known`` tells whether alpha is."""
        return known and self.duration > LONGEST or self.is_much(2.0)

    @property
    def is_new(self) -> bool:
        """Tell whether there is something, of which nothing was gone through again yet."""
        return 0.0 < self.duration < self.next == PERIOD

    def wait(self, known: bool) -> None:
        """Find when all is to be gone through again; ``known`` tells whether alpha is."""
        self.next = self.duration + max(
            2.0 * PERIOD if known else PERIOD, GROWTH * self.duration)

    def change_clock(self) -> None:
        """Let all be measured again by a new clock."""
        self._measured = []

    def accept_last_outliers(self, count: int) -> None:
        """Let the last outliers count: they were the vehicle."""
        self._measured = []
        k = len(self._pieces)
        while count and k:
            k -= 1
            piece, use = self._pieces[k]
            if use == OUTLIER:
                self._pieces[k] = (piece, USED)
                count -= 1

    def solve(self, member: M, guesses: Sequence[Sequence[float]],
              most: int = PASSES) -> Generator[int, None, M]:
        """
        Return a member that went through all this at the parameters that fit it best.

        That is done in parts; after each it gives how many measurements it went through in it.

        Parameters
        ----------
        member : Learner
            As it went through it so far.
        guesses : sequence of sequences of p floats
            Parameters to begin with, one after another until the passes settle; the best end
            counts.
        most : int
            Passes at most.

        Raises
        ------
        DivergenceError
            If that leads nowhere.

        """
        if not self._measured:
            self._measured = self._measure()
        passes = min(max(self._budget // (len(guesses) * max(len(self._measured), 1)), 1), most)
        best, least, settled = None, inf, 0
        for theta in guesses:
            if settled:
                break
            with suppress(ArithmeticError):
                found, value, settled = yield from self._iterate(member, theta, passes)
                if value < least:
                    best, least = found, value
                    self.was_there = settled == 1
        if best is None:
            raise DivergenceError('no pass came to an end')
        return best

    def _iterate(self, member: M, theta: Sequence[float],
                 passes: int) -> Generator[int, None, tuple[M, float, int]]:
        """Return a member, how badly it fits, and after how many passes it settled, 0 for none."""
        noise, settled = member.innovations.noise, 0
        for k in range(passes):
            found = self._new(member.unmodelled, theta)
            innovations = found.innovations
            innovations.noise = noise
            sizes = yield from self._pass(found)
            level = innovations.scale_noise(_level(sizes))
            noise = innovations.noise
            # what it would have been at the level of noise that is right
            innovations.likelihood += 2.0 * len(sizes) * log(level) + fsum([
                min(size / level, HUBER)**2 - min(size, HUBER)**2 for size in sizes])
            value = innovations.likelihood + found.blocks.misfit(theta)
            found.settle()
            last, theta = theta, found.filter.theta
            moved = [abs(a - b) - SETTLED * sqrt(row[i]) for i, (a, b, row) in enumerate(
                zip(last, theta, found.filter.theta_covariance))]
            if abs(level - 1.0) < SETTLED and max(moved) <= 0.0:
                settled = k + 1
                break
        return found, value, settled

    def _pass(self, member: M) -> Generator[int, None, list[float]]:
        sizes: list[float] = []
        for k, (recent, span, use) in enumerate(self._measured):
            if k % PART == 0:
                yield PART
            if recent is None:
                member.restart(span)
                continue
            member.move(recent, span)
            if use != OUTLIER:
                sizes += member.learn(span, use == USED)
        return sizes

    def _measure(self) -> list[tuple[Any, Any, int]]:
        """Return what the pieces measure and under what force, once for all passes."""
        clock = self._new_clock()
        found: list[tuple[Any, Any, int]] = []
        for piece, use in self._pieces:
            if not isinstance(piece, STEPS):
                clock.restart()
                found.append((None, piece, use))
                continue
            span = clock.add_step(piece)
            if span is not None:
                found.append((clock.recent, span, use))
        return found

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""
        return {'next': self.next, 'failed': self.failed, 'pieces': [
            [list(piece.fields() if isinstance(piece, Step) else piece)
             if isinstance(piece, STEPS) else piece, use]
            for piece, use in self._pieces]}

    def restore(self, state: Any) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
        pieces = [(self._read(piece), int(use)) for piece, use in state['pieces']]
        self.clear()
        self.next, self.failed = finite_number(state['next']), finite_number(state['failed'])
        for piece, use in pieces:
            self.add(piece, use)


def _level(sizes: Sequence[float]) -> float:
    """Return the standard deviation of normalised innovations without the outliers."""
    if not sizes:  # fixes that each begin anew, after a gap
        raise DivergenceError('nothing was measured')
    level = max(median(sizes) / 0.6745, 1e-9)
    squares = [min(size / level, HUBER)**2 for size in sizes]
    return level * sqrt(fsum(squares) / len(squares) / CLIPPED)


def read_step(values: Any, couplings: int, watched: int, shares: bool) -> Step | float:
    """
    Return a step with some number of regressors, or a velocity; raises ValueError.

    Parameters
    ----------
    values : list or float
        What a saved state has of it.
    couplings, watched : int
        How many there are.
    shares : bool
        Whether it says what each thruster did.

    """
    if not isinstance(values, list):
        return finite_number(values)
    *plain, pairs, filtered, pieces, also, each = values
    numbers = [tuple(map(finite_number, x)) if isinstance(x, (list, tuple)) else
               finite_number(x) for x in plain]
    regressors = (tuple([(finite_number(a), finite_number(b)) for a, b in pairs]),
                  tuple(map(finite_number, filtered)), tuple(map(finite_number, also)))
    if _sizes(numbers) != _sizes(Step(0.0, (0.0,) * 3, (0.0,) * 3).fields()[:-5]) or (
            _sizes(regressors) not in (
                [0, 0, 0], [0, 0, watched], [couplings, couplings, watched])):
        raise ValueError('a step does not fit')
    held = tuple([(finite_number(a), finite_number(b)) for a, b in pieces])
    fields: list[Any] = [*numbers, *regressors[:2], held, regressors[2],
                         _each(each, len(held), shares)]
    step = Step(*fields)
    if not step.dt > 0.0:
        raise ValueError('a step takes no time')
    return step


def _each(values: Any, pieces: int, shares: bool) -> tuple[Three, ...]:
    """Return what each thruster did over some pieces, or two parts; raises ValueError."""
    found = tuple([(finite_number(a), finite_number(b), finite_number(c)) for a, b, c in values])
    if len(found) != ((pieces or 2) if shares else 0):
        raise ValueError('a step does not fit')
    return found


def read_planar_step(values: Any, regressors: Sequence[int],
                     shares: Sequence[bool]) -> PlanarStep | PlanarStart:
    """
    Return a step or a start of surge and sway from its numbers; raises ValueError.

    Parameters
    ----------
    values : list
        What a saved state has of it.
    regressors : pair of ints
        How many those of surge and of sway are.
    shares : pair of bools
        Whether it says what each of their thrusters did.

    """
    if len(values) == len(PlanarStart._fields):
        (u, v), (a, b, c, d), gap = values
        return PlanarStart((finite_number(u), finite_number(v)), (
            finite_number(a), finite_number(b), finite_number(c), finite_number(d)),
            finite_number(gap))
    dt, interval, noise = [finite_number(values[i]) for i in (0, 2, 8)]
    velocity, parts, value = [
        (finite_number(a), finite_number(b)) for a, b in (values[1], values[3], values[5])]
    (p, q), (r, s) = values[4]
    a, b, c, d = map(finite_number, values[7])
    one, other = [tuple(map(finite_number, x)) for x in values[9]]
    held, more = [tuple([(finite_number(x), finite_number(y)) for x, y in pieces])
                  for pieces in values[10]]
    if not (dt > 0.0 and values[6]) or [len(one), len(other)] != list(regressors):
        raise ValueError('a step does not fit')
    return PlanarStep(
        dt, velocity, interval, parts, ((finite_number(p), finite_number(q)),
                                        (finite_number(r), finite_number(s))), value,
        tuple([PlanarPiece(*floats(piece, 7)) for piece in values[6]]), (a, b, c, d), noise,
        (one, other), (held, more), (_each(values[11][0], len(held), shares[0]),
                                     _each(values[11][1], len(more), shares[1])))


def _sizes(values: Sequence[Any]) -> list[int]:
    return [len(x) if isinstance(x, tuple) else -1 for x in values]


def finite_number(value: Any) -> float:
    """Return a number of a step; raises ValueError unless it is one."""
    number = float(value)
    if not abs(number) < LARGEST_NUMBER:
        raise ValueError(f'{number} in a step')
    return number
