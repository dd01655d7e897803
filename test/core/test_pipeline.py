"""The measurement chain, the pipe and the stream on simulated sensors."""

from dataclasses import replace
import math
import random

from hypothesis import given, settings as hypothesis_settings, strategies as st
import numpy as np
import pytest
from rovid_core.model.dofs import DOFS
from rovid_core.model.plant import lumped
from rovid_core.model.samples import Event, Sample
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import (
    DofSettings,
    IdentifierSettings,
    InputSettings,
    Settings,
    SettingsError,
    SimulatedDof,
    SimulationSettings,
    ThrusterSettings,
)
from rovid_core.simulation.sensors import simulate
from rovid_core.trials.score import ScoreLog
from rovid_core.velocity.attitude_history import (
    from_yaw,
    normalised,
    product,
    rotate,
    rotation_between,
    turned,
)

from test.support.memory import lengths
from test.support.surge import run, surge_settings

TRUTH = {
    'surge': SimulatedDof(290.0, 290.0, 43.5, 2.9, (150.0, 80.0), (1 / 18, 1 / 7.3)),
    'sway': SimulatedDof(500.0, 700.0, 80.0, 0.0, (150.0, 80.0), (1 / 15, 1 / 6.1)),
    'heave': SimulatedDof(2000.0, 1500.0, 150.0, 10.0, (300.0, 150.0), (1 / 25, 1 / 11)),
    'roll': SimulatedDof(40.0, 20.0, 15.0, 0.0, (12.0, 6.0), (1 / 6, 1 / 4)),
    'pitch': SimulatedDof(80.0, 60.0, 30.0, 0.0, (24.0, 12.0), (1 / 7, 1 / 5)),
    'yaw': SimulatedDof(60.0, 60.0, 10.0, 0.0, (20.0, 10.0), (1 / 16, 1 / 7)),
}
SIX = ThrusterSettings(
    topics=('/thrusters',), gain=(10.0,) * 6,
    allocation=tuple(tuple(float(i == j) for j in range(6)) for i in range(6)))


def vehicle(dofs, **changes):
    truth = {d: TRUTH[d] for d in dofs}
    values = {
        'dofs': tuple(dofs), 'thrusters': SIX,
        'dof': {d: DofSettings(1.6 * t.mass, t.quadratic_drag / 1.6, t.linear_drag / 1.6)
                for d, t in truth.items()},
        'position': InputSettings('/position'), 'attitude': InputSettings('/attitude'),
        'simulation': SimulationSettings(dofs=truth), **changes}
    return Settings(**values)


def identified(settings, duration=160.0, seed=1, measurements=None, **keywords):
    stream = Stream(settings, **keywords)
    estimates = run(stream, measurements or simulate(settings, duration, seed))
    return stream, estimates


def mass_ratios(estimate):
    """Return identified over true mass per DOF."""
    return {d.dof: 1.0 / d.parameters[0] / TRUTH[d.dof].mass for d in estimate.dofs}


@pytest.mark.long
def test_six_dofs_from_fixes_depth_and_attitude_at_their_own_rates():
    settings = vehicle(DOFS, depth=InputSettings('/depth'))
    stream, estimates = identified(settings)
    for dof, ratio in mass_ratios(estimates[-1]).items():
        assert ratio == pytest.approx(1.0, abs=0.15), dof
    steps = {d.dof: d.steps for d in estimates[-1].dofs}
    assert steps['surge'] == steps['sway'] == pytest.approx(1600, abs=3)  # 10 Hz
    assert steps['heave'] == pytest.approx(3200, abs=3)  # 20 Hz
    assert steps['yaw'] == pytest.approx(3200, abs=3)
    assert stream.rejected == {}
    assert [w.split()[0] for w in stream.take_warnings()] == ['roll', 'pitch']
    assert stream.take_warnings() == []


@pytest.mark.long
def test_heading_that_turns_all_the_way_round_does_not_mix_the_axes():
    turning = replace(TRUTH['yaw'], forces=(12.0, 5.0), frequencies=(0.001, 0.1))
    settings = vehicle(('surge', 'sway', 'yaw'))
    settings = replace(settings, simulation=replace(
        settings.simulation, dofs={**settings.simulation.dofs, 'yaw': turning}))
    _, estimates = identified(settings)
    for dof in ('surge', 'sway'):
        assert mass_ratios(estimates[-1])[dof] == pytest.approx(1.0, abs=0.1)


