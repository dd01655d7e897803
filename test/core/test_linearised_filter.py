"""The filter of the extended Kalman filter: its force, sensitivities and covariances."""

import json
import math

import numpy as np
import pytest
from rovid_core.identify.ekf.single.delayed_force import DelayedForce
from rovid_core.identify.ekf.single.linearised_filter import CANDIDATES, GAMMA, LinearisedFilter
from rovid_core.identify.ekf.single.measurements import MeasurementClock
from rovid_core.identify.ekf.single.watched_lag import LAGS, SECOND_LAG, WatchedLag
from rovid_core.model.dofs import EACH
from rovid_core.model.samples import Step
from rovid_core.model.thrusters import AS_CONFIGURED, DEAD_BAND, Thrusters
from scipy.signal import lfilter

FADING = Thrusters(loss=0.3)


def parabola(times, values, i, time):
    return np.polyval(np.polyfit(times[i - 1:i + 2], values[i - 1:i + 2], 2), time)


def test_the_impulse_of_a_smooth_force_is_the_mean_of_the_parabolas_on_either_side():
    random, recent = np.random.default_rng(0), DelayedForce()
    spans, forces = random.uniform(0.02, 0.1, 400), random.normal(size=400)
    for piece in zip(spans.tolist(), forces.tolist()):
        recent.add([piece])
    times = np.concatenate([[0.0], np.cumsum(spans)])
    values = np.concatenate([[0.0], np.cumsum(spans * forces)])
    for i in range(380, 399):
        for share in (0.3, 0.9, 1.0):
            time = times[i] + share * (times[i + 1] - times[i])
            both = [parabola(times, values, k, time) for k in (i, i + 1)]
            impulse, *_ = recent.over(times[i], time)
            assert impulse == pytest.approx(np.mean(both) - values[i], abs=1e-9)
    # the last span has nothing after it, and then the force stays as it is
    time = 0.5 * (times[399] + times[400])
    assert recent.over(times[399], time)[0] == pytest.approx(
        parabola(times, values, 399, time) - values[399], abs=1e-9)
    assert recent.over(times[399], times[400] + 2.0)[0] == pytest.approx(
        values[400] - values[399] + 2.0 * forces[399])
    assert recent.state()['times'][0] > times[400] - 9.0  # it does not grow


@pytest.mark.parametrize(('start', 'end'), [
    (0.1, 0.2), (0.1, 0.75), (0.3, 0.7), (-0.4, 0.1), (-0.4, 1.4), (0.7, 1.9), (1.2, 1.3),
    (-0.5, -0.2)])
def test_a_held_force_moves_a_body_as_its_pieces_do(start, end):
    recent, edges, forces = DelayedForce(), [0.0, 0.3, 0.7, 1.0], [2.0, -1.0, 0.5]
    for k in range(3):
        recent.add([(edges[k + 1] - edges[k], forces[k])], held=True)
    time = np.linspace(start, end, 20_001)
    middle, dt = 0.5 * (time[1:] + time[:-1]), np.diff(time)
    force = np.array(forces)[np.clip(np.searchsorted(edges, middle) - 1, 0, 2)]
    impulse, moment, first, last = recent.over(start, end)
    assert impulse == pytest.approx(force @ dt, abs=1e-4)
    assert moment == pytest.approx(((end - middle) * force) @ dt, abs=1e-4)
    assert (first, last) == (force[0], force[-1])
    same = DelayedForce()
    same.restore(recent.state())
    assert same.over(start, end) == (impulse, moment, first, last)


def test_fixes_that_come_fast_are_one_measurement_of_their_mean():
    """At 100 Hz, while the vehicle goes evenly and what couples it changes evenly."""
    clocks, found = [MeasurementClock(
        2.0, 0.5, 1, 1, (-1, -1), True, AS_CONFIGURED) for _ in range(2)], []
    for k in range(17):
        mean = 0.01 * k  # since the fix before
        step = Step(0.01, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), mean=1.0, interval=0.01,
                    parts=(0.005, 0.005), couplings=((mean, math.nan),), watched=(-mean,))
        found += [one for one in [clocks[0].add_step(step)] if one is not None]
        clocks[1].restore(json.loads(json.dumps(clocks[0].state())))
        clocks.reverse()  # a saved clock goes on as if it had not been
    first, *spans = found
    assert [span.end for span in spans] == pytest.approx([0.03, 0.07, 0.11, 0.15])
    assert [span.start for span in spans] == [first.end, *[span.end for span in spans[:-1]]]
    ways = [2.0 * (span.end - first.end) for span in spans]
    # the first fix of the path is the one before the first step
    assert [span.value for span in spans] == pytest.approx([way + spans[0].value - ways[0]
                                                            for way in ways])
    for span in spans:
        assert span.couplings == [pytest.approx(0.5 * (span.start + span.end), abs=2e-3)]
        assert span.watched == [-span.couplings[0]]


