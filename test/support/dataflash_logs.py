"""Dataflash logs, written from the first FMT record up, as ArduSub writes them."""

from collections.abc import Sequence
import math
from pathlib import Path
import struct
from typing import Any

import numpy as np
from rovid_core.settings.run import Settings
from rovid_core.simulation.sensors import simulate
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

HEAD = b'\xa3\x95'
FMT = 128
CODES = {  # in struct, by format character
    'a': '32h', 'b': 'b', 'B': 'B', 'h': 'h', 'H': 'H', 'i': 'i', 'I': 'I', 'q': 'q', 'Q': 'Q',
    'g': 'e', 'f': 'f', 'd': 'd', 'n': '4s', 'N': '16s', 'Z': '64s', 'M': 'B', 'c': 'h', 'C': 'H',
    'e': 'i', 'E': 'I', 'L': 'i'}
FACTORS = {'c': 100, 'C': 100, 'e': 100, 'E': 100, 'L': 10_000_000}
LATITUDE, LONGITUDE = 63.4, 10.4  # [deg]
_PHI = math.radians(LATITUDE)
PER_DEGREE = (  # [m] of latitude and of longitude there: the usual series
    111132.92 - 559.82 * math.cos(2 * _PHI) + 1.175 * math.cos(4 * _PHI),
    111412.84 * math.cos(_PHI) - 93.5 * math.cos(3 * _PHI) + 0.118 * math.cos(5 * _PHI))


class DataflashWriter:
    """Makes the bytes of a log, record by record."""

    def __init__(self, time: int = 0) -> None:
        self._time = time  # [us] of declarations
        self.data = bytearray()
        self.places: list[int] = []
        self._types: dict[str, tuple[int, str]] = {}
        self.define('FMT', 'BBnNZ', 'Type,Length,Name,Format,Columns')
        self.define('FMTU', 'QBNN', 'TimeUS,FmtType,UnitIds,MultIds')

    def define(self, name: str, kinds: str, columns: str, units: str = '') -> None:
        """Add the FMT record of a type, and the FMTU record if units are given."""
        number = FMT + len(self._types)
        self._types[name] = (number, kinds)
        length = 3 + struct.calcsize('<' + ''.join(CODES[kind] for kind in kinds))
        self.write('FMT', number, length, name, kinds, columns)
        if units:
            self.write('FMTU', self._time, number, units, '-' * len(units))

    def write(self, name: str, *values: Any) -> None:
        """Add a record; numbers are in the unit of the column, also where the file scales."""
        number, kinds = self._types[name]
        packed: list[Any] = []
        for kind, value in zip(kinds, values, strict=True):
            if kind in FACTORS:
                value = round(value * FACTORS[kind])
            elif isinstance(value, str):
                value = value.encode()
            packed += value if kind == 'a' else [value]
        self.places.append(len(self.data))
        self.data += HEAD + bytes([number]) + struct.pack(
            '<' + ''.join(CODES[kind] for kind in kinds), *packed)


def heavy(dofs: Sequence[str], inputs: Sequence[str] = ('depth',)) -> Settings:
    """Return the shipped configuration with these DOFs and inputs, and a vehicle to simulate."""
    config = Path(__file__).parents[2] / 'config'
    values = load(config / 'ardusub_bin.yaml')
    truth = {key: value for key, value in load(config / 'bluerov2_ardusub.yaml').items()
             if key.startswith('simulation.') and not key.endswith('_rate')}
    topics = {'depth': '/CTUN', 'velocity': '/VISO', 'position': '/GPS'}
    return settings_from({
        **values, **truth, 'dofs': list(dofs),
        **{f'{name}.topic': topic if name in inputs else '' for name, topic in topics.items()},
        **{f'simulation.{name}_rate': 10.0 for name in (
            'thruster', 'attitude', 'depth', 'velocity', 'position')},
        'current.prior': 0.0,  # a tank
        'simulation.depth_noise': 0.003, 'simulation.velocity_noise': 0.01})


PARAMETERS = {'FRAME_CONFIG': 2.0, 'BARO_PRIMARY': 1.0, 'LOG_DISARMED': 0.0} | {
    f'SERVO{n}_FUNCTION': 32.0 + n for n in range(1, 9)} | {
    f'MOT_{n}_DIRECTION': 1.0 for n in range(1, 9)}


