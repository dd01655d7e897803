"""How a vehicle moves and is pushed in a log, on one grid of time; what one says of the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import math

import numpy as np
from rovid_core.model.dofs import COUPLINGS, DOFS
from rovid_ros.discovery.signals import Array, Signal

STEP = 0.1  # [s] of the grid
DELAYS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)  # [s] of the thrust that are tried
_MOST_GAPS = 1000
_FAR = 8.0  # times the median of the residuals: what misses by more is left out
_FAST = 5.0  # times the speed that is seldom exceeded: no vehicle does
_STEEP = 0.5  # of the vertical: a body that tilts more says next to nothing of its heave
_COARSE = 0.3  # of the speed that fixes show; where more is noise, they are coarse


@dataclass(frozen=True)
class Motion:
    """
    Body velocities of a vehicle on a grid of time.

    Attributes
    ----------
    times : array
        [s], with steps of ``STEP``.
    velocities : dict of str to array
        [m/s] or [rad/s] by DOF, of those that were measured; NaN across gaps.
    halves : dict of str to float
        Half of the span [s] over which the velocity of each DOF is a mean.
    coarse : frozenset of str
        DOFs that are measured by fixes of whose speed much is noise.
    tilting : dict of str to array
        Rates of roll and pitch [rad/s], where an attitude says them.
    turned : array, optional
        How far the vehicle has turned about its own z [rad].
    upright : array, shape (3, n), optional
        What of each axis of the body points along the vertical of the attitude.

    """

    times: Array
    velocities: Mapping[str, Array]
    halves: Mapping[str, float]
    tilting: Mapping[str, Array] = field(default_factory=dict)
    turned: Array | None = None
    coarse: frozenset[str] = frozenset()
    upright: Array | None = None

    def coupled(self, dof: str) -> dict[str, Array]:
        """Return what the other motions may push a DOF with, by name of the coupling."""
        rates = {**self.velocities, **self.tilting}
        known = {letter: rates[one] for letter, one in zip('uvwpqr', DOFS) if one in rates}
        return {name: np.prod([known[letter] for letter in name], axis=0)
                for name in COUPLINGS[dof] if {*name} <= known.keys()}

    def turning(self, dof: str) -> Array:
        """Return how fast it turns [rad/s], a mean over the span of the velocity of a DOF."""
        return _rate(self.times, np.zeros_like(self.times) if self.turned is None else self.turned,
                     self.times, self.halves[dof])

    def heaving(self) -> Array:
        """Return the heave of a body that tilts, where the one that is known is vertical."""
        heave = self.velocities['heave']
        if self.upright is None or not {'surge', 'sway'} <= self.velocities.keys():
            return heave
        ahead, aside, up = self.upright
        steep = np.abs(up) < _STEEP
        return np.where(steep, np.nan, heave - ahead * self.velocities['surge']
                        - aside * self.velocities['sway']) / np.where(steep, 1.0, up)

    def drifting(self, dof: str) -> list[Array]:
        """Return what a current of the water pushes a DOF with: it turns with the heading."""
        if self.turned is None or dof not in ('surge', 'sway'):
            return []
        return [np.cos(self.turned), np.sin(self.turned)]


@dataclass(frozen=True)
class Push:
    """How a DOF answers to commands: v' = sum of alpha u + beta v|v| + gamma v + delta + ..."""

    alphas: Array  # one per command
    beta: float
    gamma: float
    explained: float  # share of the changes of the velocity that only the commands explain
    errors: Array  # standard errors of the alphas
    coupled: Mapping[str, Sequence[float]]  # each coupling, and its standard error
    swung: tuple[float, float] = (0.0, 0.0)  # how far it goes with ``swinging``, and its error


