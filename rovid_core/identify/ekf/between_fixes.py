"""
The velocity along a step that takes long, which others are coupled with.

Between fixes that come seldom it is what the model makes of the thrust, no straight line.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Final

from rovid_core.model.samples import NS

LONGEST: Final = 0.15
"""[s] over which a velocity may go in a straight line: couplings by it are 2 % off at 0.2 s."""

Way = list[tuple[float, ...]]
"""How long before the end of a step [s], and velocities then."""


def is_long(dt: float) -> bool:
    """Tell whether a step [s] takes so long that its end alone does not tell how it went."""
    return dt > LONGEST


def parts(begin: float, end: float) -> list[tuple[float, float]]:
    """Return equal parts, ``LONGEST`` at most, of a span [s before the end of a step]."""
    # what is left of a difference of two times may be rounding, in which no force is known
    count = math.ceil((begin - end - NS) / LONGEST)
    times = [begin - (begin - end) * k / count for k in range(count + 1)] if count else []
    return list(zip(times, times[1:]))


def led_to(way: Way, found: Sequence[float]) -> Way:
    """Return a way that ends at velocities: what a measurement told came up on the way to it."""
    if not way:
        return way
    off = [(new - old) / len(way) for new, old in zip(found, way[-1][1:])]
    return [(at, *[old + k * more for old, more in zip(velocities, off)])
            for k, (at, *velocities) in enumerate(way, 1)]
