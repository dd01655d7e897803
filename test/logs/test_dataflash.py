"""ArduPilot's dataflash logs: every type of value, instances, derived columns, cuts, damage."""

import math
from pathlib import Path
import random

import numpy as np
import pytest
from rovid_core.settings.run import Settings
from rovid_ros.commands.check import check
from rovid_ros.commands.replay import replay
from rovid_ros.logs.container import LogError
from rovid_ros.logs.dataflash import PARAMETERS
from rovid_ros.logs.log import Log, LogMessage
from rovid_ros.logs.player import PipelinePlayer

from test.support.dataflash_logs import DataflashWriter, dive, heavy


def written(path: Path, log: DataflashWriter) -> Path:
    path.write_bytes(log.data)
    return path


def read(path: Path, topic: str) -> list[LogMessage]:
    with Log([path]) as log:
        return list(log.messages([topic]))


def barometers(count: int) -> DataflashWriter:
    """Return a small log of two barometers at 10 Hz, one behind the other."""
    log = DataflashWriter()
    log.define('BARO', 'QBfc', 'TimeUS,I,Alt,Temp', 's#mO')
    log.define('PARM', 'QNf', 'TimeUS,Name,Value')
    log.write('PARM', 1_000_000, 'BARO_PRIMARY', 1.0)
    for k in range(count):
        for instance in range(2):
            log.write('BARO', 1_000_000 + 100_000 * k, instance, -0.5 * k, 12.25)
    return log


@pytest.fixture(scope='module')
def vehicle() -> Settings:
    return heavy(['surge', 'sway', 'heave', 'yaw'], ['depth', 'velocity'])


