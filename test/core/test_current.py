"""Surge and sway in water that moves, from fixes or a DVL through the whole pipeline."""

from dataclasses import replace
from functools import partial
import json
import re

import numpy as np
import pytest
from rovid_core.model.samples import Sample
from rovid_core.model.thrusters import Thrusters
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import CurrentSettings, DofSettings
from rovid_core.trials.score import ScoreLog

from test.support.moving_water import (
    away,
    CURRENT,
    events,
    Run,
    settings,
    TRUTH,
    with_fixes_late,
    with_headings_off,
    with_lever_arm,
)

pytestmark = pytest.mark.long

FIXES, STRAIGHT = Run(), Run(stiff=True, duration=75.0)


def followed(stream, of, end=1e9, start=0.0):
    """Give a stream what is measured from ``start`` to ``end`` [s]; return its estimates."""
    return [one for event in events(of) if start <= event.time * 1e-9 < end
            for one in stream.receive(event)]


@pytest.fixture(scope='module')
def run():
    """Return the estimates of a run that turns, and the state of its filter after a minute."""
    stream = Stream(settings(FIXES))
    first, state = followed(stream, FIXES, 60.0), json.dumps(stream.state())
    return [*first, *followed(stream, FIXES, start=60.0)], state


@pytest.fixture(scope='module')
def turning(run):
    """Return the estimates of a run that turns."""
    return run[0]


@pytest.fixture(scope='module')
def known(run):
    """Return the state of a filter that knows the current after a minute."""
    return run[1]


def restored(state):
    """Return a stream that goes on from a state."""
    stream = Stream(settings(FIXES))
    stream.restore(json.loads(state))
    return stream


def masses_held(estimate, truth=TRUTH):
    """Tell of each DOF whether the interval holds the mass."""
    return [dof.intervals['mass'][0] <= truth[dof.dof].mass <= dof.intervals['mass'][1]
            for dof in estimate.dofs]


def test_a_vehicle_that_turns_finds_the_current_and_itself(turning):
    last = turning[-1]
    assert last.current.status == 'known'
    assert away(last.current[:2]) < 0.015
    assert all(masses_held(last))
    for dof in last.dofs:
        assert 1.0 / dof.parameters[0] == pytest.approx(TRUTH[dof.dof].mass, rel=0.03)


def test_how_much_each_model_predicts_is_told(turning):
    assert all(dof.fit > 0.9 for dof in turning[-1].dofs)


def test_the_first_intervals_hold_what_nothing_tells_yet():
    """Thrusters that lag look like more mass, and so may a current before the turn."""
    late = Run(lag=0.3, stiff=True, duration=50.0)
    last = followed(Stream(settings(late)), late)[-1]
    assert last.current.status == 'unobservable'
    assert all(masses_held(last))


def test_the_velocity_of_the_filter_is_that_of_its_stamp(turning):
    """It is behind no low-pass, and a controller need not look ahead of it."""
    assert {dof.v_hat_delay for dof in turning[-1].dofs} == {0.0}
    assert all(dof.velocity_delay > 0.0 for dof in turning[-1].dofs)


def with_yaw(run=FIXES):
    """Return settings that identify yaw, too, with its couplings."""
    known, true = settings(run), TRUTH['yaw']
    return replace(known, dofs=('surge', 'sway', 'yaw'), dof={
        **known.dof, 'yaw': DofSettings(1.5 * true.mass, true.quadratic_drag / 1.8,
                                        couplings=('v', 'uv'))})


def test_yaw_is_coupled_with_the_velocity_through_the_water():
    true, scores = TRUTH['yaw'], ScoreLog(with_yaw())
    yaw = followed(Stream(with_yaw(), scorer=scores), FIXES)[-1].dofs[2]
    assert yaw.steps > 1900  # of 2,000
    # over ground, until the current is known, it was a thousand times the true one
    assert 1.0 / yaw.parameters[0] == pytest.approx(true.mass, rel=0.03)
    assert yaw.couplings[1] == pytest.approx(
        (TRUTH['surge'].mass - TRUTH['sway'].mass) / true.mass, rel=0.03)
    # it is not scored on what it has not learned from
    assert scores.score('yaw', (*yaw.parameters, *yaw.couplings)).fit > 0.97