@pytest.mark.long
def test_lever_arm_is_taken_off():
    at = InputSettings('/fix', lever_arm=(0.5, 0.4, 0.0))
    settings = vehicle(('surge', 'sway', 'yaw'), position=at)
    measured = list(simulate(settings, 120.0, 3))
    truth = {t: v for t, n, v in simulate(
        replace(settings, reference=InputSettings('/truth')), 120.0, 3) if n == 'reference'}
    for arm, worse in (((0.5, 0.4, 0.0), False), ((0.0, 0.0, 0.0), True)):
        _, estimates = identified(
            replace(settings, position=replace(at, lever_arm=arm), cutoff=0.0),
            measurements=measured)
        times = np.array(sorted(truth))
        surge = np.array([truth[t][0] for t in times])
        got = [(e.time, e.dofs[0].velocity) for e in estimates if 0 in e.stepped]
        error = np.array([v - np.interp(t, times, surge) for t, v in got])
        averaged = np.convolve(error, np.ones(10) / 10, 'valid')  # noise of single fixes
        assert (np.abs(averaged).max() > 0.06) == worse


@pytest.mark.parametrize(('method', 'arm', 'hole'), [
    ('aid', 0.0, (2.0, 3.9)), ('aid', 0.1, (2.0, 3.9)), ('ekf', 0.0, (0.4, 2.2)),
    ('ekf', 0.1, (2.0, 3.9)), ('ekf', 0.0, (9.0, 9.0))])
def test_no_fix_is_turned_by_an_attitude_that_nobody_measured(method, arm, hole):
    """Over seconds the headings in between count, too."""
    settings = vehicle(
        ('surge', 'sway', 'yaw'), identifier=IdentifierSettings(method), max_gap=9.0,
        position=InputSettings('/fix', lever_arm=(0.0, 0.0, arm)),
        attitude=InputSettings('/imu', timeout=1.0))
    stream = Stream(settings)
    for k in range(101):
        time, half = 50_000_000 * k, 0.02 * k
        samples = [Sample('thrusters', (1.0,) * 6)]
        if not hole[0] < 0.05 * k < hole[1]:
            samples.append(Sample('attitude', (0.0, 0.0, math.sin(half), math.cos(half))))
        if k in (0, 100):
            samples.append(Sample('position', (0.05 * k, 0.0, 0.0)))
        for sample in samples:
            stream.receive(Event(time, (sample,)))
    stream.finish()
    assert stream.rejected.get(('position', 'no_attitude'), 0) == (hole[0] < 5.0)


def test_a_lever_arm_without_an_attitude_is_left_out():
    settings = vehicle(('heave',), depth=InputSettings('/depth'), attitude=InputSettings(),
                       position=InputSettings('/fix', lever_arm=(0.3, 0.0, 0.2)))
    _, estimates = identified(settings, 60.0)
    assert mass_ratios(estimates[-1])['heave'] == pytest.approx(1.0, abs=0.1)


@pytest.mark.long
def test_velocity_and_gyro_sensors_are_used_where_there_are_some():
    settings = vehicle(
        ('surge', 'heave', 'yaw'), position=InputSettings(),
        velocity=InputSettings('/dvl'), angular_velocity=InputSettings('/gyro'))
    _, estimates = identified(settings)
    for dof, ratio in mass_ratios(estimates[-1]).items():
        assert ratio == pytest.approx(1.0, abs=0.1), dof


@pytest.mark.long
@pytest.mark.parametrize('gyro_rate', [50.0, 4.0])
def test_what_turning_adds_at_a_dvl_is_taken_off(gyro_rate):
    at = InputSettings('/dvl', lever_arm=(0.5, 0.4, -0.3))
    settings = vehicle(
        ('surge', 'sway', 'yaw'), position=InputSettings(), velocity=at,
        angular_velocity=InputSettings('/gyro'))
    settings = replace(settings, cutoff=0.0, simulation=replace(
        settings.simulation, angular_velocity_rate=gyro_rate, angular_velocity_noise=0.0,
        velocity_noise=0.0))
    measured = list(simulate(settings, 60.0, 3))
    here = {t: v for t, n, v in simulate(
        replace(settings, velocity=InputSettings('/dvl')), 60.0, 3) if n == 'velocity'}
    errors = []
    for arm in ((0.5, 0.4, -0.3), (0.0, 0.0, 0.0)):
        _, estimates = identified(
            replace(settings, velocity=replace(at, lever_arm=arm)), measurements=measured)
        steps = [e for e in estimates if 0 in e.stepped]
        assert len(steps) > 500
        errors.append([max(abs(e.dofs[i].velocity - here[e.time][i]) for e in steps)
                       for i in (0, 1)])
    assert max(errors[0]) < 0.002 and min(errors[1]) > 0.04


