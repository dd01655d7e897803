"""Warn of wrong units, signs and frames that show in the data, each once, and name the key."""

from __future__ import annotations

from collections.abc import Callable
import math
from operator import mul, sub

from rovid_core.model.dofs import Vector
from rovid_core.model.samples import Step
from rovid_core.settings.run import DofSettings, Scales, Settings, ThrusterSettings

NS = 1e-9

WINDOW = 1_000_000_000
"""[ns] Speeds are taken over at least so long, which leaves the noise behind."""

MANY_TOO_FAST = 0.3
"""Share of attitudes that the gate finds too fast, in a window of such."""

WRONG_WINDOWS = 10
"""More of these that were too fast than were not are no accident."""

PULSES = (800.0, 2200.0)
"""[us] What the pulses of a servo or motor controller can be."""

NEUTRAL = 1500.0
"""[us] No thrust, as a pulse."""

COMPARE_AFTER = 600
"""Steps after which force and acceleration are compared, and seconds that they take."""
DURATION = 60.0

CONTRARY, RIGHT = -0.15, 0.1
"""Partial correlation of acceleration and force that is taken for a wrong or a right sign."""

WRONG_IN_A_ROW = 3
"""So many in a row have to be wrong."""

EXCITED = 0.1
"""Force, in typical ones, below which it is no wonder that nothing follows it."""

UNITS = {
    'position': 'position.field takes metres',
    'depth': 'depth.scale turns its unit into metres',
    'attitude': 'attitude.unit may be deg, and a quaternion has to be one',
    'velocity': 'velocity.field takes m/s',
    'angular_velocity': 'angular_velocity.field takes rad/s',
}


class UnitCheck:
    """
    Warn when an input keeps moving faster than the vehicle can.

    Parameters
    ----------
    settings : Settings
        The run.
    input : str
        Name of the input.
    warn : callable
        Called with one line, once.

    """

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
    """
    Warn when thruster commands are pulse widths, and their middle is taken for thrust.

    Parameters
    ----------
    settings : Settings
        The run.
    warn : callable
        Called with one line, once.

    """

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


class SignCheck:
    """
    Warn when a DOF accelerates against its thrust.

    Judged by the partial correlation of acceleration and force at equal velocity, in
    stretches of data one after the other; once it is clearly positive nothing more is.

    Parameters
    ----------
    dof : str
        Its name.
    force : float
        Its typical force [N or N m].
    source : str
        The input that measures its velocity.
    warn : callable
        Called with one line, once.

    """

    def __init__(self, dof: str, force: float, source: str,
                 warn: Callable[[str], None]) -> None:
        self._dof = dof
        self._least = (EXCITED * force) ** 2
        self._source = source
        self._warn = warn
        self._is_active = True
        self._contrary = 0
        self._begin()

    def _begin(self) -> None:
        self._count, self._duration = 0, 0.0
        # means and mean products of acceleration a, force f and velocity v
        self._a = self._f = self._v = 0.0
        self._aa = self._ff = self._vv = self._af = self._av = self._fv = 0.0

    def add_step(self, step: Step) -> None:
        """Add a step."""
        if not self._is_active:
            return
        before, v, after = step.velocity
        f, dt = step.force[1], step.dt
        a = (after - before) / dt
        self._a += a
        self._f += f
        self._v += v
        self._aa += a * a
        self._ff += f * f
        self._vv += v * v
        self._af += a * f
        self._av += a * v
        self._fv += f * v
        self._count += 1
        self._duration += dt
        if self._count >= COMPARE_AFTER and self._duration >= DURATION:
            self._compare()

    def _compare(self) -> None:
        n = self._count
        a, f, v = self._a / n, self._f / n, self._v / n
        aa, ff, vv = self._aa / n - a * a, self._ff / n - f * f, self._vv / n - v * v
        af, av, fv = self._af / n - a * f, self._av / n - a * v, self._fv / n - f * v
        self._begin()
        # what the velocity leaves of each
        rest = (aa * vv - av * av) * (ff * vv - fv * fv)
        if not (ff > self._least and rest > 0.0):
            return
        partial = (af * vv - av * fv) / math.sqrt(rest)
        self._contrary = self._contrary + 1 if partial < CONTRARY else 0
        if partial > RIGHT:
            self._is_active = False
        elif self._contrary == WRONG_IN_A_ROW:
            self._is_active = False
            self._warn_of_sign()

    def _warn_of_sign(self) -> None:
        depth = {'depth': ', or that of depth.scale', 'attitude': ', or, of a heading that is '
                 'a number, see attitude.heading'}.get(self._source, '')
        frames = '' if self._dof in ('surge', 'roll') else (
            '; if it is so of sway, heave and yaw, the messages may be in other axes: frames')
        self._warn(f'{self._dof} accelerates against its thrust: turn the sign of its row of '
                   f'thrusters.allocation{depth}{frames}')


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


class UnsignedCommandCheck:
    """
    Warn when thruster commands have no sign although the vehicle moves both ways.

    Parameters
    ----------
    settings : Settings
        The run.
    warn : callable
        Called with one line, once.

    """

    def __init__(self, settings: Settings, warn: Callable[[str], None]) -> None:
        self._offset = settings.thrusters.offset
        self._slow = [
            -0.2 * (settings.dof[d].typical_velocity or 0.5) for d in settings.dofs]
        self._warn = warn
        self._backwards = self._forwards = 0
        # a curve may have its zero anywhere
        self._is_active = settings.thrusters.model in ('linear', 'quadratic')

    def add_commands(self, values: tuple[float, ...]) -> None:
        """Add raw commands."""
        if self._is_active and min(values, default=0.0) < self._offset:
            self._is_active = False

    def add_velocity(self, i: int, velocity: float) -> None:
        """Add the velocity of DOF number ``i``."""
        if not self._is_active:
            return
        self._backwards += velocity < self._slow[i]
        self._forwards += velocity > -self._slow[i]
        if min(self._backwards, self._forwards) >= ENOUGH:
            self._is_active = False
            self._warn('no thruster command was ever negative while the vehicle went '
                       'backwards: if they are magnitudes, give their direction with '
                       'thrusters.sign')


class TwoSendersCheck:
    """
    Warn when thruster commands jump to and fro, as those of two programs on one topic do.

    Parameters
    ----------
    warn : callable
        Called with one line, once.

    """

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


class TypicalSizeCheck:
    """
    Warn when a DOF's force or velocity is far from the typical one.

    What counts as thrust, as rest and as enough data is measured in typical sizes, whatever
    the method; ``aid`` takes its gains from the data.

    Parameters
    ----------
    dof : str
        Its name.
    settings : DofSettings
        Its typical or initial values.
    warn : callable
        Called with one line, once.

    """

    def __init__(self, dof: str, settings: DofSettings, warn: Callable[[str], None]) -> None:
        self._dof = dof
        self._scales = Scales.of(settings)
        self._warn = warn
        self._steps = 0
        self._squares = [0.0, 0.0]

    def add_step(self, step: Step) -> None:
        """Add a step."""
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