@pytest.mark.parametrize(('current', 'anew'), [(CURRENT, True), ((0.0, 0.0), False)])
def test_yaw_begins_anew_with_what_it_has_where_there_is_a_current(current, anew):
    run = replace(FIXES, current=current)
    stream = Stream(with_yaw(run))
    found = followed(stream, run)
    assert any('yaw: begun anew' in line for line in stream.take_warnings()) is anew
    k = next(k for k, one in enumerate(found) if one.current.status == 'known')
    alphas = [one.dofs[2].parameters[0] for one in found[k - 20:k + 20]]
    assert min(alphas) > 1.1 / with_yaw().dof['yaw'].mass  # not at the guess again


@pytest.mark.parametrize('current', [CurrentSettings(), CurrentSettings(prior=0.0)])
def test_between_slow_fixes_yaw_is_coupled_with_what_the_model_makes_of_the_thrust(current):
    """With a straight line between velocities at the fixes its inertia could be 65 % larger."""
    run = Run(rate=1.0, noise=0.02, duration=150.0, current=(0.0, 0.0))
    known = replace(with_yaw(run), current=current)
    stream, same = Stream(known), Stream(known)
    followed(stream, run, 75.0)
    stream.interrupt()  # the state has no histories of the inputs
    same.restore(json.loads(json.dumps(stream.state())))
    yaw, again = [followed(one, run, start=75.0)[-1].dofs[2] for one in (stream, same)]
    least, most = yaw.intervals['mass']
    assert least < TRUTH['yaw'].mass < most < 1.35 * TRUTH['yaw'].mass
    assert again.parameters == yaw.parameters


def test_yaw_alone_is_coupled_with_the_velocities_that_are_measured():
    known = replace(with_yaw(), dofs=('yaw',))
    yaw, = followed(Stream(known), FIXES, 40.0)[-1].dofs
    assert yaw.steps > 750
    assert yaw.couplings[1] < 0.0


@pytest.mark.parametrize(('late', 'anew'), [(0.0, True), (60.0, False)])
def test_what_yaw_learned_beside_velocities_that_were_not_found_yet_does_not_count(late, anew):
    """Unless that was much: it may be driven first."""
    run = replace(FIXES, current=(0.0, 0.0), duration=late + 40.0)
    stream, begun = Stream(with_yaw(run)), []
    for event in events(run):
        if event.samples[0].input == 'thrusters' and event.time < late * 1e9:
            surge, sway, *rest = event.samples[0].value
            event = event.replaced(samples=(Sample('thrusters', (0.0, 0.0, *rest)),))
        found = stream.receive(event)
        begun += [one.dofs[2].steps for one in found
                  if one.dofs[2].steps and one.dofs[2].judgement.reasons == ('no step yet',)]
    assert bool(begun) is anew


@pytest.mark.parametrize('own', ['reverse_thrust', 'reverse_drag'])
def test_what_a_dof_has_of_its_own_does_not_wait_for_the_current(own):
    known = with_yaw()
    of_its_own = replace(known, dof={
        **known.dof, 'yaw': replace(known.dof['yaw'], couplings=(own,))})
    assert followed(Stream(of_its_own), FIXES, 40.0)[-1].dofs[2].steps > 750  # at 20 Hz


def test_yaw_goes_on_when_the_filter_of_surge_and_sway_begins_anew():
    stream = Stream(with_yaw())
    followed(stream, FIXES, 40.0)
    stream.control('reset', '')
    refused = stream.rejected_by_reason()
    assert followed(stream, FIXES, 50.0, 40.0)[-1].dofs[2].steps > 195  # at 20 Hz
    assert stream.rejected_by_reason() == refused


