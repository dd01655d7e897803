"""
Tell which key of the configuration is wrong, from the data: signs, order, heading, frames, time.

Each mistake that is looked for can be undone in the data: a sign turned, two thrusters exchanged,
the heading turned by 90 degrees or mirrored, the forces moved in time. The mean velocity of a
block of time follows from that of the block before and the forces f on it,

    v_(k+1) = a v_k - b v_k|v_k| + c f_k + d f_(k+1) + e + couplings        a, b, c, d >= 0

which holds of a vehicle that takes minutes to gain speed, and of one that has it at once (a is 0).
If this predicts the motion of all axes better with a mistake undone than with the configuration
as it is, by more than chance allows and by more than the thrust as it is configured tells at all,
that mistake is named: a law of blocks is not exact, and of one slow sinusoid, which a vehicle
follows late in any case, a little later fits a little better. Two laws, neither of which is a
special case of the other, are compared by the ratio of their likelihoods (Vuong, Econometrica
57(2), 1989); its variance is that of batches of some seconds, for errors of one second are like
those of the next. A force that is wrong by a factor cannot be seen, for c and d are free.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product
import math
from statistics import NormalDist
from typing import Final

import numpy as np
from rovid_core.model.dofs import DOFS
from rovid_core.model.plant import Array
from rovid_core.model.samples import Motion, NS
from rovid_core.settings.run import Scales, Settings

BLOCK: Final = 500_000_000
"""[ns] Means over so long are kept; where fixes are rare, several are taken together."""

LONGEST: Final = 60_000_000_000
"""[ns] A command or a motion that lasts longer tells nothing."""

MOST_BLOCKS: Final = 600
"""Blocks that wait for those of the other inputs."""

LOOKS = (128, 256, 512, 1024)
"""Accelerations after which the mistakes are tried, and after the last no more."""

ERROR_RATE: Final = 1e-2
"""Chance of naming a mistake where there is none, over all mistakes and looks together."""

BATCH_ROWS, BATCH_DURATION = 4, 2.0
"""A batch has so many accelerations, and takes so long [s], at least."""

LEAST_BATCHES: Final = 12

HOLDING: Final = 0.0316
"""Of the typical force: up to so much is no thrust to the identifiers either."""

CLOSE: Final = 2.3
"""Student's t below which two mistakes are not told from each other: a chance of 1 %."""

MOST_NAMED: Final = 3
"""Mistakes in a warning."""

LAGS = (-4, -3, -2, -1, 1, 2, 3, 4)
"""Blocks by which the forces may be late (positive) or early."""

LEAST_LAG: Final = 1.0
"""[s] Less may be the thrusters themselves, and ``ekf`` finds it."""

AGREEING = 'so the data would agree with each other, and as it is configured they do not'
"""How the line ends that names a mistake."""

TIME = 'thrusters.delay, or a latency'
"""How it begins where the mistake is one of time, which leaves what a model says of use."""

AXES = ('surge', 'sway', 'heave', 'yaw')
"""Whose motion is explained; roll and pitch are left to themselves on most vehicles."""


class BlockMeans:
    """
    The means of a quantity over blocks of time.

    Parameters
    ----------
    width : int
        Number of its components.

    Attributes
    ----------
    width : int
        As given.
    end : int
        Up to when it is known [ns].
    blocks : dict
        Number of a block -> covered share, and integral in blocks.

    """

    def __init__(self, width: int) -> None:
        self.width = width
        self.end = 0
        self.blocks: dict[int, tuple[float, list[float]]] = {}
        self._duration, self._count = 0.0, 0

    @property
    def interval(self) -> float:
        """Return the mean length [blocks] of what was added."""
        return self._duration / max(self._count, 1)

    def add(self, start: int, end: int, value: Sequence[float]) -> None:
        """Add a value that holds from ``start`` to ``end`` [ns]; not one that holds for long."""
        self.end = end
        if end - start > LONGEST:
            return
        blocks = self.blocks
        self._duration += (end - start) / BLOCK
        self._count += 1
        while start < end:
            number = start // BLOCK
            until = min(end, (number + 1) * BLOCK)
            share = (until - start) / BLOCK
            known = blocks.get(number)
            blocks[number] = (share, [share * y for y in value]) if known is None else (
                known[0] + share, [x + share * y for x, y in zip(known[1], value)])
            start = until
        while len(blocks) > MOST_BLOCKS:  # nothing comes of another input
            del blocks[next(iter(blocks))]


