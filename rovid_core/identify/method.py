"""What every identification method is given, and what it has to do."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any, Protocol

from rovid_core.identify.uncertainty import NOTHING, Uncertainty
from rovid_core.model.dofs import Four
from rovid_core.model.samples import Step


class Identifier(Protocol):
    """
    One method on one DOF.

    Obligations of a new method (the contract tests check them):

    1. ``step`` moves the estimate by one step and returns '' or, with the estimate left
       as it was, the reason why the step was refused.
    2. Whatever it is given, ``parameters`` stays finite and inside ``bounds``.
    3. Left-out terms stay exactly 0.
    4. With ``adapt`` False the parameters stay; the state goes on.
    5. ``restart`` sets the state to a measurement (the first one, or after a gap) and
       keeps the parameters; ``reset`` goes back to how it was made.
    6. ``state`` is made of numbers, strings, lists and dicts; ``restore`` of it in a new
       identifier continues with the same bits.
    7. Reading an attribute changes nothing.

    ``uncertainty`` is how well the parameters are known, a value of its own that does not
    change when the method goes on. ``delay`` is that of the thrust [s], NaN where it is not
    estimated. ``note`` is what the method has noticed of vehicle and model, '' if nothing.
    """

    parameters: Four
    uncertainty: Uncertainty = NOTHING
    delay: float = math.nan
    v_hat: float
    excitation: float

    @property
    def std(self) -> Four:
        """Return the standard deviations of the parameters."""
        return self.uncertainty.std

    @property
    def covariance(self) -> tuple[float, ...]:
        """Return that of the parameters."""
        return self.uncertainty.covariance

    @property
    def delay_std(self) -> float:
        """Return the standard deviation of the delay [s]."""
        return self.uncertainty.delay_std

    @property
    def note(self) -> str:
        """Return what the method has noticed."""
        return ''

    def step(self, step: Step, adapt: bool = True) -> str:
        """Take one step; return '' or why it was refused."""

    def restart(self, velocity: float) -> None:
        """Take up from a measured velocity, keeping the parameters."""

    def reset(self) -> None:
        """Go back to the initial values."""

    def retune(self, adaptation_time: float) -> None:
        """Take another adaptation time [s] and keep what was found; some have none."""
        return None

    def energy(self, dv: float, parameters: Four, truth: Four) -> float:
        """Return W of eq. 9 for a velocity error and parameters, NaN for a method without."""
        return math.nan

    def lyapunov(self, velocity: float, truth: Four) -> float:
        """Return W as it is now, against the true parameters, NaN for a method without."""
        return math.nan

    def state(self) -> dict[str, Any]:
        """Return all that is needed to go on from here."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``; raises ValueError if it does not fit."""
