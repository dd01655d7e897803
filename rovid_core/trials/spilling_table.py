"""A table that grows over a log, with all but its last rows in a temporary file."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
import os
from tempfile import TemporaryFile
from typing import BinaryIO

import numpy as np
from rovid_core.model.plant import Array
from rovid_core.trials.record import Times

BLOCK = 1 << 15
"""Rows of a table that are kept in memory, and processed at a time."""


class SpillingTable:
    """
    A table of times and values, with its older rows in a nameless temporary file.

    The memory of the process therefore does not grow with the log.

    Parameters
    ----------
    times, values : int
        Number of times and of values in a row.
    block : int
        Number of rows that are kept in memory.

    Attributes
    ----------
    count : int
        Number of rows.

    """

    def __init__(self, times: int, values: int, block: int = BLOCK) -> None:
        self.count = 0
        self._block = block
        self._width = times, values
        self._times = array('q')
        self._values = array('d')
        self._file: BinaryIO | None = None
        self._spilled = 0  # rows

    def append(self, times: tuple[int, ...], values: tuple[float, ...]) -> None:
        """Append a row of times [ns] and values."""
        self._times.extend(times)
        self._values.extend(values)
        self.count += 1
        if self.count - self._spilled == self._block:
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
