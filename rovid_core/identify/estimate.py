"""
The frozen values that go through the pipe: samples and events in, estimates out.

There are many of them, and a tuple is made several times faster than a frozen dataclass.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rovid_core.identify.intervals import Interval, intervals
from rovid_core.identify.status import Judgement, WAITING
from rovid_core.identify.uncertainty import NOTHING, Uncertainty
from rovid_core.model.dofs import Four


class DofEstimate(NamedTuple):
    """
    What is known of one degree of freedom after a step.

    Units are those of the DOF: N, m/s and kg, or N m, rad/s and kg m^2. What few read
    (covariance, standard deviations, reasons, intervals) is computed when it is read.
    """

    dof: str
    parameters: Four  # alpha, beta, gamma, delta
    uncertainty: Uncertainty = NOTHING
    judgement: Judgement = WAITING
    time: int = 0  # [ns] to which velocity and v_hat belong
    steps: int = 0
    velocity: float = math.nan  # measured, filtered
    v_hat: float = math.nan  # the identifier's state
    force: float = math.nan  # mean over the step, filtered like the velocity
    excitation: float = 0.0  # mean square of the thrust, in typical forces
    W: float = math.nan  # Lyapunov function, where the truth is known
    delay: float = math.nan  # of the thrust [s], where it is estimated

    @property
    def std(self) -> Four:
        """Return the standard deviations of the parameters, NaN where there are none."""
        return self.uncertainty.std

    @property
    def covariance(self) -> tuple[float, ...]:
        """Return that of the parameters, 16 by rows; () without."""
        return self.uncertainty.covariance

    @property
    def delay_std(self) -> float:
        """Return the standard deviation of the delay [s]."""
        return self.uncertainty.delay_std

    @property
    def status(self) -> str:
        """Return one of ``status.STATUSES``."""
        return self.judgement.status

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return why the status is no better."""
        return self.judgement.reasons

    @property
    def dv(self) -> float:
        """Return v_hat - v (paper eq. 8)."""
        return self.v_hat - self.velocity

    @property
    def intervals(self) -> dict[str, Interval]:
        """Return the 95 % intervals of the parameters in both forms; none without covariance."""
        return intervals(self.parameters, self.covariance)


class Estimate(NamedTuple):
    """
    All DOFs after a step of one or more of them.

    Attributes
    ----------
    time : int
        Time [ns] to which the newest velocity belongs: the middle of the interval between
        two position fixes, or the stamp of a measured velocity.
    dofs : tuple of DofEstimate
        In the order of ``Settings.dofs``.
    stepped : tuple of int
        Indices into ``dofs`` of those that this step moved.

    """

    time: int
    dofs: tuple[DofEstimate, ...]
    stepped: tuple[int, ...]
