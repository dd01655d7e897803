"""What every identification method is given, and what it has to do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any, NamedTuple, Protocol

from rovid_core.dofs import Four, PARAMETERS
from rovid_core.plant import lumped
from rovid_core.settings import DofSettings
from rovid_core.uncertainty import NOTHING, Uncertainty

Three = tuple[float, float, float]


class Step(NamedTuple):
    """
    What was measured over one step of one DOF.

    Attributes
    ----------
    dt : float
        Length of the step [s], above 0.
    velocity : tuple of 3 floats
        Filtered velocity at the start, the middle and the end [m/s or rad/s].
    force : tuple of 3 floats
        Force at the same points, filtered alike [N or N m]. The pipe gives the exact mean
        over the step three times.
    mean : float
        What was measured, not filtered: the mean velocity over ``interval``, in whose middle
        the step ends, or the velocity at the step's end [m/s or rad/s].
    interval : float
        From the fix before the step's end to the fix after it [s]; 0 for a velocity sensor.
    parts : tuple of 2 floats
        Lengths of the step before and after the first of those fixes [s]; (dt, 0) for a
        velocity sensor.
    forces : tuple of 2 floats
        Exact mean of the force over each part, not filtered [N or N m].
    turn : float
        Angle by which the body turned since the interval before [rad].
    slip : float
        By how much the noise of the attitude puts the way over ``interval`` wrong [m].

    """

    dt: float
    velocity: Three
    force: Three
    mean: float = math.nan
    interval: float = 0.0
    parts: tuple[float, float] = (0.0, 0.0)
    forces: tuple[float, float] = (0.0, 0.0)
    turn: float = 0.0
    slip: float = 0.0


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


@dataclass(frozen=True, slots=True)
class Scales:
    """
    Typical size of things on one DOF, for normalised regressors and bounds.

    Attributes
    ----------
    force, velocity : float
        Typical force [N or N m] and velocity [m/s or rad/s], above 0.
    initial : tuple of 4 floats
        Initial lumped parameters, 0 for terms that are left out.
    active : tuple of 4 bools
        Terms that are identified.

    """

    force: float
    velocity: float
    initial: Four
    active: tuple[bool, bool, bool, bool]

    @staticmethod
    def of(settings: DofSettings) -> Scales:
        """
        Derive the scales from a DOF's settings.

        Without typical values: 0.5 m/s (rad/s), and the force that the initial model needs
        for that speed plus that for reaching it in 3 s.
        """
        active = tuple([name in settings.terms for name in PARAMETERS])
        values = lumped(
            settings.mass, settings.quadratic_drag, settings.linear_drag, settings.bias)
        initial = tuple([x if on else 0.0 for x, on in zip(values, active)])
        speed = settings.typical_velocity or 0.5
        force = settings.typical_force or (
            settings.mass * speed / 3.0
            + settings.quadratic_drag * speed * speed + settings.linear_drag * speed)
        return Scales(force, speed, initial, active)  # type: ignore[arg-type]

    @property
    def regressor(self) -> Four:
        """Return what the terms of phi = [tau, v|v|, v, 1] are multiplied by."""
        v = self.velocity
        return (1.0 / self.force, 1.0 / (v * v), 1.0 / v, 1.0)

    def bounds(self) -> tuple[Four, Four]:
        """
        Return the lowest and the highest allowed parameters.

        alpha > 0, beta <= 0 and gamma <= 0 are physics; the outer limits only keep a
        wrong input from leading to infinity: alpha within a factor of 1000 of the initial
        one, and each other term at most 1000 times the initial acceleration or its initial
        value.
        """
        largest = 1000.0 * max(self.initial[0] * self.force, self.velocity / 3.0)
        low: list[float] = []
        high: list[float] = []
        ranges = (
            (self.initial[0] / 1000.0, self.initial[0] * 1000.0),
            (-largest / self.velocity**2, 0.0),
            (-largest / self.velocity, 0.0),
            (-largest, largest),
        )
        for (bottom, top), start, on in zip(ranges, self.initial, self.active):
            low.append(min(bottom, start) if on else 0.0)
            high.append(max(top, start) if on else 0.0)
        return tuple(low), tuple(high)  # type: ignore[return-value]


def finite(values: tuple[float, ...]) -> bool:
    """Tell whether all values are finite."""
    return all(map(math.isfinite, values))
