"""What is let in of an input: neither what is stuck nor what does not follow from before."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rovid_core.inputs.outlier_gate import Floats, Gate
from rovid_core.inputs.units_and_signs import Units
from rovid_core.model.dofs import ANGULAR_DOFS, LINEAR_DOFS
from rovid_core.settings.run import Settings
from rovid_core.settings.scales import Scales
from rovid_core.thrust.force_history import Thrust

STUCK = 10
"""Repeats of the very same value in a row, under thrust, of a sensor that is stuck."""

KNOWN = 200
"""Values after which it is known how often a sensor repeats one."""

SELDOM = 0.01
"""Share of repeats up to which it never does, normally."""

WORKING = 0.1
"""Force that should move the vehicle, in typical ones."""

STILL = 50
"""Repeats in a row that are told where the vehicle is driven, if not by a thrust of its own."""

LOOK = 300
"""Values after which it is told when most of them only repeat the one before, under thrust."""

MOST = 200
"""Repeats among them that are most."""

TAKEN_ANEW = frozenset({'gap', 'shifted'})
"""Reasons for which a measurement is not refused: it is where the input goes on."""


class Inlet:
    """
    What is let in of one input.

    Parameters
    ----------
    settings : Settings
        The run.
    input : str
        ``position``, ``depth``, ``attitude``, ``velocity`` or ``angular_velocity``.
    thrust : Thrust
        Tells whether the vehicle should be moving.
    warn : callable
        Told one line whenever the input gets stuck.

    Attributes
    ----------
    gate : Gate
        Tells the outliers.

    """

    def __init__(self, settings: Settings, input: str, thrust: Thrust,
                 warn: Callable[[str], None]) -> None:
        self._input = input
        self._thrust = thrust
        self._warn = warn
        self.gate = Gate(settings, input)
        self._units = Units(settings, input, warn)
        self._told = False
        self.change(settings)
        names = ANGULAR_DOFS if input in ('attitude', 'angular_velocity') else (
            ('heave',) if input == 'depth' else LINEAR_DOFS)
        own = [i for i, d in enumerate(settings.dofs) if d in names]
        self._all_forces = [
            (i, WORKING * Scales.of(settings.dof[d]).force) for i, d in enumerate(settings.dofs)]
        # any thrust will do where none is known to move what it measures
        self._forces = [self._all_forces[i] for i in own] or self._all_forces
        self.restart()

    def change(self, settings: Settings) -> None:
        """Take other limits."""
        self._gated = settings.gate > 0.0
        self.gate.change_limits(settings)
        self._units.change(settings)
        if not self._gated:
            self.gate.restart()  # what it last saw must not stand for what comes

    def restart(self) -> None:
        """Forget everything."""
        self.gate.restart()
        self._units.restart()
        self._value: Floats | None = None
        self._count = self._repeats = self._run = 0
        self._resting = self._still = 0  # repeats in a row without its own thrust, under others
        self._looked = self._same = 0
        self._stuck = False

    def take(self, time: int, value: Floats) -> str:
        """
        Judge a value at ``time`` [ns].

        Returns
        -------
        str
            '' to take it, one of ``TAKEN_ANEW`` to go on from it, or why it is refused.

        """
        self._count += 1
        self._looked += 1
        if value == self._value:
            if self._is_stuck():
                return 'stuck'
            if self._looked >= LOOK:
                self._look()
        else:
            self._value = value
            self._resting = self._still = 0
            if self._run:
                self._repeats += self._run
                self._run = 0
            if self._stuck:
                self._stuck = False
                self.gate.take_up(time, value)
                return 'gap'
        reason = self.gate.take(time, value) if self._gated else ''
        self._units.take(time, value, reason, self.gate.change)
        return reason

    def _is_stuck(self) -> bool:
        """Take a value that is exactly the one before."""
        if self._stuck:
            self._count -= 1  # says nothing of how it normally is
            return True
        if not self._is_driven(self._forces):
            self._repeats += 1
            self._note_still()
            return False
        self._run += 1
        self._same += 1
        usual = self._count - self._run
        if self._run < STUCK or usual < KNOWN or self._repeats > SELDOM * usual:
            return False
        self._count, self._run, self._stuck = usual, 0, True
        self._warn(f'{self._input} is stuck: it has repeated the very same value {STUCK} times '
                   'under thrust; it is refused until it changes')
        return True

    def _is_driven(self, forces: Sequence[tuple[int, float]]) -> bool:
        return any(abs(self._thrust.newest(i)) > least for i, least in forces)

    def _note_still(self) -> None:
        """Tell when a sensor that hardly ever repeats a value does for long."""
        self._resting += 1
        if not self._is_driven(self._all_forces):
            return
        self._still += 1
        usual = self._count - self._resting
        if (self._still == STILL and usual >= KNOWN
                and self._repeats - self._resting <= SELDOM * usual):
            self._warn(f'{self._input} may be stuck: it has repeated the very same value {STILL} '
                       'times while the vehicle was driven, which it hardly ever did before')

    def _look(self) -> None:
        """Say once when most of the last values were only repeats."""
        if self._same >= MOST and not self._told:
            self._told = True
            self._warn(f'{self._input} mostly repeats its last value under new stamps: it is '
                       'published more often than it is measured, or in coarse steps')
        self._looked = self._same = 0
