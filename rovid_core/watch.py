"""Watch the data for the mistakes that a configuration can hold."""

from __future__ import annotations

from collections.abc import Callable

from rovid_core.settings import Settings

ENOUGH = 100
"""Steps backwards after which commands should have been negative once."""


class OneSided:
    """
    Tell when thruster commands have no sign although the vehicle moves both ways.

    Parameters
    ----------
    settings : Settings
        The run.
    warn : callable
        Told one line, once.

    """

    def __init__(self, settings: Settings, warn: Callable[[str], None]) -> None:
        self._offset = settings.thrusters.offset
        self._slow = [
            -0.2 * (settings.dof[d].typical_velocity or 0.5) for d in settings.dofs]
        self._warn = warn
        self._backwards = 0
        self._watching = True

    def command(self, values: tuple[float, ...]) -> None:
        """Take raw commands."""
        if self._watching and min(values, default=0.0) < self._offset:
            self._watching = False

    def velocity(self, i: int, velocity: float) -> None:
        """Take the velocity of DOF number ``i``."""
        if self._watching and velocity < self._slow[i]:
            self._backwards += 1
            if self._backwards == ENOUGH:
                self._watching = False
                self._warn('no thruster command was ever negative while the vehicle went '
                           'backwards: if they are magnitudes, give their direction with '
                           'thrusters.sign')
