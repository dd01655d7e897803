"""A recorded trial as the fits take it: the steps of one DOF as arrays, through the water."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from typing import cast

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.dofs import Four, NAN4
from rovid_core.model.plant import Array
from rovid_core.model.samples import Step
from rovid_core.model.thrusters import AS_CONFIGURED, Thrusters

Times = NDArray[np.int64]

WATER_PERIOD = 1_000_000_000
"""[ns] Least time between two values of the current that are kept: the water changes slowly."""

TURNING = {'vr': -1.0, 'ur': 1.0}
"""
Sign with which a regressor changes that is made of velocities over ground.

The axes of surge and sway turn by e_u' = r e_v and e_v' = -r e_u, so that
(v - e_v c) r = v r - (e_u c)' and (u - e_u c) r = u r + (e_v c)'.
"""


@dataclass(frozen=True)
class Record:
    """The measurements of one DOF between two interruptions."""

    time: Array  # shape (m,); times of the fixes (or velocity samples) from the trial's start [s]
    # shape (m,) or (0,); path along the body axis at the fixes [m or rad], from 0; empty for a
    # velocity sensor
    position: Array
    # shape (m - 1,) or (m,); mean velocity between two fixes, or the velocity at each sample [m/s
    # or rad/s]
    velocity: Array
    # shape (2 m - 2,) or (m - 1,); segments of known mean force [s], [N or N m]: two from fix to
    # fix, or one from sample to sample
    dt: Array
    force: Array
    # shape (k, 2 m - 2) or (k, m - 1); mean of each regressor of the couplings over each segment
    couplings: Array = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def nodes(self) -> slice:
        """Return the slice of the segments' ends that are fixes or samples."""
        return slice(None, None, 2 if len(self.position) else 1)

    @property
    def mean_force(self) -> Array:
        """Return the mean force from fix to fix, shape (m - 1,) [N or N m]."""
        if not len(self.position):
            return self.force
        pairs = (self.dt * self.force).reshape(-1, 2).sum(axis=1)
        return np.asarray(pairs / self.dt.reshape(-1, 2).sum(axis=1))

    def steps(self) -> list[Step]:
        """
        Return the steps from one velocity to the next for an identifier, not filtered.

        The mean velocity between two fixes belongs to the middle of their interval.
        """
        dt, force, fixes = self.dt, self.force, bool(len(self.position))
        others = self.couplings if len(self.couplings) else np.empty((0, len(dt)))
        if fixes:  # a step has a part before its fix and one after it
            dt, force = dt[1:-1].reshape(-1, 2), force[1:-1].reshape(-1, 2)
            others = others[:, 1:-1].reshape(len(others), len(dt), 2)
        else:
            dt = np.stack([dt, np.zeros_like(dt)], axis=1)
            force = np.stack([force, np.zeros_like(force)], axis=1)
            others = np.stack([others, others], axis=2)
        spans = dt.sum(axis=1)
        means = (dt * force).sum(axis=1) / spans
        filtered = (dt * others).sum(axis=2) / spans
        v = self.velocity.tolist()
        return [Step(h, (a, 0.5 * (a + b), b), (f, f, f), b, h if fixes else 0.0, (p, q), (g, k),
                     couplings=tuple(map(tuple, x)), filtered_couplings=tuple(y))
                for h, f, a, b, (p, q), (g, k), x, y in zip(
                    spans.tolist(), means.tolist(), v, v[1:], dt.tolist(), force.tolist(),
                    others.transpose(1, 0, 2).tolist(), filtered.T.tolist())]


@dataclass(frozen=True)
class Fit:
    """The result of an offline method."""

    parameters: Four  # lumped parameters
    # shape (4, 4); covariance of the parameters, 0 for terms that are left out; None if unknown
    covariance: Array | None = None
    note: str = ''  # what is wrong with the result, '' if nothing
    # of a method that identifies them, with their standard deviations
    couplings: tuple[float, ...] = ()
    couplings_std: tuple[float, ...] = ()
    delay: float = 0.0  # of the thrust [s], of a method that identifies it
    thrusters: Thrusters = AS_CONFIGURED  # as such a method found them

    @property
    def std(self) -> Four:
        """Return the standard deviations, NaN where there are none."""
        if self.covariance is None:
            return NAN4
        roots = np.sqrt(np.diag(self.covariance))
        return cast(Four, tuple(np.where(roots > 0.0, roots, np.nan).tolist()))

    @staticmethod
    def none(note: str) -> Fit:
        """Return a result without a model; the note says why."""
        return Fit(NAN4, None, note)