@pytest.mark.parametrize(('again', 'refused'), [(21.5, 14), (99.0, 180)])
def test_a_dvl_with_a_lever_arm_does_not_wait_for_a_gyro_that_is_dead(again, refused):
    settings = vehicle(
        ('surge',), position=InputSettings(), angular_velocity=InputSettings('/gyro'),
        velocity=InputSettings('/dvl', lever_arm=(0.5, 0.4, 0.0)))
    measured = [(t, n, v) for t, n, v in simulate(settings, 40.0, 3)
                if n != 'angular_velocity' or not 20.0 < t * 1e-9 < again]
    stream, estimates = identified(settings, measurements=measured)
    times = [e.time * 1e-9 for e in estimates if 0 in e.stepped]
    assert not [t for t in times if 20.1 < t < again]
    assert [t for t in times if 19.8 < t < 20.0]
    assert (max(times) > 39.8) == (again < 40.0)
    assert stream.rejected['velocity', 'no_rate'] >= refused


def test_only_a_dvl_with_a_lever_arm_needs_a_gyro():
    for arm, needs in (((0.0, 0.0, 0.0), ('velocity', 'thrusters')),
                       ((0.5, 0.0, 0.0), ('velocity', 'angular_velocity', 'thrusters'))):
        settings = vehicle(('surge',), position=InputSettings(), attitude=InputSettings(),
                           velocity=InputSettings('/dvl', lever_arm=arm),
                           angular_velocity=InputSettings('/gyro'))
        assert settings.needs('surge') == needs


def test_each_velocity_is_from_the_most_direct_input():
    names = ('position', 'depth', 'attitude', 'velocity', 'angular_velocity')
    every = vehicle(('surge', 'heave', 'yaw'), **{n: InputSettings(f'/{n}') for n in names})
    assert [every.source(d) for d in every.dofs] == ['velocity', 'velocity', 'angular_velocity']
    fixes = replace(every, velocity=InputSettings(), angular_velocity=InputSettings())
    assert [fixes.source(d) for d in fixes.dofs] == ['position', 'depth', 'attitude']


@pytest.mark.long
def test_delay_and_lag_of_the_thrusters_are_undone():
    right = replace(SIX, delay=0.25, time_constant=0.4)
    settings = vehicle(('surge',), thrusters=right)
    measured = list(simulate(settings, 160.0, 1))
    errors = []
    for thrusters in (right, SIX):
        _, estimates = identified(replace(settings, thrusters=thrusters), measurements=measured)
        errors.append(abs(mass_ratios(estimates[-1])['surge'] - 1))
    assert errors[0] < 0.05 < errors[1]


def test_linear_hold_gives_the_last_step_too():
    settings = vehicle(('surge',), thrusters=replace(SIX, hold='linear'))
    _, estimates = identified(settings, duration=60.0)
    assert estimates[-1].dofs[0].steps == pytest.approx(598, abs=2)


def events(settings, duration=30.0, seed=1):
    return [Event(t, (Sample(n, v),)) for t, n, v in simulate(settings, duration, seed)]


def bits(estimates):
    """Return what can be compared: a NaN is not equal to itself."""
    return [repr(e) for e in estimates]


def feed(stream, sequence):
    out = []
    for event in sequence:
        out += stream.receive(event)
    return out + stream.finish()


def test_shifted_stamps_change_nothing():
    settings = surge_settings()
    shift = 1_700_000_000_123_456_789
    plain = feed(Stream(settings), events(settings))
    later = feed(Stream(settings), [e.replaced(time=e.time + shift) for e in events(settings)])
    assert [d.dofs[0].parameters for d in plain] == [d.dofs[0].parameters for d in later]
    assert later[-1].time == plain[-1].time + shift


def test_any_delivery_within_max_wait_gives_the_same_bits():
    settings = surge_settings()
    expected = feed(Stream(settings), events(settings))
    shuffle, latest = random.Random(1), {}

    def arrival(e):
        name = e.samples[0].input
        latest[name] = max(latest.get(name, 0), e.time + shuffle.uniform(0, 0.099) * 1e9)
        return latest[name]

    stream = Stream(settings)
    got = feed(stream, sorted(events(settings), key=arrival))
    assert bits(got) == bits(expected)
    assert stream.rejected == {}


