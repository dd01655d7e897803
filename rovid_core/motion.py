"""One measured velocity."""

from __future__ import annotations

from typing import NamedTuple


class Motion(NamedTuple):
    """
    One measured velocity.

    Attributes
    ----------
    start, end : int
        The interval over which it is the mean [ns]; the same for a point measurement.
    time : int
        At which the velocity stands: the middle of the interval [ns].
    velocity : tuple of float
        One value per DOF of the source [m/s or rad/s], in the body frame.
    turn : float
        Angle by which the body turned since the interval before [rad].
    slips : tuple of float
        By how much the noise of the attitude puts the way over the interval wrong [m], one
        per DOF; empty where none was used.

    """

    start: int
    end: int
    time: int
    velocity: tuple[float, ...]
    turn: float = 0.0
    slips: tuple[float, ...] = ()
