"""Outliers, jumps of the fix and stuck sensors, put into the simulated stream."""

from dataclasses import replace
from random import Random

import pytest
from rovid_core.inputs.outlier_gate import OutlierGate
from rovid_core.model.samples import Event, Sample
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import InputSettings
from rovid_core.simulation.profiles import Steps
from rovid_core.simulation.sensors import simulate
from rovid_core.velocity.attitude_history import from_yaw, product

from test.support.injected_faults import (
    clean,
    run,
    seconds,
    spoilt,
    START,
    stepped,
    vehicle,
    worse,
)

pytestmark = pytest.mark.long


def spikes(share, size):
    """Let some be off by up to ``size`` either way."""
    return lambda t, v, random: tuple(
        [x + random.uniform(-size, size) for x in v]) if random.random() < share else v


def echoes(every, length, *offset):
    """Let all be off alike for a while, again and again."""
    return lambda t, v, random: tuple(
        [x + d for x, d in zip(v, offset)]) if t % every < length else v


def held(start, end):
    """Let the value stay what it was."""
    kept = []

    def fault(t, v, random):
        if start <= t < end:
            kept.append(v)
            return kept[0]
        return v

    return fault


SPOILT = {
    'a tenth of the fixes': ('position', spikes(0.1, 2.0)),
    'an echo of four fixes every 10 s': ('position', echoes(10.0, 0.35, 1.0, 0.7, 0.0)),
    'an echo of five fixes every 10 s': ('position', echoes(10.0, 0.5, 1.0, 0.7, 0.0)),
    '20 s of nonsense': ('position', lambda t, v, random: tuple(
        [x + random.uniform(-3.0, 3.0) for x in v]) if 100.0 <= t < 120.0 else v),
    'depths': ('depth', spikes(0.05, 1.0)),
    'headings': ('attitude', lambda t, v, random: product(from_yaw(1.0), v)
                 if random.random() < 0.03 else v),
}


def test_noise_is_no_speed_however_high_the_rate():
    settings = vehicle()
    fast = replace(settings.simulation, position_rate=1000.0, position_noise=0.005,
                   attitude_rate=500.0, attitude_noise=0.002)
    settings = replace(settings, simulation=fast, max_speed=5.0)
    events = [Event(time, (Sample(name, value),)) for time, name, value in simulate(
        settings, 3.0, seed=1)]
    assert run(settings, events).rejected == {}


@pytest.mark.parametrize('name', SPOILT)
def test_outliers_cost_no_model(name):
    input, fault = SPOILT[name]
    stream = run(vehicle(), spoilt(input, fault))
    assert worse(stream) < 1.06
    reasons = {reason for i, reason in stream.rejected if i == input}
    assert reasons & {'outlier', 'too_fast'}
    assert reasons <= {'outlier', 'too_fast', 'shifted', 'gap'}
    # a heading that is wild from the start is followed from where it is right
    assert {i for i, reason in stream.rejected if reason != 'no_attitude'} == {input}


def dive_of_faults():
    """Return a dive of wild depths and headings, and of fixes wrong one way after the other."""
    def fixes(t, v, random):
        return SPOILT['a tenth of the fixes' if t < 80.0 else '20 s of nonsense' if t < 160.0 else
                      'an echo of five fixes every 10 s'][1](t, v, random)

    wild = spoilt('position', fixes, spoilt(*SPOILT['depths'], spoilt(*SPOILT['headings'])))
    stuck = spoilt('position', held(205.0, 225.0), wild)
    return stepped(('position',), 60.0, 70.0, 10.0, stepped(
        ('position',), 130.0, 140.0, -START * 1e-9, stuck))


def test_nor_do_they_cost_the_filter_its_model():
    """What is refused does not depend on the method: all at once here, and a clock that steps."""
    stream = run(vehicle('ekf'), dive_of_faults())
    assert worse(stream) < 1.02  # without the gate 1.06
    assert {reason for input, reason in stream.rejected if input == 'position'} > {
        'future', 'backward', 'outlier', 'too_fast'}
    assert stream.rejected[('position', 'stuck')] > 150


@pytest.mark.parametrize('name', ['an echo of four fixes every 10 s', 'depths'])
def test_without_the_gate_they_do(name):
    assert worse(run(replace(vehicle(), gate=0.0), spoilt(*SPOILT[name]))) > 1.2