@pytest.mark.parametrize(('input', 'noise'), [('position', 0.005), ('velocity', 0.01)])
def test_what_comes_fast_is_taken_together_at_no_loss(input, noise):
    fast = Run(input=input, rate=100.0, noise=noise, duration=60.0)
    last = followed(Stream(settings(fast)), fast)[-1]
    assert away(last.current[:2]) < 0.01
    assert all(masses_held(last))
    for dof in last.dofs:
        assert 1.0 / dof.parameters[0] == pytest.approx(TRUTH[dof.dof].mass, rel=0.02)


def test_the_interval_of_the_current_holds_it(turning):
    late = [one.current for one in turning if one.current.status == 'known']
    assert len(late) > 200
    for x, y, true in ((c.x, c.std[0], CURRENT[0]) for c in late):
        assert abs(x - true) < 3.0 * y


def test_thrust_that_falls_is_told_of_both_at_once():
    run = Run(duration=200.0, runs_down=0.2 / 200.0)
    last = followed(Stream(settings(run)), run)[-1]
    said = 'thrust falls by ([0-9]+) % .* the mass is ([0-9.]+)[)]'
    for dof in last.dofs:
        share, mass = map(float, re.search(said, ' '.join(dof.judgement.reasons)).groups())
        assert share == pytest.approx(20, abs=3)
        assert mass == pytest.approx(TRUTH[dof.dof].mass, rel=0.03)
    assert all(masses_held(last))


def test_until_it_has_turned_the_current_cannot_be_seen(turning):
    assert turning[0].current.status == 'unobservable'
    assert turning[0].current.std == (0.3, 0.3)


def test_what_is_missing_is_said_once(turning):
    said = list(dict.fromkeys(one.current.advice for one in turning))
    assert said == ['turn by 45 degrees or more', *[
        f'after the turn, thrust for {left} s more' for left in (20, 15, 10, 5)], '']
    reasons = turning[100].dofs[0].reasons
    assert sum('after the turn' in reason for reason in reasons) == 1
    assert not any('turn by' in reason for reason in reasons)


def test_fixes_too_noisy_for_what_was_driven_ask_for_more_headings():
    of = Run(rate=1.0, noise=3.0, duration=30.0)
    last = followed(Stream(settings(of)), of)[-1].current
    assert (last.status, last.advice) == ('unobservable', 'thrust on other headings')


@pytest.mark.parametrize(('late', 'said'), [
    (0.2, 'clocks disagree: thrust acts about 0.'),
    (-0.7, 'clocks disagree: motion is stamped about 0.')])
def test_clocks_that_disagree_are_said_of_both(late, said):
    moved = sorted([event.replaced(time=event.time + round(late * 1e9))
                    if event.samples[0].input == 'thrusters' else event
                    for event in events(FIXES) if event.time < 70e9],
                   key=lambda event: event.time)
    stream = Stream(settings(FIXES))
    for event in moved:
        stream.receive(event)
    for dof in stream.estimate.dofs:
        assert said in ' '.join(dof.reasons)
        assert dof.status == 'converging'


def test_a_current_is_known_once_it_is_judged_whether_it_is_one(run):
    early = [one for one in run[0] if one.time < 60e9]
    seen = [one for one in early if one.current.status == 'converging']
    assert seen and max(seen[-1].current.std) < 0.01
    assert not any(one.current.status == 'known' for one in early)
    assert any('too little motion yet' in reason for reason in seen[-1].dofs[0].reasons)


def test_with_one_heading_nothing_converges_and_the_mass_is_held():
    found = followed(Stream(settings(STRAIGHT)), STRAIGHT)
    assert {one.current.status for one in found} == {'unobservable'}
    assert not any(dof.status == 'converged' for one in found for dof in one.dofs)
    assert all(masses_held(found[-1]))
    assert 'turn by 45 degrees' in ' '.join(found[-1].dofs[0].reasons)


def test_still_water_is_a_current_that_nobody_asks_for():
    quiet = Stream(replace(settings(FIXES), current=CurrentSettings(prior=0.0)))
    found = followed(quiet, FIXES, 10.0)
    assert found[-1].current is None


def test_where_no_current_is_looked_for_it_is_missed_by_its_own_key():
    still = Stream(replace(settings(FIXES), current=CurrentSettings(prior=0.0)))
    said = {reason for one in followed(still, FIXES) for dof in one.dofs for reason in dof.reasons}
    missed = [reason for reason in said if 'as with a current' in reason]
    assert missed
    assert all(reason.endswith(': see current.prior') for reason in missed)


