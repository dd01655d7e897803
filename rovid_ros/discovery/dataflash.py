"""What could be which input in a dataflash log, whose types of records are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import re
from typing import Any

import numpy as np
from rovid_ros.discovery.candidates import Candidate
from rovid_ros.discovery.signals import Signal
from rovid_ros.messages.field_paths import field_names

_FIELDS = {
    'ATT': ('Roll', 'Pitch', 'Yaw'), 'CTUN': ('BAlt',), 'BARO': ('Alt',),
    'VISO': ('VelX', 'VelY', 'VelZ'), 'GPS': ('North', 'East', 'Down'), 'BAT': ('Volt',)}
_OUTPUT = re.compile(r'C\d{1,2}')
_INPUTS = {'ATT': 'attitude', 'CTUN': 'depth', 'BARO': 'depth', 'VISO': 'velocity',
           'GPS': 'position', 'RCOU': 'thrusters'}
_KEYS: dict[str, dict[str, Any]] = {
    'attitude': {'unit': 'deg'}, 'thrusters': {'pwm': True}}
# A barometer of the hull moves too, but less than one in the water.
_AS_DEEP = 0.8


def paths(topic: str, blank: Any) -> tuple[str, ...]:
    """Return the field paths that could be an input, given a blank message of a topic."""
    there = field_names(blank)
    kind = re.sub(r'_\d+$', '', topic.lstrip('/'))
    fields = [name for name in there if _OUTPUT.fullmatch(name)] if kind == 'RCOU' else list(
        _FIELDS.get(kind, ()))
    return (', '.join(fields),) if fields and {*fields} <= {*there} else ()


def remarks(signals: Sequence[Signal], found: Mapping[str, object]) -> list[str]:
    """Return what the log lacks and what it says besides, a line each."""
    said = []
    if not {'velocity', 'position'} & found.keys():
        said.append('surge and sway: no DVL (VISO), underwater GPS or GPS is in the log; heave '
                    'and yaw are in every one')
    volts = [float(np.mean(one.values)) for one in signals if one.topic == '/BAT']
    if volts:
        said.append(f'what the voltage does to the thrust: the battery had {volts[0]:.1f} V')
    return said


def dataflash_candidates(signals: Sequence[Signal]) -> dict[str, list[Candidate]]:
    """Return what could be each input, the likeliest first."""
    found: dict[str, list[Candidate]] = {}
    for signal in signals:
        kind = signal.type.rpartition('/')[2]
        name = _INPUTS.get(kind, '')
        if not name or np.max(signal.spread) < 1e-3:
            continue
        points = float(np.ptp(signal.values[:, 0])) if name == 'depth' else 0.0
        if kind == 'CTUN':
            points /= _AS_DEEP
        found.setdefault(name, []).append(Candidate(signal, points, _KEYS.get(name, {})))
    for judged in found.values():
        judged.sort(key=lambda one: -one.points)
    return found