@pytest.mark.parametrize('input', ['position', 'depth', 'attitude'])
def test_a_jump_is_followed_after_six(input):
    def fault(t, v, random):
        if not 100.0 <= t < 130.0:
            return v
        return product(from_yaw(1.5), v) if input == 'attitude' else tuple(
            [x + 2.0 for x in v])

    stream = run(vehicle(), spoilt(input, fault))
    counts = {reason: n for (i, reason), n in stream.rejected.items() if i == input}
    assert counts.pop('shifted') == 2
    assert counts.pop('outlier', 0) + counts.pop('too_fast', 0) == 10
    assert set(counts) <= {'no_attitude'}
    # 30 s with another heading are no longer the same motion
    assert worse(stream) < (1.2 if input == 'attitude' else 1.02)


def test_echoes_that_do_not_agree_are_refused_as_long_as_they_come():
    dive = clean(85.0)
    good = [e for e in dive if e.samples[0].input != 'position' or seconds(e) < 60.0]
    wild = spoilt('position', lambda t, v, random: v if t < 60.0 else tuple(
        [x + random.choice((-1.0, 1.0)) * random.uniform(1.0, 5.0) for x in v]), dive)
    stream = run(vehicle(), wild)
    steps = stream.estimate.dofs[0].steps
    assert steps - run(vehicle(), good).estimate.dofs[0].steps <= 2


def judged(positions):
    """Return what a gate says of positions at 10 Hz."""
    gate = OutlierGate(vehicle(), 'position')
    return [gate.check(START + 100_000_000 * k, (x, 0.0, 0.0)) for k, x in enumerate(positions)]


def test_outliers_that_do_not_follow_from_each_other_are_never_a_jump():
    random = Random(1)
    good = [random.gauss(0.0, 0.005) for _ in range(100)]
    assert set(judged([*good, *[(-1.0)**k * (20.0 + k) for k in range(30)]])[100:]) == {'too_fast'}
    assert 'shifted' in judged([*good, *[20.0 + x for x in good]])


def test_outliers_teach_what_the_noise_has_become():
    random = Random(1)
    noise = [random.gauss(0.0, 0.005) for _ in range(100)]
    louder = [random.gauss(0.0, 0.5) for _ in range(300)]
    said = judged([*noise, *louder])
    assert said[100:140].count('') < 20
    assert said[300:].count('') > 80


def test_a_sensor_that_turns_noisy_is_believed_again():
    noisy = spoilt('position', lambda t, v, random: v if t < 40.0 else tuple(
        [x + random.gauss(0.0, 0.1) for x in v]), clean(120.0))
    stream = Stream(vehicle())
    late = [e for event in noisy for e in stream.receive(event)
            if seconds(event) > 90.0 and 0 in e.stepped]
    assert len(late) > 250  # of 300


FULL = {'surge': (Steps((0.0,) * 10 + (450.0, -450.0, 0.0, 450.0), 5.0),),
        'heave': (Steps((0.0,) * 6 + (1050.0, 0.0, -1050.0), 7.0),),
        'yaw': (Steps((0.0,) * 7 + (60.0, -60.0, 0.0, 60.0), 3.0),)}
AT_ONCE = {'surge': (Steps((450.0, -450.0), 9.0),), 'heave': (Steps((1050.0, -1050.0), 7.0),),
           'yaw': (Steps((60.0, -60.0), 3.0),)}
DVL = {'velocity': InputSettings('/dvl'), 'angular_velocity': InputSettings('/gyro'),
       'position': InputSettings(), 'depth': InputSettings()}


@pytest.mark.parametrize('profile', [FULL, AT_ONCE], ids=['from rest', 'at once'])
@pytest.mark.parametrize('noise', [1.0, 0.0])
@pytest.mark.parametrize('sensors', [{}, DVL, {'depth': InputSettings()}],
                         ids=['fixes', 'dvl', 'no depth'])
def test_steps_of_three_times_the_typical_thrust_are_let_in(profile, noise, sensors):
    settings = replace(vehicle(), **sensors)
    truth = settings.simulation
    settings = replace(settings, simulation=replace(truth, **{
        name: noise * getattr(truth, name) for name in vars(truth) if name.endswith('_noise')}))
    stream = Stream(settings)
    for time, name, value in simulate(settings, 90.0 if profile is FULL else 45.0, 2, profile):
        stream.receive(Event(time, (Sample(name, value),)))
    assert not {input for input, _ in stream.rejected} & set(settings.used_inputs())


