"""A linear recurrence over a whole trial at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LENGTH = 32
"""Of the pieces that are solved side by side."""


def recurrence(factor: Array, added: Array) -> Array:
    """
    Return ``x[k] = factor[k] x[k - 1] + added[k]``, with 0 before the first.

    All pieces of a trial are solved side by side, as if each began at 0; what each begins
    with is a recurrence of the same kind over the ends of the pieces.

    Parameters
    ----------
    factor : ndarray, shape (n,)
        Up to 1 in size; else the result grows as it says.
    added : ndarray, shape (..., n)
        One or more series.

    Returns
    -------
    x : ndarray, shape (..., n)

    """
    series, count = added.shape[:-1], len(factor)
    pieces = -(-count // LENGTH)
    padded = np.zeros(pieces * LENGTH)
    padded[:count] = factor
    x = np.zeros((*series, pieces * LENGTH))
    x[..., :count] = added
    # a step of all pieces lies together in memory
    gain = padded.reshape(pieces, LENGTH).T.copy()
    x = np.moveaxis(x.reshape(*series, pieces, LENGTH), -1, 0).copy()
    for k in range(1, LENGTH):
        x[k] += gain[k] * x[k - 1]
        gain[k] *= gain[k - 1]
    if pieces > 1:
        x[..., 1:] += gain.reshape(LENGTH, *[1] * len(series), pieces)[..., 1:] * recurrence(
            gain[-1], x[-1])[..., :-1]
    return np.moveaxis(x, 0, -1).reshape(*series, pieces * LENGTH)[..., :count]
