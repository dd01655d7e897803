"""Other settings for a stream that runs: nothing is lost, and time does not go back."""

from dataclasses import replace
import math

from hypothesis import given, settings as hypothesis_settings, strategies as st
import pytest
from rovid_core.identify.estimate import Estimate
from rovid_core.model.samples import Event, Sample
from rovid_core.ordering.event_order import EventOrder
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_core.simulation.sensors import simulate
from rovid_core.thrust.force_history import ForceHistory
from rovid_core.trials.score import ScoreLog

from test.support.surge import surge_settings

RAW = {'feedback_gain': -2.0, 'adaptation_gains': (1e-5, 5.0, 1.0, 0.1)}


def changed(settings: Settings, **changes: object) -> Settings:
    """Return settings with some of them changed; gains go into ``identifier``."""
    gains = {k: v for k, v in changes.items() if hasattr(settings.identifier, k)}
    thrusters = {k: v for k, v in changes.items() if hasattr(settings.thrusters, k)}
    rest = {k: v for k, v in changes.items() if k not in {**gains, **thrusters}}
    return replace(settings, identifier=replace(settings.identifier, **gains),
                   thrusters=replace(settings.thrusters, **thrusters), **rest)


@pytest.fixture(scope='module')
def events() -> list[Event]:
    return [Event(time, (Sample(name, value),))
            for time, name, value in simulate(surge_settings(), 60.0, 3)]


def feed(stream: Stream, events: list[Event]) -> list[Estimate]:
    return [estimate for event in events for estimate in stream.receive(event)]


def told(estimates: list[Estimate]) -> str:
    """Return all numbers as text, for a NaN is equal to itself alone."""
    return repr([(estimate.time, [(*dof.replaced(uncertainty=None).fields(), dof.covariance,
                                   dof.delay_std)
                                  for dof in estimate.dofs]) for estimate in estimates])


def held(stream: Stream) -> tuple[object, ...]:
    """Return what a change must leave alone."""
    identifier = stream.identifier('surge')
    return (identifier.v_hat, identifier.parameters, identifier.excitation, identifier.std,
            identifier.covariance, stream.estimate)


GAINS = {
    'longer': ({}, {'adaptation_time': 30.0}),
    'shorter': ({}, {'adaptation_time': 0.5}),
    'raw': ({}, RAW),
    'averaged': (RAW, {'feedback_gain': 0.0, 'adaptation_gains': ()}),
    'other raw': (RAW, {'feedback_gain': -4.0, 'adaptation_gains': (1e-6, 1.0, 2.0, 0.3)}),
}


@pytest.mark.parametrize('case', GAINS)
def test_new_gains_keep_the_estimate_and_count_from_the_next_step(
        case: str, events: list[Event]) -> None:
    first, then = GAINS[case]
    settings = changed(surge_settings(method='aid'), **first)
    stream, same = Stream(settings), Stream(settings)
    half = len(events) // 2
    feed(stream, events[:half])
    feed(same, events[:half])
    before = held(stream)
    stream.change(changed(settings, **then), '')
    assert repr(held(stream)) == repr(before)
    after, unchanged = feed(stream, events[half:]), feed(same, events[half:])
    assert after[0].dofs[0].velocity == unchanged[0].dofs[0].velocity
    assert after[0].dofs[0].parameters != unchanged[0].dofs[0].parameters
    assert all(map(math.isfinite, after[-1].dofs[0].parameters))
    assert after[-1].dofs[0].steps == unchanged[-1].dofs[0].steps


def test_raw_gains_mean_nothing_to_the_filter(events: list[Event]) -> None:
    settings = surge_settings(method='ekf')
    stream, same = Stream(settings), Stream(settings)
    half = len(events) // 2
    feed(stream, events[:half])
    feed(same, events[:half])
    stream.change(changed(settings, **RAW), '')
    assert told(feed(stream, events[half:])) == told(feed(same, events[half:]))


CHANGES = {
    'adaptation_time': {'adaptation_time': 10.0}, 'raw': RAW, 'cutoff': {'cutoff': 1.1},
    'max_speed': {'max_speed': 0.4}, 'max_gap': {'max_gap': 0.15}, 'max_wait': {'max_wait': 2.0},
    'timeout': {'timeout': 0.01}, 'hold for ever': {'timeout': 0.0}, 'frozen': {'enable': False},
    'gate': {'gate': 1.0}, 'no gate': {'gate': 0.0},
}


@pytest.mark.long
@pytest.mark.parametrize('method', ['aid', 'ekf'])
@pytest.mark.parametrize('case', CHANGES)
def test_changed_at_the_start_is_as_if_it_had_been_so(
        case: str, method: str, events: list[Event]) -> None:
    base = surge_settings(method=method)
    settings = changed(base, **CHANGES[case])
    scores, expected_scores = ScoreLog(base), ScoreLog(settings)
    stream, expected = Stream(base, scorer=scores), Stream(settings, scorer=expected_scores)
    stream.change(settings, '')
    gone = [e for i, e in enumerate(events) if i % 11]  # gaps for max_gap to tell apart
    got, wanted = feed(stream, gone), feed(expected, gone)
    assert stream.settings == settings
    assert stream.rejected == expected.rejected
    assert len(got) == len(wanted)
    if not wanted:
        return
    final, other = got[-1].dofs[0], wanted[-1].dofs[0]
    assert final.parameters == pytest.approx(other.parameters, rel=1e-6)
    assert (final.status, final.reasons, final.velocity) == (
        other.status, other.reasons, other.velocity)
    assert scores.score('surge', other.parameters) == expected_scores.score(
        'surge', other.parameters)


