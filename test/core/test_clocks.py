"""Clocks that step and messages in the wrong order, put into the simulated stream."""

from dataclasses import replace
import math
from random import Random

import pytest
from rovid_core.model.samples import Event, Sample
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import InputSettings
from rovid_core.velocity.attitude_history import AttitudeHistory, from_yaw

from test.support.injected_faults import (
    arriving,
    clean,
    DURATION,
    feed,
    run,
    seconds,
    spoilt,
    START,
    stepped,
    undisturbed,
    vehicle,
    worse,
)
from test.support.memory import lengths

pytestmark = pytest.mark.long

ALL = ('position', 'depth', 'attitude', 'thrusters')
UNHEARD = {'no_attitude', 'stale_thrust', 'no_thrust', 'gap'}
"""Reasons of what lacks the input whose clock is off."""

HOUR, SINCE_1970 = 3600.0, START * 1e-9
EXPECTED = {  # of the input itself
    0.5: {'backward', 'duplicate', 'outlier', 'late', 'gap'}, -0.5: {'backward', 'late'},
    10.0: {'future'}, -10.0: {'backward', 'late'},
    HOUR: {'future'}, -HOUR: {'backward'}, -SINCE_1970: {'backward'}}


def check_refusals(refused, input, by):
    """Check what is refused while the clock of an input is off: its own, and what lacks it."""
    own = {reason for i, reason in refused if i == input}
    assert own <= EXPECTED[by] | UNHEARD | {'duplicate'}
    assert own & EXPECTED[by]
    others = {reason for i, reason in refused if i != input}
    assert others <= UNHEARD | ({'late', 'outlier'} if by == 0.5 else set())


def check_warnings(stream):
    warnings = stream.take_warnings()
    assert warnings  # which clock is off; no jump of time, nothing reset
    assert not any('reset' in warning for warning in warnings)


@pytest.mark.parametrize('by', [0.5, -0.5])
@pytest.mark.parametrize('input', ['position', 'thrusters', 'attitude'])
def test_the_clock_of_one_input_steps_a_little_for_20_s(input, by):
    stream = run(vehicle(), stepped((input,), 100.0, 120.0, by))
    assert worse(stream) < 1.05
    check_refusals(stream.rejected, input, by)
    check_warnings(stream)
    assert stream.estimate.dofs[0].steps > 0.8 * DURATION * 10.0


@pytest.mark.parametrize('by', [by for by in EXPECTED if abs(by) > 1.0])
def test_the_clock_of_one_input_after_the_other_steps_for_20_s(by):
    events, starts = clean(), {'position': 40.0, 'thrusters': 100.0, 'attitude': 160.0}
    for input, start in starts.items():
        events = stepped((input,), start, start + 20.0, by, events)
    stream = Stream(vehicle())
    assert feed(stream, arriving(events, 0.0, 40.0)) == set()
    for input, start in starts.items():
        check_refusals(feed(stream, arriving(events, start, start + 50.0)), input, by)
        check_warnings(stream)
        assert feed(stream, arriving(events, start + 50.0, start + 60.0)) == set()
    feed(stream, arriving(events, 220.0))
    assert worse(stream) < 1.05
    assert stream.estimate.dofs[0].steps > 0.7 * DURATION * 10.0


@pytest.mark.parametrize('by', EXPECTED)
def test_all_clocks_step_for_20_s(by):
    stream = run(vehicle(), stepped(ALL, 60.0, 80.0, by))
    assert worse(stream) < 1.1
    reset = any('parameters reset' in warning for warning in stream.take_warnings())
    assert reset == (abs(by) > 1.0)  # either there or back it is a jump
    assert set(stream.rejected_by_reason()) <= {
        'backward', 'duplicate', 'outlier', 'shifted', 'gap', 'discarded'}
    assert sum(stream.rejected.values()) < 80


@pytest.mark.parametrize('inputs', [('position',), ('thrusters',), ('attitude',), ALL])
def test_stamps_are_seconds_since_boot_before_the_clock_is_set(inputs):
    stream = run(vehicle(), stepped(inputs, 0.0, 20.0, 12.0 - SINCE_1970))
    assert worse(stream) < 1.05
    if inputs == ALL:
        assert set(stream.rejected_by_reason()) == {'gap'}
        return
    assert {reason for i, reason in stream.rejected if i == inputs[0]} <= {'late', 'gap'}
    assert f'the stamps of {inputs[0]} are 16999999' in stream.take_warnings()[0]


def test_disorder_within_max_wait_changes_nothing():
    random, latest = Random(3), {}

    def arrival(event):
        name = event.samples[0].input
        latest[name] = max(latest.get(name, 0), event.time + random.uniform(0, 0.099) * 1e9)
        return latest[name]

    events = spoilt('position', lambda t, v, random: tuple([x + 3.0 for x in v])
                    if random.random() < 0.1 else v)
    straight, mixed = run(vehicle(), events), run(vehicle(), sorted(events, key=arrival))
    assert repr(straight.estimate) == repr(mixed.estimate)
    assert straight.rejected == mixed.rejected


def test_duplicates_and_messages_of_before_are_counted_and_change_nothing():
    events, (_, expected) = [], undisturbed()
    for k, event in enumerate(clean()):
        events.append(event)
        if k % 50 == 49:
            events += [event, clean()[k - 40].replaced(samples=event.samples)]
    stream = run(vehicle(), events)
    assert repr(stream.estimate) == repr(expected)
    assert set(stream.rejected_by_reason()) == {'duplicate', 'backward'}


