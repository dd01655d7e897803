"""Which signal could be which input, the likeliest first: by type, name, unit and range."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
import math
import os
import re
from typing import Any

import numpy as np
from rovid_ros.discovery.signals import Array, part, Signal, together

PWM = (1000.0, 2000.0)  # [us] servo pulses, and what a controller makes of them
NEUTRAL = 1500.0  # [us]
_PASCAL = 1.0 / (1000.0 * 9.80665)  # [m/Pa] of fresh water
_ATMOSPHERE = 101325.0  # [Pa]
_THRUSTER = {'thruster', 'thrusters', 'thrust', 'thrusts', 'motor', 'motors', 'prop', 'propeller',
             'propellers', 'rpm'}
_SIDES = {'left', 'right', 'port', 'starboard', 'front', 'rear', 'fore', 'aft', 'bow', 'stern',
          'center', 'middle', 'lateral', 'vertical', 'horizontal'}
_MEASURED = {'temperature', 'temp', 'voltage', 'vel', 'velocity', 'pos', 'position', 'angle',
             'timestamp'}
FAST = 10.0
"""[m/s] Faster than underwater vehicles are."""

_LAGGING = {'filtered', 'filter', 'ekf', 'ukf', 'fused', 'smoothed'}  # behind what they are of
_UNITS = {'mm': 1e-3, 'cm': 1e-2, 'dm': 0.1}
_GRAVITY = (8.8, 10.8)  # [m/s^2] length of what an accelerometer sees on average
_PLACES = ('position', 'point', 'translation')
_CHANGES = ('linear', 'angular', 'velocity')
_FASTEST = 20.0  # [m/s]
_FASTEST_DIVE = 2.0  # [m/s] half of the time; what scatters by a few Pa seems faster in hPa
_ARRAYS = {*[(name, 3) for name in (*_PLACES, 'velocity', 'angular_velocity')], ('q', 4),
           ('quaternion', 4), ('orientation', 4)}
_DEPTH = {'depth', 'pressure', 'altitude', 'baro', 'ctun'}
# What is asked for, and not what is.
_ASKED = {'goal', 'target', 'setpoint', 'desired', 'waypoint', 'ref', 'error', 'trajectory'}
# And what a controller makes of it.
_MADE = {'cmd', 'command', 'commanded', 'controller', 'gain', 'gains', 'sigma'}


@dataclass(frozen=True)
class Candidate:
    """A signal as an input: how likely it is, and what keys its input needs beside the topic."""

    signal: Signal
    points: float
    keys: dict[str, Any] = field(default_factory=dict)


def candidates(signals: Sequence[Signal]) -> dict[str, list[Candidate]]:
    """Return what could be each input, the likeliest first; inputs without any are left out."""
    signals = [*[_depth_of_point(signal) or _named_array(signal) or signal for signal in signals],
               *_inertial_parts(signals), *_one_topic_each(signals), *_planar(signals)]
    measured = [signal for signal in signals if not signal.words & (_ASKED | _MADE)]
    found: dict[str, list[Candidate]] = {}
    for name, judge in _JUDGES.items():
        judged = [one for signal in (signals if name == 'thrusters' else measured)
                  for one in judge(signal)]
        judged.sort(key=lambda one: -one.points)
        if judged:
            found[name] = judged
    return found


def of_one_vehicle(found: dict[str, list[Candidate]]) -> tuple[dict[str, list[Candidate]], str]:
    """
    Return what could be each input without what another vehicle measures, and which that is.

    A namespace with commands and something that moves is a vehicle. Where there are several, that
    of the likeliest commands is taken, and of the others only what it does not measure itself:
    the name of a driver is such a namespace, too.
    """
    parts = {id(one): (one.signal.topics or (one.signal.topic,))[0].strip('/').split('/')
             for judged in found.values() for one in judged}
    shared = len(os.path.commonprefix([*parts.values()]))

    def vehicle(one: Candidate) -> str:
        return '/'.join(parts[id(one)][:shared + 1]) if len(parts[id(one)]) > shared + 1 else ''
    moving = {vehicle(one) for name in found if name != 'thrusters' for one in found[name]}
    vehicles = [name for name in map(vehicle, found.get('thrusters', ()))
                if name and name in moving]
    others = {*vehicles} - {*vehicles[:1]}
    if not others:
        return found, ''
    kept = {name: [one for one in judged if vehicle(one) not in others] or judged
            for name, judged in found.items()}
    return kept, ', '.join(f'/{name}' for name in sorted(others))


def words_in(name: str) -> list[str]:
    """Return the words in a name, in lower case."""
    return [word for word in re.split(r'[^a-z]+', name.lower()) if word]


def too_fast(signals: Sequence[Signal]) -> list[tuple[Signal, float]]:
    """Return what could be a position but moves too fast, and how fast [m/s]."""
    places = [(signal, _speeds(signal)) for signal in signals if _is_place(signal)]
    return [(signal, float(np.median(speeds))) for signal, speeds in places
            if len(speeds) and np.median(speeds) > _FASTEST]


def upside_down(signal: Signal) -> bool:
    """Tell whether it is an attitude that is turned over, while vehicles are mostly level."""
    return signal.shape == 'quaternion' and bool(
        np.median(np.sum(signal.values[:, :2]**2, axis=1)) > 0.5)


def _points(signal: Signal, likely: Iterable[str], unlikely: Iterable[str] = ()) -> float:
    """Return a point per likely word, up to two, and how much its rate counts among equals."""
    words = signal.words
    points = min(len(words & set(likely)), 2) - 3.0 * bool(words & _ASKED)
    points -= 2.0 * bool(words & set(unlikely))
    return points + 0.2 * math.log10(max(min(signal.rate, 100.0), 0.1))


def _speeds(signal: Signal) -> Array:
    """Return how fast the values change [1/s]."""
    steps = np.diff(signal.times)
    moved = np.linalg.norm(np.diff(signal.values, axis=0), axis=1)
    return np.asarray(moved[steps > 0.0] / steps[steps > 0.0])


def _moves(signal: Signal, least: float) -> bool:
    return bool(np.max(signal.spread) > least)


def _is_place(signal: Signal) -> bool:
    """Tell whether a signal that moves is named as a position."""
    last = signal.path.rpartition('.')[2]
    named = last in _PLACES or last not in _CHANGES and bool(
        signal.words & {'position', 'pos', 'lbl', 'usbl', 'fix'}) or _is_planar(signal)
    vector = signal.shape == 'vector' or (signal.shape == 'array' and ',' in signal.path)
    return (vector and named or signal.shape == 'geographic') and _moves(signal, 0.01)


def _position(signal: Signal) -> Iterable[Candidate]:
    if not _is_place(signal):
        return
    speeds = _speeds(signal)
    if not len(speeds) or np.median(speeds) > _FASTEST:
        return
    typed = signal.path.rpartition('.')[2] in _PLACES or _is_planar(signal)
    # a GPS is under water the last one to be right
    yield Candidate(signal, 3.0 * typed - 3.0 * (signal.shape == 'geographic') + _points(
        signal, ('position', 'pose', 'odom', 'odometry', 'mocap', 'lbl', 'usbl', 'local', 'nav',
                 'fix', 'gps', 'viso'), ('joint', 'angular'))
        - bool(signal.words & _LAGGING))


def _attitude(signal: Signal) -> Iterable[Candidate]:
    likely = ('orientation', 'attitude', 'imu', 'pose', 'odom', 'odometry', 'mocap', 'heading')
    if signal.shape == 'quaternion':
        lengths = np.linalg.norm(signal.values, axis=1)
        if abs(np.median(lengths) - 1.0) < 0.02 and _moves(signal, 1e-4):
            yield Candidate(signal, 3.0 + _points(signal, likely) - 2.0 * upside_down(signal)
                            - bool(signal.words & _LAGGING))
    elif signal.shape == 'vector' and signal.words & {'rpy', 'euler', 'angles'}:
        yield Candidate(part(signal, (0, 1, 2), ', '.join(
            f'{signal.path}.{axis}'.lstrip('.') for axis in 'xyz'), 'array'),
            1.0 + _points(signal, likely), _angle_unit(signal))
    elif signal.shape == 'array' and ',' in signal.path and 'attitude' in signal.words:
        yield Candidate(signal, 2.0, _angle_unit(signal))
    elif signal.shape == 'number' and (
            signal.words & {'heading', 'yaw', 'compass', 'hdg'} or (
                _is_planar(signal) and signal.path.rpartition('.')[2] == 'theta')):
        if _moves(signal, 1e-3) and 'rate' not in signal.words:
            sense = {'heading': 'ned'} if signal.words & {'compass', 'heading', 'hdg'} else {}
            yield Candidate(signal, 0.5 + _points(signal, likely), {
                **_angle_unit(signal), **sense})


def _angle_unit(signal: Signal) -> dict[str, str]:
    return {'unit': 'deg'} if np.max(np.abs(signal.values)) > 2.0 * math.pi + 0.1 else {}


def _is_planar(signal: Signal) -> bool:
    return signal.type == 'geometry_msgs/msg/Pose2D'


def _planar(signals: Sequence[Signal]) -> list[Signal]:
    """Return the positions in poses that have x, y and a heading."""
    known = {(signal.topic, signal.path): signal for signal in signals if _is_planar(signal)}
    pairs = [(x, known[topic, f'{path[:-1]}y'])
             for (topic, path), x in known.items() if path.rpartition('.')[2] == 'x']
    return [replace(x, path=f'{x.path}, {y.path}', shape='array', values=np.column_stack(
        [x.values, y.values, np.zeros_like(x.values)]))
        for x, y in pairs if len(x.values) == len(y.values)]


def _named_array(signal: Signal) -> Signal | None:
    """Return what an array of numbers is by its name: three of a vector, four of a rotation."""
    name, width = signal.path.rpartition('.')[2], signal.values.shape[1]
    if signal.shape != 'array' or (name, width) not in _ARRAYS or 'joint' in signal.words:
        return None
    if width == 3:
        return replace(signal, shape='vector')
    # a vehicle is level most of the time: of roll and pitch there is little
    first, last = [float(np.mean(signal.values[:, k:k + 2]**2)) for k in (1, 0)]
    if first >= last:
        return replace(signal, shape='quaternion')
    return part(signal, (1, 2, 3, 0), ', '.join(
        f'{signal.path}[{k}]' for k in (1, 2, 3, 0)), 'quaternion')


def _depth_of_point(signal: Signal) -> Signal | None:
    """Return the depth in a point that a depth sensor fills in: its x and y never change."""
    if signal.shape != 'vector' or not signal.words & _DEPTH or (
            np.ptp(signal.values[:, :2]) > 0.0):
        return None
    return part(signal, (2,), f'{signal.path}.z'.lstrip('.'), 'number')


def _depth(signal: Signal) -> Iterable[Candidate]:
    words = signal.words
    if signal.shape not in ('number', 'array') or signal.values.shape[1] != 1 or (
            not (words & _DEPTH or words >= {'rel', 'alt'})
            or words & {'variance', 'cmd', 'temperature', 'air'}
            or words >= {'dvl', 'altitude'}):  # that above the ground
        return
    if not _moves(signal, 1e-3):
        return
    low, high = float(np.min(signal.values)), float(np.max(signal.values))
    keys: dict[str, Any] = {}
    if 'pressure' in words:
        if low > 0.8 * _ATMOSPHERE:
            keys = {'scale': -_PASCAL, 'offset': _ATMOSPHERE * _PASCAL}
        elif low > 800.0 and high < 2e4 and not _dives_too_fast(signal):  # [hPa]
            keys = {'scale': -100.0 * _PASCAL, 'offset': _ATMOSPHERE * _PASCAL}
        elif high > 1000.0:  # [Pa] above that of the atmosphere
            keys = {'scale': -_PASCAL}
        else:  # [bar]
            keys = {'scale': -1e5 * _PASCAL, 'offset': _ATMOSPHERE * _PASCAL}
    else:
        unit = next((size for name, size in _UNITS.items() if name in words), 1.0)
        if 'depth' in words and high > -low:
            unit = -unit
        keys = {'scale': unit} if unit != 1.0 else {}
    yield Candidate(signal, _points(
        signal, ('depth', 'pressure', 'water', 'fluid', 'baro'), ('altitude',)), keys)


def _dives_too_fast(signal: Signal) -> bool:
    """Tell whether a pressure cannot be in hPa, for its depth changes too fast."""
    speeds = _speeds(signal)
    return bool(len(speeds) and 100.0 * _PASCAL * np.median(speeds) > _FASTEST_DIVE)


def _velocity(signal: Signal) -> Iterable[Candidate]:
    last = signal.path.rpartition('.')[2]
    words = signal.words & {'velocity', 'vel', 'dvl', 'twist', 'viso'}
    if 'gps' in signal.words:  # that of the world
        return
    vector = signal.shape == 'vector' or (signal.shape == 'array' and ',' in signal.path)
    if vector and words and last not in ('angular', 'angular_velocity') and (
            last not in ('position', 'point', 'acceleration', 'linear_acceleration')):
        if _moves(signal, 0.01) and np.median(np.abs(signal.values)) < 20.0:
            yield Candidate(signal, _points(signal, ('dvl', 'velocity', 'twist', 'linear', 'viso'),
                                            ('cmd', 'command', 'angular')))


def _angular_velocity(signal: Signal) -> Iterable[Candidate]:
    last = signal.path.rpartition('.')[2]
    if signal.shape == 'gyro' or signal.shape == 'vector' and (
            last in ('angular_velocity', 'angular') or 'gyro' in signal.words):
        if _moves(signal, 1e-4) and np.median(np.abs(signal.values)) < 20.0:
            yield Candidate(signal, 1.0 + _points(
                signal, ('imu', 'gyro', 'angular'), ('cmd', 'command')))


def _inertial_parts(signals: Sequence[Signal]) -> list[Signal]:
    """
    Return the gyros within arrays of numbers without names.

    An accelerometer gives itself away, for it sees gravity; the gyro is the three beside it.
    """
    found = []
    for signal in signals:
        width = signal.values.shape[1]
        if signal.shape != 'array' or width < 6 or not signal.words & {'imu', 'inertial'}:
            continue
        for at in range(width - 2):
            length = np.median(np.linalg.norm(signal.values[:, at:at + 3], axis=1))
            for gyro in (at - 3, at + 3):
                if _GRAVITY[0] < length < _GRAVITY[1] and 0 <= gyro <= width - 3:
                    path = f'{signal.path}[{gyro}:{gyro + 3}]'
                    columns = part(signal, range(gyro, gyro + 3), path, 'gyro')
                    if np.max(np.abs(columns.values)) < 20.0:
                        found.append(columns)
    return found


def _one_topic_each(signals: Sequence[Signal]) -> list[Signal]:
    """Return commands of thrusters that have a topic each, as /thruster1/cmd or /left_thrust."""
    groups: dict[tuple[Any, ...], list[Signal]] = {}
    for signal in signals:
        parts = signal.topic.split('/')
        if signal.shape == 'number' and signal.words & _THRUSTER and (
                signal.words & {'cmd', 'command'} or not signal.words & _MEASURED):
            kind = [word for word in words_in(parts[-1]) if word not in _SIDES]
            groups.setdefault((signal.type, signal.path, len(parts), *kind), []).append(signal)
    return [together(sorted(group, key=lambda one: [
        (int(digits or 0), text) for text, digits in re.findall(r'(\D+)(\d*)', one.topic)]))
        for group in groups.values()]


def _thrusters(signal: Signal) -> Iterable[Candidate]:
    if signal.shape == 'wrench' and np.max(signal.spread) > 1e-6:
        yield Candidate(signal, 4.0 + _points(
            signal, ('wrench', 'force', 'thrust', 'actual'), ('meas',)))
    if signal.shape != 'array' or not _moves(signal, 1e-6):
        return
    words = signal.words
    likely = ('thruster', 'thrusters', 'thr', 'motor', 'motors', 'rc', 'rcou', 'out', 'pwm',
              'servo', 'esc', 'command', 'cmd', 'force', 'forces', 'effort', 'current', 'axes',
              'actuator', 'actuators', 'channels', 'thrust', 'thrusts', 'rpm')
    named = any(_THRUSTER.intersection(words_in(name)) for name in signal.names) or (
        bool(words & _THRUSTER) and signal.path in ('effort', 'velocity'))
    if not (named or words & set(likely)) or words & {'imu', 'magnetometer', 'gps'} or (
            'states' in words and not named):
        return
    pulses = is_pwm(signal.values)
    columns = driven(signal.values)
    unlikely = ('in', 'override') if named else ('in', 'override', 'joint')
    yield Candidate(signal, 1.0 + _points(signal, likely, unlikely) + (
        1.5 * pulses + 1.5 * bool(words & {'force', 'forces', 'thrust'})) + 0.5 * (
        len(columns) > 1), {'pwm': pulses})


def is_pwm(values: Array) -> bool:
    """Return whether commands are pulse widths [us]; 0 stands for no output."""
    told = values[values > 0.0]
    return bool(len(told) and np.mean((told >= PWM[0]) & (told <= PWM[1])) > 0.98
                and np.min(values) >= 0.0 and np.max(told) - np.min(told) > 5.0)


def driven(values: Array) -> list[int]:
    """Return the columns that change."""
    return [k for k in range(values.shape[1]) if np.ptp(values[:, k]) > 1e-6]


_JUDGES: dict[str, Callable[[Signal], Iterable[Candidate]]] = {
    'position': _position, 'depth': _depth, 'attitude': _attitude,
    'angular_velocity': _angular_velocity, 'velocity': _velocity, 'thrusters': _thrusters}
