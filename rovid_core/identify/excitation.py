"""The excitation of one DOF, whatever the method: the Gram matrix of the regressors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
import math
from typing import Final

from rovid_core.model.dofs import Four
from rovid_core.model.samples import Step
from rovid_core.settings.run import Scales

# Mean square of the thrust, in typical forces, below which nothing can be learned.
MIN_EXCITATION: Final = 1e-3
# mean square of the velocity, in typical ones, below which it is mostly noise
MIN_MOTION: Final = 1e-2
# Least part of a regressor's mean square, in typical ones, that the others must not explain. With
# 5 mm of noise on fixes at 10 Hz, thrust of 0.02 to 0.1 Hz reaches it for both drags of a 300 kg
# vehicle; a sinusoid of 0.25 Hz, a square wave of one amplitude, or a fifth of the thrust do not.
MIN_INFORMATION: Final = 1e-2
FLOOR: Final = 1e-12  # share of a mean square below which the unexplained part is rounding error
# Upper triangle of the sum of phi phi' dt, row by row; its last entry is the time [s].
Sums = tuple[float, ...]
NO_SUMS: Sums = (0.0,) * 10
BATCH: Final = 64  # steps whose products are added together, which halves the cost
ALPHA, BETA, GAMMA, DELTA = range(4)


@dataclass(frozen=True)
class Gram:
    """Mean products of the normalised regressors phi = [tau/F, v|v|/V^2, v/V, 1]."""

    sums: Sums  # upper triangle, row by row, times the time [s], which is its last entry
    active: tuple[int, ...]  # the terms that are identified
    # what the regressors were multiplied by (``Scales.regressor``)
    scale: Four = (1.0, 1.0, 1.0, 1.0)

    def acceleration(self, parameters: Sequence[float]) -> float:
        """Return the root mean square of theta . phi over the data [m/s^2 or rad/s^2]."""
        (p, q, r, s), (t, u, v, w) = parameters, self.scale
        p, q, r, s = p / t, q / u, r / v, s / w
        a, ab, ac, ad, b, bc, bd, c, cd, d = self.sums
        square = (p * p * a + q * q * b + r * r * c + s * s * d + 2.0 * (
            p * (q * ab + r * ac + s * ad) + q * (r * bc + s * bd) + r * s * cd))
        return math.sqrt(square / d) if square > 0.0 else 0.0

    def uncertainty(self, covariance: Sequence[float]) -> float:
        """Return the root of the mean variance of theta . phi, from a covariance of 16 floats."""
        p, pq, pr, ps, _, q, qr, qs, _, _, r, rs, _, _, _, s = covariance
        t, u, v, w = self.scale
        a, ab, ac, ad, b, bc, bd, c, cd, d = self.sums
        square = (p * a / (t * t) + q * b / (u * u) + r * c / (v * v) + s * d / (w * w) + 2.0 * (
            pq * ab / (t * u) + pr * ac / (t * v) + ps * ad / (t * w)
            + qr * bc / (u * v) + qs * bd / (u * w) + rs * cd / (v * w)))
        return math.sqrt(square / d) if square > 0.0 else 0.0

    @cached_property
    def reasons(self) -> tuple[str, ...]:
        """Return in words what the data do not show and what would help; empty if nothing."""
        time = self.sums[9]
        if time <= 0.0:
            return ('no step yet',)
        thrust = self.sums[0] / time
        if thrust < MIN_EXCITATION:
            return ('no thrust',)
        weak = {i for i in self.active if self.unexplained(i, self.active) < MIN_INFORMATION}
        found = []
        if ALPHA in weak:
            found.append(
                'thrust only balances drag and bias: the mass cannot be told; change the '
                'thrust faster' if thrust >= MIN_INFORMATION
                else 'thrust is too small to tell the mass')
        if DELTA in weak:
            found.append('the speed hardly changes: the bias cannot be told from drag; drive '
                         'both ways')
        if weak & {BETA, GAMMA}:
            found.append(self._why_no_drag())
        return tuple(found)

    def _why_no_drag(self) -> str:
        if self.sums[7] / self.sums[9] < MIN_MOTION:
            return 'the speed is always near zero: drag cannot be seen'
        alone = [self.unexplained(drag, [i for i in self.active if i != other])
                 for drag, other in ((BETA, GAMMA), (GAMMA, BETA))
                 if {drag, other} <= set(self.active)]
        if max(alone, default=0.0) < MIN_INFORMATION:
            return 'drag can hardly be seen: run with larger thrust and slowly (0.02 to 0.05 Hz)'
        return ('linear and quadratic drag cannot be told apart yet: run at several speeds, with '
                'larger thrust and slowly (0.02 to 0.05 Hz)')

    def unexplained(self, i: int, terms: Sequence[int]) -> float:
        """Return the part of mean square ``i`` that the other terms leave, 1 / (G^-1)_ii."""
        a, ab, ac, ad, b, bc, bd, c, cd, d = self.sums
        rows = [[a, ab, ac, ad], [ab, b, bc, bd], [ac, bc, c, cd], [ad, bd, cd, d]]
        squares = (a, b, c, d)
        rest = [k for k in terms if k != i]
        rest.append(i)
        while len(rest) > 1:
            k = rest.pop(0)
            row = rows[k]
            pivot = row[k]
            if pivot <= FLOOR * squares[k]:
                continue  # the terms before it explain it completely
            for r in rest:
                own, factor = rows[r], row[r] / pivot
                for s in rest:
                    own[s] -= factor * row[s]
        return max(rows[i][i], 0.0) / (d or 1.0)


def add_products(sums: Sums, steps: Sequence[Step], force_scale: float = 1.0,
                 velocity_scale: float = 1.0) -> Sums:
    """
    Return the 10 sums of phi phi' dt with those of some steps added, in their order.

    Many steps at once cost half as much as one by one.
    """
    a, ab, ac, ad, b, bc, bd, c, cd, d = sums
    for step in steps:
        dt = step.dt
        force = step.force[1] * force_scale
        velocity = step.velocity[1] * velocity_scale
        drag = velocity * abs(velocity)
        force_dt, drag_dt, velocity_dt = force * dt, drag * dt, velocity * dt
        a += force * force_dt
        ab += drag * force_dt
        ac += velocity * force_dt
        ad += force_dt
        b += drag * drag_dt
        bc += velocity * drag_dt
        bd += drag_dt
        c += velocity * velocity_dt
        cd += velocity_dt
        d += dt
    return a, ab, ac, ad, b, bc, bd, c, cd, d


class Excitation:
    """
    The Gram matrix of one DOF: with a fading memory, and of everything since the start.

    ``memory`` is the time [s] after which data count 1/e in the fading one.
    """

    def __init__(self, scales: Scales, memory: float) -> None:
        self._scale = scales.regressor
        self._force, _, self._velocity, _ = self._scale
        self._active = tuple([i for i, on in enumerate(scales.active) if on])
        self.memory = memory
        self._fading: Sums = NO_SUMS
        self._older: Sums = NO_SUMS
        self._sums: Sums = NO_SUMS  # not yet in the two others

    def add_steps(self, steps: Sequence[Step]) -> None:
        """Add some steps; many at once cost half as much as one by one."""
        self._sums = add_products(self._sums, steps, self._force, self._velocity)

    def update_fading(self) -> Gram:
        """Let the memory fade up to now and return its matrix."""
        kept = math.exp(-self._sums[9] / self.memory)
        self._fading = _added(self._fading, self._sums, kept)
        self._older = _added(self._older, self._sums)
        self._sums = NO_SUMS
        return Gram(self._fading, self._active, self._scale)

    def since_start(self) -> Gram:
        """Return the matrix of everything since the start."""
        return Gram(_added(self._older, self._sums), self._active, self._scale)


def _added(old: Sums, new: Sums, kept: float = 1.0) -> Sums:
    a, b, c, d, e, f, g, h, i, j = old
    k, m, n, o, p, q, r, s, t, u = new
    return (kept * a + k, kept * b + m, kept * c + n, kept * d + o, kept * e + p, kept * f + q,
            kept * g + r, kept * h + s, kept * i + t, kept * j + u)