THETA = (0.5, -0.5, -0.2, 0.01, 0.05)
VARIANCES = (1.0, 1.0, 1.0, 0.2, 0.02)


def test_the_force_ends_where_the_step_begins():
    """As at 20 Hz, with the delay at its lower bound because commands are stamped late."""
    filter = LinearisedFilter((*THETA[:4], -0.05), VARIANCES, 0.0)
    filter.set_motion(0.0, (1e-4, 1.0))
    force = DelayedForce()
    force.add([(0.05, 1.0), (0.05, 0.5)])
    assert force.end - 0.05 == 0.05
    filter.move(force, 0.05, 0.1)
    assert filter.motion[1] == pytest.approx(0.5 * 0.05 * 0.5, rel=0.1)
    assert filter.covariance[0] > 0.0


def coupled(regressor, edges, kappa=0.9):
    """Return a filter that went along a coupling which changes evenly, from edge to edge."""
    theta = (0.5, -0.6, -0.9, 0.05, kappa, 0.0)
    filter, force = LinearisedFilter(theta, [0.1] * 6, 0.0), DelayedForce()
    filter.set_motion(0.4, (0.0, 0.0))
    force.add([(2.0, 0.7)], True)
    for start, end in zip(edges, edges[1:]):
        middle, half = 0.5 * (start + end), 0.5 * (end - start)
        filter.move(force, start, end, [regressor(middle)], (),
                    [regressor(middle + half) - regressor(middle)])
    return filter


@pytest.mark.parametrize('end', [0.25, 1.0])
def test_a_coupling_that_rises_pushes_as_it_does_in_short_steps(end):
    """Path, velocity, and what both owe to the coupling; over a second in steps of its own."""
    def rising(time):
        return 0.3 + 1.1 * time

    one, many = coupled(rising, [0.0, end]), coupled(rising, np.linspace(0.0, end, 401).tolist())
    assert one.motion[:2] == pytest.approx(many.motion[:2], rel=2e-3)
    for found, exact in zip(one.sensitivities, many.sensitivities):
        assert found[4] == pytest.approx(exact[4], rel=0.03)
    flat = coupled(lambda time: 0.3 + 0.55 * end, [0.0, end])
    assert abs(flat.motion[0] / many.motion[0] - 1.0) > 0.01


@pytest.mark.parametrize('interval', [0.2, 0.0])
def test_how_couplings_rise_goes_by_the_intervals_around(interval):
    """By both of a sensor of the path, by those before of one of the velocity."""
    clock = MeasurementClock(2.0, 0.5, 1, 0, (-1, -1), True, AS_CONFIGURED)
    found = []
    for k in range(6):
        mean, follows = 0.2 * k, 0.2 * (k + 1) if interval else 0.2 * k
        span = clock.add_step(Step(
            0.2, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), mean=1.0, interval=interval,
            parts=(0.1, 0.1) if interval else (0.2, 0.0), couplings=((mean, follows),)))
        found.append(list(span.rises))
    assert found == [[], *[[pytest.approx(0.1)]] * 5]


def behind_a_lag(values, first, lag, dt):
    """Return what follows values, each of them held for ``dt``, from a steady one on."""
    keep = np.exp(-dt / lag)
    return lfilter([1.0 - keep], [1.0, -keep], values, zi=[first * keep])[0]


def check_over(one, force, dt, start, end):
    """Compare what is felt, and what of it in reverse, with a force in short steps."""
    inside = slice(round(start / dt), round(end / dt))
    left = end - dt * (np.arange(inside.start, inside.stop) + 0.5)
    impulse, moment = force[inside].sum() * dt, (force[inside] * left).sum() * dt
    found = one.over(start + 0.02, end + 0.02, 0.02)
    assert found[:2] == pytest.approx((impulse, moment), abs=3e-3 * (end - start))
    assert found[2:] == pytest.approx((force[inside.start], force[inside.stop]), abs=0.02)
    if end < one.end and force[inside].max() < 0.0:
        (astern, _), _ = one.bent(start + 0.02, end + 0.02, 0.02)
        assert astern == pytest.approx(impulse, abs=3e-3 * (end - start))


