"""Units, signs and frames that are not what the settings say, told from the data."""

from dataclasses import replace
import math
from random import Random

import pytest
from rovid_core.inputs.units_and_signs import (
    look_like_pulse_widths,
    NeutralCheck,
    TwoSendersCheck,
    TypicalSizeCheck,
    UnsignedCommandCheck,
)
from rovid_core.model.samples import Step
from rovid_core.settings.run import DofSettings, InputSettings
from rovid_core.velocity.attitude_history import from_yaw

from test.support.injected_faults import clean, run, spoilt, vehicle
from test.support.surge import surge_settings

DIVE = 150.0
"""[s]"""


def times(factor):
    return lambda t, v, random: tuple([factor * x for x in v])


def degrees(t, v, random):
    """Read the heading's degrees as radians."""
    return from_yaw(math.degrees(2.0 * math.atan2(v[2], v[3])))


SLIPS = {
    'mm': ('position', times(1000.0), 'position.field takes metres'),
    'cm': ('position', times(100.0), 'position.field takes metres'),
    'pressure': ('depth', lambda t, v, random: (101325.0 - 9806.65 * v[0],), 'depth.scale'),
    'depth downwards': ('depth', times(-1.0), 'depth.scale'),
    'degrees': ('attitude', degrees, 'attitude.unit'),
    'pulses': ('thrusters', lambda t, v, random: tuple([1500.0 + 40.0 * x for x in v]),
               'set thrusters.offset'),
    'thrust the other way': ('thrusters', lambda t, v, random: (-v[1], -v[0], v[2]),
                             'turn the sign of its row surge'),
}


@pytest.mark.parametrize(('row', 'told'), [
    ((1.0, 1.0), True), ((1.0, -1.0), False), ((0.0, 0.0), False)])
def test_thrusters_that_push_both_ways_or_not_at_all_need_no_sign(row, told):
    """A boat turns to both sides by two thrusters that both push forward."""
    known, said = surge_settings(), []
    check = UnsignedCommandCheck(replace(known, thrusters=replace(
        known.thrusters, gain=(1.0, 1.0), allocation=(row, *[(0.0, 0.0)] * 5))), said.append)
    for k in range(1400):
        check.add_commands((1.0, 0.5))
        check.add_velocity(0, math.copysign(5.0, (k % 2) - 0.5))
    assert bool(said) is told


@pytest.mark.long
@pytest.mark.parametrize('name', SLIPS)
def test_a_slip_is_told_once_with_the_key(name):
    input, fault, text = SLIPS[name]
    warnings = run(vehicle(), spoilt(input, fault, clean(DIVE))).take_warnings()
    assert sum(text in warning for warning in warnings) == 1, warnings
    assert all('\n' not in warning for warning in warnings)


@pytest.mark.parametrize('fastest', [5.0, 10.0])
@pytest.mark.parametrize('dofs', [('surge',), ('yaw',)])
def test_degrees_are_told_whatever_is_identified_and_may_move(dofs, fastest):
    settings = replace(vehicle(), dofs=dofs, max_speed=fastest)
    warnings = run(settings, spoilt('attitude', degrees, clean(DIVE))).take_warnings()
    assert any('attitude.unit' in warning for warning in warnings), warnings


def test_ned_read_as_enu_is_told():
    half = math.sqrt(0.5)

    def position(t, v, random):
        return (v[1], v[0], -v[2])

    def attitude(t, v, random):
        x, y, z, w = v
        return (half * (x + y), half * (x - y), half * (w - z), half * (w + z))

    events = [e for e in clean(DIVE) if e.samples[0].input != 'depth']
    warnings = run(replace(vehicle(), depth=InputSettings()), spoilt(
        'position', position, spoilt('attitude', attitude, events))).take_warnings()
    assert [w.split(':')[0] for w in warnings] == ['frames']


@pytest.mark.parametrize('low, high, changes, expected', [
    (1100.0, 1900.0, {}, True), (800.0, 2200.0, {}, True), (1500.0, 1900.0, {}, True),
    (799.0, 1900.0, {}, False), (1100.0, 2201.0, {}, False), (1510.0, 1900.0, {}, False),
    (-1.0, 1.0, {}, False), (1100.0, 1900.0, {'offset': 1500.0}, False),
    (1100.0, 1900.0, {'model': 'polynomial', 'polynomial': (-1500.0, 1.0)}, False)])
def test_what_looks_like_pulse_widths(low, high, changes, expected):
    thrusters = replace(vehicle().thrusters, **changes)
    assert look_like_pulse_widths(thrusters, low, high) is expected


