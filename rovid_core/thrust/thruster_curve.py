"""From raw thruster commands to the force on the body at one moment, without delay and lag."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
import math

from rovid_core.model.dofs import DOFS
from rovid_core.model.thrusters import DEAD_BAND
from rovid_core.settings.run import ThrusterSettings

NO_COMMAND = 2.0
"""What is beyond the limit by this factor is no command, such as 0 in place of PWM."""


def thruster_model(settings: ThrusterSettings) -> Callable[[float], float]:
    """
    Return the force of one thruster before its gain, as a function of the raw command.

    Offset, scale, limit, deadband, dead zone, curve and reverse: linear ``u``, quadratic ``u|u|``,
    polynomial ``c0 + c1 u + ...`` or a table interpolated linearly and held beyond its ends.
    Beyond the limit the command is the limit. Inside the deadband it is 0, outside it stays as it
    is; of the dead zone the command loses the size, so that it begins at 0 there.
    """
    curves: dict[str, Callable[[float], float]] = {
        'linear': lambda u: u,
        'quadratic': lambda u: u * abs(u),
        'polynomial': lambda u: _polynomial(settings.polynomial, u),
        'table': lambda u: _interpolate(settings.table_command, settings.table_force, u),
    }
    curve = curves[settings.model]
    offset, scale, deadband = settings.offset, settings.scale, settings.deadband
    dead_zone = settings.dead_zone
    limit, reverse = settings.limit or math.inf, settings.reverse

    def force(raw: float) -> float:
        command = (raw - offset) * scale
        if abs(command) > limit:
            command = math.copysign(limit, command)
        if abs(command) <= deadband:
            command = 0.0
        if dead_zone:
            command = math.copysign(max(abs(command) - dead_zone, 0.0), command)
        return curve(command) * (reverse if command < 0.0 else 1.0)

    return force


def thruster_models(settings: ThrusterSettings) -> list[Callable[[float], float]]:
    """
    Return the force of each thruster with its gain, as a function of the raw command.

    A gain below 0 is that of a motor that turns the other way. It mirrors the command, so that
    the curve, and what is weaker backwards, is that of the propeller.
    """
    model, twice = thruster_model(settings), 2.0 * settings.offset

    def of_motor(gain: float) -> Callable[[float], float]:
        if gain < 0.0:
            return lambda raw: -gain * model(twice - raw)
        return lambda raw: gain * model(raw)

    return [of_motor(gain) for gain in settings.gain]


def _polynomial(coefficients: Sequence[float], u: float) -> float:
    total = 0.0
    for c in reversed(coefficients):
        total = total * u + c
    return total


def _interpolate(xs: Sequence[float], ys: Sequence[float], x: float) -> float:
    if x <= xs[0]:
        return ys[0]
    if x >= xs[-1]:
        return ys[-1]
    i = bisect_right(xs, x) - 1
    return ys[i] + (ys[i + 1] - ys[i]) * (x - xs[i]) / (xs[i + 1] - xs[i])


def wrench_model(settings: ThrusterSettings, dofs: Sequence[str],
                 units: Mapping[str, float] | None = None
                 ) -> Callable[[Sequence[float]], tuple[float, ...]]:
    """
    Return the body force of raw commands, without delay and lag, as a function.

    Parameters
    ----------
    settings : ThrusterSettings
        The chain; its allocation has 6 rows (surge to yaw) and n columns.
    dofs : sequence of str
        The rows that are wanted.
    units : mapping of str to float, optional
        Typical forces of DOFs of which what each thruster does is wanted, too.

    Returns
    -------
    callable
        From n raw commands, such as currents [A], to the forces [N] and moments [N m] in the
        body frame, one per DOF, and behind them ``EACH`` of the DOFs with units, as shares of
        these: what the thrusters that run backwards give, what a dead band as wide as
        ``DEAD_BAND`` takes, and the root of the force, by which it falls with speed.

    """
    models = thruster_models(settings)
    rows = [settings.allocation[DOFS.index(d)] for d in dofs]
    each = []
    for dof, unit in (units or {}).items():
        row = settings.allocation[DOFS.index(dof)]
        each.append((row, unit, unit / math.fsum(map(abs, row)), math.fsum([a * a for a in row])))

    def wrench_of(commands: Sequence[float]) -> tuple[float, ...]:
        forces = [model(u) for model, u in zip(models, commands)]
        wrench = []
        for row in rows:
            # sum() rounds differently from Python 3.12 on; a log has to give the same bits on all
            total = 0.0
            for a, f in zip(row, forces):
                total += a * f
            wrench.append(total)
        for row, unit, one, squares in each:
            backwards = cut = root = 0.0
            for a, f in zip(row, forces):
                if f < 0.0:
                    backwards += a * f
                cut += a * max(-DEAD_BAND * one, min(f, DEAD_BAND * one))
                root += a * a * math.sqrt(abs(f) / one)
            wrench += [backwards / unit, cut / unit, root / squares]
        return tuple(wrench)

    return wrench_of


def wrench(settings: ThrusterSettings, commands: Sequence[float],
           dofs: Sequence[str] = DOFS) -> tuple[float, ...]:
    """Return the body force of raw commands; see ``wrench_model``."""
    return wrench_model(settings, dofs)(commands)


def are_commands(settings: ThrusterSettings, raw: Sequence[float], part: int = 0) -> bool:
    """
    Tell whether raw values can be commands: none is far beyond the limit.

    A thruster with no gain is not asked.

    Parameters
    ----------
    settings : ThrusterSettings
        The chain; without a limit every value can be one.
    raw : sequence of float
        One value per thruster, or the one value of thruster ``part``.
    part : int
        Index of the topic among ``thrusters.topics``.

    """
    if settings.limit == 0.0:
        return True
    gains = settings.gain[part:] if len(settings.topics) > 1 else settings.gain
    most = NO_COMMAND * settings.limit
    return all(abs((u - settings.offset) * settings.scale) <= most
               for u, k in zip(raw, gains) if k)
