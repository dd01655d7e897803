"""Steps as a saved state has them, in numbers that may be anything."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rovid_core.identify.ekf.single.linearised_filter import floats
from rovid_core.model.samples import PlanarPiece, PlanarStart, PlanarStep, Step

LARGEST_NUMBER = 1e18
"""Far more than any force, velocity or time of a step."""


def read_step(values: Any, couplings: int, watched: int) -> Step | float:
    """
    Return a step with some number of regressors, or a velocity; raises ValueError.

    Parameters
    ----------
    values : list or float
        What a saved state has of it.
    couplings, watched : int
        How many there are.

    """
    if not isinstance(values, list):
        return finite_number(values)
    *plain, pairs, filtered, pieces, also = values
    numbers = [tuple(map(finite_number, x)) if isinstance(x, (list, tuple)) else
               finite_number(x) for x in plain]
    regressors = (tuple([(finite_number(a), finite_number(b)) for a, b in pairs]),
                  tuple(map(finite_number, filtered)), tuple(map(finite_number, also)))
    if _sizes(numbers) != _sizes(Step(0.0, (0.0,) * 3, (0.0,) * 3).fields()[:-4]) or (
            _sizes(regressors) not in (
                [0, 0, 0], [0, 0, watched], [couplings, couplings, watched])):
        raise ValueError('a step does not fit')
    held = tuple([(finite_number(a), finite_number(b)) for a, b in pieces])
    fields: list[Any] = [*numbers, *regressors[:2], held, regressors[2]]
    step = Step(*fields)
    if not step.dt > 0.0:
        raise ValueError('a step takes no time')
    return step


def read_planar_step(values: Any, regressors: Sequence[int]) -> PlanarStep | PlanarStart:
    """
    Return a step or a start of surge and sway from its numbers; raises ValueError.

    Parameters
    ----------
    values : list
        What a saved state has of it.
    regressors : pair of ints
        How many those of surge and of sway are.

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
        (one, other), (held, more))


def _sizes(values: Sequence[Any]) -> list[int]:
    return [len(x) if isinstance(x, tuple) else -1 for x in values]


def finite_number(value: Any) -> float:
    """Return a number of a step; raises ValueError unless it is one."""
    number = float(value)
    if not abs(number) < LARGEST_NUMBER:
        raise ValueError(f'{number} in a step')
    return number