@pytest.mark.parametrize('held', [True, False])
def test_the_force_behind_a_lag_is_that_of_short_steps(held):
    random, lag, dt = np.random.default_rng(1), 0.13, 1e-4
    asked, later = DelayedForce(False), DelayedForce(False)
    known = DelayedForce(False, Thrusters(lag))
    for k in range(40):
        span = (0.1, float(random.normal() if held else np.sin(0.3 * k)))
        for one in (asked, known, later):
            one.add([span], held)
    later.set_thrusters(Thrusters(lag))
    force = np.array([asked.over(t, t + dt)[0] / dt for t in dt * np.arange(41_000)])
    lagged = behind_a_lag(force, asked.over(-1.0, 0.0)[2], lag, dt)
    for start, end in ((0.0, 0.4), (1.03, 1.31), (2.004, 2.007), (3.9, 4.05)):
        for one in (known, later):
            check_over(one, lagged, dt, start, end)


def driven_by_torque(values, first, inertia, dt):
    """Return the turns of propellers that torques drive, each of them for ``dt``."""
    turns = [first]
    for value in values.tolist():
        middle = turns[-1] + 0.5 * dt * (value - turns[-1] * abs(turns[-1])) / inertia
        turns.append(turns[-1] + dt * (value - middle * abs(middle)) / inertia)
    return np.array(turns)


@pytest.mark.parametrize('lag_at', [0.0, 0.7])
def test_the_force_of_propellers_whose_turns_lag_is_that_of_short_steps(lag_at):
    """Also of those that turn the other way in between, and with a lag that is found later."""
    random, lag, dt = np.random.default_rng(1), 0.13, 1e-4
    lagging = Thrusters(lag, turns=True, lag_at=lag_at)
    known, later = DelayedForce(False, lagging), DelayedForce(False)
    asked = random.normal(size=40)
    asked[[0, 7, 20]] = 0.0
    for one in (known, later):
        one.add([(0.1, force) for force in asked.tolist()], True)
    later.set_thrusters(lagging)
    steady = np.repeat(np.sign(asked) * np.sqrt(np.abs(asked)), round(0.1 / dt))
    turns = driven_by_torque(steady * np.abs(steady), steady[0], 2.0 * lag * lag_at**0.5, dt) if (
        lag_at) else behind_a_lag(steady, steady[0], lag, dt)
    force = turns * np.abs(turns)
    changes_sign = np.flatnonzero(force[1:] * force[:-1] < 0.0)
    assert len(changes_sign) > 10
    for start, end in ((0.0, 0.4), (1.03, 1.31), (2.004, 2.007), (3.5, 3.95),
                       *[(dt * (k - 300), dt * (k + 300)) for k in changes_sign[3:8].tolist()]):
        for one in (known, later):
            check_over(one, force, dt, start, end)
            edges = np.linspace(start, end, 1 + round((end - start) / 1e-3))
            parts = np.array([one.over(a, b)[0] for a, b in zip(edges, edges[1:])])
            assert one.over(start, end)[:2] == pytest.approx(
                (parts.sum(), parts @ (end - 0.5 * (edges[:-1] + edges[1:]))), abs=2e-7)
    early, late = known.over(-1.0, -0.5), known.over(9.0, 9.5)
    assert early[0] == pytest.approx(0.5 * asked[0])
    assert late[0] == pytest.approx(0.5 * asked[-1], rel=1e-5)
    assert known.over(-0.5, 0.0)[0] + known.over(0.0, 0.3)[0] == pytest.approx(
        known.over(-0.5, 0.3)[0])


def test_what_a_lag_takes_of_a_force_that_is_watched_goes_as_it_stays():
    one, dt, lag = WatchedLag(), 0.01, 0.15
    taken, force = np.zeros(3), 0.7
    for _ in range(300):
        one.move(-force, dt)
        taken += -dt * np.array([one.of_force, one.of_turns, one.of_second])
    assert taken[0] == pytest.approx(force * lag, rel=1e-6)
    assert taken[1] == pytest.approx(force * lag * 1.5, rel=1e-3)  # of 1 - (1 - e)^2
    assert taken[2] == pytest.approx(force * lag, rel=1e-6)
    assert one.of_force == pytest.approx(0.0, abs=1e-6)
    # of a second lag behind the first: 1 - e = 1 - (1 + t / T) exp(-t / T) of the force is there
    one.begin(0.0, force)
    one.move(force, lag)
    one.move(force, 0.5 * lag)
    left = [(1.0 + t) * np.exp(-t) for t in (1.0, 1.5)]
    assert one.of_second == pytest.approx(2.0 * force * (left[0] - left[1]))
    # a force that has long been held lags no more
    one.begin(-force, -force)
    one.move(-force, dt)
    assert (one.of_force, one.of_turns, one.of_second) == pytest.approx((0.0, 0.0, 0.0))
    same = WatchedLag()
    same.restore(one.state())
    for each in (one, same):
        each.move(0.2, dt)
    assert (same.of_force, same.of_turns, same.of_second) == (
        one.of_force, one.of_turns, one.of_second)