def test_a_dvl_over_ground_tells_the_current_too():
    of = Run(input='velocity', noise=0.01, duration=70.0)
    last = followed(Stream(settings(of)), of)[-1]
    assert away(last.current[:2]) < 0.02
    assert all(masses_held(last))


def test_a_dvl_in_the_water_tells_nothing_of_it():
    of = replace(settings(Run(input='velocity', noise=0.01)), relative_to='water')
    assert not of.estimates_current


def test_surge_alone_drifts_sideways():
    last = followed(Stream(settings(FIXES, ('surge',))), FIXES, 80.0)[-1]
    assert last.current.status != 'unobservable'
    assert away(last.current[:2]) < 0.1


def test_nothing_fits_an_exact_vehicle_better_than_the_current(turning):
    assert 'inconsistent' not in {one.current.status for one in turning}
    assert turning[-1].current.chi2 < 10.0


@pytest.mark.parametrize(('of', 'seen', 'named', 'true', 'by'), [
    (Run(pull=(0.8, -0.6), duration=110.0), events,
     r'a constant pull of ([\d.]+) in units of force', 1.0, 0.2),
    (replace(FIXES, duration=80.0), partial(with_headings_off, degrees=5.0),
     r'headings that are off by ([\d.]+) degrees', 5.0, 0.8),
    (FIXES, partial(with_lever_arm, ahead=0.5, to_port=0.0),
     r'fixes of a sensor ([\d.]+) m ahead of the middle', 0.5, 0.1),
    (FIXES, partial(with_lever_arm, ahead=0.3, to_port=0.3),
     r'the middle and ([\d.]+) m to port', 0.3, 0.1),
    (FIXES, partial(with_fixes_late, late=0.3), r'fixes that come ([\d.]+) s later', 0.3, 0.1),
    (FIXES, partial(with_fixes_late, late=-0.4), r'fixes that come ([\d.]+) s sooner', 0.4, 0.1)])
def test_what_looks_like_a_current_is_named_with_its_size(of, seen, named, true, by):
    stream = Stream(settings(of))
    for event in seen(of):
        stream.receive(event)
    last = stream.estimate
    assert last.current.status == 'inconsistent'
    assert float(re.search(named, last.current.advice)[1]) == pytest.approx(true, abs=by)
    assert last.current.chi2 > 20.0
    for dof in last.dofs:
        assert dof.status == 'converging'
        assert last.current.advice in ' '.join(dof.reasons)


def test_what_fits_better_is_said_also_where_it_hides_the_current():
    stream = Stream(settings(FIXES))
    for event in with_lever_arm(FIXES, ahead=0.0, to_port=-0.4):
        stream.receive(event)
    current = stream.estimate.current
    assert current.status == 'unobservable'
    assert 'm to starboard fit better, see position.lever_arm' in current.advice


def test_a_velocity_of_the_other_handedness_is_named():
    run = Run(input='velocity', rate=5.0, noise=0.005, duration=200.0)
    streams = [Stream(settings(run)) for _ in range(2)]
    for event in events(run):
        sample, = event.samples
        u, v, *rest = sample.value
        mirrored = sample.replaced(value=(u, -v, *rest)) if sample.input in (
            'velocity', 'thrusters') else sample
        for stream, one in zip(streams, (sample, mirrored)):
            stream.receive(event.replaced(samples=(one,)))
    told = [' '.join(stream.estimate.dofs[0].reasons) for stream in streams]
    assert ['handedness' in text for text in told] == [False, True]


def test_a_sensor_ahead_of_the_middle_is_no_coupling_with_the_yaw_thrust():
    run = replace(FIXES, apart=True, duration=130.0)
    stream = Stream(settings(run, ('surge', 'sway', 'yaw')))
    for event in with_lever_arm(run, ahead=0.5, to_port=0.0):
        stream.receive(event)
    current = stream.estimate.current
    assert 'm ahead of the middle' in current.advice
    assert 'add couplings' not in ' '.join(stream.estimate.dofs[1].reasons)


