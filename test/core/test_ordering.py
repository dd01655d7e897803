"""Event-time ordering: only event times decide."""

import random

from hypothesis import given, settings as hypothesis_settings, strategies as st
import pytest
from rovid_core.model.samples import Event, Sample
from rovid_core.ordering.event_order import EventOrder

from test.support.memory import lengths

MS = 1_000_000
INPUTS = [('position', 0), ('attitude', 0), ('thrusters', 0)]


class Order:
    """An order that notes what it is told."""

    def __init__(self, max_wait=0.1, time_jump=1.0, inputs=INPUTS):
        self.rejected, self.warnings = [], []
        self.order = EventOrder(inputs, max_wait, time_jump,
                                lambda i, r: self.rejected.append((i, r)),
                                self.warnings.append)

    def push(self, ms, *inputs):
        released, self.jumped = self.order.push(event(ms, *inputs))
        return named(released)

    def feed(self, events):
        out = []
        for e in events:
            out += self.order.push(e)[0]
        return out + self.order.flush()


def event(ms, *inputs):
    return Event(round(ms * MS), tuple(Sample(i, (0.0,)) for i in inputs))


def named(events):
    return [(e.time // MS, e.samples[0].input) for e in events]


def stream(count=200):
    """Three inputs at their own rates, in the order of event time."""
    events = [event(100 * k, 'position') for k in range(count // 10)]
    events += [event(20 * k, 'attitude') for k in range(count // 2)]
    events += [event(50 * k + 3, 'thrusters') for k in range(count // 5)]
    rank = [name for name, _ in INPUTS].index
    return sorted(events, key=lambda e: (e.time, rank(e.samples[0].input)))


def test_nobody_waits_for_a_reference_that_comes_late():
    # positions fail after a second: the others wait for them as long as they may
    events = [e for e in stream(1000) if e.samples[0].input != 'position' or e.time < 1000 * MS]
    late = [event(e.time / MS - 500, 'reference') for e in events if e.time > 600 * MS]
    released = []
    for behind in ([], late):
        order = EventOrder(INPUTS, 0.1, 1.0, lambda i, r: None, lambda line: None, grows=True)
        waiting, out = iter(behind), []
        for e in events:
            out.append([x for x in named(order.push(e)[0]) if x[1] != 'reference'])
            if e.time > 600 * MS and behind:
                order.push(next(waiting))
        released.append(out)
    assert released[0] == released[1]


def test_released_as_soon_as_every_other_input_has_come_as_far():
    order = Order()
    assert order.push(0, 'position') == []
    assert order.push(1, 'attitude') == []
    assert order.push(2, 'thrusters') == [(0, 'position')]
    assert order.push(3, 'position') == [(1, 'attitude')]


def test_released_at_the_latest_after_max_wait():
    order = Order()
    order.push(0, 'position')
    assert order.push(50, 'thrusters') == []
    assert order.push(100, 'position') == []
    assert order.push(101, 'position') == [(0, 'position')]


def test_max_wait_0_holds_nothing_once_two_inputs_agree():
    order = Order(max_wait=0.0)
    order.push(0, 'position')
    assert order.push(1, 'attitude') == [(0, 'position'), (1, 'attitude')]
    assert order.push(2, 'position') == [(2, 'position')]


def test_ties_go_in_the_order_of_the_inputs():
    order = Order()
    for name in ('thrusters', 'attitude'):
        order.push(5, name)
    assert order.push(5, 'position') == [
        (5, 'position'), (5, 'attitude'), (5, 'thrusters')]


@given(st.integers(0, 2**32))
@hypothesis_settings(max_examples=50, deadline=None)
def test_any_delivery_within_max_wait_gives_the_same_sequence(seed):
    shuffle = random.Random(seed)
    expected = stream()
    order = Order()
    delays = {}

    def arrival(e):  # each input keeps its own order, as DDS does
        name = e.samples[0].input
        late = e.time + shuffle.uniform(0.0, 0.099) * 1e9
        delays[name] = max(delays.get(name, 0.0), late)
        return delays[name]

    delivered = sorted(expected, key=arrival)
    assert order.feed(delivered) == expected
    assert order.rejected == []


def test_late_duplicate_and_backward_are_dropped_and_counted():
    order = Order()
    for ms in (0, 200, 400):
        order.push(ms, 'position')
        order.push(ms, 'attitude')
    order.push(250, 'thrusters')
    order.push(400, 'attitude')
    order.push(390, 'attitude')
    assert order.rejected == [
        ('thrusters', 'late'), ('attitude', 'duplicate'), ('attitude', 'backward')]
    assert not order.jumped


def test_back_by_more_than_time_jump_starts_anew():
    order = Order()
    for ms in (5000, 5010):
        order.push(ms, 'position')
        order.push(ms, 'attitude')
    order.push(1000, 'position')
    assert not order.jumped  # one stamp may be wrong
    assert order.push(1001, 'attitude') == []
    assert order.jumped
    assert ('attitude', 'discarded') in order.rejected
    assert order.push(1102, 'thrusters') == [(1000, 'position'), (1001, 'attitude')]
    assert not order.jumped


def test_one_stamp_far_back_is_dropped():
    order = Order()
    for ms in (5000, 5020, 5040):
        order.push(ms, 'position')
        order.push(ms - 3000 if ms == 5020 else ms, 'attitude')
        assert not order.jumped
    assert order.rejected == [('attitude', 'backward')]


def test_an_input_alone_can_jump_back():
    order = Order(inputs=[('position', 0), ('thrusters', 0)])
    for ms in (5000, 5020):
        order.push(ms, 'position')
        order.push(ms, 'thrusters')
    released = []
    for ms in range(100, 1121, 20):  # a second, in which the other is silent
        assert not order.jumped
        released += order.push(ms, 'position')
    assert order.jumped
    assert released[0] == (100, 'position')


def test_a_clock_that_steps_back_alone_is_refused_and_told():
    order = Order()
    for k in range(500):
        order.push(20 * k + 60_000, 'position')
        order.push(20 * k + 60_000, 'attitude')
        order.push(20 * k + (60_000 if k < 100 or k >= 400 else 50_000), 'thrusters')
        assert not order.jumped
    assert set(order.rejected) == {('thrusters', 'backward')}
    assert len(order.rejected) == 300
    assert len(order.warnings) == 1
    assert 'thrusters have gone back by 10.0 s' in order.warnings[0]


def test_a_log_of_whole_messages_starts_again():
    order = Order()
    for k in range(100):
        order.push(60_000 + 20 * k, 'position', 'attitude', 'thrusters')
    order.push(0, 'position', 'attitude', 'thrusters')
    assert not order.jumped
    order.push(20, 'position', 'attitude', 'thrusters')
    assert order.jumped


@pytest.mark.long
def test_events_that_nothing_releases_are_bounded():
    order = Order(inputs=[('position', 0), ('thrusters', 0)])
    order.push(0, 'position')
    order.push(0, 'thrusters')
    for k in range(70_000):
        order.push(10 * k, 'reference')
    assert max(lengths(order.order)) <= 65_536


def test_one_stamp_far_ahead_moves_nothing():
    order = Order()
    for ms in (0, 10):
        order.push(ms, 'position')
        order.push(ms, 'attitude')
    assert order.push(90_000, 'thrusters') == []
    assert order.push(20, 'thrusters') == [(0, 'position'), (0, 'attitude'),
                                           (10, 'position'), (10, 'attitude')]
    assert order.rejected == [('thrusters', 'future')]


def test_a_pause_of_everything_goes_on_when_two_inputs_agree():
    order = Order()
    for ms in (0, 10):
        for name, _ in INPUTS:
            order.push(ms, name)
    assert order.push(60_000, 'position') == []
    assert order.push(60_010, 'position') == []
    released = order.push(60_005, 'attitude')
    assert released[:1] == []  # thrusters may still come
    assert order.push(60_120, 'attitude') == [
        (60_000, 'position'), (60_005, 'attitude'), (60_010, 'position')]
    assert order.rejected == []


def test_a_wild_first_stamp_does_not_decide_the_time():
    order = Order()
    order.push(10**9, 'thrusters')
    order.push(0, 'position')
    order.push(5, 'attitude')
    assert order.push(7, 'thrusters') == [(0, 'position')]
    assert order.rejected == [('thrusters', 'future')]


def test_a_clock_that_is_ahead_is_told_and_hurts_nobody():
    order = Order()
    for k in range(1000):
        order.push(20 * k, 'position')
        order.push(20 * k, 'attitude')
        order.push(20 * k + 7000, 'thrusters')
    assert order.rejected == []
    assert len(order.warnings) == 1
    assert 'thrusters are 7.0 s ahead' in order.warnings[0]


def test_a_clock_that_steps_ahead_alone_is_refused_and_told():
    order, released = Order(), []
    for k in range(1000):
        for name, _ in INPUTS:
            released += order.push(20 * k + (
                7000 if name == 'thrusters' and 100 <= k < 900 else 0), name)
    assert set(order.rejected) == {('thrusters', 'future')}
    assert len(order.rejected) == 800
    assert len(order.warnings) == 1
    assert 'thrusters are 7.0 s ahead' in order.warnings[0]
    assert 'refused until its clock is right' in order.warnings[0]
    assert len(released) > 2190


def test_a_step_ahead_between_bursts_is_refused_however_the_inputs_take_turns():
    order = Order(max_wait=5.0)
    for second in range(60):
        for name, _ in INPUTS:  # what came of one input in a second, then that of the next
            for k in range(40):
                leap = 10_000 if name == 'position' and 20.5 <= second + k / 40 < 40.5 else 0
                order.push(1000 * second + 25 * k + leap, name)
    assert set(order.rejected) == {('position', 'future')}
    assert len(order.rejected) == 800


def test_a_clock_that_is_behind_is_told():
    order = Order()
    for k in range(100):
        order.push(20 * k + 300, 'position')
        order.push(20 * k + 300, 'attitude')
        order.push(20 * k, 'thrusters')
    assert {name for name, _ in order.rejected} == {'thrusters'}
    assert len(order.warnings) == 1
    assert 'thrusters come up to 0.30 s after' in order.warnings[0]


def test_a_reference_decides_nothing():
    order = Order()
    for k in range(100):
        order.push(20 * k, 'position')
        order.push(20 * k, 'attitude')
        order.push(20 * k, 'thrusters')
        order.push(20 * k + 300, 'reference')
    assert order.rejected == []


def test_all_inputs_in_one_message_need_no_second_one():
    order = Order()
    released = []
    for k in range(200):
        released += order.push(20 * k + (60_000 if k >= 100 else 0),
                               'position', 'attitude', 'thrusters')
    assert order.rejected == []
    assert len(released) > 190


def test_an_input_later_than_a_second_but_within_max_wait_takes_part():
    order = Order(max_wait=5.0, inputs=[('velocity', 0), ('thrusters', 0)])
    released = []
    for k in range(1000):
        released += order.push(20 * k, 'thrusters')
        released += order.push(20 * k - 4000, 'velocity')
    assert order.rejected == []
    assert len(released) > 1500


def test_the_end_releases_all_that_waits():
    order = Order()
    for k in range(10):
        order.push(20 * k, 'position')
    assert len(order.order.flush()) == 10
    assert order.rejected == []


def test_a_single_input_is_released_too():
    order = Order(inputs=[('thrusters', 0)])
    assert order.push(0, 'thrusters') == [(0, 'thrusters')]


@pytest.mark.parametrize('seed', range(20))
def test_random_stamps_never_break_the_order(seed):
    random_ = random.Random(seed)
    order = Order()
    last = None
    for _ in range(2000):
        name = random_.choice(INPUTS)[0]
        ms = random_.choice([random_.uniform(0, 1e4), random_.uniform(0, 1e9)])
        released, jumped = order.order.push(event(ms, name))
        last = None if jumped else last
        for e in released:
            assert last is None or e.time >= last
            last = e.time
    assert sum(lengths(order.order)) < 20_000
