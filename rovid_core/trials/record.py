"""One DOF of a recorded trial: the steps as they are kept, and as arrays for the fits."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import cast

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.dofs import Four, NAN4
from rovid_core.model.samples import Step
from rovid_core.model.trajectory import Array

Times = NDArray[np.int64]


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
        dt, impulse = self.dt, self.dt * self.force
        if len(self.position):
            dt = dt[1:-1].reshape(-1, 2).sum(axis=1)
            impulse = impulse[1:-1].reshape(-1, 2).sum(axis=1)
        v = self.velocity.tolist()
        return [Step(h, (a, 0.5 * (a + b), b), (f, f, f)) for h, f, a, b in zip(
            dt.tolist(), (impulse / dt).tolist(), v, v[1:])]


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
