"""The thrust of a whole log as a function of delay and lag, for many candidates of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rovid_core.model.trajectory import Array, linear_recurrence

NS = 1e-9
BEFORE = 60.0
"""[s] The first command is taken to have stood this long, whatever the delay."""


class Commanded:
    """
    The force that was commanded on each DOF, before delay and lag.

    ``impulse`` is that of ``Thrust``, for all times of a log at once.

    Parameters
    ----------
    times : ndarray of int64, shape (n,)
        Of the commands [ns], increasing.
    forces : ndarray, shape (dofs, n)
        [N or N m]
    linear : bool
        Whether the force goes in a straight line from one command to the next.

    """

    def __init__(self, times: NDArray[np.int64], forces: Array, linear: bool) -> None:
        self._origin = int(times[0])
        self._at = np.concatenate([[-BEFORE], (times - times[0]) * NS])
        self._forces = np.concatenate([forces[:, :1], forces], axis=1)
        rise = np.diff(self._forces) / np.diff(self._at)
        # after the last command its force stays
        self._slopes = np.concatenate([rise * linear, np.zeros((len(forces), 1))], axis=1)

    def impulse(self, dof: int, times: NDArray[np.int64], delay: float,
                lag: float) -> Array:
        """
        Return the integral of the force on a DOF up to some times.

        Parameters
        ----------
        dof : int
            Row of the forces.
        times : ndarray of int64
            [ns]
        delay, lag : float
            Dead time and time constant [s].

        Returns
        -------
        ndarray
            [N s or N m s], from a start that is the same for all times.

        """
        at, force, slope = self._at, self._forces[dof], self._slopes[dof]
        step = np.diff(at)
        decay = np.exp(-step / lag) if lag > 0.0 else np.zeros_like(step)
        # what the lagged force is behind its steady response to the ramp
        ends = force[:-1] + slope[:-1] * (step - lag) - force[1:] + slope[1:] * lag
        behind = np.concatenate([[0.0], linear_recurrence(decay, ends)]) if lag > 0.0 else 0.0 * at
        spans = _span(force[:-1], slope[:-1], behind[:-1], step, lag)
        total = np.concatenate([[0.0], np.cumsum(spans)])
        x = (times - self._origin) * NS - delay
        i = np.maximum(np.searchsorted(at, x, 'right') - 1, 0)
        return np.asarray(total[i] + _span(force[i], slope[i], behind[i], x - at[i], lag))


def _span(force: Array, slope: Array, behind: Array, x: Array, lag: float) -> Array:
    """Return the impulse over ``x`` [s] from a command on."""
    transient = -behind * lag * np.expm1(-x / lag) if lag > 0.0 else 0.0
    return np.asarray(force * x + slope * x * (0.5 * x - lag) + transient)