def test_what_is_refused_changes_nothing():
    settings = surge_settings()
    clean = events(settings)
    expected = feed(Stream(settings), clean)
    bad = []
    for k, event in enumerate(clean):
        bad.append(event)
        if k % 50 == 49:
            bad.append(event)  # duplicate
            bad.append(clean[k - 40].replaced(samples=event.samples))  # backward
    stream = Stream(settings)
    assert bits(feed(stream, bad)) == bits(expected)
    assert set(stream.rejected_by_reason()) == {'duplicate', 'backward'}
    nan = Sample('position', (math.nan, 0.0, 0.0))
    stream = Stream(settings)
    with_nan = clean[:200] + [Event(clean[200].time - 1, (nan,))] + clean[200:]
    assert bits(feed(stream, with_nan)) == bits(expected)
    assert stream.rejected == {('position', 'non_finite'): 1}


def test_one_wild_fix_costs_one_step():
    settings = surge_settings()
    clean = events(settings)
    expected = feed(Stream(settings), clean)[-1].dofs[0]
    k = [i for i, e in enumerate(clean) if e.samples[0].input == 'position'][150]
    clean[k] = clean[k].replaced(samples=(Sample('position', (500.0, 0.0, 0.0)),))
    stream = Stream(settings)
    got = feed(stream, clean)[-1].dofs[0]
    assert stream.rejected == {('position', 'too_fast'): 1}
    assert got.steps == expected.steps - 1
    assert got.parameters[:3] == pytest.approx(expected.parameters[:3], rel=0.1)
    assert got.parameters[3] == pytest.approx(expected.parameters[3], abs=0.001)  # noise: 0.006


@pytest.mark.parametrize('input', ['position', 'velocity'])
def test_what_is_too_fast_costs_one_step_without_a_gate_too(input):
    inputs = {'velocity': InputSettings('/dvl'), 'position': InputSettings()}
    settings = replace(surge_settings(), gate=0.0, **(inputs if input == 'velocity' else {}))
    clean = events(settings)
    k = [i for i, e in enumerate(clean) if e.samples[0].input == input][150]
    wild = [*clean[:k], clean[k].replaced(samples=(Sample(input, (500.0, 0.0, 0.0)),)),
            *clean[k + 1:]]
    stream = Stream(settings)
    steps = [feed(one, which)[-1].dofs[0].steps
             for one, which in ((Stream(settings), clean), (stream, wild))]
    assert stream.rejected == {(input, 'too_fast'): 1}
    assert steps[1] == steps[0] - 1


def test_force_and_velocity_go_through_the_same_filter():
    """Both rise at the same time, so both are the same share of what they become."""
    settings = replace(surge_settings(), gate=0.0, position=InputSettings(),
                       velocity=InputSettings('/dvl'), cutoff=0.3)
    log = [(time, name, value) for time in range(0, 10_000_000_000, 100_000_000)
           for on in (time >= 5_000_000_000,)
           for name, value in (('attitude', (0.0, 0.0, 0.0, 1.0)), ('thrusters', (2.0 * on,)),
                               ('velocity', (0.5 * (time > 5_000_000_000), 0.0, 0.0)))]
    dofs = [estimate.dofs[0] for estimate in run(Stream(settings), log)]
    rising = [dof for dof in dofs if 0.01 < dof.velocity < 0.49]
    assert len(rising) > 10
    for dof in rising:
        assert dof.force / 80.0 == pytest.approx(dof.velocity / 0.5)


def test_a_step_that_is_refused_is_none_and_says_so():
    stream = Stream(surge_settings(method='ekf'))
    log = list(simulate(stream.settings, 12.0, 1))
    wild = [(time, name, (1e9,)) if name == 'thrusters' and 6e9 < time < 7e9
            else (time, name, value) for time, name, value in log]
    estimates = run(stream, wild)
    refused = [e.dofs[0] for e in estimates if e.dofs[0].status == 'invalid']
    assert len(refused) >= 8
    assert all(dof.reasons == ('out_of_range',) for dof in refused)
    assert stream.rejected['surge', 'out_of_range'] == len(refused)
    assert estimates[-1].dofs[0].steps == len(estimates) - len(refused)
    assert estimates[-1].dofs[0].status != 'invalid'


