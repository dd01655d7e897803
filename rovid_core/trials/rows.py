"""Rows of numbers, of which there can be more than the memory is to hold."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
import os
from tempfile import TemporaryFile
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.trajectory import Array

BLOCK = 1 << 15
"""Rows that are kept in memory, and worked on at a time."""

Times = NDArray[np.int64]


class Rows:
    """
    Rows of times and values, the older ones in a temporary file that has no name.

    Parameters
    ----------
    times, values : int
        How many of each are in a row.
    spill : bool
        False: keep all in memory.

    Attributes
    ----------
    count : int
        Rows so far.

    """

    def __init__(self, times: int, values: int, spill: bool = True) -> None:
        self.count = 0
        self._width = times, values
        self._times = array('q')
        self._values = array('d')
        self._spill = spill
        self._file: BinaryIO | None = None
        self._spilled = 0  # rows

    def append(self, times: tuple[int, ...], values: tuple[float, ...]) -> None:
        """Take a row: times [ns] and values."""
        self._times.extend(times)
        self._values.extend(values)
        self.count += 1
        if self._spill and self.count - self._spilled == BLOCK:
            self._write()

    def read(self, first: int, last: int) -> tuple[Times, Array]:
        """
        Return the rows from one to before another.

        Returns
        -------
        times : ndarray of int64, shape (n, times)
            [ns]
        values : ndarray, shape (n, values)

        """
        parts = [self._part(at, max(first, at), min(last, at + BLOCK))
                 for at in range(first - first % BLOCK, min(last, self._spilled), BLOCK)]
        if last > self._spilled or not parts:
            parts.append(self._held(max(first, self._spilled), last))
        times, values = zip(*parts)
        return (times[0], values[0]) if len(parts) == 1 else (
            np.concatenate(times), np.concatenate(values))

    def blocks(self, first: int, last: int) -> Iterator[tuple[Times, Array]]:
        """Yield the same rows, some at a time."""
        for at in range(first, last, BLOCK):
            yield self.read(at, min(at + BLOCK, last))

    def _write(self) -> None:
        if self._file is None:
            self._file = TemporaryFile(prefix='rovid-')
        self._file.write(self._times.tobytes() + self._values.tobytes())
        self._file.flush()  # all of it, or an OSError
        del self._times[:], self._values[:]
        self._spilled = self.count

    def _part(self, at: int, first: int, last: int) -> tuple[Times, Array]:
        """Return rows of the block in the file that begins with row ``at``."""
        assert self._file is not None
        times, values = self._width
        size = 8 * BLOCK * (times + values)
        # not by the file's position, which processes share that were forked from this one
        data = os.pread(self._file.fileno(), size, at * 8 * (times + values))
        split = 8 * BLOCK * times
        return (np.frombuffer(data[:split], np.int64).reshape(-1, times)[first - at:last - at],
                np.frombuffer(data[split:]).reshape(-1, values)[first - at:last - at])

    def _held(self, first: int, last: int) -> tuple[Times, Array]:
        """Return rows that are in memory, as copies: an array that is lent cannot grow."""
        times, values = self._width
        rows = slice(first - self._spilled, last - self._spilled)
        return (np.array(self._times, np.int64).reshape(-1, times)[rows],
                np.array(self._values).reshape(-1, values)[rows])