def dive(settings: Settings, duration: float, seed: int = 1, *, start: float = 20.0,
         parameters: dict[str, float] | None = None, outputs: Sequence[int] = range(8),
         reversed_motors: Sequence[int] = (), busy: int = 1) -> DataflashWriter:
    """
    Return the log of a simulated BlueROV2, with what ArduSub writes besides.

    ``start`` is when the log begins after the autopilot [s]. ``outputs`` are where the motors are
    among the servo outputs, from 0; ``reversed_motors`` those, from 1, whose direction is -1.
    ``busy`` is how many records of the IMU come at 100 Hz.
    """
    begin = round(start * 1e6)
    log = DataflashWriter(begin)
    _define(log)
    for name, value in (PARAMETERS if parameters is None else parameters).items():
        log.write('PARM', begin, name, value, value)
    log.write('MSG', begin, 'ArduSub V4.5.0 (00000000)')
    random = np.random.default_rng((seed, 2))
    signs = [-1.0 if k + 1 in reversed_motors else 1.0 for k in range(8)]
    tick = begin
    for time, name, value in simulate(settings, duration, seed):
        us = begin + time // 1000
        while busy and tick < us:
            for k in range(busy):
                log.write('IMU', tick, k % 2, *random.normal(0.0, 0.05, 6).tolist())
            tick += 10_000
        if name == 'thrusters':
            pwm = [1500] * 14
            for place, command, sign in zip(outputs, value, signs, strict=True):
                pwm[place] = round(1500.0 + sign * (command - 1500.0))
            log.write('RCOU', us, *pwm)
            log.write('BAT', us, 0, 15.2)
        else:
            _SENSORS[name](log, us, *value)
    return log


def _write_attitude(log: DataflashWriter, us: int, *q: float) -> None:
    roll, pitch, yaw = _angles(q)
    log.write('ATT', us, roll, roll, pitch, pitch, yaw, yaw, 3)


def _write_depth(log: DataflashWriter, us: int, z: float) -> None:
    log.write('CTUN', us, 0.0, 0.0, 0.0, 0.5, z, z, z, 0.0, 0.0, 0.0, 0, 0)
    log.write('BARO', us, 0, 0.3 * math.sin(us * 1e-8), 101000.0, 31.2)  # inside the hull
    log.write('BARO', us, 1, z, 101325.0 - 9810.0 * z, 12.4)


def _write_velocity(log: DataflashWriter, us: int, x: float, y: float, z: float) -> None:
    log.write('VISO', us, 0.1, 0.0, 0.0, 0.0, 0.1 * x, -0.1 * y, -0.1 * z, 90.0)


def _write_position(log: DataflashWriter, us: int, east: float, north: float, z: float) -> None:
    log.write('GPS', us, 0, 3, 0, 0, 12, 0.8, LATITUDE + north / PER_DEGREE[0],
              LONGITUDE + east / PER_DEGREE[1], z)


_SENSORS = {'attitude': _write_attitude, 'depth': _write_depth, 'velocity': _write_velocity,
            'position': _write_position}


def _angles(q: tuple[float, ...]) -> tuple[float, float, float]:
    """Return roll, pitch and compass heading [deg] of a body FLU in a world ENU."""
    x, y, z, w = q
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(2.0 * (w * y - z * x))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return math.degrees(roll), -math.degrees(pitch), (90.0 - math.degrees(yaw)) % 360.0


def _define(log: DataflashWriter) -> None:
    log.define('PARM', 'QNff', 'TimeUS,Name,Value,Default')
    log.define('MSG', 'QZ', 'TimeUS,Message')
    log.define('RCOU', 'QHHHHHHHHHHHHHH', 'TimeUS,' + ','.join(f'C{n}' for n in range(1, 15)))
    log.define('ATT', 'QccccCCB', 'TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF')
    log.define('CTUN', 'Qfffffffccfhh',
               'TimeUS,ThI,ABst,ThO,ThH,DAlt,Alt,BAlt,DSAlt,SAlt,TAlt,DCRt,CRt')
    log.define('BARO', 'QBfff', 'TimeUS,I,Alt,Press,Temp', 's#mPO')
    log.define('IMU', 'QBffffff', 'TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ', 's#EEEooo')
    log.define('VISO', 'Qffffffff', 'TimeUS,dt,AngDX,AngDY,AngDZ,PosDX,PosDY,PosDZ,conf')
    log.define('GPS', 'QBBIHBcLLe', 'TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt', 's#')
    log.define('BAT', 'QBf', 'TimeUS,Inst,Volt', 's#v')