def test_a_coupling_that_is_missing_comes_before_what_looks_like_a_current():
    of = settings(FIXES)
    stream = Stream(replace(of, dof={
        name: replace(dof, couplings=()) for name, dof in of.dof.items()}))
    for event in with_fixes_late(replace(FIXES, duration=80.0), late=0.3):
        stream.receive(event)
    current = stream.estimate.current
    assert (current.status, current.advice) == (
        'inconsistent', 'a coupling is missing, which may look like one')
    assert 'add couplings: [' in ' '.join(stream.estimate.dofs[0].reasons)


def test_a_latency_that_is_off_is_within_the_intervals():
    slow = Run(rate=1.0, noise=0.1, duration=300.0)
    stream = Stream(settings(slow))
    for event in with_fixes_late(slow, 0.25):
        stream.receive(event)
    assert all(masses_held(stream.estimate))


def test_a_start_among_fixes_that_say_little_goes_on_until_they_say_enough():
    slow = Run(rate=0.2, noise=0.5, duration=600.0)
    stream = Stream(settings(slow))
    last = followed(stream, slow)[-1]
    assert all(masses_held(last))
    for dof in last.dofs:
        assert 1.0 / dof.parameters[0] == pytest.approx(TRUTH[dof.dof].mass, rel=0.2)
    assert last.current.status == 'known'
    assert away(last.current[:2]) < 0.03


def test_the_velocity_between_slow_fixes_turns_with_the_body():
    """Up to half of the time to the next fix after the last one that is known."""
    slow, fast = [{one.time: [dof.v_hat for dof in one.dofs]
                   for one in followed(Stream(settings(of)), of) if one.time > 180e9}
                  for of in (Run(rate=rate, noise=noise, duration=240.0)
                             for rate, noise in ((0.2, 0.01), (10.0, 0.001)))]
    times = sorted(fast)
    for k in range(2):
        expected = np.interp(list(slow), times, [fast[time][k] for time in times])
        assert [v[k] for v in slow.values()] == pytest.approx(expected, abs=0.03)
    assert len(slow) > 8


def test_a_saved_state_goes_on_with_the_same_bits():
    first, before = Stream(settings(FIXES)), 0.0
    for at in (15.0, 45.0, 85.0):
        followed(first, FIXES, at, before)
        first.interrupt()  # the state has no histories of the inputs
        second = restored(json.dumps(first.state()))
        assert json.dumps(second.state()) == json.dumps(first.state())
        before = at + 12.0
        found = [followed(stream, FIXES, before, at)[-1] for stream in (first, second)]
        assert found[0].dofs[0].parameters == found[1].dofs[0].parameters
        # as text, for a NaN is equal to itself alone
        assert repr(found[0].current) == repr(found[1].current)


@pytest.mark.parametrize('at', [66.0, 87.0])
def test_what_is_found_of_the_thrusters_goes_on_with_the_same_bits(at):
    """While it is looked for, and when it was found."""
    run = Run(duration=140.0, lag=0.2, reverse=0.75)
    stream = Stream(settings(run))
    followed(stream, run, at)
    stream.interrupt()
    second = Stream(settings(run))
    state = json.dumps(stream.state())
    assert ('"gone"' in state) == (at < 80.0)
    second.restore(json.loads(state))
    ends = [followed(one, run, start=at + 1.0)[-1] for one in (stream, second)]
    for of_first, of_second in zip(ends[0].dofs, ends[1].dofs):
        assert of_first.parameters == of_second.parameters
        assert of_first.thrusters == of_second.thrusters
        assert 'the thrusters lag by about 0.' in ' '.join(of_first.reasons)
        assert of_first.delay == pytest.approx(0.2, abs=0.05)
    surge, sway, *_ = ends[0].dofs
    assert surge.thrusters.reverse == pytest.approx(0.75, abs=0.02)
    assert 'reverse thrust is about 0.7' in ' '.join(surge.reasons)
    assert sway.thrusters.found == ['lag']
    assert all(masses_held(ends[0]))