def test_a_filter_that_begins_under_way_sees_no_lag_in_the_thrust_there_is():
    """After a gap, or in a log that begins there: what it saw in that would hide a real lag."""
    filter, recent = LinearisedFilter(THETA, [0.0] * 5, 0.0), DelayedForce()
    filter.set_motion(1.0, (0.0, 0.0))
    lags = [len(THETA) + CANDIDATES.index(name) for name in (*LAGS, SECOND_LAG)]
    recent.add([(0.1, 0.7)] * 20, True)
    for k in range(20):
        filter.move(recent, 0.1 * k, 0.1 * (k + 1))
    path, *_ = filter.sensitivities
    assert [path[i] for i in lags] == pytest.approx([0.0] * 3, abs=1e-12)
    recent.add([(0.1, -0.7)] * 5, True)
    filter.move(recent, 2.0, 2.5)
    assert np.abs(np.array(filter.sensitivities)[0, lags]).min() > 0.01


@pytest.mark.parametrize('held', [True, False])
def test_the_force_that_there_is_is_less_by_a_dead_band_and_backwards(held):
    """Also where that is found later, but for what was asked for in the dead band before."""
    thrusters, random = Thrusters(0.0, 0.2, 0.7), np.random.default_rng(1)
    plain, known = DelayedForce(False), DelayedForce(False, thrusters)
    later = DelayedForce(False, Thrusters(0.0, 0.1, 1.0))
    for asked in random.normal(size=40).tolist():
        plain.add([(0.1, thrusters.given(asked))], held)
        for one in (known, later):
            one.add([(0.1, asked)], held)
    later.set_thrusters(thrusters)
    for start, end in ((0.0, 0.4), (1.03, 1.31), (2.004, 2.007), (3.9, 4.05)):
        expected = plain.over(start, end, 0.02)
        assert known.over(start, end, 0.02) == expected
        if held:
            assert later.over(start, end, 0.02) == pytest.approx(expected, abs=1e-12)


def test_what_thrusters_give_of_many_forces_is_what_they_give_of_each():
    thrusters, forces = Thrusters(0.1, 0.2, 0.7), np.linspace(-2.0, 2.0, 101)
    each = [thrusters.given(force) for force in forces.tolist()]
    assert thrusters.all_given(forces) == pytest.approx(each, abs=1e-15)
    assert each[0] == pytest.approx(-0.7 * 1.8)
    for force, given in zip(forces.tolist(), each):
        if given:
            assert thrusters.asked(given) == pytest.approx(force)
    assert thrusters.in_units(10.0, 2.0) == (0.1, 2.0, 0.7, 0.0, False, 0.0)


@pytest.mark.parametrize('force', [-3.0, -0.2, 0.0, 0.4, 5.0])
def test_what_is_lost_with_speed_is_asked_for_besides(force):
    for velocity in (-0.8, 0.0, 0.5):
        asked = FADING.at_rest(force, velocity)
        assert asked - FADING.slowing(asked) * velocity == pytest.approx(force)
    # the same in N and m/s
    whole = FADING.in_units(10.0, 2.0)
    assert whole.slowing(10.0 * force) * 2.0 == pytest.approx(10.0 * FADING.slowing(force))


def sines(duration, dt=0.1):
    force = DelayedForce()
    force.add([(dt, 0.0)] * 3)
    for k in range(round(duration / dt)):
        force.add([(dt, float(np.sin(0.5 * k * dt) + 0.5 * np.sin(1.3 * k * dt)))])
        yield force, (k + 2) * dt, (k + 3) * dt