def test_pulses_with_an_offset_or_a_table_are_no_slip():
    fault = SLIPS['pulses'][1]
    thrusters = vehicle().thrusters
    gain = tuple([k / 40.0 for k in thrusters.gain])
    for settings in (replace(thrusters, offset=1500.0, gain=gain),
                     replace(thrusters, model='table', table_command=(1100.0, 1900.0),
                             table_force=(-400.0, 400.0), gain=gain)):
        stream = run(replace(vehicle(), thrusters=settings),
                     spoilt('thrusters', fault, clean(DIVE)))
        assert stream.take_warnings() == []


def test_a_jump_of_the_fix_is_no_unit():
    stream = run(vehicle(), spoilt('position', lambda t, v, random: tuple(
        [x + 50.0 * (t // 20.0 % 2) for x in v]), clean(DIVE)))
    assert stream.take_warnings() == []


@pytest.mark.parametrize('parts', [1, 2])
def test_commands_of_two_programs_are_told_once(parts):
    told = []
    check = TwoSendersCheck(told.append)
    for k in range(400):
        for part in range(parts):
            own = 5.0 * math.sin(0.02 * k + part)
            check.add_commands((own, -own) if k % 2 else (0.0, 0.0), part)
    assert len(told) == 1
    assert 'two programs' in told[0]


def test_commands_of_one_program_are_not_taken_for_those_of_two():
    told, random = [], Random(1)
    check = TwoSendersCheck(told.append)
    for k in range(20_000):  # of noise, of steps, of none
        noise = random.gauss(0.0, 1.0) if k < 15_000 else 0.0
        check.add_commands((noise, 3.0 * (k // 5 % 2)), 0)
    assert told == []


@pytest.mark.parametrize('offset', [1450.0, 1550.0])
def test_neutral_that_is_off_is_told_by_the_rest_of_the_thrusters(offset):
    told = []
    thrusters = replace(vehicle().thrusters, offset=offset)
    check = NeutralCheck(thrusters, lambda u: u - offset, told.append)
    for k in range(300):
        check.add_commands((1500.0 + k % 7, 1500.0 - k % 5, 1500.0))
    assert told == []  # seldom at rest
    for _ in range(100):
        check.add_commands((1500.0, 1500.0, 1500.0))
    assert len(told) == 1 and told[0].startswith('thrusters.offset')


def test_thrusters_that_rest_where_they_should_are_no_slip():
    told = []
    check = NeutralCheck(replace(vehicle().thrusters, offset=1500.0), lambda u: u - 1500.0,
                         told.append)
    for k in range(1000):  # at rest, and now and then pushed all alike
        check.add_commands((1500.0 + 80.0 * (k % 10 == 3),) * 3)
    assert told == []


@pytest.mark.parametrize(('force', 'advice'), [
    (1.0, []), (0.1, ['sway.typical.force 0.12 instead of 1']), (1e-15, [])])
def test_a_force_of_rounding_is_no_typical_size(force, advice):
    """As of an allocation that was computed and asks nothing of a DOF."""
    check = TypicalSizeCheck(
        'sway', DofSettings(1.0, typical_force=1.0, typical_velocity=1.0), 10.0)
    for sign in (1.0, -1.0):
        check.add_step(Step(0.1, (sign, sign, sign), (force * sign, force * sign, force * sign)))
    assert check.advice(True) == advice


@pytest.mark.parametrize('count', [3000, 300_000])
def test_a_glitch_decides_no_typical_size(count):
    check = TypicalSizeCheck(
        'yaw', DofSettings(1.0, typical_force=1.0, typical_velocity=1.0), 10.0)
    for k in range(count):
        force, velocity = math.sin(0.1 * k), 9.0 if 785 <= k < 790 else math.cos(0.1 * k)
        check.add_step(Step(0.1, (velocity,) * 3, (force,) * 3))
    assert check.advice(True) == []


@pytest.mark.parametrize(('fastest', 'advice'), [
    (10.0, ['sway.typical.velocity 5.8 instead of 1']), (5.0, [])])
def test_what_is_too_fast_to_be_is_no_typical_velocity(fastest, advice):
    check = TypicalSizeCheck(
        'sway', DofSettings(1.0, typical_force=1.0, typical_velocity=1.0), fastest)
    for sign in (1.0, -1.0):
        check.add_step(Step(0.1, (5.0 * sign,) * 3, (sign,) * 3))
    assert check.advice(True) == advice