@pytest.mark.parametrize('stamped', [True, False], ids=['old stamps', 'new stamps'])
def test_a_burst_after_a_stall(stamped):
    out, stalled = [], []
    for event in clean():
        if event.samples[0].input == 'position' and 100.0 <= seconds(event) < 103.0:
            stalled.append(event)
            continue
        if stalled and seconds(event) > 103.0:
            out += stalled if stamped else [
                e.replaced(time=event.time - 2000 * (len(stalled) - k))
                for k, e in enumerate(stalled)]
            stalled = []
        out.append(event)
    stream = run(vehicle(), out)
    assert worse(stream) < 1.02
    reasons = {reason for input, reason in stream.rejected}
    assert reasons <= ({'late', 'gap'} if stamped else {
        'gap', 'burst', 'too_fast', 'outlier', 'shifted'})


def test_a_fix_right_after_the_first_one_of_a_pause_is_no_motion():
    fixes = [e for e in clean(40.0) if not (
        e.samples[0].input == 'position' and 30.0 < seconds(e) < 30.6)]
    k = next(k for k, e in enumerate(fixes) if e.samples[0].input == 'position' and
             seconds(e) > 30.0)
    x, y, z = fixes[k].samples[0].value
    again = Event(fixes[k].time + 20_000, (Sample('position', (x + 0.002, y, z)),))
    stream = run(vehicle(), [*fixes[:k + 1], again, *fixes[k + 1:]])
    assert stream.rejected == {('position', 'burst'): 1}
    usual = run(vehicle(), fixes)
    for one, other in zip(stream.estimate.dofs, usual.estimate.dofs):
        assert (one.parameters, one.velocity, one.v_hat) == (
            other.parameters, other.velocity, other.v_hat)


def test_values_that_are_no_numbers_cost_themselves():
    events, bad, starts = clean(), (math.nan, math.inf, -math.inf, 1e300), (10.0, 20.0, 30.0, 40.0)
    for input, start in zip(ALL, starts):
        events = spoilt(input, lambda t, v, random, start=start: (bad[int(t / 60.0)],) * len(v)
                        if start <= t % 60.0 < start + 0.5 else v, events)
    stream = Stream(vehicle())
    for k in range(len(bad)):
        refused = feed(stream, arriving(events, 60.0 * k, 60.0 * (k + 1)))
        for input in ALL:
            own = {reason for i, reason in refused if i == input}
            assert own & ({'too_fast', 'not_a_rotation', 'not_a_command', 'outlier'}
                          if bad[k] == 1e300 else {'non_finite'})
    assert worse(stream) < 1.05


@pytest.mark.parametrize(('input', 'reason'), [
    ('depth', 'gap'), ('position', 'gap'), ('attitude', 'no_attitude')])
def test_each_input_has_a_timeout_of_its_own(input, reason):
    """2 s of nothing, with timeouts of 1 and 3 s: only the long one bridges it."""
    holed = [e for e in clean(30.0) if e.samples[0].input != input
             or not 20.0 < seconds(e) < 22.0]
    settings = replace(vehicle(), max_gap=1.0)
    for timeout, missing in ((0.0, True), (1.5, True), (3.0, False)):
        stream = run(replace(settings, **{
            input: replace(settings.input(input), timeout=timeout)}), holed)
        assert (reason in stream.rejected_by_reason()) == missing, timeout
    assert settings.timeout_of(input) == settings.max_gap
    assert replace(settings, depth=replace(settings.depth, timeout=7.0)).timeout_of('depth') == 7.0


def test_a_direction_that_is_silent_is_no_direction():
    settings = replace(vehicle(), sign=InputSettings('/sign'))
    events = []
    for event in clean(30.0):
        sample = event.samples[0]
        if sample.input == 'thrusters' and seconds(event) < 10.0:
            events.append(event.replaced(samples=(Sample('sign', sample.value), sample)))
        else:
            events.append(event)
    stream = Stream(settings)
    for event in events:
        stream.receive(event)
    stream.finish()
    assert stream.rejected[('thrusters', 'stale_sign')] == pytest.approx(190, abs=5)


def test_memory_is_bounded_however_close_the_stamps_are():
    settings = vehicle()
    stream = Stream(settings)
    for event in clean(5.0):
        stream.receive(event)
    now = START + 6_000_000_000
    for k in range(80_000):  # a nanosecond apart, and no attitude comes that they could wait for
        stream.receive(Event(now + k, (Sample('position', (0.1, 0.0, 0.0)),)))
        stream.receive(Event(now + k, (Sample('thrusters', (1.0, 1.0, 0.0)),)))
    assert max(lengths(stream)) <= 66_000


def test_memory_does_not_grow_under_an_hour_of_faults():
    """Every second something else is wrong; what is kept is that of the last seconds."""
    settings = vehicle()
    stream, random, largest = Stream(settings), Random(5), []
    for k in range(20):
        for event in clean(30.0):
            event = event.replaced(time=event.time + k * 30_000_000_000)
            fault = random.random()
            if fault < 0.02:
                event = event.replaced(time=event.time + random.choice(
                    (-20, -3, 2, 5000)) * 10**9)
            elif fault < 0.05:
                sample = event.samples[0]
                event = event.replaced(samples=(sample.replaced(value=tuple(
                    [x * random.choice((math.nan, 1e6, -1.0)) for x in sample.value])),))
            stream.receive(event)
        largest.append(sum(lengths(stream)))
    assert max(largest) < 8000  # four minutes that are gone through again
    assert len(stream.rejected) < 60


def test_a_gap_says_nothing_of_the_noise_of_the_attitude():
    history, random = AttitudeHistory(1_000_000_000, 2_000_000_000), Random(1)
    for k in range(200):
        history.add_sample(k * 50_000_000, from_yaw(random.gauss(0.0, 0.002)))
    before = history.noise_density
    assert 0.0 < before < 1e-5
    history.add_sample(1_700_000_000_000_000_000, from_yaw(1.0))  # the clock has been set
    assert history.noise_density == before