def test_a_shift_of_the_fix_is_taken_up_once_it_is_no_echo():
    settings = surge_settings()
    clean = events(settings)
    moved = [e.replaced(samples=(Sample('position', tuple(x + 5.0 for x in e.samples[0].value)),))
             if e.samples[0].input == 'position' and e.time > 15e9 else e for e in clean]
    stream = Stream(settings)
    got = feed(stream, moved)
    assert stream.rejected == {('position', 'too_fast'): 5, ('position', 'shifted'): 1}
    assert max(abs(e.dofs[0].velocity) for e in got) < 1.0


@pytest.mark.parametrize('spoilt', ['position', 'depth'])
def test_what_one_source_refuses_does_not_reach_the_others(spoilt):
    settings = vehicle(('surge', 'heave'), depth=InputSettings('/depth'), max_speed=3.0)
    tilted = (0.0, math.sin(0.15), 0.0, math.cos(0.15))
    steady = [Event(e.time, (Sample('attitude', tilted),)) if e.samples[0].input == 'attitude'
              else e for e in events(settings)]
    highest = []
    for wild in (False, True):
        sequence = [Event(e.time, (Sample(spoilt, (8.0, 0.0, 0.0)[:len(e.samples[0].value)]),))
                    if wild and e.samples[0].input == spoilt and k % 97 == 0 else e
                    for k, e in enumerate(steady)]
        stream = Stream(settings)
        got = feed(stream, sequence)
        assert bool(stream.rejected) == wild
        highest.append(max(abs(d.velocity) for e in got for d in e.dofs if d.steps))
    assert highest[1] < 1.3 * highest[0]


def test_depth_without_heave_still_turns_the_surge():
    settings = vehicle(('surge',), depth=InputSettings('/depth'))
    climb = (0.0, math.sin(-0.15), 0.0, math.cos(-0.15))  # nose up by 0.3 rad
    sequence = []
    for k in range(1200):
        t, x = k * 10_000_000, 0.5 * k * 0.01  # 0.5 m/s ahead
        z = x * math.sin(0.3)
        sequence.append(Event(t, (Sample('thrusters', (0.0,) * 6),)))
        sequence.append(Event(t, (Sample('attitude', climb),)))
        if k % 5 == 0:
            sequence.append(Event(t, (Sample('depth', (z,)),)))
        if k % 10 == 0:
            sequence.append(Event(t, (Sample('position', (x * math.cos(0.3), 0.0, 77.0)),)))
    for dead in (False, True):  # once the depth has died, z of the position counts
        got = feed(Stream(settings), [e for e in sequence if not dead or e.time < 6e9
                                      or e.samples[0].input != 'depth'])
        expected = 0.5 * math.cos(0.3) ** 2 if dead else 0.5
        assert got[-1].dofs[0].velocity == pytest.approx(expected, abs=1e-6)


def test_memory_does_not_grow_without_fixes():
    settings = vehicle(('surge', 'yaw'))
    stream = Stream(settings)
    for event in events(settings, 60.0):
        if event.samples[0].input != 'position' or event.time < 5e9:
            stream.receive(event)
    assert max(lengths(stream)) < 400


def test_a_restored_state_shows_in_every_dof():
    settings = vehicle(('surge', 'yaw'))
    stream = Stream(settings)
    state = stream.state()
    state['dofs']['surge']['parameters'][0] = 1 / 500
    stream.restore(state)
    yaw_only = [e for e in events(settings, 3.0) if e.samples[0].input != 'position']
    assert feed(stream, yaw_only)[-1].dofs[0].parameters[0] == 1 / 500


def test_one_topic_per_thruster_moves_the_simulated_vehicle():
    settings = vehicle(('surge',), thrusters=replace(
        SIX, topics=tuple(f'/thruster/{i}' for i in range(6))))
    positions = [v[0] for _, n, v in simulate(settings, 10.0, 1) if n == 'position']
    assert max(positions) > 0.5


def test_messages_further_apart_than_max_gap_are_told():
    settings = replace(surge_settings(), max_gap=0.05)
    stream = Stream(settings)
    assert feed(stream, events(settings)) == []
    assert 'max_gap' in ' '.join(stream.take_warnings())


