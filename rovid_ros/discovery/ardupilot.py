"""
What an ArduPilot says of its vehicle: the records of its logs, and its own parameters.

The types of the records in a dataflash log are known, and so which could be which input. ArduSub's
parameters say what frame the vehicle has, which motors and on which outputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import re
from typing import Any

import numpy as np
from rovid_core.model.dofs import DOFS
from rovid_ros.discovery.candidates import Candidate
from rovid_ros.discovery.signals import Signal
from rovid_ros.messages.field_paths import field_names

Factors = tuple[float, ...]

# How each motor turns and pushes the vehicle: roll, pitch, yaw, throttle, forward, lateral, in
# forward-right-down but for the throttle, which is up. From ArduPilot's AP_Motors6DOF.
_VECTORED: tuple[Factors, ...] = (
    (0, 0, 1, 0, -1, 1), (0, 0, -1, 0, -1, -1), (0, 0, -1, 0, 1, 1), (0, 0, 1, 0, 1, -1))
_SIMPLE: tuple[Factors, ...] = (
    (0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 1, 0), (0, 0, 0, -1, 0, 0), (0, 0, 0, -1, 0, 0),
    (0, 0, 0, 0, 0, 1))

_FIELDS = {
    'ATT': ('Roll', 'Pitch', 'Yaw'), 'CTUN': ('BAlt',), 'BARO': ('Alt',),
    'VISO': ('VelX', 'VelY', 'VelZ'), 'VISP': ('PX', 'PY', 'PZ'),
    'GPS': ('North', 'East', 'Down'), 'BAT': ('Volt',)}
_OUTPUT = re.compile(r'C\d{1,2}')
_INPUTS = {'ATT': 'attitude', 'CTUN': 'depth', 'BARO': 'depth', 'VISO': 'velocity',
           'VISP': 'position', 'GPS': 'position', 'RCOU': 'thrusters'}
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
        said.append('surge and sway: no DVL (VISO), external position (VISP) or GPS is in the '
                    'log; heave and yaw are in every one')
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
        points = float(np.ptp(signal.values[:, 0])) if name == 'depth' else float(kind == 'VISP')
        if kind == 'CTUN':
            points /= _AS_DEEP
        found.setdefault(name, []).append(Candidate(signal, points, _KEYS.get(name, {})))
    for judged in found.values():
        judged.sort(key=lambda one: -one.points)
    return found


@dataclass(frozen=True)
class Frame:
    """A frame of ArduSub."""

    number: int  # FRAME_CONFIG
    name: str
    factors: tuple[Factors, ...]  # of each motor
    # levers [m] of a motor that turns the vehicle in roll, pitch and yaw
    levers: tuple[float, float, float]
    vehicle: str = ''  # whose levers they are; '' if they are a guess


FRAMES = {frame.number: frame for frame in (
    Frame(0, 'BlueROV1', (
        (0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 1, 0), (-0.5, 0.5, 0, 0.45, 0, 0),
        (0.5, 0.5, 0, 0.45, 0, 0), (0, -1, 0, 1, 0, 0), (-0.25, 0, 0, 0, 0, 1)),
        (0.2, 0.2, 0.1)),
    # J. Mar. Sci. Eng. 10(12), 2022, 1898 has the Heavy; its level motors are those of both
    Frame(1, 'vectored', (*_VECTORED, (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0)),
          (0.11, 0.0, 0.1888), 'a BlueROV2'),
    Frame(2, 'vectored_6dof', (
        *_VECTORED, (1, -1, 0, -1, 0, 0), (-1, -1, 0, -1, 0, 0), (1, 1, 0, -1, 0, 0),
        (-1, 1, 0, -1, 0, 0)), (0.218, 0.12, 0.1888), 'a BlueROV2 Heavy'),
    Frame(3, 'vectored_6dof_90deg', (
        (1, 1, 0, 1, 0, 0), (0, 0, 1, 0, 1, 0), (1, -1, 0, 1, 0, 0), (0, 0, 0, 0, 0, 1),
        (0, 0, 0, 0, 0, 1), (-1, 1, 0, 1, 0, 0), (0, 0, -1, 0, 1, 0), (-1, -1, 0, 1, 0, 0)),
        (0.2, 0.2, 0.2)),
    Frame(4, 'simplerov_3', _SIMPLE[:3], (0.2, 0.2, 0.2)),
    Frame(5, 'simplerov_4', _SIMPLE[:4], (0.2, 0.2, 0.2)),
    Frame(6, 'simplerov_5', _SIMPLE, (0.2, 0.2, 0.2)))}

_FIRST_MOTOR = 33  # SERVOn_FUNCTION of motor 1
_OUTPUTS = 32


def allocation(frame: Frame) -> dict[str, tuple[float, ...]]:
    """
    Return the rows of the allocation of a frame, by DOF, in forward-left-up.

    A factor says which way; the force is a unit vector. A motor that pushes in two directions
    stands at an angle between them.
    """
    rows: dict[str, list[float]] = {dof: [] for dof in DOFS}
    for roll, pitch, yaw, up, forward, right in frame.factors:
        length = (forward * forward + right * right + up * up) ** 0.5 or 1.0
        signs = [(value > 0) - (value < 0) for value in (roll, pitch, yaw)]
        levers = [sign * lever for sign, lever in zip(signs, frame.levers)]
        for dof, value in zip(DOFS, (forward / length, -right / length, up / length,
                                     levers[0], -levers[1], -levers[2])):
            rows[dof].append(round(value, 4) + 0.0)
    return {dof: tuple(row) for dof, row in rows.items()}


@dataclass(frozen=True)
class Motors:
    """The motors of a vehicle, in their order."""

    frame: Frame
    outputs: tuple[int, ...]  # of the servo outputs, from 1
    directions: tuple[float, ...]  # 1, or -1 where the pulses are reversed


def motors(parameters: Mapping[str, str]) -> Motors | None:
    """Return the motors that the parameters tell of; None if they do not, or of no known frame."""
    def number(name: str, default: float) -> float:
        return float(parameters.get(name, default))

    frame = FRAMES.get(round(number('FRAME_CONFIG', -1.0)))
    if frame is None:
        return None
    count = len(frame.factors)
    by_motor = {round(number(f'SERVO{n}_FUNCTION', 0.0)) - _FIRST_MOTOR: n
                for n in range(_OUTPUTS, 0, -1)}
    return Motors(
        frame, tuple(by_motor.get(k, k + 1) for k in range(count)),
        tuple(-1.0 if number(f'MOT_{k + 1}_DIRECTION', 1.0) < 0.0 else 1.0 for k in range(count)))