@dataclass(frozen=True)
class Mistake:
    """
    What may be wrong, and how it is undone.

    Attributes
    ----------
    advice : str
        What to do about it, beginning with the key.
    allocation : ndarray, shape (6, thrusters)
        What it should be.
    quarter, mirrored : int, bool
        By how many quarters of a turn the heading is off, and whether it counts backwards.
    lag : int
        Blocks by which the forces are late.

    """

    advice: str
    allocation: Array
    quarter: int = 0
    mirrored: bool = False
    lag: int = 0


@dataclass
class _Rows:
    """Pairs of neighbouring blocks; velocities and forces have shape (rows, 2)."""

    velocity: dict[str, Array]  # by axis
    mirrored: dict[str, Array]  # of surge and sway, with a mirrored heading
    forces: dict[int, Array]  # of the thrusters by lag, shape (thrusters, rows, 2)
    length: float  # of a block [s]
    batch: int  # rows
    held: list[str] = field(default_factory=list)  # axes whose thrust says nothing
    fits: dict[tuple[object, ...], Array] = field(default_factory=dict)


class ConfigurationCheck:
    """
    Collect motion and forces, and name the key that is wrong, once.

    Parameters
    ----------
    settings : Settings
        The run.
    models : sequence of callables
        The force of each thruster, of its raw command.
    warn : callable
        Called with one line, once.

    Attributes
    ----------
    active : bool
        Whether more data are wanted.
    linear : str
        The input that measures surge and sway, for which the heading is needed.

    """

    def __init__(self, settings: Settings, models: Sequence[Callable[[float], float]],
                 warn: Callable[[str], None]) -> None:
        self._settings = settings
        self._models = models
        self._warn = warn
        thrusters = settings.thrusters
        self._allocation = np.array(thrusters.allocation)
        self._late = round((thrusters.delay + thrusters.time_constant) / NS)
        linear: str = next((n for n in ('velocity', 'position') if settings.input(n).topic), '')
        self._axes_of = {  # the axes that an input measures, and where they are in its vector
            linear: {'surge': 0, 'sway': 1},
            settings.source('heave') or 'depth': {'heave': 2},
            settings.source('yaw') or 'attitude': {'yaw': 2}}
        if linear and linear == settings.source('heave'):
            self._axes_of[linear] = {'surge': 0, 'sway': 1, 'heave': 2}
        self._means = {name: BlockMeans(5 if name == linear else 3)
                       for name in self._axes_of if name}
        self.linear = linear
        self.active = True
        self._names: tuple[str, ...] = ()
        self._looked_up_to = -1  # the first block that was not complete when all were looked at
        self._kept: dict[int, Array] = {}
        self._count = self._looks = 0
        self._thrust = BlockMeans(thrusters.count)
        self._command: tuple[int, list[float]] | None = None
        self._points: dict[str, tuple[int, tuple[float, ...]]] = {}

    def restart(self) -> None:
        """Forget where commands and points were; what was collected stays."""
        self._command = None
        self._points.clear()

    def add_commands(self, time: int, raw: Sequence[float]) -> None:
        """Add the raw commands of all thrusters from ``time`` [ns] on."""
        thrusters = self._settings.thrusters
        new = [model(u) for model, u in zip(self._models, raw)]
        time += self._late
        last, self._command = self._command, (time, new)
        longest = round(thrusters.timeout / NS) or LONGEST
        if last is None or not 0 < time - last[0] <= longest:
            return
        held = last[1]
        if thrusters.hold == 'linear':
            held = [0.5 * (a + b) for a, b in zip(held, new)]
        self._thrust.add(last[0], time, held)

    def add_motion(self, input: str, motion: Motion, heading: float | None) -> None:
        """Add what an input measured; the heading [rad] where it is known, of ``linear``."""
        means = self._means.get(input)
        if means is None:
            return
        body: tuple[float, ...] = motion.body
        if input == self.linear:
            u, v = body[:2]
            c, s = (1.0, 0.0) if heading is None else (
                math.cos(2.0 * heading), math.sin(2.0 * heading))
            body = (*body, c * u - s * v, s * u + c * v)
        if not means.end:
            self._looked_up_to = -1
        start = motion.start
        if start < motion.end:
            means.add(start, motion.end, body)
        else:
            before = self._points.get(input)
            self._points[input] = motion.time, body
            longest = round(self._settings.timeout_of(input) / NS)
            if before and 0 < motion.time - before[0] <= longest:
                start = before[0]
                means.add(start, motion.time,
                          [0.5 * (a + b) for a, b in zip(before[1], body)])
        if self._collect(start) and self._count >= LOOKS[self._looks]:
            self._looks += 1
            last = self._looks == len(LOOKS)
            self.look(more=not last)
            if last:
                self.active = False
                self._kept.clear()

    def _known(self) -> int:
        """Return up to when all that was heard is known [ns]."""
        known = self._thrust.end
        for m in self._means.values():
            if m.end and m.end < known:
                known = m.end
        return known

    def _collect(self, start: int) -> bool:
        """
        Keep the blocks that are complete; return whether one came.

        What was added since the last time begins at ``start`` [ns] or is of commands.
        """
        complete = self._known() // BLOCK
        if complete == self._looked_up_to and start >= complete * BLOCK:
            return False  # as most times
        heard = [one for one in self._means.items() if one[1].end]
        if not heard:
            return False
        used = [self._thrust, *[m for _, m in heard]]
        self._looked_up_to = complete
        names = tuple([name for name, _ in heard])
        oldest = [next(iter(m.blocks), complete) for m in used]
        if min(oldest) >= complete:
            return False
        if names != self._names:  # the first message of an input that comes later
            self._names = names
            self._kept.clear()
            self._count = 0
        before = self._count
        # not all numbers in between: a clock that is set at last jumps over thousands of millions
        for number in [n for n in self._thrust.blocks if n < complete]:
            blocks = [m.blocks.pop(number, None) for m in used]
            if all(b is not None and b[0] > 0.999 for b in blocks) and any(
                    x != 0.0 for x in blocks[0][1]):  # type: ignore[index]
                self._kept[number] = np.concatenate(
                    [b[1] for b in blocks])  # type: ignore[index]
                self._count += 1
        for m in used:  # of a gap that no other input has
            for number in [n for n in m.blocks if n < complete]:
                del m.blocks[number]
        return self._count != before

    def look(self, more: bool = False) -> None:
        """
        Try the mistakes on what was collected, and warn of the likeliest if it is one.

        While ``more`` data are to come, it waits until they tell it from the others.
        """
        rows = self._rows() if self.active else None
        if rows is None:
            return
        mistakes = list(self._mistakes(rows))
        right = self._evidence(rows, Mistake('', self._allocation))
        without = self._evidence(rows, Mistake('', np.zeros_like(self._allocation)))
        found = []
        # what a standard normal number exceeds with this chance
        limit = -NormalDist().inv_cdf(ERROR_RATE / (len(LOOKS) * max(len(mistakes), 1)))
        for mistake in mistakes:
            by_axis = self._evidence(rows, mistake)
            changed = [axis for axis in right if not np.allclose(by_axis[axis], right[axis])]
            if not changed:
                continue  # what is left is rounding: thrusters with one command are like this
            gained = _total([by_axis[axis] - right[axis] for axis in changed])
            told = _total([right[axis] - without[axis] for axis in changed])
            # the thrust as it is may say more than all that is left to say
            if gained.sum() > told.sum() and _t(_batches(gained, rows.batch)) > _t_quantile(
                    limit, len(gained) // rows.batch - 1):
                found.append((mistake, _total([*by_axis.values()])))
        if not found:
            return
        # of mistakes that are the same here, the first, which is the simplest
        best = max(float(evidence.sum()) for _, evidence in found)
        likeliest, top = next(
            one for one in found if one[1].sum() > best - 1e-9 * abs(best))
        same = [mistake.advice for mistake, evidence in found if mistake is not likeliest
                and (evidence is top or np.allclose(evidence, top))]
        close = [mistake.advice for mistake, evidence in found
                 if mistake is not likeliest and mistake.advice not in same
                 and _t(_batches(top - evidence, rows.batch)) < CLOSE]
        if more and close:
            return
        self.active = False
        self._kept.clear()
        advice = dict.fromkeys([likeliest.advice, *same, *close])
        self._warn(f'{"; or ".join(list(advice)[:MOST_NAMED])}: {AGREEING}')

    def _rows(self) -> _Rows | None:
        """Return the accelerations so far, None if they are too few."""
        if not self._kept:
            return None
        rare = max(self._means[name].interval for name in self._names)
        several = max(1, math.ceil(2.0 * rare - 0.2))  # two fixes in each at least
        h = several * BLOCK * NS
        batch = max(BATCH_ROWS, math.ceil(BATCH_DURATION / h))
        pairs = [n for n in self._kept if n % several == 0 and all(
            n + k in self._kept for k in range(2 * several))]
        if len(pairs) < LEAST_BATCHES * batch:
            return None
        merged = {n + k: np.mean([self._kept[n + k + i] for i in range(several)], axis=0)
                  for n in pairs for k in (0, several)}
        both = np.array([(merged[n], merged[n + several]) for n in pairs]).transpose(2, 0, 1)
        index = {n: k for k, n in enumerate(pairs)}
        n = self._settings.thrusters.count
        rows = _Rows({}, {}, {0: both[:n]}, h, batch)
        for lag in LAGS:
            # where nothing is known, those of now stand in, alike for all mistakes
            rows.forces[lag] = both[:n, [
                index.get(at - lag * several, index[at]) for at in pairs]]
        for name in self._names:
            for axis, i in self._axes_of[name].items():
                rows.velocity[axis] = both[n + i]
            if name == self.linear:
                rows.mirrored = {'surge': both[n + 3], 'sway': both[n + 4]}
            n += self._means[name].width
        rows.held = [axis for axis in rows.velocity if self._is_held(axis, rows)]
        return rows

    def _is_held(self, axis: str, rows: _Rows) -> bool:
        """
        Tell whether the thrust on a DOF is only that of a controller which holds it.

        Such thrust follows the motion, and not the other way round.
        """
        dof = self._settings.dof.get(axis)
        if dof is None:
            return False
        force = np.tensordot(self._allocation[DOFS.index(axis)], rows.forces[0], 1)
        return 0.0 < float(np.sqrt(np.mean(force * force))) < HOLDING * Scales.of(dof).force

    def _mistakes(self, rows: _Rows) -> Iterator[Mistake]:
        """Yield all mistakes that can be told, those with the simplest cure first."""
        pushed = [axis for axis in rows.velocity if axis not in rows.held
                  and np.any(self._allocation[DOFS.index(axis)] != 0.0)]
        turned = tuple(axis for axis in pushed if axis != 'surge' and not (
            axis == 'heave' and self._settings.depth.topic))  # depth has its own sign
        has_heading = bool(rows.mirrored) and self.linear == 'position'
        is_ = self._allocation
        for axis in pushed:
            yield Mistake(self._row_advice(axis), self._with_signs([axis]))
        if turned:
            other = 'enu' if self._settings.frames == 'ned' else 'ned'
            yield Mistake(
                f'frames: the messages may be {other}, for {", ".join(turned)} count the other '
                'way (thrusters.allocation is forward, left, up in both)',
                self._with_signs(turned))
            if has_heading:
                yield Mistake(
                    f'frames: the messages may be {other}, apart from the position (latitude and '
                    'longitude are the same in both)', self._with_signs(turned), quarter=1,
                    mirrored=True)
        if len(pushed) > 1:
            yield Mistake('thrusters.gain: turn all signs', -is_)
        if has_heading:
            for quarter, degrees in ((1, 90), (2, 180), (3, -90)):
                yield Mistake(f'attitude.yaw_offset: add {math.radians(degrees):.4f} rad '
                              f'({degrees} degrees)', is_, quarter=quarter)
            for quarter in range(4):
                yield Mistake(
                    'attitude.heading: the heading counts the other way (of a quaternion, see '
                    'frames)', is_, quarter=quarter, mirrored=True)
        yield from self._thruster_mistakes(pushed)
        for lag in LAGS:
            apart = abs(lag) * rows.length
            if apart >= LEAST_LAG:
                yield Mistake(
                    f'{TIME}: the motion is about {apart:g} s '
                    f'{"later" if lag > 0 else "earlier"} than its thrust', is_, lag=lag)

    def _with_signs(self, axes: Sequence[str], thrusters: Sequence[int] | None = None) -> Array:
        """Return the allocation with other signs in the rows of axes, of some thrusters or all."""
        allocation = self._allocation.copy()
        columns = range(allocation.shape[1]) if thrusters is None else thrusters
        allocation[np.ix_([DOFS.index(axis) for axis in axes], columns)] *= -1.0
        return allocation

    def _row_advice(self, axis: str) -> str:
        if axis == 'heave' and self._settings.depth.topic:
            return 'depth.scale, or the row heave of thrusters.allocation: turn its sign'
        # the force of a brake follows the velocity as thrust that is turned does
        return (f'thrusters.allocation: turn the sign of its row {axis} (unless all that a '
                'controller does there is to brake)')

    def _thruster_mistakes(self, pushed: Sequence[str]) -> Iterator[Mistake]:
        n = self._settings.thrusters.count
        names = [f'{k + 1}' + (f' ({self._settings.thrusters.names[k]})'
                               if self._settings.thrusters.names else '') for k in range(n)]
        rows = self._allocation[[DOFS.index(axis) for axis in pushed]]
        # which component of a wrench is which the message says
        is_wrench = np.array_equal(self._allocation, np.eye(len(DOFS)))
        for j, k in () if is_wrench else combinations(range(n), 2):
            if np.any(rows[:, j] != rows[:, k]):
                exchanged = self._allocation.copy()
                exchanged[:, [j, k]] = exchanged[:, [k, j]]
                yield Mistake('thrusters.allocation or thrusters.names: exchange thrusters '
                              f'{names[j]} and {names[k]}', exchanged)
        for k in range(n):
            if np.any(rows[:, k] != 0.0):
                yield Mistake('thrusters.allocation or thrusters.gain: turn the sign of thruster '
                              f'{names[k]}', self._with_signs(DOFS, [k]))
        for i, axis in enumerate(pushed):
            for k in range(n):
                if rows[i, k] != 0.0 and np.count_nonzero(rows[i]) > 1:
                    yield Mistake(f'thrusters.allocation: turn the sign of thruster {names[k]} '
                                  f'in its row {axis}', self._with_signs([axis], [k]))

    def _evidence(self, rows: _Rows, mistake: Mistake) -> dict[str, Array]:
        """Return the log likelihood of each row by axis, with a mistake undone."""
        velocity = {**rows.velocity, **(rows.mirrored if mistake.mirrored else {})}
        if mistake.mirrored and 'yaw' in velocity:
            velocity['yaw'] = -velocity['yaw']  # it turns the other way, too
        for _ in range(mistake.quarter):
            velocity['surge'], velocity['sway'] = velocity['sway'], -velocity['surge']
        found = {}
        for axis, v in velocity.items():
            row = mistake.allocation[DOFS.index(axis)]
            if axis in rows.held:  # whatever moves it is left unexplained, in all cases alike
                row = np.zeros_like(row)
            key = (axis, row.tobytes(), mistake.lag, mistake.quarter, mistake.mirrored)
            if key not in rows.fits:
                force = np.tensordot(row, rows.forces[mistake.lag], 1)
                rows.fits[key] = log_likelihood(v, force, _others(axis, velocity))
            found[axis] = rows.fits[key]
        return found


def _total(evidence: Sequence[Array]) -> Array:
    """Return the log likelihood of each row, of several axes together."""
    return np.asarray(np.sum(evidence, axis=0))


def _others(axis: str, velocity: dict[str, Array]) -> list[Array]:
    """Return what the other axes do to one: the Coriolis terms and the drag of sideways motion."""
    pairs = {'surge': ('sway', 'yaw'), 'sway': ('surge', 'yaw'), 'yaw': ('surge', 'sway')}
    a, b = pairs.get(axis, ('', ''))
    found = [velocity[a][:, 0] * velocity[b][:, 0]] if a in velocity and b in velocity else []
    if axis == 'yaw' and 'sway' in velocity:
        found.append(velocity['sway'][:, 0])
    return found


def log_likelihood(velocity: Array, force: Array, others: Sequence[Array]) -> Array:
    """
    Return the log likelihood of each velocity after the one before, by the law.

    The law is the one of least squares among those with a, b, c and d of 0 or more. Errors have
    Laplace's distribution, so that a few wild ones do not decide.

    Parameters
    ----------
    velocity, force : ndarray, shape (n, 2)
        Means over pairs of blocks that follow each other [m/s and N, or rad/s and N m].
    others : sequence of ndarray, shape (n,)
        The couplings, which may have either sign.

    Returns
    -------
    ndarray, shape (n,)

    """
    v, after = velocity.T
    signed = [x for x in (force[:, 0], force[:, 1], v, -v * abs(v)) if np.any(x != 0.0)]
    terms = np.array([*signed, np.ones_like(v), *others]).T
    scale = np.sqrt(np.mean(terms * terms, axis=0))
    scale[scale == 0.0] = 1.0
    terms = terms / scale
    # one that would be negative is left out, and which that is depends on what else there is
    used = np.array([(*one, *[1.0] * (len(scale) - len(signed)))
                     for one in product((1.0, 0.0), repeat=len(signed))])
    inverse = np.linalg.pinv(
        used[:, :, None] * (terms.T @ terms) * used[:, None, :], rcond=1e-12, hermitian=True)
    right = terms.T @ after
    factors = used * np.einsum('kij,kj->ki', inverse, used * right)
    gained = np.where(np.any(factors[:, :len(signed)] < 0.0, axis=1), -np.inf, factors @ right)
    error = abs(after - terms @ factors[gained.argmax()])
    mean = float(np.mean(error)) or 1e-300
    return np.asarray(-math.log(mean) - error / mean)


def _batches(values: Array, size: int) -> Array:
    """Return the sums of batches, the rest in the last."""
    count = len(values) // size
    return np.add.reduceat(values, np.arange(count) * size)


def _t(values: Array) -> float:
    """Return Student's t of the mean of values."""
    deviation = float(np.std(values, ddof=1))
    return float(np.mean(values)) * math.sqrt(len(values)) / deviation if deviation else 0.0


def _t_quantile(normal: float, freedom: int) -> float:
    """Return Student's quantile to a normal one (Wallace, Ann. Math. Stat. 30(4), 1959)."""
    z = normal * (8.0 * freedom + 3.0) / (8.0 * freedom + 1.0)
    return math.sqrt(freedom * math.expm1(min(z * z / freedom, 700.0)))