def motion(used: Mapping[str, Signal], angles: Array | None = None,
           depth_scale: float = 1.0, spans: int = 1) -> Motion:
    """
    Return the body velocities that follow from signals, by the name of their input.

    ``angles`` are heading [rad] in the world of the position, at the attitude's times, if the
    attitude is not a quaternion of it; the body is taken to be level then. From coarse fixes,
    means are taken over ``spans`` times as long as their rate asks for.
    """
    seen = [used[name] for name in ('position', 'depth', 'attitude', 'angular_velocity',
                                    'velocity', 'thrusters') if name in used]
    begin = max(signal.times[0] for signal in seen)
    end = min(signal.times[-1] for signal in seen)
    times = np.arange(begin, end, STEP) if end > begin else np.empty(0)
    slowest = max((float(np.median(np.diff(used[name].times)))
                   for name in ('position', 'depth', 'attitude', 'velocity') if name in used),
                  default=STEP)
    half = max(0.2, slowest)
    halves, coarse = dict.fromkeys(DOFS, half), frozenset[str]()
    velocities: dict[str, Array] = {}
    tilting: dict[str, Array] = {}
    known, attitudes, turned, upright = np.empty(0), np.empty((0, 4)), None, None
    if 'attitude' in used:
        attitude = used['attitude']
        known, attitudes = _continuous(attitude) if angles is None else (
            attitude.times, _level(np.unwrap(angles)))
        roll, pitch, yaw = _turned(attitudes)
        tilting = {'roll': _rate(known, roll, times, half),
                   'pitch': _rate(known, pitch, times, half)}
        velocities['yaw'], turned = _rate(known, yaw, times, half), np.interp(times, known, yaw)
        x, y, z, w = [np.interp(times, known, column) for column in attitudes.T]
        upright = np.array([2.0 * (x * z - w * y), 2.0 * (y * z + w * x),
                            w * w + z * z - x * x - y * y]) / (x * x + y * y + z * z + w * w)
    if 'angular_velocity' in used:
        gyro = used['angular_velocity']
        velocities['yaw'] = _mean(gyro.times, gyro.values[:, 2], times, half)
    if 'position' in used:
        rates: list[Array] = []
        for dofs, columns in ((('surge', 'sway'), (0, 1)), (('heave',), (2,))):
            at_fixes, fixes = used['position'].times, used['position'].values[:, columns]
            if _are_coarse(at_fixes, fixes, times, half):
                at_fixes, fixes = _without_outliers(at_fixes, fixes)
                halves.update(dict.fromkeys(dofs, spans * half))
                coarse |= {*dofs}
            rates += [_rate(at_fixes, column, times, halves[dofs[0]]) for column in fixes.T]
        velocities['heave'] = rates[2]
        if len(attitudes):
            at = np.array([np.interp(times, known, column) for column in attitudes.T])
            velocities.update(zip(DOFS, _in_body(at, np.array(rates))))
    if 'velocity' in used:
        body = used['velocity']
        for dof, column in zip(DOFS, body.values.T):
            velocities[dof] = _mean(body.times, column, times, half)
    elif 'depth' in used:  # beside a velocity it is of no use
        depth = used['depth']
        velocities['heave'] = _rate(depth.times, depth_scale * depth.values[:, 0], times, half)
        halves['heave'], coarse = half, coarse - {'heave'}
    return Motion(times, {dof: _plausible(v) for dof, v in velocities.items()}, halves, tilting,
                  turned, coarse, upright)


def _are_coarse(times: Array, fixes: Array, grid: Array, half: float) -> bool:
    """Return whether much of the speed that fixes show over twice ``half`` [s] is noise."""
    if len(grid) == 0 or len(times) < 5:
        return False
    speeds = np.linalg.norm([_rate(times, column, grid, half) for column in fixes.T], axis=0)
    speeds = speeds[speeds <= np.nanpercentile(speeds, 90.0)]  # without outliers
    noise = math.hypot(*[noise_of(column) for column in fixes.T]) / (math.sqrt(2.0) * half)
    return noise > _COARSE * math.sqrt(np.mean(speeds ** 2))


def _without_outliers(times: Array, fixes: Array) -> tuple[Array, Array]:
    """Return fixes without those that are far from where those around them are."""
    around = np.median(np.lib.stride_tricks.sliding_window_view(fixes, 5, axis=0), axis=-1)
    off = np.linalg.norm(fixes[2:-2] - around, axis=1)
    good = np.pad(off <= _FAR * np.median(off), 2, constant_values=True)
    return times[good], fixes[good]


def noise_of(values: Array) -> float:
    """Return the standard deviation of the noise of values, as it shows from one to the next."""
    # of a normal distribution; outliers do not count
    return 1.4826 * float(np.median(np.abs(np.diff(values, 2)))) / math.sqrt(6.0)


def _plausible(velocity: Array) -> Array:
    """Return a velocity with NaN where the sensor must have been lost."""
    known = np.abs(velocity[np.isfinite(velocity)])
    most = _FAST * float(np.percentile(known, 95.0)) if len(known) else 0.0
    return np.where(np.abs(velocity) > max(most, 1e-9), np.nan, velocity)