def record_of_steps(origin: int, times: Times, values: Array) -> Record | None:
    """
    Return the steps of the pipeline, from midpoint to midpoint, as a record from fix to fix.

    Parameters
    ----------
    origin : int
        The trial's start [ns].
    times : ndarray of int64, shape (2, n)
        Time of the fix at which each step's measurement begins, and of the step's end [ns].
    values : ndarray, shape (4 + 2 k, n)
        Mean force of each step before and after its fix [N or N m]; its filtered velocity,
        which is not used; its measured velocity, not filtered [m/s or rad/s]; each regressor
        of its couplings before and after its fix.

    Returns
    -------
    Record or None
        None if there are too few steps.

    """
    (fix, end), (first, last, _, mean), couplings = times, values[:4], values[4:]
    if len(end) < 3:
        return None
    if fix[-1] == end[-1]:  # a velocity sensor: steps from sample to sample
        dt = np.diff(end) * 1e-9
        return Record(
            (end - origin) * 1e-9, np.empty(0), mean, dt, first[1:], couplings[::2, 1:])
    dt = np.stack([end[:-1] - fix[:-1], fix[1:] - end[:-1]], axis=1).ravel() * 1e-9
    force = np.stack([last[:-1], first[1:]], axis=1).ravel()
    regressors = np.stack([couplings[1::2, :-1], couplings[::2, 1:]], axis=2)
    velocity = mean[:-1]
    position = np.concatenate([[0.0], np.cumsum(velocity * np.diff(fix) * 1e-9)])
    return Record((fix - origin) * 1e-9, position, velocity, dt, force,
                  regressors.reshape(len(regressors), len(force)))


class LogWater:
    """
    What was found of the current while a log was played.

    Before the first value it is that one, after the last that one. Without any the water is still.
    """

    def __init__(self) -> None:
        self._times = array('q')
        self._x = array('d')
        self._y = array('d')

    def add(self, time: int, x: float, y: float) -> None:
        """Add the current in the world [m/s] at a time [ns], not before that of the last one."""
        if not self._times or time - self._times[-1] >= WATER_PERIOD:
            self._times.append(time)
            self._x.append(x)
            self._y.append(y)

    @property
    def is_still(self) -> bool:
        """Tell whether nothing is known of a current."""
        return not self._times

    def at(self, time: int) -> tuple[float, float]:
        """Return the current in the world [m/s] at a time [ns]; still water unless it is known."""
        x, y = self.along(np.array([time, time]), np.eye(2)).tolist()
        return x, y

    def along(self, times: Times, axes: Array) -> Array:
        """Return the velocity of the water along axes, shape (n, 2), at n times [m/s]."""
        if self.is_still:
            return np.zeros(len(times))
        first = self._times[0]  # absolute times have too many digits for a float
        known = np.array(self._times, np.int64) - first
        x, y = (np.interp(times - first, known, np.array(c)) for c in (self._x, self._y))
        return np.asarray(axes[:, 0] * x + axes[:, 1] * y)


def through_water(values: Array, names: tuple[str, ...], nodes: Times, water: Array) -> Array:
    """
    Return rows of a table of steps with the regressors of couplings relative to the water.

    Parameters
    ----------
    values : ndarray, shape (n, 4 + 2 k + ...)
        Each regressor before and after the middle of each step, from column 4.
    names : tuple of str, length k
        Of the couplings.
    nodes : ndarray of int64, shape (2 n + 1,)
        Start, and middle and end of every step [ns].
    water : ndarray, shape (2 n + 1,)
        Velocity of the water along the axis of the DOF at these times [m/s].

    """
    found = values.copy()
    dt = np.diff(nodes) * 1e-9
    slopes = np.divide(np.diff(water), dt, out=np.zeros(len(dt)), where=dt > 0.0).reshape(-1, 2)
    for k, name in enumerate(names):
        found[:, 4 + 2 * k:6 + 2 * k] += TURNING.get(name, 0.0) * slopes
    return found
