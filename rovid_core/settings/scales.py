"""Typical sizes of the quantities of one degree of freedom."""

from __future__ import annotations

from dataclasses import dataclass

from rovid_core.model.dofs import Four, PARAMETERS
from rovid_core.model.plant import lumped
from rovid_core.settings.run import DofSettings


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
