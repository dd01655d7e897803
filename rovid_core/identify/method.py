"""What every identification method is given and has to do, and how it tells that it diverged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, Protocol

from rovid_core.identify.intervals import NO_UNCERTAINTY, Uncertainty
from rovid_core.model.dofs import Four
from rovid_core.model.samples import Step
from rovid_core.model.thrusters import AS_CONFIGURED, Thrusters


class Identifier(Protocol):
    """
    One method on one DOF.

    Obligations of a new method (the contract tests check them):

    1. ``step`` moves the estimate by one step and returns ''. If it refuses the step, it leaves
       the estimate as it was and returns the reason.
    2. Whatever the input, ``parameters`` stays finite and inside ``bounds``.
    3. Left-out terms stay exactly 0.
    4. With ``adapt`` False the parameters stay as they are; the state moves on.
    5. ``restart`` sets the state to a measurement (the first one, or the first after a gap)
       and keeps the parameters; ``reset`` returns to the initial state.
    6. ``state`` consists of numbers, strings, lists and dicts. A new identifier that is given
       this state by ``restore`` continues with the same bits.
    7. Reading an attribute changes nothing.

    ``converged_share`` is the relative uncertainty of acceleration and alpha below which a
    model of the method has converged. A method that ``judges_errors`` has looked at its own before
    ``doubt`` is ''; of the others the status looks at what they predict (``LastMinute``).
    ``uncertainty`` is an immutable value that says how well the parameters are known. ``delay``
    is the delay of the thrust [s], NaN if the method does not estimate it. ``thrusters`` says how
    they are found to work besides, in units of the force: alpha is of the force that they give,
    and their lag is part of the delay. ``note`` says what the method has noticed about vehicle and
    model, '' if nothing. One that judges its errors has a ``fit``, as ``DofStatus`` has for the
    others. ``filtered`` tells whether ``v_hat`` is a velocity behind the low-pass.
    """

    parameters: Four
    uncertainty: Uncertainty = NO_UNCERTAINTY
    delay: float = math.nan
    couplings: tuple[float, ...] = ()
    thrusters: Thrusters = AS_CONFIGURED
    v_hat: float
    excitation: float
    converged_share: float = 0.05
    judges_errors: bool = False
    filtered: bool = True

    @property
    def std(self) -> Four:
        """Return the standard deviations of the parameters."""
        return self.uncertainty.std

    @property
    def covariance(self) -> tuple[float, ...]:
        """Return the covariance of the parameters."""
        return self.uncertainty.covariance

    @property
    def delay_std(self) -> float:
        """Return the standard deviation of the delay [s]."""
        return self.uncertainty.delay_std

    @property
    def changed_at(self) -> float:
        """Return after how long [s] the vehicle was found to have changed last, 0 for never."""
        return 0.0

    def hear(self, thrusters: Thrusters) -> None:
        """Learn how another DOF of the vehicle shows that its thrusters work."""
        return  # of no use to most

    def trust_thrusters(self) -> None:
        """Begin with thrusters that are taken to be as configured, and look for nothing else."""
        return

    @property
    def surprise(self) -> tuple[float, int]:
        """
        Return -2 log of the likelihood of what was measured so far, and how many numbers that was.

        Each is predicted from those before it; NaN and 0 if the method does not know it.
        """
        return math.nan, 0

    def hear_of_change(self) -> None:
        """Learn that another DOF has shown that the vehicle changed."""
        return

    @property
    def is_found(self) -> bool:
        """Tell whether ``v_hat`` is of a model that some seconds of data gave."""
        return True

    @property
    def way(self) -> list[tuple[float, ...]]:
        """Return how long before the end of the last step [s] the velocity was what, by time."""
        return [(0.0, self.v_hat)]

    @property
    def kept(self) -> float:
        """Return of how much motion under thrust all data are kept [s], inf if they are not."""
        return math.inf

    @property
    def fit(self) -> float:
        """Return how much of the motion the model predicts without corrections."""
        return math.nan

    @property
    def note(self) -> str:
        """Return what the method has noticed."""
        return ''

    @property
    def doubt(self) -> str:
        """Return why the model must not be used yet, however small its uncertainty is, or ''."""
        return ''

    def step(self, step: Step, adapt: bool = True) -> str:
        """Process one step; return '' or the reason why it was refused."""

    def restart(self, velocity: float) -> None:
        """Set the state to a measured velocity [m/s or rad/s] and keep the parameters."""

    def reset(self) -> None:
        """Return to the initial values."""

    def begin_anew(self) -> None:
        """Forget the data; begin with the parameters as they are, if the method can."""
        self.reset()

    def conclude(self) -> bool:
        """Make the best of data that end here, and are few; tell whether there was a better."""
        return False

    def retune(self, adaptation_time: float) -> None:
        """Change the adaptation time [s], if the method has one, and keep the estimate."""
        return None

    def energy(self, dv: float, parameters: Sequence[float], truth: Sequence[float]) -> float:
        """Return W of eq. 9 for a velocity error and parameters; NaN if there is none."""
        return math.nan

    def lyapunov(self, velocity: float, truth: Sequence[float]) -> float:
        """Return the present W against the true parameters; NaN if there is none."""
        return math.nan

    def state(self) -> dict[str, Any]:
        """Return all that is needed to continue from here."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``; raise ValueError if it does not fit."""


def floats(values: Any, count: int) -> list[float]:
    """Return a list of finite floats; raises ValueError unless there are that many."""
    found = [float(x) for x in values]
    if len(found) != count or not all(map(math.isfinite, found)):
        raise ValueError(f'{len(found)} numbers that do not fit')
    return found


def check_bounds(names: Sequence[str], values: Sequence[float], low: Sequence[float],
                 high: Sequence[float]) -> None:
    """Raise ValueError for a value of a saved state that is out of its bounds, or NaN."""
    for name, value, bottom, top in zip(names, values, low, high):
        if not bottom <= value <= top:
            raise ValueError(f'{name} {value} is outside {bottom} to {top}')


class DivergenceError(ArithmeticError):
    """Why a method cannot go on: the state of its filter means nothing any more."""
