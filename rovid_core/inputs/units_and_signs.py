"""
Warn of wrong units, signs and frames that show in the data, and name the key.

Each check calls ``warn`` with one line, once.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from operator import lt, mul, sub
from typing import Final

from rovid_core.model.dofs import DOFS, Vector
from rovid_core.model.samples import NS, Step
from rovid_core.settings.run import DofSettings, Scales, Settings, ThrusterSettings

WINDOW: Final = 1_000_000_000
"""[ns] Speeds are taken over at least so long, which leaves the noise behind."""

MANY_TOO_FAST: Final = 0.3
"""Share of attitudes that the gate finds too fast, in a window of such."""

WRONG_WINDOWS: Final = 10
"""More of these that were too fast than were not are no accident."""

PULSES = (800.0, 2200.0)
"""[us] What the pulses of a servo or motor controller can be."""

NEUTRAL: Final = 1500.0
"""[us] No thrust, as a pulse."""

COMPARE_AFTER: Final = 600
"""Commands after which they are taken for what they look like."""

UNITS = {
    'position': 'position.field takes metres',
    'depth': 'depth.scale turns its unit into metres',
    'attitude': 'attitude.unit may be deg, and a quaternion has to be one',
    'velocity': 'velocity.field takes m/s',
    'angular_velocity': 'angular_velocity.field takes rad/s',
}


class UnitCheck:
    """Warn when an input keeps moving faster than the vehicle can."""

    def __init__(self, settings: Settings, input: str, warn: Callable[[str], None]) -> None:
        self._input = input
        self._is_rate = input in ('velocity', 'angular_velocity')
        self._axes = 2 if input == 'position' and settings.depth.topic else 3
        self.change(settings)
        self._warn = warn
        self._score = 0
        self._is_active = True
        self._mean = 0.0  # speed where it was too fast
        self.restart()

    def change(self, settings: Settings) -> None:
        """Use another ``velocity.max``."""
        self._max_speed = settings.max_speed

    def restart(self) -> None:
        """Forget where the window began."""
        self._begin: tuple[int, tuple[float, ...]] | None = None
        self._turned = 0.0
        self._seen = self._too_fast = 0

    def add_sample(self, time: int, value: tuple[float, ...], reason: str,
             change: Vector | None) -> None:
        """
        Add a measurement.

        Parameters
        ----------
        time : int
            [ns]
        value : tuple of float
            What was measured.
        reason : str
            Why the gate refuses it, or ''.
        change : Vector, optional
            Since the last good one; an attitude is followed by it, for it goes round.

        """
        if not self._is_active:
            return
        self._seen += 1
        self._too_fast += reason == 'too_fast'
        if not reason and change is not None:
            self._turned += change[2]
        if self._begin is None:
            self._begin = time, value
        elif time - self._begin[0] >= WINDOW:
            self._end(time, value)

    def _end(self, time: int, value: tuple[float, ...]) -> None:
        assert self._begin is not None
        dt, before = (time - self._begin[0]) * NS, self._begin[1]
        if self._is_rate:
            speed = math.hypot(*value)
        elif self._input == 'attitude':
            # turns beyond half a turn look like smaller ones, here and there
            speed = abs(self._turned) / dt if self._too_fast < MANY_TOO_FAST * self._seen else (
                2.0 * self._max_speed)
        else:
            speed = math.dist(value[:self._axes], before[:self._axes]) / dt
        self.restart()
        self._begin = time, value
        if not speed > self._max_speed:
            self._score = max(0, self._score - 1)
        elif speed < math.inf:
            self._score += 1
            self._mean += (speed - self._mean) / self._score
        if self._score == WRONG_WINDOWS:
            self._is_active = False
            unit = 'rad/s' if self._input == 'angular_velocity' else 'm/s'
            # how fast an attitude turns cannot be told when it is too fast
            about = '' if self._input == 'attitude' else f' at about {self._mean:.0f} {unit},'
            self._warn(f'{self._input} moves{about} again and again faster than velocity.max: '
                       f'{UNITS[self._input]}')


def look_like_pulse_widths(thrusters: ThrusterSettings, low: float, high: float) -> bool:
    """
    Tell whether commands are pulse widths [us] whose middle the settings take for thrust.

    Parameters
    ----------
    thrusters : ThrusterSettings
        With an offset, a polynomial or a table the middle is no thrust.
    low, high : float
        The smallest and the largest command as it came.

    """
    return (thrusters.offset == 0.0 and thrusters.model in ('linear', 'quadratic')
            and PULSES[0] <= low <= NEUTRAL <= high <= PULSES[1])


class PulseWidthCheck:
    """Warn when thruster commands are pulse widths, and their middle is taken for thrust."""

    def __init__(self, settings: Settings, warn: Callable[[str], None]) -> None:
        self._thrusters = settings.thrusters
        # with an offset, a polynomial or a table no commands look so
        self._is_active = look_like_pulse_widths(settings.thrusters, NEUTRAL, NEUTRAL)
        self._warn = warn
        self._low, self._high = math.inf, -math.inf
        self._count = 0

    def add_commands(self, values: tuple[float, ...]) -> None:
        """Add raw commands."""
        if not self._is_active:
            return
        self._low, self._high = min(self._low, *values), max(self._high, *values)
        self._count += 1
        if not PULSES[0] <= self._low <= self._high <= PULSES[1]:
            self._is_active = False
        elif self._count >= COMPARE_AFTER and look_like_pulse_widths(
                self._thrusters, self._low, self._high):
            self._is_active = False
            self._warn(f'the thruster commands lie between {self._low:g} and {self._high:g}, as '
                       'pulse widths do: set thrusters.offset to what gives no thrust, such as '
                       f'{NEUTRAL:g}')


ENOUGH: Final = 600
"""Steps each way after which commands should have been negative once."""

LONG, SHORT = 300.0, 20.0
"""[s] of steps after which sizes are compared with the typical ones, and of a log that ends."""

FAR_OFF: Final = 3.0
"""Factor by which typical sizes may be off."""

TO_AND_FRO: Final = 30
"""Commands in a row, each of which takes back the one before: noise does not do that."""

BACK: Final = 0.8
"""Share of a change that the next one takes back at least."""


class UnsignedCommandCheck:
    """
    Warn when thruster commands have no sign although the vehicle moves both ways.

    What thrusters push both ways without a sign, as a boat's two turn it, says nothing, nor does
    what none of them pushes.

    Attributes
    ----------
    active : bool
        Whether more data are wanted.

    """

    def __init__(self, settings: Settings, warn: Callable[[str], None]) -> None:
        self._offset = settings.thrusters.offset
        self._slow = [
            -0.2 * (settings.dof[d].typical_velocity or 0.5) for d in settings.dofs]
        self._warn = warn
        thrusters, rows = settings.thrusters, [DOFS.index(d) for d in settings.dofs]
        self._one_way = [any(map(mul, thrusters.allocation[row], thrusters.gain))
                         and not thrusters.pushes_both_ways(row) for row in rows]
        self._backwards, self._forwards = [[0] * len(settings.dofs) for _ in range(2)]
        # a curve may have its zero anywhere
        self.active = settings.thrusters.model in ('linear', 'quadratic')

    def add_commands(self, values: tuple[float, ...]) -> None:
        """Add raw commands."""
        if self.active and min(values, default=0.0) < self._offset:
            self.active = False

    def add_velocity(self, i: int, velocity: float) -> None:
        """Add the velocity of DOF number ``i``."""
        if not self._one_way[i]:
            return
        self._backwards[i] += velocity < self._slow[i]
        self._forwards[i] += velocity > -self._slow[i]
        if min(self._backwards[i], self._forwards[i]) >= ENOUGH:
            self.active = False
            self._warn('no thruster command was ever negative while the vehicle went '
                       'backwards: if they are magnitudes, give their direction with '
                       'thrusters.sign')


class TwoSendersCheck:
    """Warn when thruster commands jump to and fro, as those of two programs on one topic do."""

    def __init__(self, warn: Callable[[str], None]) -> None:
        self._warn = warn
        self._is_active = True
        self._last: dict[int, tuple[float, ...]] = {}  # by part
        self._change: dict[int, list[float]] = {}
        self._count: dict[int, int] = {}

    def add_commands(self, values: tuple[float, ...], part: int) -> None:
        """Add raw commands of one topic."""
        if not self._is_active:
            return
        change = list(map(sub, values, self._last.get(part, values)))
        before = self._change.get(part, change)
        taken_back = -sum(map(mul, change, before))
        square = max(sum(map(mul, change, change)), sum(map(mul, before, before)))
        count = self._count.get(part, 0) + 1 if taken_back > BACK * square else 0
        self._last[part], self._change[part], self._count[part] = values, change, count
        if count == TO_AND_FRO:
            self._is_active = False
            self._warn('the thruster commands jump to and fro from each message to the next: do '
                       'two programs publish them?')


class NeutralCheck:
    """
    Warn when all thrusters rest at a command that the settings take for thrust.

    Three thrusters or more that push different ways have exactly one command at the same time
    where nothing is asked of them. ``curve`` returns the force of a thruster before its gain, of
    a raw command.
    """

    def __init__(self, thrusters: ThrusterSettings, curve: Callable[[float], float],
                 warn: Callable[[str], None]) -> None:
        self._offset = thrusters.offset
        self._curve = curve
        columns = {column for column in zip(*thrusters.allocation) if any(column)}
        self._is_active = thrusters.count > 2 and len(columns) > 1 and len(thrusters.topics) == 1
        self._warn = warn
        self._rests: dict[float, int] = {}
        self._neutral = 0

    def add_commands(self, values: tuple[float, ...]) -> None:
        """Add raw commands of all thrusters."""
        if not self._is_active or values.count(values[0]) < len(values):
            return
        rest = values[0]
        if self._curve(rest) == 0.0:
            self._neutral += 1
            return
        count = self._rests[rest] = self._rests.get(rest, 0) + 1
        if len(self._rests) > MOST_RESTS:
            self._is_active = False
        elif count == RESTING and not self._neutral:
            self._is_active = False
            self._warn(f'thrusters.offset is {self._offset:g}, and all thrusters rest at '
                       f'{rest:g}, never at {self._offset:g}: set it to what gives no thrust')


RESTING: Final = 30
"""Messages with one command for all thrusters after which that is taken for their rest."""

MOST_RESTS: Final = 30
"""Different commands for all thrusters, after which none is taken for their rest."""


ROUNDING: Final = 1e-9
"""Of a typical size, up to which a force or a velocity is none."""

STRETCH: Final = 2.0
"""[s] of which sizes are added up; twice as long where there would be more than the most."""

MOST_STRETCHES: Final = 1000

SELDOM: Final = 0.01
"""Share of these, the largest ones, that does not count."""


class TypicalSizeCheck:
    """
    Compare a DOF's force and velocity with the typical ones.

    What counts as thrust, as rest and as enough data is measured in typical sizes, whatever
    the method; ``aid`` takes its gains from the data. The size of what comes and goes is
    sqrt(mean x^4 / mean x^2): time in which nothing moves does not count. Nor do the few
    stretches of a long log in which it is largest, for a few odd measurements would decide.

    Parameters
    ----------
    dof : str
        Its name.
    settings : DofSettings
        Its typical or initial values.
    fastest : float
        [m/s or rad/s] Beyond that it does not move; what seems to is told elsewhere.

    Attributes
    ----------
    duration : float
        Of the steps so far [s].

    """

    def __init__(self, dof: str, settings: DofSettings, fastest: float) -> None:
        self._dof, self._fastest = dof, fastest
        self._scales = Scales.of(settings)
        self.duration = 0.0
        self._sums = [0.0] * 5  # of the time, and of squares and fourth powers of both
        self._stretches: list[list[float]] = []  # the same of those that are over
        self._longest = STRETCH

    def add_step(self, step: Step) -> None:
        """Add a step."""
        dt, force, velocity = step.dt, step.force[1], step.velocity[1]
        self.duration += dt
        sums = self._sums
        sums[0] += dt
        square = force * force
        sums[1] += square * dt
        sums[2] += square * square * dt
        square = velocity * velocity
        sums[3] += square * dt
        sums[4] += square * square * dt
        if sums[0] > self._longest:
            self._end_stretch()

    def _end_stretch(self) -> None:
        stretches = self._stretches
        stretches.append(self._sums)
        self._sums = [0.0] * 5
        if len(stretches) == MOST_STRETCHES:
            self._longest *= 2.0
            self._stretches = [[x + y for x, y in zip(one, other)]
                               for one, other in zip(stretches[::2], stretches[1::2])]

    def advice(self, is_long: bool) -> list[str]:
        """
        Return the keys that are far off, each with what it could be.

        Where little pushes and moves a DOF in a short log, it may not have been driven yet.
        """
        sizes = [self._size(1), self._size(3)]
        if not all(sizes):
            return []
        typical = self._scales.force, self._scales.velocity
        if not is_long and all(map(lt, sizes, typical)):
            return []
        if sizes[1] > self._fastest or any(
                size < ROUNDING * used for size, used in zip(sizes, typical)):
            return []  # as of an allocation that was computed and asks nothing of the DOF
        return [f'{self._dof}.typical.{name} {size:.2g} instead of {used:.2g}'
                for name, size, used in zip(('force', 'velocity'), sizes, typical)
                if not used / FAR_OFF <= size <= used * FAR_OFF]

    def _size(self, of: int) -> float:
        """Return the amplitude of a sinusoid as large as what comes and goes."""
        ordered = sorted([*self._stretches, self._sums], key=lambda sums: sums[of + 1])
        usual = ordered[:len(ordered) - int(SELDOM * len(ordered))]
        squares, fourths = [math.fsum([sums[k] for sums in usual]) for k in (of, of + 1)]
        return math.sqrt(4.0 / 3.0 * fourths / squares) if squares else 0.0