@pytest.mark.parametrize('rate', [1.0, 30.0])
def test_nothing_of_a_sound_stream_is_refused_at_any_rate_and_with_gaps(rate):
    settings = replace(vehicle(), max_gap=5.0)
    settings = replace(settings, simulation=replace(
        settings.simulation, position_rate=rate, depth_rate=2 * rate, attitude_rate=5 * rate))
    stream = Stream(settings)
    for k, (time, name, value) in enumerate(
            simulate(settings, 200.0 if rate == 1.0 else 40.0, 3)):
        if name == 'thrusters' or (k * 7919 + k // 13) % 5:
            stream.receive(Event(time, (Sample(name, value),)))
    assert stream.rejected == {}


@pytest.mark.parametrize('step', [0.01, 0.1])
def test_a_coarse_sensor_is_neither_wild_nor_stuck(step):
    def coarse(t, v, random):
        return tuple([round(x / step) * step for x in v])

    stream = run(vehicle(), spoilt('depth', coarse, spoilt('position', coarse, clean(100.0))))
    assert stream.rejected == {}
    assert [w for w in stream.take_warnings() if 'stuck' in w] == []


@pytest.mark.parametrize('input', ['position', 'depth', 'attitude'])
def test_a_stuck_sensor_is_refused_told_and_taken_up_again(input):
    stream = run(vehicle(), spoilt(input, held(80.0, 100.0)))
    assert stream.rejected[(input, 'stuck')] == 200 - 10
    assert stream.rejected[(input, 'gap')] == 1
    warnings = stream.take_warnings()
    assert len(warnings) == 1
    assert f'{input} is stuck' in warnings[0]
    assert worse(stream) < 1.05


def test_no_step_leads_over_the_time_that_a_sensor_was_stuck():
    """However long a gap may be: it seems to have stood still first, and then to jump."""
    stream = run(replace(vehicle(), max_gap=10.0), spoilt('position', held(80.0, 84.0)))
    assert stream.rejected == {('position', 'stuck'): 40 - 10, ('position', 'gap'): 1}


def test_a_sensor_that_is_still_while_other_thrust_drives_is_told_and_let_in():
    still = spoilt('thrusters', lambda t, v, random: (
        v if t < 40.0 else tuple([0.5 * (v[0] + v[1]) * (t % 2.0 < 1.0)] * 2 + [0.0])),
        clean(80.0))
    # no yaw, no heave; surge for a second and none for a second
    stream = run(vehicle(), spoilt('attitude', held(40.0, 60.0), still))
    assert ('attitude', 'stuck') not in stream.rejected
    (warning,) = [line for line in stream.take_warnings() if 'stuck' in line]
    assert warning.startswith('attitude may be stuck')


def test_what_is_published_more_often_than_measured_is_told_once():
    settings = vehicle()
    stream = Stream(settings)
    for time, name, value in simulate(settings, 60.0, 1):
        for k in range(5 if name == 'position' else 1):
            stream.receive(Event(time + 20_000_000 * k, (Sample(name, value),)))
    (warning,) = stream.take_warnings()
    assert warning.startswith('position mostly repeats its last value')
    assert ('position', 'stuck') not in stream.rejected


def test_every_episode_is_told():
    both = spoilt('depth', held(30.0, 40.0), spoilt('depth', held(60.0, 80.0), clean(90.0)))
    assert len(run(vehicle(), both).take_warnings()) == 2


def test_a_simulator_without_noise_at_rest_is_not_accused():
    settings = vehicle()
    quiet = replace(settings.simulation, position_noise=0.0, depth_noise=0.0, attitude_noise=0.0)
    settings = replace(settings, simulation=quiet)
    rest = dict.fromkeys(settings.dofs, ()) | {'surge': (Steps((100.0, 0.0), 20.0),)}
    stream = Stream(settings)
    for time, name, value in simulate(settings, 120.0, 1, rest):
        stream.receive(Event(time, (Sample(name, value),)))
    assert stream.rejected == {}
    assert not any('stuck' in w for w in stream.take_warnings())


def test_without_thrust_a_value_may_repeat():
    still = spoilt('thrusters', lambda t, v, random: tuple([0.0 for _ in v])
                   if t > 35.0 else v, clean(70.0))
    stream = run(vehicle(), spoilt('position', held(40.0, 60.0), still))
    assert ('position', 'stuck') not in stream.rejected
