"""One DOF of a recorded trial: the steps as they are kept, and as arrays for the fits."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass
import os
from tempfile import TemporaryFile
from typing import BinaryIO, cast

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.dofs import Four, NAN4
from rovid_core.model.samples import Step
from rovid_core.model.trajectory import Array

BLOCK = 1 << 15
"""Rows of a table that are kept in memory, and processed at a time."""

Times = NDArray[np.int64]


@dataclass(frozen=True)
class Record:
    """
    The measurements of one DOF between two interruptions.

    Attributes
    ----------
    time : ndarray, shape (m,)
        Times of the fixes (or velocity samples) from the trial's start [s].
    position : ndarray, shape (m,) or (0,)
        Path along the body axis at the fixes [m or rad], from 0; empty for a velocity sensor.
    velocity : ndarray, shape (m - 1,) or (m,)
        Mean velocity between two fixes, or the velocity at each sample [m/s or rad/s].
    dt, force : ndarray, shape (2 m - 2,) or (m - 1,)
        Segments of known mean force [s], [N or N m]: two from fix to fix, or one from sample
        to sample.

    """

    time: Array
    position: Array
    velocity: Array
    dt: Array
    force: Array

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
    """
    The result of an offline method.

    Attributes
    ----------
    parameters : tuple of 4 floats
        Lumped parameters.
    covariance : ndarray, shape (4, 4), or None
        Covariance of the parameters, 0 for terms that are left out; None if unknown.
    note : str
        What is wrong with the result, '' if nothing.

    """

    parameters: Four
    covariance: Array | None = None
    note: str = ''

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
    values : ndarray, shape (4, n)
        Mean force of each step before and after its fix [N or N m]; its filtered velocity,
        which is not used; its measured velocity, not filtered [m/s or rad/s].

    Returns
    -------
    Record or None
        None if there are too few steps.

    """
    (fix, end), (first, last, _, mean) = times, values
    if len(end) < 3:
        return None
    if fix[-1] == end[-1]:  # a velocity sensor: steps from sample to sample
        dt = np.diff(end) * 1e-9
        return Record((end - origin) * 1e-9, np.empty(0), mean, dt, first[1:])
    dt = np.stack([end[:-1] - fix[:-1], fix[1:] - end[:-1]], axis=1).ravel() * 1e-9
    force = np.stack([last[:-1], first[1:]], axis=1).ravel()
    velocity = mean[:-1]
    position = np.concatenate([[0.0], np.cumsum(velocity * np.diff(fix) * 1e-9)])
    return Record((fix - origin) * 1e-9, position, velocity, dt, force)


class SpillingTable:
    """
    A table of times and values, with its older rows in a nameless temporary file.

    The memory of the process therefore does not grow with the log.

    Parameters
    ----------
    times, values : int
        Number of times and of values in a row.
    spill : bool
        False keeps all rows in memory.
    block : int
        Number of rows that are kept in memory.

    Attributes
    ----------
    count : int
        Number of rows.

    """

    def __init__(self, times: int, values: int, spill: bool = True, block: int = BLOCK) -> None:
        self.count = 0
        self._block = block
        self._width = times, values
        self._times = array('q')
        self._values = array('d')
        self._spill = spill
        self._file: BinaryIO | None = None
        self._spilled = 0  # rows

    def append(self, times: tuple[int, ...], values: tuple[float, ...]) -> None:
        """Append a row of times [ns] and values."""
        self._times.extend(times)
        self._values.extend(values)
        self.count += 1
        if self._spill and self.count - self._spilled == self._block:
            self._spill_rows()

    def read(self, first: int, last: int) -> tuple[Times, Array]:
        """Return times, shape (n, times), and values of the rows ``first`` to ``last - 1``."""
        block = self._block
        parts = [self._read_file(at, max(first, at), min(last, at + block))
                 for at in range(first - first % block, min(last, self._spilled), block)]
        if last > self._spilled or not parts:
            parts.append(self._read_memory(max(first, self._spilled), last))
        times, values = zip(*parts)
        return (times[0], values[0]) if len(parts) == 1 else (
            np.concatenate(times), np.concatenate(values))

    def blocks(self, first: int, last: int) -> Iterator[tuple[Times, Array]]:
        """Yield the same rows, a block at a time."""
        for at in range(first, last, self._block):
            yield self.read(at, min(at + self._block, last))

    def _spill_rows(self) -> None:
        if self._file is None:
            self._file = TemporaryFile(prefix='rovid-')
        self._file.write(self._times.tobytes() + self._values.tobytes())
        self._file.flush()  # writes everything or raises OSError
        del self._times[:], self._values[:]
        self._spilled = self.count

    def _read_file(self, at: int, first: int, last: int) -> tuple[Times, Array]:
        """Return rows of the block of the file that begins with row ``at``."""
        assert self._file is not None
        times, values = self._width
        size = 8 * self._block * (times + values)
        # with an offset: forked processes share the position in the file
        data = os.pread(self._file.fileno(), size, at * 8 * (times + values))
        split = 8 * self._block * times
        return (np.frombuffer(data[:split], np.int64).reshape(-1, times)[first - at:last - at],
                np.frombuffer(data[split:]).reshape(-1, values)[first - at:last - at])

    def _read_memory(self, first: int, last: int) -> tuple[Times, Array]:
        """Return copies of rows in memory; an array cannot grow while a view of it exists."""
        times, values = self._width
        rows = slice(first - self._spilled, last - self._spilled)
        return (np.array(self._times, np.int64).reshape(-1, times)[rows],
                np.array(self._values).reshape(-1, values)[rows])