def test_after_a_gap_filter_and_v_hat_restart_from_the_measurement():
    settings = surge_settings()
    sequence = [e for e in events(settings, 60.0) if e.samples[0].input != 'position'
                or not 20e9 < e.time < 25e9]
    stream = Stream(settings)
    estimates = feed(stream, sequence)
    assert stream.rejected == {('position', 'gap'): 1}
    jump = [b for a, b in zip(estimates, estimates[1:]) if b.time - a.time > 4e9]
    assert len(jump) == 1
    assert abs(jump[0].dofs[0].dv) < 0.1
    assert estimates[-1].dofs[0].steps > 500


def test_no_step_leads_over_a_gap_of_a_velocity_sensor():
    settings = replace(surge_settings(), position=InputSettings(),
                       velocity=InputSettings('/dvl'))
    sequence = [
        Event(time, (Sample(name, value),)) for time in range(0, 20_000_000_000, 100_000_000)
        for name, value in (('attitude', (0.0, 0.0, 0.0, 1.0)), ('thrusters', (0.5,)),
                            ('velocity', (1e-11 * time, 0.0, 0.0)))
        if name != 'velocity' or not 5e9 < time < 10e9]
    stream = Stream(settings)
    times = [estimate.time for estimate in feed(stream, sequence)]
    assert stream.rejected[('velocity', 'gap')] == 1
    assert 10_000_000_000 not in times  # it has begun anew there
    assert 10_100_000_000 in times


def test_a_dead_thruster_topic_stops_the_steps():
    settings = surge_settings()
    sequence = [e for e in events(settings, 30.0) if e.samples[0].input != 'thrusters'
                or e.time < 10e9]
    stream = Stream(settings)
    estimates = feed(stream, sequence)
    assert 10e9 < estimates[-1].time <= 11e9  # timeout 1 s
    assert stream.rejected[('position', 'stale_thrust')] > 100


def test_no_step_before_the_first_command_or_attitude():
    settings = surge_settings()
    for missing, reason in (('thrusters', 'no_thrust'), ('attitude', 'no_attitude')):
        stream = Stream(settings)
        assert feed(stream, [e for e in events(settings) if e.samples[0].input != missing]) == []
        assert stream.rejected[('position', reason)] > 100


def test_reset_enable_and_a_jump_of_time():
    settings = surge_settings()
    sequence = events(settings, 20.0)
    stream = Stream(settings)
    initial = stream.state()['dofs']['surge']['parameters']
    feed(stream, sequence)
    stream.enable(False)
    frozen = stream.estimate.dofs[0].parameters
    later = [e.replaced(time=e.time + 20_000_000_000) for e in sequence]
    estimates = feed(stream, later)
    assert {e.dofs[0].parameters for e in estimates[1:]} == {frozen}
    assert estimates[-1].dofs[0].status == 'frozen'
    stream.enable(True)
    stream.reset()
    assert stream.state()['dofs']['surge']['parameters'] == initial
    again = feed(stream, sequence)  # back by 20 s: a jump
    assert bits(again) == bits(feed(Stream(settings), sequence))
    assert 'time jumped back' in stream.take_warnings()[0]


def test_parameters_survive_a_jump_when_told_so():
    settings = replace(surge_settings(), reset_on_time_jump=False)
    stream = Stream(settings)
    feed(stream, events(settings, 20.0))
    before = stream.state()['dofs']['surge']['parameters']
    for event in events(settings)[:3]:  # all inputs, back by 20 s
        stream.receive(event)
    assert 'time jumped back' in stream.take_warnings()[0]
    assert stream.state()['dofs']['surge']['parameters'] == before


def test_recorded_controls_replay_to_the_same_bits():
    class Note(list):
        def released(self, event):
            self.append(event)

        def controlled(self, name, value):
            self.append((name, value))

    settings = vehicle(('surge', 'heave', 'yaw'), depth=InputSettings('/depth'))
    note, live = Note(), []
    stream = Stream(settings, recorder=note)
    sequence = events(settings, 40.0)
    for k, event in enumerate(sequence):
        live += stream.receive(event)
        if k == 500:
            stream.enable(False)
        elif k == 900:
            stream.enable(True)
        elif k == 1200:
            stream.reset()
    live += feed(stream, sequence)  # starts with a jump back
    again, other = [], Stream(settings)
    for item in note:
        again += other.receive(item) if isinstance(item, Event) else other.control(*item)
    assert bits(again + other.finish()) == bits(live)