def _continuous(attitude: Signal) -> tuple[Array, Array]:
    """Return the times of attitudes and their quaternions x, y, z, w without changes of sign."""
    lengths = np.linalg.norm(attitude.values, axis=1)
    known = lengths > 0.5  # a driver that has none yet gives zeros
    q = attitude.values[known] / lengths[known, np.newaxis]
    signs = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0)
    q[1:] *= np.cumprod(signs)[:, np.newaxis]
    return attitude.times[known], q


def _level(headings: Array) -> Array:
    """Return the quaternions x, y, z, w of level bodies with continuous headings [rad]."""
    zero = np.zeros_like(headings)
    return np.column_stack([zero, zero, np.sin(0.5 * headings), np.cos(0.5 * headings)])


def _turned(q: Array) -> Array:
    """Return how far a body has turned about each of its axes at each attitude [rad]; (3, n)."""
    a, b = q[:-1].T, q[1:].T
    axis = a[3] * b[:3] - b[3] * a[:3] - np.cross(a[:3], b[:3], axis=0)
    sine = np.maximum(np.linalg.norm(axis, axis=0), 1e-12)
    angle = 2.0 * np.arctan2(sine, np.sum(a * b, axis=0))
    return np.concatenate([np.zeros((3, 1)), np.cumsum(angle * axis / sine, axis=1)], axis=1)


def _in_body(q: Array, velocity: Array) -> Array:
    """Return velocities in the world, shape (3, n), along the axes of bodies with attitudes."""
    axis, w = q[:3], q[3]
    aside = np.cross(axis, velocity, axis=0)
    return np.asarray(velocity + 2.0 * (
        np.cross(axis, aside, axis=0) - w * aside) / np.sum(q * q, axis=0))


def _rate(times: Array, values: Array, grid: Array, half: float) -> Array:
    """Return the mean rate of change from ``half`` [s] before to as much behind; NaN at gaps."""
    rates = (np.interp(grid + half, times, values) - np.interp(grid - half, times, values)) / (
        2.0 * half)
    return _without_gaps(times, rates, grid, half)


def _mean(times: Array, values: Array, grid: Array, half: float) -> Array:
    """Return the mean over ``half`` [s] before and behind each time; NaN at gaps."""
    fine = np.concatenate([[0.0], np.cumsum(
        0.5 * (values[1:] + values[:-1]) * np.diff(times))])
    return _rate(times, fine, grid, half)


def held(times: Array, values: Array, grid: Array, half: float) -> Array:
    """Return the mean of held commands over ``half`` [s] before and behind each time."""
    areas = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(
        values[:-1] * np.diff(times)[:, np.newaxis], axis=0)])
    rates = [(np.interp(grid + half, times, area) - np.interp(grid - half, times, area)) / (
        2.0 * half) for area in areas.T]
    return np.array(rates).T.reshape(len(grid), values.shape[1])


def _without_gaps(times: Array, values: Array, grid: Array, half: float) -> Array:
    steps = np.diff(times)
    gaps = np.flatnonzero(steps > max(6.0 * float(np.median(steps)), 4.0 * half))
    bad = (grid - half < times[0]) | (grid + half > times[-1])
    for k in gaps[:_MOST_GAPS]:
        bad |= (grid + half > times[k]) & (grid - half < times[k + 1])
    return np.where(bad, np.nan, values)


