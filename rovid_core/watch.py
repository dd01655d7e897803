"""Watch the data for the mistakes that a configuration can hold."""

from __future__ import annotations

from collections.abc import Callable
import math
from operator import mul, sub

from rovid_core.identifier import Scales, Step
from rovid_core.settings import DofSettings, Settings

ENOUGH = 600
"""Steps each way after which commands should have been negative once."""

MANY = 600
"""Steps after which forces and velocities are compared with the typical ones."""

FAR_OFF = 3.0
"""Factor by which typical sizes may be off."""

TO_AND_FRO = 30
"""Commands in a row, each of which takes back the one before: noise does not do that."""

BACK = 0.8
"""Share of a change that the next one takes back at least."""


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
        self._backwards = self._forwards = 0
        # a curve may have its zero anywhere
        self._watching = settings.thrusters.model in ('linear', 'quadratic')

    def command(self, values: tuple[float, ...]) -> None:
        """Take raw commands."""
        if self._watching and min(values, default=0.0) < self._offset:
            self._watching = False

    def velocity(self, i: int, velocity: float) -> None:
        """Take the velocity of DOF number ``i``."""
        if not self._watching:
            return
        self._backwards += velocity < self._slow[i]
        self._forwards += velocity > -self._slow[i]
        if min(self._backwards, self._forwards) >= ENOUGH:
            self._watching = False
            self._warn('no thruster command was ever negative while the vehicle went '
                       'backwards: if they are magnitudes, give their direction with '
                       'thrusters.sign')


class Interleaved:
    """
    Tell when thruster commands jump to and fro, as those of two programs on one topic do.

    Parameters
    ----------
    warn : callable
        Told one line, once.

    """

    def __init__(self, warn: Callable[[str], None]) -> None:
        self._warn = warn
        self._watching = True
        self._last: dict[int, tuple[float, ...]] = {}  # by part
        self._change: dict[int, list[float]] = {}
        self._count: dict[int, int] = {}

    def command(self, values: tuple[float, ...], part: int) -> None:
        """Take raw commands of one topic."""
        if not self._watching:
            return
        change = list(map(sub, values, self._last.get(part, values)))
        before = self._change.get(part, change)
        taken_back = -sum(map(mul, change, before))
        square = max(sum(map(mul, change, change)), sum(map(mul, before, before)))
        count = self._count.get(part, 0) + 1 if taken_back > BACK * square else 0
        self._last[part], self._change[part], self._count[part] = values, change, count
        if count == TO_AND_FRO:
            self._watching = False
            self._warn('the thruster commands jump to and fro from each message to the next: do '
                       'two programs publish them?')


class TypicalSizes:
    """
    Tell when a DOF's force or velocity is far from the typical one.

    What counts as thrust, as rest and as enough data is measured in typical sizes, whatever
    the method; ``aid`` takes its gains from the data.

    Parameters
    ----------
    dof : str
        Its name.
    settings : DofSettings
        Its typical or initial values.
    warn : callable
        Told one line, once.

    """

    def __init__(self, dof: str, settings: DofSettings, warn: Callable[[str], None]) -> None:
        self._dof = dof
        self._scales = Scales.of(settings)
        self._warn = warn
        self._steps = 0
        self._squares = [0.0, 0.0]

    def step(self, step: Step) -> None:
        """Take a step."""
        if self._steps >= MANY:
            return
        self._steps += 1
        self._squares[0] += step.force[1] * step.force[1]
        self._squares[1] += step.velocity[1] * step.velocity[1]
        if self._steps == MANY:
            self._compare()

    def _compare(self) -> None:
        # the amplitude of a sinusoid with this mean square
        force, velocity = (math.sqrt(2.0 * x / MANY) for x in self._squares)
        for name, got, used in (('force', force, self._scales.force),
                                ('velocity', velocity, self._scales.velocity)):
            if not used / FAR_OFF <= got <= used * FAR_OFF and force > 0.0:
                self._warn(
                    f'{self._dof}: its {name} is about {got:.2g}, and {used:.2g} is taken for '
                    f'typical, which decides what is rest and what are enough data; set '
                    f'{self._dof}.typical.{name}')
