"""Tell when a sensor repeats the very same value, and check each measurement of an input."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from rovid_core.inputs.outlier_gate import Floats, OutlierGate
from rovid_core.inputs.units_and_signs import UnitCheck
from rovid_core.model.dofs import ANGULAR_DOFS, LINEAR_DOFS
from rovid_core.settings.run import Scales, Settings

STUCK_AFTER: Final = 10
"""Repeats of the very same value in a row, under thrust, of a sensor that is stuck."""

KNOWN_AFTER: Final = 200
"""Values after which it is known how often a sensor repeats one."""

SELDOM: Final = 0.01
"""Share of repeats of a sensor that normally never repeats a value."""

WORKING: Final = 0.1
"""Force that should move the vehicle, in typical forces."""

WARN_AFTER: Final = 50
"""Repeats in a row for a warning, while the vehicle is driven, but not by a thrust of its own."""

WINDOW: Final = 300
"""Values in a window, in which the repeats under thrust are counted."""

MANY_REPEATS: Final = 200
"""Repeats in a window that are worth a warning."""

RESTARTS: Final = frozenset({'gap', 'shifted'})
"""Reasons with which a measurement is used all the same: the input goes on from it."""


class InputCheck:
    """
    Decide which measurements of one input are used.

    Parameters
    ----------
    settings : Settings
        The run.
    input : str
        ``position``, ``depth``, ``attitude``, ``velocity`` or ``angular_velocity``.
    warn : callable
        Called with one line whenever the input gets stuck.

    Attributes
    ----------
    gate : OutlierGate
        Refuses the outliers.

    """

    def __init__(self, settings: Settings, input: str, warn: Callable[[str], None]) -> None:
        self._input = input
        self._warn = warn
        self.gate = OutlierGate(settings, input)
        self._units = UnitCheck(settings, input, warn)
        self._has_warned = False
        self.change(settings)
        names = ANGULAR_DOFS if input in ('attitude', 'angular_velocity') else (
            ('heave',) if input == 'depth' else LINEAR_DOFS)
        own = [i for i, d in enumerate(settings.dofs) if d in names]
        self._least_forces = [
            (i, WORKING * Scales.of(settings.dof[d]).force) for i, d in enumerate(settings.dofs)]
        # any thrust will do where none is known to move what it measures
        self._own_least_forces = [self._least_forces[i] for i in own] or self._least_forces
        self.restart()

    def change(self, settings: Settings) -> None:
        """Use other limits."""
        self.gate.change_limits(settings)
        self._units.change(settings)

    def restart(self) -> None:
        """Forget everything."""
        self.gate.restart()
        self._units.restart()
        self._value: Floats | None = None
        self._count = self._repeats = 0
        self._driven_run = 0  # repeats in a row under its own thrust
        self._idle_run = self._moved_run = 0  # in a row without it; of these, under other thrust
        self._window = self._window_repeats = 0
        self._is_stuck = False

    def check(self, time: int, value: Floats, forces: Sequence[float]) -> str:
        """
        Judge a measurement.

        Parameters
        ----------
        time : int
            [ns]
        value : tuple of float
            What was measured.
        forces : sequence of float
            The newest commanded force on every DOF of the run [N or N m].

        Returns
        -------
        str
            '' to use it, one of ``RESTARTS`` to go on from it, or why it is refused.

        """
        self._count += 1
        self._window += 1
        if value == self._value:
            if self._repeats_stuck(forces):
                return 'stuck'
            if self._window >= WINDOW:
                self._warn_if_repeated()
        else:
            self._value = value
            self._idle_run = self._moved_run = 0
            if self._driven_run:
                self._repeats += self._driven_run
                self._driven_run = 0
            if self._is_stuck:
                self._is_stuck = False
                self.gate.restart_from(time, value)
                return 'gap'
        reason = self.gate.check(time, value)
        self._units.add_sample(time, value, reason, self.gate.change)
        return reason

    def _repeats_stuck(self, forces: Sequence[float]) -> bool:
        """Note a repeat of the value before, and tell whether the sensor is stuck."""
        if self._is_stuck:
            self._count -= 1  # says nothing of how it normally is
            return True
        if not _is_driven(forces, self._own_least_forces):
            self._repeats += 1
            self._note_idle(forces)
            return False
        self._driven_run += 1
        self._window_repeats += 1
        usual = self._count - self._driven_run
        if (self._driven_run < STUCK_AFTER or usual < KNOWN_AFTER
                or self._repeats > SELDOM * usual):
            return False
        self._count, self._driven_run, self._is_stuck = usual, 0, True
        self._warn(f'{self._input} is stuck: it has repeated the very same value {STUCK_AFTER} '
                   'times under thrust; it is refused until it changes')
        return True

    def _note_idle(self, forces: Sequence[float]) -> None:
        """Warn when a sensor that hardly ever repeats a value does for long."""
        self._idle_run += 1
        if not _is_driven(forces, self._least_forces):
            return
        self._moved_run += 1
        usual = self._count - self._idle_run
        if (self._moved_run == WARN_AFTER and usual >= KNOWN_AFTER
                and self._repeats - self._idle_run <= SELDOM * usual):
            self._warn(f'{self._input} may be stuck: it has repeated the very same value '
                       f'{WARN_AFTER} times while the vehicle was driven, which it hardly ever '
                       'did before')

    def _warn_if_repeated(self) -> None:
        """Warn once when most of the last values were only repeats."""
        if self._window_repeats >= MANY_REPEATS and not self._has_warned:
            self._has_warned = True
            self._warn(f'{self._input} mostly repeats its last value under new stamps: it is '
                       'published more often than it is measured, or in coarse steps')
        self._window = self._window_repeats = 0


def _is_driven(forces: Sequence[float], least: Sequence[tuple[int, float]]) -> bool:
    for i, force in least:
        if abs(forces[i]) > force:
            return True
    return False