@pytest.mark.parametrize('thrusters', [AS_CONFIGURED, FADING])
@pytest.mark.parametrize('i', range(5))
def test_sensitivities_are_derivatives_of_the_motion(i, thrusters):
    ends = []
    small = 1e-5
    for sign in (-1.0, 0.0, 1.0):
        theta = list(THETA)
        theta[i] += sign * small
        filter = LinearisedFilter(theta, VARIANCES, 0.0, thrusters=thrusters)
        for force, start, end in sines(3.0):
            filter.move(force, start, end)
        ends.append((filter.motion[:2], [row[i] for row in filter.sensitivities[:2]]))
    for k in range(2):
        derivative = (ends[2][0][k] - ends[0][0][k]) / (2.0 * small)
        assert ends[1][1][k] == pytest.approx(derivative, rel=0.05, abs=0.01)


def test_thrust_that_falls_with_speed_is_linear_drag_under_a_force_that_stays():
    """By the root of the force, either way."""
    filter = LinearisedFilter(THETA, VARIANCES, 0.0, shares=True)
    recent = DelayedForce()
    recent.add([(1.0, -0.49)], True, each=[each_of_one(-0.49)])
    filter.move(recent, 0.2, 0.8)
    for row in filter.sensitivities[:2]:
        assert row[-1] == pytest.approx(0.7 * row[GAMMA])
        assert row[5 + CANDIDATES.index('thrust_loss')] == pytest.approx(0.7 * row[GAMMA])
        assert row[GAMMA]


COMMANDS = [0.9, -0.7, 0.1, -0.1, 0.6, -1.0, 0.15, 0.8, -0.3, -0.9, 0.5, 0.05]


def each_of_one(force, bend=DEAD_BAND):
    """Return ``EACH`` of a single thruster."""
    return min(force, 0.0), DEAD_BAND * force / max(abs(force), bend), abs(force)**0.5


def test_what_one_thruster_does_by_itself_is_what_the_force_of_its_dof_does():
    """Also for commands that jump within a step."""
    recent = DelayedForce()
    bend = DEAD_BAND * sum(abs(x)**3 for x in COMMANDS) / sum(x * x for x in COMMANDS)
    recent.add([(0.07, force) for force in COMMANDS], True,
               each=[each_of_one(force, bend) for force in COMMANDS])
    filter = LinearisedFilter(THETA, VARIANCES, 0.0, shares=True)
    filter.set_motion(0.3, (0.0, 0.0))
    for k in range(3):
        filter.move(recent, 0.1 + 0.2 * k, 0.3 + 0.2 * k)
    for row in filter.sensitivities[:2]:
        known, each = row[5:5 + len(CANDIDATES)], row[5 + len(CANDIDATES):]
        assert each[:2] == pytest.approx([
            known[CANDIDATES.index(name)] for name in ('reverse_thrust', 'dead_band')])
        assert len(each) == len(EACH)
        assert each[2]


def test_the_force_of_a_step_is_kept_for_the_next_one_however_long_both_take():
    recent, whole = DelayedForce(), DelayedForce(False)
    for k in range(9):
        for force in (recent, whole):
            force.add([(15.0, 1.0 + k), (15.0, -0.5 * k)])
        if k:
            same = DelayedForce()
            same.restore(recent.state())
            # from the middle of one step to the middle of the next
            begin = recent.end - 45.0
            assert recent.over(begin, begin + 30.0, 0.3) == whole.over(begin, begin + 30.0, 0.3)
            assert same.state() == recent.state()
    assert len(recent.state()['means']) < len(whole.state()['means'])


def test_what_each_thruster_did_is_kept_as_long_as_the_force_and_comes_as_late():
    recent = DelayedForce(thrusters=Thrusters(lag=0.1))
    for k in range(400):  # a force that stays, of thrusters that do not
        recent.add([(0.06, 0.5)], True, each=[(-0.01 * k, 0.2, float(k % 2))])
    assert recent.state()['times'][0] > 24.0 - 9.0
    same = DelayedForce(thrusters=Thrusters(lag=0.1))
    same.restore(recent.state())
    for one in (recent, same):
        reverse, moment, cut, cut_moment, root = one.each(23.5, 23.56, 0.26)
        # 0.36 s before: a third of span 385 and two of 386
        assert reverse == pytest.approx(-(0.02 * 3.85 + 0.04 * 3.86))
        assert moment == pytest.approx(-(0.02 * 0.05 * 3.85 + 0.04 * 0.02 * 3.86))
        assert (cut, cut_moment) == pytest.approx((0.2 * 0.06, 0.2 * 0.5 * 0.06**2))
        assert root == pytest.approx(0.02)
    assert DelayedForce().each(0.0, 0.1) == (0.0,) * 5
    state = recent.state()
    for broken in (state['each'][1:], [[0.0, 0.0, float('nan')], *state['each'][1:]]):
        with pytest.raises(ValueError, match='each thruster'):
            DelayedForce(thrusters=Thrusters(lag=0.1)).restore({**state, 'each': broken})