def test_the_changes_of_the_test_above_do_something(events: list[Event]) -> None:
    base = surge_settings(method='aid')
    gone = [e for i, e in enumerate(events) if i % 11]
    plain = Stream(base)
    unchanged = feed(plain, gone)
    for case, change in CHANGES.items():
        if case in ('max_wait', 'hold for ever', 'no gate'):
            continue  # they show where something is late, stale or wild
        stream = Stream(base)
        stream.change(changed(base, **change), '')
        assert repr(feed(stream, gone)) != repr(unchanged), case


def test_a_score_knows_which_cutoff_each_step_had(events: list[Event]) -> None:
    """The model of the truth is scored as well with two cutoffs as with one."""
    settings = surge_settings()
    truth = (1 / 290, -1.0, -0.15, -0.01)
    maes = []
    for cutoff in (settings.cutoff, 0.1):
        scores = ScoreLog(settings)
        stream = Stream(settings, scorer=scores)
        feed(stream, events[:len(events) // 2])
        stream.change(changed(settings, cutoff=cutoff), '')
        feed(stream, events[len(events) // 2:])
        maes.append(scores.score('surge', truth).mae)
    assert maes[1] < maes[0]  # less noise; the lag of another cutoff would be 5 times that


def test_a_longer_timeout_holds_for_the_commands_so_far() -> None:
    settings = surge_settings().thrusters
    thrust = ForceHistory(replace(settings, timeout=0.0), ('surge',))
    thrust.add_commands(0, (1.0,) * settings.count)
    second = 1_000_000_000
    assert thrust.missing(0, 5 * second) == ''
    thrust.change(10.0)
    assert thrust.missing(0, 5 * second) == ''
    assert thrust.missing(0, 11 * second) == 'stale_thrust'
    thrust.change(4.0)
    assert thrust.missing(0, 5 * second) == 'stale_thrust'


def test_frozen_from_the_start(events: list[Event]) -> None:
    stream = Stream(replace(surge_settings(), enable=False))
    initial = stream.identifier('surge').parameters
    assert feed(stream, events)[-1].dofs[0].status == 'frozen'
    assert stream.identifier('surge').parameters == initial
    stream.enable(True)
    assert stream.settings.enable
    other = Stream(surge_settings())
    other.restore({**stream.state(), 'adapt': False})
    assert not other.settings.enable


def shifted(changes: list[float | None], lags: list[int]) -> list[int]:
    """Return the times [ms] that are released while positions lag and max_wait changes."""
    order = EventOrder([(n, 0) for n in ('position', 'attitude', 'thrusters')], 0.1, 60.0,
                       lambda name, reason: None, lambda line: None)
    released = []
    for i, (max_wait, lag) in enumerate(zip(changes, lags)):
        now = 10_000 + 50 * i
        for name, time in (('attitude', now), ('thrusters', now + 3), ('position', now - lag)):
            released += order.push(Event(time * 1_000_000, (Sample(name, (0.0,)),)))[0]
        if max_wait is not None:
            order.change(max_wait)
    return [event.time // 1_000_000 for event in released + order.flush()]


def test_a_longer_wait_does_not_bring_back_what_has_passed() -> None:
    times = shifted([None] * 20 + [5.0] + [None] * 19, [20] * 2 + [900] * 18 + [600] * 20)
    assert times == sorted(times)
    assert len(times) > 80


@given(st.lists(st.tuples(st.none() | st.floats(0.0, 2.0), st.integers(0, 1500)), max_size=60))
@hypothesis_settings(max_examples=200, deadline=None)
def test_whatever_max_wait_becomes_nothing_older_is_released(
        actions: list[tuple[float | None, int]]) -> None:
    times = shifted([wait for wait, _ in actions], [lag for _, lag in actions])
    assert times == sorted(times)


def test_an_interruption_starts_the_histories_anew(events: list[Event]) -> None:
    """What follows an hour later is a gap, and the estimate goes on."""
    stream = Stream(surge_settings(method='aid'))
    half = len(events) // 2
    feed(stream, events[:half])
    before = stream.identifier('surge').parameters
    stream.interrupt()
    assert stream.finish() == []
    later = [event.replaced(time=event.time + 3600 * 10**9) for event in events[half:]]
    after = feed(stream, later)
    assert stream.rejected == {}
    assert after[0].dofs[0].parameters == pytest.approx(before, rel=0.05)
    assert after[-1].dofs[0].steps > len(after)