def test_a_state_of_another_configuration_is_refused():
    settings = surge_settings()
    stream = Stream(settings)
    state = stream.state()
    for key, value in (('version', 2), ('method', 'ekf'), ('dofs', {'yaw': {}}), ('dofs', 3)):
        with pytest.raises(ValueError):
            stream.restore({**state, key: value})
    broken = {**state, 'dofs': {'surge': {**state['dofs']['surge'], 'parameters': ['x'] * 4}}}
    with pytest.raises(ValueError, match='surge'):
        stream.restore(broken)
    assert stream.state() == state


@pytest.mark.long
def test_magnitudes_without_a_sign_are_told_and_a_sign_input_heals_them():
    settings = vehicle(('surge',))
    measured = list(simulate(settings, 200.0, 1))
    folded = []
    for time, name, value in measured:
        if name == 'thrusters':
            folded.append((time, name, tuple(map(abs, value))))
            folded.append((time, 'sign', tuple(math.copysign(1.0, x) for x in value)))
        else:
            folded.append((time, name, value))
    stream, _ = identified(settings, measurements=[m for m in folded if m[1] != 'sign'])
    assert 'thrusters.sign' in stream.take_warnings()[0]
    signed = replace(settings, sign=InputSettings('/sign'))
    stream, estimates = identified(signed, measurements=folded)
    assert stream.rejected == {}
    assert mass_ratios(estimates[-1])['surge'] == pytest.approx(1.0, abs=0.1)
    assert stream.take_warnings() == []


def test_slow_sampling_clamps_the_cutoff_and_says_so():
    settings = replace(surge_settings(), cutoff=6.0)
    stream = Stream(settings)
    feed(stream, events(settings))
    assert 'velocity.cutoff' in stream.take_warnings()[0]


@pytest.mark.long
def test_the_truth_scores_noise_against_the_pipe_and_nothing_against_a_reference():
    noiseless = {'position_noise': 0.0, 'attitude_noise': 0.0}
    for reference, limit in ((InputSettings(), 5e-4), (InputSettings('/truth'), 3e-4)):
        settings = replace(vehicle(('surge',)), reference=reference)
        settings = replace(settings, simulation=replace(settings.simulation, **noiseless))
        log = ScoreLog(settings)
        identified(settings, scorer=log)
        truth = lumped(290.0, 290.0, 43.5, 2.9)
        assert log.score('surge', truth).mae < limit
        assert log.score('surge', truth).fit > 0.99
        wrong = [truth[0] * 0.8, *truth[1:]]
        assert log.score('surge', wrong).mae > 10 * limit


def test_a_dof_that_nothing_pushes_says_so():
    settings = vehicle(('surge', 'yaw'))
    settings = replace(settings, simulation=replace(settings.simulation, dofs={
        'surge': TRUTH['surge'], 'yaw': replace(TRUTH['yaw'], forces=(), frequencies=())}))
    surge, yaw = feed(Stream(settings), events(settings))[-1].dofs
    assert (surge.status, yaw.status, yaw.reasons) == ('converging', 'unexcited', ('no thrust',))


def test_scales_far_from_the_data_are_told_with_what_to_set():
    settings = surge_settings(DofSettings(20.0))
    stream = Stream(settings)
    feed(stream, events(settings, 120.0))
    assert any('rest' in w and 'set surge.typical.force' in w for w in stream.take_warnings())
    stream = Stream(surge_settings())
    feed(stream, events(settings, 120.0))
    assert stream.take_warnings() == []


@pytest.mark.long
@pytest.mark.parametrize(('velocity', 'duration', 'told'), [
    (5.0, 100.0, False),  # it may not have been driven yet
    (0.3, 100.0, True), (5.0, 310.0, True)])
def test_a_dof_that_hardly_moves_yet_has_no_wrong_sizes(velocity, duration, told):
    settings = surge_settings(DofSettings(300.0, typical_force=2000.0, typical_velocity=velocity))
    stream = Stream(settings)
    feed(stream, events(settings, duration))
    stream.finish()
    assert any('set surge.typical.force' in w for w in stream.take_warnings()) is told


@pytest.mark.long
def test_sizes_of_a_whole_log_are_judged_at_its_end():
    settings = surge_settings(DofSettings(300.0, typical_force=2000.0, typical_velocity=5.0))
    for whole in (False, True):
        stream = Stream(settings, whole=whole)
        for event in events(settings, 310.0):
            stream.receive(event)
        early = [w for w in stream.take_warnings() if 'set surge.typical.force' in w]
        stream.finish()
        late = [w for w in stream.take_warnings() if 'set surge.typical.force' in w]
        assert (len(early), len(late)) == ((0, 1) if whole else (1, 0))


