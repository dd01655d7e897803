"""The current of the water over a log, along the axes of a body that turns in it."""

from __future__ import annotations

from array import array

import numpy as np
from rovid_core.model.plant import Array
from rovid_core.trials.record import Times

PERIOD = 1_000_000_000
"""[ns] Least time between two values that are kept: the water changes slowly."""

TURNING = {'vr': -1.0, 'ur': 1.0}
"""
Sign with which a regressor changes that is made of velocities over ground.

The axes of surge and sway turn by e_u' = r e_v and e_v' = -r e_u, so that
(v - e_v c) r = v r - (e_u c)' and (u - e_u c) r = u r + (e_v c)'.
"""


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
        if not self._times or time - self._times[-1] >= PERIOD:
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
