"""What has happened to inputs and degrees of freedom since one looked last, a line each."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from rovid_core.identify.estimate import DofEstimate
from rovid_core.model.plant import physical
from rovid_ros.node.health.levels import dof_level, HealthData, input_level, last_estimate
from rovid_ros.results.outputs import STALE
from rovid_ros.results.text import number, percent, unit

REPEAT = 10.0  # [s] What happens to one of them again sooner, is not told
CHANGED = 'the vehicle changed'  # how a method's note about that begins


class Line(NamedTuple):
    """A line for the console."""

    text: str
    is_warning: bool


@dataclass
class _Seen:
    """How an input or DOF was when one looked last."""

    good: bool = True
    since: float = math.nan  # when it became not good
    changed: bool = False
    told: float = -math.inf  # when its last line was told that it is not good
    silenced: bool = False  # whether that is not told yet


class Events:
    """
    Tells of each change once; what comes and goes all the time is told once per ``REPEAT``.

    An input is silent or back. A DOF is valid, is so no more, or its vehicle has changed. What
    went too soon after the last time and stays away is told when that time has passed.
    """

    def __init__(self) -> None:
        self._inputs: dict[str, _Seen] = {}
        self._dofs: dict[str, _Seen] = {}

    def lines(self, data: HealthData) -> list[Line]:
        """Return what has changed, the inputs first: they are the cause."""
        found = [line for name in data.settings.used_inputs()
                 for line in self._of_input(data, name)]
        return found + [line for dof in data.settings.dofs for line in self._of_dof(data, dof)]

    def _of_input(self, data: HealthData, name: str) -> list[Line]:
        level, message = input_level(data, name)
        seen = self._inputs.setdefault(name, _Seen())
        if level == STALE:
            return _gone(seen, data.steady, f'{name}: {message}')
        if not seen.good:
            return _back(seen, data.steady,
                         f'{name}: back after {data.steady - seen.since:.0f} s')
        return []

    def _of_dof(self, data: HealthData, name: str) -> list[Line]:
        dof = last_estimate(data.stream, name)
        if dof is None:
            return []
        seen = self._dofs.setdefault(name, _Seen(good=False))
        found = []
        changed = any(CHANGED in reason for reason in dof.judgement.reasons)
        if changed and not seen.changed:
            found.append(Line(f'{name}: {dof.judgement.reasons[0]}', True))
        seen.changed = changed
        level, message = dof_level(data, name)
        valid = dof.valid and level != STALE
        if valid and not seen.good:
            found += _back(seen, data.steady, f'{name}: valid, {model_text(dof)}')
        elif not valid:
            found += _gone(seen, data.steady, f'{name}: no longer valid: {message}')
        return found


def _gone(seen: _Seen, now: float, text: str) -> list[Line]:
    if seen.good:
        seen.good, seen.since, seen.silenced = False, now, True
    if not seen.silenced or now - seen.told < REPEAT:
        return []
    seen.told, seen.silenced = now, False
    return [Line(text, True)]


def _back(seen: _Seen, now: float, text: str) -> list[Line]:
    seen.good = True
    return [] if seen.silenced else [Line(text, False)]


def model_text(dof: DofEstimate) -> str:
    """Return mass and fit in a few words."""
    mass, std = physical(dof.parameters)[0], dof.physical_std[0]
    known = f' ± {number(std)}' if math.isfinite(std) else ''
    fit = f', fit {percent(dof.fit)}' if math.isfinite(dof.fit) else ''
    return f'mass {number(mass)}{known} {unit(dof.dof, "mass")}{fit}'


def result_text(data: HealthData) -> str:
    """Return what was found of all DOFs in one line, '' if there was no step."""
    dofs = [dof for name in data.settings.dofs if (dof := last_estimate(data.stream, name))]
    return '; '.join(f'{dof.dof} {dof.judgement.status} after {dof.steps:,} steps, '
                     f'{model_text(dof)}' for dof in dofs)