def staircase(duration, dt=0.1):
    """Commands that jump at every fix and once between two, as those of a controller do."""
    random, force = np.random.default_rng(3), DelayedForce()
    force.add([(dt, 0.0)] * 3, held=True)
    for k in range(round(duration / dt)):
        force.add([(0.4 * dt, float(random.normal())), (0.6 * dt, float(random.normal()))],
                  held=True)
        yield force, (k + 2) * dt, (k + 3) * dt


@pytest.mark.parametrize('delay', [-0.012, 0.001, 0.05])
def test_the_delay_feels_every_jump_of_held_commands(delay):
    ends, small = [], 1e-5
    for one in (delay - small, delay, delay + small):
        filter = LinearisedFilter((*THETA[:4], one), VARIANCES, 0.0)
        ends.append([])
        for force, start, end in staircase(10.0):
            filter.move(force, start, end)
            ends[-1].append((filter.motion[0], filter.sensitivities[0][4]))
    low, middle, high = np.array(ends)
    derivative = (high[:, 0] - low[:, 0]) / (2.0 * small)
    assert np.std(middle[:, 1] - derivative) < 0.1 * np.std(derivative)


@pytest.mark.parametrize('force_std', [0.0, 0.1])
def test_information_is_the_sum_of_what_each_measurement_tells(force_std):
    random = np.random.default_rng(0)
    filter = LinearisedFilter(THETA, VARIANCES, force_std)
    filter.set_motion(0.0, (1e-4, 1.0))
    information = np.diag(1.0 / np.array(VARIANCES))
    for force, start, end in sines(30.0):
        filter.move(force, start, end)
        found = filter.innovation(0, filter.motion[0] + 0.01 * float(random.normal()), 1e-4)
        psi = np.array(found.psi[:5])
        assert found.total == pytest.approx(
            found.given + psi @ np.array(filter.theta_covariance) @ psi)
        information += np.outer(psi, psi) / found.given
        filter.update(found, 0.0, True)
    covariance = np.array(filter.theta_covariance)
    assert (covariance == covariance.T).all()
    assert covariance == pytest.approx(np.linalg.inv(information), rel=1e-6, abs=1e-12)


def test_without_adaptation_the_motion_counts_with_uncertain_parameters():
    filter = LinearisedFilter(THETA, VARIANCES, 0.0)
    filter.set_motion(0.0, (1e-4, 1e-4))
    known = LinearisedFilter(THETA, (1e-12,) * 5, 0.0)
    known.set_motion(0.0, (1e-4, 1e-4))
    for force, start, end in sines(2.0):
        for one in (filter, known):
            one.move(force, start, end)
    before = filter.motion[0]
    for one in (filter, known):
        one.update(one.innovation(0, before + 1.0, 1e-2), 0.0, False)
    # what is far off is believed where the parameters may be wrong, not where they are exact
    assert filter.motion[0] > before + 0.9
    assert known.motion[0] < before + 0.2
    assert filter.theta == list(THETA)
    assert filter.covariance[0] > 0.0


@pytest.mark.long
def test_the_covariance_stays_symmetric_and_positive_over_very_many_updates():
    random = np.random.default_rng(0)
    filter = LinearisedFilter(THETA, VARIANCES, 0.05)
    filter.set_motion(0.0, (1e-4, 1.0))
    force, time, h = DelayedForce(), 0.0, 0.1
    force.add([(h, 0.0)] * 2)
    box = [(0, 1e-3, 1e3), (1, -1e3, 0.0), (2, -1e3, 0.0), (4, -0.05, 0.6)]
    for k in range(50_000):
        # long rests, and a change of the noise now and then
        force.add([(h, 0.0 if k % 3000 > 2000 else float(np.sin(0.05 * k)))])
        filter.move(force, time, time + h)
        time += h
        noise = (1e-9, 1e-5, 1.0)[k // 500 % 3]
        value = filter.motion[0] + float(random.normal()) * noise**0.5
        filter.update(filter.innovation(0, value, noise), 0.0, True)
        filter.keep_inside(box)
    covariance = np.array(filter.theta_covariance)
    assert (covariance == covariance.T).all()
    size = np.sqrt(np.diag(covariance))
    assert (size > 0.0).all()
    assert np.linalg.eigvalsh(covariance / np.outer(size, size))[0] > -1e-6
