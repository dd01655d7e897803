"""The frozen results of the pipeline: the estimate of one DOF, and of all of them."""

from __future__ import annotations

import math
from typing import ClassVar, Final, NamedTuple

from rovid_core.identify.intervals import (
    Interval,
    intervals,
    NO_UNCERTAINTY,
    physical_std,
    Uncertainty,
)
from rovid_core.identify.status import Judgement, WAITING
from rovid_core.model.dofs import Four
from rovid_core.model.samples import Values
from rovid_core.model.thrusters import AS_CONFIGURED, Thrusters

TURN = 'turn by 45 degrees or more'
"""What to do first, that a current can be told from drag and bias."""

KNOWN_CURRENT: Final = 0.02
"""[m/s] How well a current has to be known, and below which it is as good as none."""


class DofEstimate(Values):
    """
    The estimate of one degree of freedom after a step.

    Units are those of the DOF: N, m/s and kg, or N m, rad/s and kg m^2. What is seldom read
    (covariance, standard deviations, reasons, intervals) is computed when it is read.

    Attributes
    ----------
    parameters : tuple of 4 floats
        alpha, beta, gamma, delta.
    time : int
        Of velocity and v_hat [ns].
    velocity : float
        Measured, filtered.
    v_hat : float
        The velocity in the identifier's state.
    force : float
        Mean over the step, filtered like the velocity.
    excitation : float
        Mean square of the thrust, in typical forces.
    W : float
        Lyapunov function, where the truth is known.
    delay : float
        Of the thrust [s], where it is estimated.
    couplings : tuple of float
        kappa of each of the DOF's ``couplings`` settings.
    settled : bool
        Whether the model may be used, as ``DofStatus`` has it.
    fit : float
        How much of the motion the model predicts; 1: all.
    velocity_delay, v_hat_delay : float
        By which these lag behind the motion at ``time`` [s].
    thrusters : Thrusters
        How they are found to work besides the configuration.
    stale_for : float
        [s] since the last step where that is too long ago, otherwise 0.

    """

    NAMES: ClassVar[tuple[str, ...]] = (
        'dof', 'parameters', 'uncertainty', 'judgement', 'time', 'steps', 'velocity', 'v_hat',
        'force', 'excitation', 'W', 'delay', 'couplings', 'settled', 'fit', 'velocity_delay',
        'v_hat_delay', 'thrusters', 'stale_for')

    def __init__(self, dof: str, parameters: Four, uncertainty: Uncertainty = NO_UNCERTAINTY,
                 judgement: Judgement = WAITING, time: int = 0, steps: int = 0,
                 velocity: float = math.nan, v_hat: float = math.nan, force: float = math.nan,
                 excitation: float = 0.0, W: float = math.nan,  # noqa: N803
                 delay: float = math.nan,
                 couplings: tuple[float, ...] = (), settled: bool = False,
                 fit: float = math.nan, velocity_delay: float = math.nan,
                 v_hat_delay: float = math.nan, thrusters: Thrusters = AS_CONFIGURED,
                 stale_for: float = 0.0) -> None:
        self.dof = dof
        self.parameters = parameters
        self.uncertainty = uncertainty
        self.judgement = judgement
        self.time = time
        self.steps = steps
        self.velocity = velocity
        self.v_hat = v_hat
        self.force = force
        self.excitation = excitation
        self.W = W
        self.delay = delay
        self.couplings = couplings
        self.settled = settled
        self.fit = fit
        self.velocity_delay = velocity_delay
        self.v_hat_delay = v_hat_delay
        self.thrusters = thrusters
        self.stale_for = stale_for

    @property
    def std(self) -> Four:
        """Return the standard deviations of the parameters, NaN where there are none."""
        return self.uncertainty.std

    @property
    def covariance(self) -> tuple[float, ...]:
        """Return the covariance of the parameters: 16 floats, row-major, or ()."""
        return self.uncertainty.covariance

    @property
    def delay_std(self) -> float:
        """Return the standard deviation of the delay [s]."""
        return self.uncertainty.delay_std

    @property
    def couplings_std(self) -> tuple[float, ...]:
        """Return the standard deviations of the couplings."""
        return self.uncertainty.couplings_std

    @property
    def status(self) -> str:
        """Return one of ``status.STATUSES``."""
        return 'stale' if self.stale_for else self.judgement.status

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return why the status is no better."""
        if self.stale_for:
            return (f'no step for {self.stale_for:.1f} s' if math.isfinite(self.stale_for)
                    else 'no step since time jumped back',)
        return self.judgement.reasons

    @property
    def valid(self) -> bool:
        """Tell whether model and velocity may be used now."""
        return self.settled and self.status not in ('invalid', 'stale')

    @property
    def physical_std(self) -> Four:
        """Return the standard deviations of mass, drags and bias, NaN where there are none."""
        return physical_std(self.parameters, self.covariance)

    @property
    def dv(self) -> float:
        """Return v_hat - v (paper eq. 8)."""
        return self.v_hat - self.velocity

    @property
    def intervals(self) -> dict[str, Interval]:
        """Return the 95 % intervals of the parameters in both forms; empty if unknown."""
        return intervals(self.parameters, self.covariance)


class Current(NamedTuple):
    """
    The horizontal current of the water in the ENU world, where it goes to.

    ``chi2`` (two degrees of freedom) says how much better a pull in the world or headings that
    are off fit what surge and sway tell of it; NaN until that is judged.
    """

    x: float  # [m/s]
    y: float
    covariance: tuple[float, float, float]  # xx, xy, yy [m^2/s^2]
    chi2: float = math.nan
    # off, unobservable (until the vehicle has turned), converging, known or inconsistent
    status: str = 'converging'
    advice: str = ''  # what is missing, or what fits better than a current

    @property
    def is_seen(self) -> bool:
        """Tell whether x and y say something."""
        return self.status not in ('off', 'unobservable')

    @property
    def std(self) -> tuple[float, float]:
        """Return the standard deviations of x and y [m/s]."""
        return math.sqrt(self.covariance[0]), math.sqrt(self.covariance[2])


class Estimate(Values):
    """
    All DOFs after a step of one or more of them.

    Attributes
    ----------
    time : int
        [ns] of the newest velocity: the middle of the interval between two position fixes, or
        the stamp of a measured velocity.
    dofs : tuple of DofEstimate
        In the order of ``Settings.dofs``.
    stepped : tuple of int
        Indices into ``dofs`` of those that this step moved.
    current : Current or None
        None where it is not estimated.
    now : int
        Event time [ns] of the sample that completed the step, which is what ages count up to.

    """

    NAMES: ClassVar[tuple[str, ...]] = ('time', 'dofs', 'stepped', 'current', 'now')

    def __init__(self, time: int, dofs: tuple[DofEstimate, ...], stepped: tuple[int, ...],
                 current: Current | None = None, now: int = 0) -> None:
        self.time = time
        self.dofs = dofs
        self.stepped = stepped
        self.current = current
        self.now = now