@pytest.mark.long
def test_w_is_published_where_the_truth_is_known():
    settings = surge_settings()
    assert math.isnan(feed(Stream(settings), events(settings))[-1].dofs[0].W)
    known = replace(settings, simulation=replace(settings.simulation, publish_w=True))
    values = [e.dofs[0].W for e in feed(Stream(known), events(known, 200.0))]
    assert 0.0 < values[-1] < 0.1 * values[0]


@pytest.fixture(scope='module')
def second():
    """Return a second of sound samples."""
    return events(vehicle(('surge', 'heave', 'yaw'), depth=InputSettings('/depth')), 1.0)


wild = st.floats(allow_nan=True, allow_infinity=True)
samples = st.one_of(
    st.tuples(st.just('position'), st.tuples(wild, wild, wild)),
    st.tuples(st.just('attitude'), st.tuples(wild, wild, wild, wild)),
    st.tuples(st.just('thrusters'), st.tuples(*[wild] * 6)),
    st.tuples(st.just('depth'), st.tuples(wild)))


@pytest.mark.long
@given(st.lists(st.tuples(st.sampled_from([0, 1, 10**6, 10**8, 10**10, -10**6, -10**10]),
                          samples), max_size=60), st.floats(0.05, 1e4))
@hypothesis_settings(max_examples=200, deadline=None)
def test_no_stream_of_samples_breaks_the_pipe(second, moves, adaptation_time):
    settings = vehicle(('surge', 'heave', 'yaw'), depth=InputSettings('/depth'),
                       identifier=IdentifierSettings(adaptation_time=adaptation_time))
    stream = Stream(settings)
    feed(stream, second)
    time, estimates = 10**9, []
    for step, (name, value) in moves:
        time += step
        estimates += stream.receive(Event(time, (Sample(name, value),)))
    estimates += feed(stream, [e.replaced(time=e.time + time + 10**9) for e in second])
    for estimate in estimates:
        for dof in estimate.dofs:
            assert all(map(math.isfinite, dof.parameters))
            assert dof.parameters[0] > 0.0
            assert max(dof.parameters[1:3]) <= 0.0
            assert math.isfinite(dof.excitation)


def test_rotations_agree_with_matrices():
    rng = np.random.default_rng(0)

    def matrix(q):
        x, y, z, w = q
        k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.eye(3) + 2 * w * k + 2 * k @ k

    for _ in range(50):
        p, q = (normalised(tuple(rng.normal(size=4))) for _ in range(2))
        v = tuple(rng.normal(size=3))
        assert rotate(p, v) == pytest.approx(matrix(p) @ v)
        assert matrix(product(p, q)) == pytest.approx(matrix(p) @ matrix(q))
        assert matrix(turned(p, rotation_between(p, q), 1.0)) == pytest.approx(matrix(q))
        minus = tuple(-x for x in q)
        assert rotation_between(p, minus) == pytest.approx(rotation_between(p, q))
    assert rotate(from_yaw(math.pi / 2), (1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0))
    assert rotation_between(from_yaw(3.1), from_yaw(-3.1))[2] == pytest.approx(2 * math.pi - 6.2)


@pytest.mark.parametrize(('changes', 'key'), [
    ({'dofs': ()}, 'dofs'),
    ({'dofs': ('surge', 'yow')}, 'dofs'),
    ({'attitude': InputSettings()}, 'attitude.topic'),
    ({'position': InputSettings()}, 'dofs'),
    ({'velocity': InputSettings('/dvl', lever_arm=(0.5, 0.0, 0.0))}, 'velocity.lever_arm'),
    ({'identifier': IdentifierSettings(feedback_gain=-1.0)}, 'identifier.feedback_gain'),
    ({'identifier': IdentifierSettings(feedback_gain=-1.0, adaptation_gains=(1.0,))},
     'identifier.adaptation_gains'),
    ({'dof': {'surge': DofSettings(-1.0)}}, 'surge.initial.mass'),
    ({'dof': {'surge': DofSettings(1.0, terms=('beta',))}}, 'surge.terms'),
])
def test_settings_that_contradict_name_their_key(changes, key):
    with pytest.raises(SettingsError) as caught:
        replace(surge_settings(), **changes)
    assert caught.value.key == key