def test_surge_and_sway_hear_what_the_others_show_of_the_thrusters():
    one, other = Stream(settings(FIXES)), Stream(settings(FIXES))
    one.identifier('sway').hear(Thrusters(lag=0.1))
    state = json.dumps(one.state())
    assert '"heard": [0.1, false]' in state
    other.restore(json.loads(state))
    assert json.dumps(other.state()) == state
    other.reset()
    assert '"heard": [0.0, false]' in json.dumps(other.state())


@pytest.mark.parametrize('heard', [0.0, 0.06])
def test_surge_and_sway_take_a_lag_that_another_dof_shows(heard):
    run = Run(lag=0.06)
    stream = Stream(settings(run))
    stream.identifier('sway').hear(Thrusters(lag=heard))
    for dof in followed(stream, run)[-1].dofs[:2]:
        assert dof.thrusters.lag == heard
        assert 1.0 / dof.parameters[0] == pytest.approx(TRUTH[dof.dof].mass, rel=0.01)


def test_turns_that_lag_are_those_of_surge_and_of_sway():
    run = Run(duration=140.0, lag=0.25, turns=True)
    last = followed(Stream(settings(run)), run)[-1]
    for dof in last.dofs[:2]:
        assert dof.thrusters.found == ['turns_lag']
        assert dof.thrusters.lag == pytest.approx(0.25, abs=0.03)
        assert "the thrusters' turns lag by about 0.2" in ' '.join(dof.reasons)
        assert 1.0 / dof.parameters[0] == pytest.approx(TRUTH[dof.dof].mass, rel=0.03)


def test_a_state_without_the_filter_of_both_is_refused():
    stream, row = Stream(settings(FIXES)), Stream(replace(
        settings(FIXES), current=CurrentSettings(prior=0.0)))
    for one, other in ((stream, row), (row, stream)):
        before = json.dumps(one.state())
        with pytest.raises(ValueError):
            one.restore(other.state())
        assert json.dumps(one.state()) == before


def test_a_frozen_vehicle_still_follows_the_current(known):
    stream = restored(known)
    before = followed(stream, FIXES, 62.0, 60.0)[-1]
    stream.enable(False)
    after = followed(stream, FIXES, 72.0, 62.0)[-1]
    assert after.dofs[0].parameters == before.dofs[0].parameters
    assert after.dofs[0].status == 'frozen'
    assert after.current != before.current


def test_what_nobody_saw_of_the_current_makes_it_uncertain_again(known):
    before = followed(restored(known), FIXES, 60.5, 60.0)[-1]
    after = followed(restored(known), FIXES, 90.5, 90.0)[-1]
    assert after.current.std[0]**2 > before.current.std[0]**2 + 0.9 * 30.0 * 1e-5


def test_a_reset_forgets_the_current(known):
    stream = restored(known)
    stream.reset()
    last = followed(stream, FIXES, 62.0, 60.0)[-1]
    assert last.current.status == 'unobservable'
    assert last.dofs[0].steps > 0


def test_after_a_change_the_vehicle_is_found_anew_and_the_current_stays():
    of = Run(rate=5.0, weak=(200.0, 0.6), duration=255.0)
    stream = Stream(settings(of))
    before = followed(stream, of, 200.0)[-1]
    said = followed(stream, of, 232.0, 200.0)[-1]
    assert 'the vehicle changed' in ' '.join(said.dofs[0].reasons)
    second = Stream(settings(of))
    stream.interrupt()  # the state has no histories of the inputs
    second.restore(json.loads(json.dumps(stream.state())))
    last, other = [followed(one, of, start=232.0)[-1] for one in (stream, second)]
    assert repr(last.current) == repr(other.current)
    assert all(masses_held(before))
    for dof in last.dofs:
        true = TRUTH[dof.dof].mass / 0.6
        assert 1.0 / dof.parameters[0] == pytest.approx(true, rel=0.04)
        assert dof.std[0] < 0.03 * dof.parameters[0]
    assert last.current.status == 'known'
    assert away(last.current[:2]) < 0.02