@pytest.fixture(scope='module')
def dived(vehicle: Settings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of a dive with a DVL."""
    return written(tmp_path_factory.mktemp('dive') / 'DIVE.BIN', dive(vehicle, 60.0))


# --- what is read -------------------------------------------------------------------------


VALUES = {
    'a': [*range(-16, 16)], 'b': -128, 'B': 255, 'h': -32768, 'H': 65535, 'i': -2**31,
    'I': 2**32 - 1, 'q': -2**63, 'Q': 2**64 - 1, 'g': 0.5, 'f': 0.25, 'd': 0.1, 'n': 'RCOU',
    'N': 'MOT_1_DIRECTION', 'Z': 'ArduSub', 'M': 19, 'c': -12.34, 'C': 655.35,
    'e': -2.0e7, 'E': 42949672.95, 'L': -122.1234567}


@pytest.mark.parametrize('kind', VALUES)
def test_every_type_of_value_is_read(kind: str, tmp_path: Path) -> None:
    log = DataflashWriter()
    log.define('TEST', f'QB{kind}B', 'TimeUS,Before,Value,After')
    log.write('TEST', 5_000_000, 1, VALUES[kind], 2)
    log.write('TEST', 5_100_000, 3, VALUES[kind], 4)
    found = read(written(tmp_path / 'log.bin', log), '/TEST')
    assert [(m.time, m.type, m.data.Before, m.data.After) for m in found] == [
        (5_000_000_000, 'ardupilot/msg/TEST', 1, 2), (5_100_000_000, 'ardupilot/msg/TEST', 3, 4)]
    for message in found:
        value = message.data.Value
        if isinstance(VALUES[kind], str):
            value = bytes(value).rstrip(b'\0').decode()
        assert np.array_equal(value, VALUES[kind])


def test_the_second_barometer_is_a_topic_of_its_own(tmp_path: Path) -> None:
    path = written(tmp_path / 'log.bin', barometers(20))
    with Log([path]) as log:
        assert {name: info.count for name, info in log.topics.items()} == {
            '/BARO': 20, '/BARO_1': 20, '/PARM': 1, '/FMTU': 1}
        assert log.warnings == []
    for topic, instance in (('/BARO', 0), ('/BARO_1', 1)):
        found = read(path, topic)
        assert [m.data.Alt for m in found] == [-0.5 * k for k in range(20)]
        assert {m.data.I for m in found} == {instance}


def test_the_autopilots_parameters_are_metadata(dived: Path) -> None:
    with Log([dived]) as log:
        known = log.metadata[PARAMETERS]
    assert (known['FRAME_CONFIG'], known['SERVO8_FUNCTION'], known['MOT_1_DIRECTION']) == (
        '2', '40', '1')


def test_a_dvl_gives_velocities_and_a_gps_metres(tmp_path: Path) -> None:
    log = DataflashWriter()
    log.define('VISO', 'Qffff', 'TimeUS,dt,PosDX,PosDY,PosDZ')
    log.define('GPS', 'QBLLe', 'TimeUS,Status,Lat,Lng,Alt')
    for k, (status, latitude) in enumerate([(1, 0.0), (3, 60.0), (3, 60.001), (0, 60.002)]):
        log.write('VISO', 100_000 * k, 0.125 * k, 0.125, -0.25, 0.0)
        log.write('GPS', 100_000 * k, status, latitude, -179.9999 if k == 1 else 179.9999, 3.5)
    path = written(tmp_path / 'log.bin', log)
    velocities = [(m.data.VelX, m.data.VelY) for m in read(path, '/VISO')]
    assert velocities[1:] == [(1.0, -2.0), (0.5, -1.0), (1 / 3, -2 / 3)]
    assert math.isinf(velocities[0][0])
    fixes = [(m.data.North, m.data.East, m.data.Down) for m in read(path, '/GPS')]
    assert np.isnan(fixes[0]).all() and np.isnan(fixes[3]).all()
    assert fixes[1] == (0.0, 0.0, 0.0)
    # 0.001 deg of latitude at 60 deg and, across the date line, 0.0002 deg of longitude
    assert fixes[2] == pytest.approx((111.412, -11.160, 0.0), abs=0.002)


def test_it_counts_its_own_time_and_is_not_joined(dived: Path, tmp_path: Path) -> None:
    other = written(tmp_path / 'other.bin', barometers(10))
    with pytest.raises(LogError, match='cannot be joined with other logs'):
        Log([dived, other])


# --- cuts and damage ----------------------------------------------------------------------


def test_a_log_is_read_up_to_the_cut(tmp_path: Path) -> None:
    log = barometers(10)
    ends = [*log.places[1:], len(log.data)]
    for end in range(log.places[-8], len(log.data) + 1):
        path = tmp_path / 'log.bin'
        path.write_bytes(log.data[:end])
        whole = sum(place <= end for place in ends)
        with Log([path]) as opened:
            assert sum(1 for _ in opened.messages(['/BARO', '/BARO_1'])) == whole - 6
            assert bool(opened.warnings) == (end not in ends)
            assert all('cut off after' in line for line in opened.warnings)


def test_damage_costs_a_record_or_two(tmp_path: Path) -> None:
    log = barometers(40)
    path = tmp_path / 'log.bin'
    for k in (0, 1, 2, 5, 12):  # both bytes of the head, the type, the time, a value
        data = bytearray(log.data)
        data[log.places[-21] + k] ^= 0x40
        if k == 5:
            data[log.places[-21] + 8] ^= 0x40  # far away
        path.write_bytes(data)
        with Log([path]) as opened:
            found = list(opened.messages(['/BARO', '/BARO_1']))
            assert 78 <= len(found) <= 80
            assert opened.end == pytest.approx(4.9e9, abs=0.2e9)
            assert bool(opened.warnings) == (k != 12)


def test_what_an_autopilot_writes_is_no_damage(tmp_path: Path) -> None:
    """Columns that are numbers, and parameters now and then while it does not move."""
    log = DataflashWriter()
    log.define('PARM', 'QNf', 'TimeUS,Name,Value')
    log.define('SBRH', 'QQQ', 'TimeUS,msg_flag,1')
    for k, time in enumerate((0, 31, 62)):  # [s]
        log.write('PARM', time * 1_000_000, 'STAT_RUNTIME', float(k))
        if not k:
            for n in range(20):
                log.write('SBRH', n * 100_000, 5, n)
    path = written(tmp_path / 'log.bin', log)
    with Log([path]) as opened:
        assert opened.warnings == []
    assert [message.time for message in read(path, '/PARM')] == [0, 31_000_000_000]
    assert len(read(path, '/SBRH')) == 20


@pytest.mark.long
def test_no_damage_makes_a_traceback(tmp_path: Path) -> None:
    draw = random.Random(1)
    whole = bytes(dive(heavy(['heave']), 0.5, busy=0, parameters={'FRAME_CONFIG': 2.0}).data)
    path = tmp_path / 'log.bin'
    read_some = refused = 0
    for _ in range(1000):
        data = bytearray(whole)
        for _ in range(draw.choice([1, 1, 3, 10, 100])):
            at = draw.randrange(len(data))
            kind = draw.randrange(5)
            if kind == 0:
                data[at] ^= 1 << draw.randrange(8)
            elif kind == 1:
                data[at:at + draw.randrange(100)] = draw.randbytes(draw.randrange(100))
            elif kind == 2:
                del data[at:at + draw.randrange(200)]
            elif kind == 3:
                data[at:at] = data[draw.randrange(len(data)):][:draw.randrange(200)]
            else:
                data[at:at + draw.randrange(64)] = bytes([draw.choice([0, 255])]) * 64
        path.write_bytes(data)
        try:
            with Log([path]) as log:
                read_some += sum(1 for _ in log.messages(sorted(log.topics))) > 0
        except LogError as error:
            assert str(path) in str(error)
            refused += 1
    assert read_some > 800
    assert refused + read_some <= 1000


# --- what comes of it ---------------------------------------------------------------------


def masses(path: Path, settings: Settings) -> dict[str, float]:
    result = replay([path], settings, PipelinePlayer(settings)).document()
    return {dof: values['mass'] / settings.simulation.dofs[dof].mass
            for dof, values in result['dofs'].items()}


def test_a_dive_is_identified_with_a_dvl(vehicle: Settings, dived: Path) -> None:
    assert masses(dived, vehicle) == pytest.approx(
        {'surge': 1.0, 'sway': 1.0, 'heave': 1.0, 'yaw': 1.0}, rel=0.1)


def test_a_dive_is_identified_with_a_gps(tmp_path: Path) -> None:
    settings = heavy(['surge', 'yaw'], ['position'])
    path = written(tmp_path / 'surface.BIN', dive(settings, 60.0, busy=0))
    assert masses(path, settings) == pytest.approx({'surge': 1.0, 'yaw': 1.0}, rel=0.15)


def test_the_shipped_file_fits_the_log(repository: Path, dived: Path) -> None:
    outcome = check(repository / 'config' / 'ardusub_bin.yaml', [dived])
    assert outcome.verdict == 'all is well', outcome.text
