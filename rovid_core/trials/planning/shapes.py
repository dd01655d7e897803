"""The shapes that a profile can have, the ones near to a shape, and their thrust over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
import math

import numpy as np
from rovid_core.model.plant import Array
from rovid_core.simulation.profiles import Sinusoid, Steps

Part = Sinusoid | Steps
Shape = tuple[Part, ...]  # sinusoids, or one sequence of steps
FREQUENCIES = 0.01, 1.0  # [Hz] from the slowest to the fastest motion that is considered
RATIOS = 2.0, 3.0, 4.4
# Of the second sinusoid to the first. With twice the frequency the thrust is strong one way and
# long the other, and the slow drift that quadratic drag makes of that tells it from linear drag.
SHARES = 1.0, 0.5, -0.5, -1.0

# Levels of steps, without a mean. Two speeds, or two ways, tell the drags apart.
PATTERNS: tuple[tuple[float, ...], ...] = (
    (1.0, -1.0), (1.0, -1.0, -1.0, 1.0), (1.0, 0.0, -1.0, 0.0), (1.0, -1.0, 0.4, -0.4),
    (1.0, -0.5, -0.5), (-1.0, 0.5, 0.5), (1.0, -1.0, -1.0, 1.0, 0.5, -0.5, -0.5, 0.5))

SHORTEST = 0.2  # [s] that a level is held


def first_shapes(grid: Sequence[float]) -> Iterator[Shape]:
    """Yield one or two sinusoids, and steps back and forth, all of size about 1."""
    for f in grid:
        yield (Sinusoid(1.0, f),)
        for times_f, share in product(RATIOS, SHARES):
            yield Sinusoid(1.0, f), _sinusoid(share, times_f * f)
        for levels in PATTERNS:
            yield (Steps(levels, _held(0.5 / f)),)


def near_shapes(shape: Shape, change: float) -> Iterator[Shape]:
    """Yield shapes that differ a little."""
    for by in (change, 1.0 / change):
        for i, w in enumerate(shape):
            for other in _changed(w, by):
                yield *shape[:i], other, *shape[i + 1:]
        if isinstance(shape[0], Sinusoid):  # all slower or all faster
            yield tuple([next(_changed(w, by)) for w in shape])
    if isinstance(shape[0], Sinusoid) and len(shape) < 3:
        for times_f, share in product(RATIOS, SHARES):
            third = _sinusoid(0.5 * share * shape[0].amplitude, times_f * shape[0].frequency)
            yield *shape, third


def _changed(w: Part, by: float) -> Iterator[Part]:
    """Yield a part, first with another frequency, then with another amplitude."""
    if isinstance(w, Sinusoid):
        yield _sinusoid(w.amplitude, w.frequency * by)
        yield _sinusoid(w.amplitude * by * by, w.frequency)
    else:
        yield Steps(w.levels, _held(w.hold / by))
        for k, level in enumerate(w.levels):
            yield Steps((*w.levels[:k], rounded(level * by, 3), *w.levels[k + 1:]), w.hold)


def _sinusoid(amplitude: float, frequency: float) -> Sinusoid:
    return Sinusoid(rounded(amplitude, 3), rounded(min(frequency, FREQUENCIES[1]), 3))


def _held(seconds: float) -> float:
    return round(max(seconds, SHORTEST), 1)


def rounded(value: float, digits: int) -> float:
    """Return a value towards 0 with so many digits."""
    if value == 0.0:
        return 0.0
    unit = 10.0 ** (digits - 1 - math.floor(math.log10(abs(value))))
    return float(f'{math.trunc(value * unit * (1.0 + 1e-12)) / unit:.{digits}g}')


def samples(shape: Shape, t: Array) -> Array:
    """Return the thrust of a shape at many times at once [N or N m]."""
    total = np.zeros(len(t))
    for w in shape:
        if isinstance(w, Sinusoid):
            total += w.amplitude * np.sin(2.0 * math.pi * w.frequency * t)
        else:
            which = np.floor(t / w.hold + 1e-9).astype(int) % len(w.levels)
            total += np.array(w.levels)[which]
    return total


def times(duration: float, dt: float) -> Array:
    """Return the middles of the steps of a trial [s]."""
    return np.asarray((np.arange(max(round(duration / dt), 1)) + 0.5) * dt, dtype=np.float64)