class Windows:
    """
    Windows of time in which a DOF moved: how its velocity changed, and integrals over them.

    What the other DOFs and a current push it with is there too: a vehicle that turns while it
    moves sideways is pushed more by that than by its thrusters.

    Attributes
    ----------
    width : int
        Of a window, in steps.
    known : array of bool
        Where all is measured.
    velocity : array
        Of the DOF [m/s or rad/s], 0 where it is not known.
    coupled : tuple of str
        The couplings.
    beside : array, shape (n, 1 + couplings + 2 or 0)
        A constant, the couplings, and the current's direction.
    changes : array
        Of the velocity, over each window without a gap in it.

    """

    def __init__(self, moved: Motion, dof: str) -> None:
        velocity, coupled = moved.velocities[dof], moved.coupled(dof)
        self.width = width = max(round(max(1.0, 2.0 * moved.halves[dof]) / STEP), 1)
        self.coupled = tuple(coupled)
        self.known = known = np.isfinite(velocity) & np.isfinite(
            sum(coupled.values(), np.zeros(len(velocity))))
        self.velocity, *pushing = [
            np.where(known, x, 0.0) for x in (velocity, *coupled.values())]
        self.beside = np.column_stack(
            [np.ones_like(self.velocity), *pushing, *moved.drifting(dof)])
        self._whole = np.convolve(~known, np.ones(width + 1), 'valid') < 0.5 if (
            len(velocity) > 3 * width) else np.zeros(max(len(velocity) - width, 0), bool)
        self.changes = self.changes_of(self.velocity)

    def are_enough(self) -> bool:
        """Return whether ten of them can stand side by side, and the velocity changes."""
        return len(self.changes) >= 10 * self.width and bool(np.ptp(self.changes) > 0.0)

    def changes_of(self, values: Array) -> Array:
        """Return by how much something changes over each window."""
        values = np.where(self.known, values, 0.0)
        return np.asarray((values[self.width:] - values[:-self.width])[self._whole])

    def integrals(self, values: Array) -> Array:
        """Return the integrals of columns over each window."""
        sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(
            0.5 * STEP * (values[1:] + values[:-1]), axis=0)])
        return np.asarray((sums[self.width:] - sums[:-self.width])[self._whole])


def answer(moved: Motion, dof: str, commands: Array,
           swinging: Array | None = None) -> Push | None:
    """
    Return how a DOF answers to commands, one column each; None where the log does not say.

    By least squares of the changes over a window on the integrals over it, which asks for no
    derivative. With ``swinging`` the velocity also has a part of that in it.
    """
    windows = Windows(moved, dof)
    if not windows.are_enough():
        return None
    velocity, width, changes = windows.velocity, windows.width, windows.changes
    regressors = windows.integrals(np.column_stack(
        [commands, velocity * np.abs(velocity), velocity, windows.beside]))
    if swinging is not None:
        regressors = np.column_stack([regressors, windows.changes_of(swinging)])
    count = commands.shape[1]
    for _ in range(2):  # again without what is far off, such as a sensor that was lost
        if len(changes) < 10 * width or not np.ptp(changes) > 0.0:
            return None
        solution, residual, squares = _fitted(regressors, changes)
        far = np.abs(residual) > max(_FAR * np.median(np.abs(residual)), np.std(changes))
        if not far.any():
            break
        regressors, changes = regressors[~far], changes[~far]
    solution, residual, squares = _fitted(regressors, changes)
    left, whole = float(np.mean(residual ** 2)), float(np.var(changes))
    without = float(np.mean(_fitted(regressors[:, count:], changes)[1] ** 2))
    # windows overlap: only every width-th is new
    errors = np.sqrt(squares * left * width)
    return Push(solution[:count], float(solution[count]), float(solution[count + 1]),
                max(0.0, without - left) / whole if whole else 0.0, errors[:count],
                dict(zip(windows.coupled,
                         np.column_stack([solution, errors])[count + 3:].tolist())),
                (float(solution[-1]), float(errors[-1])) if swinging is not None else (0.0, 0.0))


def _fitted(regressors: Array, changes: Array) -> tuple[Array, Array, Array]:
    """Return the least squares, what is left, and the diagonal of the inverse of the squares."""
    alike, sizes = scaled(regressors)
    solution, *_ = np.linalg.lstsq(alike, changes, rcond=1e-3)
    squares = np.diag(np.linalg.pinv(alike.T @ alike, rcond=1e-6))
    return solution / sizes, changes - alike @ solution, squares.clip(0.0) / sizes ** 2


def scaled(columns: Array) -> tuple[Array, Array]:
    """Return columns with a mean square of 1, and their sizes before, 1 for those of zeros."""
    sizes = np.sqrt(np.mean(columns ** 2, axis=0))
    sizes[sizes == 0.0] = 1.0
    return columns / sizes, sizes


def best_delay(moved: Motion, times: Array, commands: Mapping[str, Array]) -> float:
    """
    Return the delay [s] with which commands explain most of the motion.

    ``commands`` are by DOF, a row per time [s] and a column each.
    """
    def explained(delay: float) -> float:
        pushes = [answer(moved, dof, held(times + delay, columns, moved.times, moved.halves[dof]))
                  for dof, columns in commands.items()]
        return sum(push.explained for push in pushes if push)
    return max(DELAYS, key=explained)
