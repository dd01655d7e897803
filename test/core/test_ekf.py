"""The extended Kalman filter: bound, coverage, faults, changes, rest, units, robustness."""

from dataclasses import replace
from math import inf, isfinite, isnan, nan
import re

import numpy as np
import pytest
from rovid_core.identify.ekf.batch_start import NEVER
from rovid_core.identify.ekf.extended_kalman import ExtendedKalman
from rovid_core.identify.intervals import intervals
from rovid_core.identify.status import DofStatus
from rovid_core.model.dofs import PARAMETERS
from rovid_core.model.plant import lumped, trajectory
from rovid_core.model.samples import Event, Sample, Step
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import CurrentSettings, InputSettings, Scales, SimulatedDof
from rovid_core.simulation.profiles import Steps
from rovid_core.simulation.sensors import simulate
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

from test.support.online_runs import followed_payload, guess_error, moved, Rest, run, scaled_error
from test.support.online_trials import (
    bound,
    Case,
    CLEAN,
    FAULTS,
    follow,
    HONEST,
    impulse,
    prediction_error,
    trial,
)
from test.support.sensors import at_rates
from test.support.surge import (
    HEAVY,
    LIGHT,
    run as run_stream,
    surge_settings,
    SURGE_TRUTH,
    TRAINING,
)
from test.support.tank import LEAST, online_fits, replayed, yaw_fit
from test.support.trials import CONFIG

pytestmark = pytest.mark.long

TRUE = np.array(SURGE_TRUTH)
MINUTE = replace(CLEAN, duration=60.0)


def identified(case, seed, guess=HEAVY, marks=(inf,)):
    return follow(ExtendedKalman(Scales.of(guess)), trial(case, seed).pieces(), marks)


@pytest.fixture(scope='module')
def clean():
    """Return some runs of the clean case."""
    return [run(CLEAN, 'ekf', seed) for seed in range(8)]


@pytest.fixture(scope='module')
def honest():
    """Return some runs with outliers, dropouts and a delay."""
    return [run(HONEST, 'ekf', seed) for seed in range(5)]


def test_the_errors_after_5_minutes_are_those_of_the_cramer_rao_bound(clean):
    errors = np.array([one.parameters[1] for one in clean]) - TRUE
    assert max(np.sqrt(np.mean(errors**2, axis=0)) / bound(300.0, True)) < 1.4


def test_the_errors_after_a_minute_are_those_of_the_cramer_rao_bound():
    # of 12 at the bound one rms in a thousand is above 1.66
    errors = np.array([identified(MINUTE, seed)[0].parameters for seed in range(12)]) - TRUE
    assert max(np.sqrt(np.mean(errors**2, axis=0)) / bound(60.0, True)) < 1.66


def test_the_intervals_hold_the_truth(clean):
    inside = np.mean([one.covered for one in clean])
    assert inside > 0.88  # of 128, which hang together in fours


def test_no_run_takes_the_vehicle_for_changed(clean):
    assert not any(one.changed for one in clean)


def test_the_model_predicts_another_profile(clean):
    assert max(one.error for one in clean) < 2e-4


def test_outliers_dropouts_delay_and_gains_cost_next_to_nothing(honest):
    for one in (*honest, run(FAULTS, 'ekf', 0)):
        assert one.error < 5e-4
        assert not one.changed


@pytest.mark.parametrize(('wrong', 'missing'), [
    ((0,), ()), ((1,), ()), ((1,), (4,)), ((2, 3), ()), ((8, 9), ()), ((40, 41, 42, 43), ())])
def test_outliers_in_the_first_seconds_cost_nothing(wrong, missing):
    one = trial(MINUTE, 0)
    fixes = one.fixes.copy()
    fixes[list(wrong)] += 1.0
    one = replace(one, time=np.delete(one.time, missing), fixes=np.delete(fixes, missing))
    [found] = follow(ExtendedKalman(Scales.of(HEAVY)), one.pieces())
    assert max(abs(np.array(found.parameters) - TRUE) / bound(60.0, True)) < 5.0


def test_the_intervals_hold_with_outliers_dropouts_and_delay(honest):
    assert np.mean([one.covered for one in honest]) > 0.85


@pytest.mark.parametrize('delay', [0.0, 0.1, 0.3])
def test_the_delay_is_found(delay):
    [found] = identified(replace(MINUTE, delay=delay), 0)
    assert found.delay == pytest.approx(delay, abs=max(4 * found.delay_std, 2e-3))
    assert found.delay_std < 0.006  # a lag is in it, which a minute hardly tells from a delay


def test_clocks_that_disagree_are_named_with_their_size():
    one = ExtendedKalman(Scales.of(HEAVY))
    follow(one, trial(replace(CLEAN, duration=150.0, delay=-0.3), 0).pieces())
    assert one.delay == pytest.approx(-0.05, abs=2e-3)
    size, = re.findall('clocks disagree: thrust acts about ([0-9.]+) s', one.note)
    assert float(size) == pytest.approx(0.3, rel=0.25)
    assert one.doubt


@pytest.mark.parametrize('case', [CLEAN, HONEST], ids=['clean', 'honest'])
def test_a_payload_is_noticed_and_followed(case):
    payload = followed_payload(case, 0)
    assert payload.after < 60.0
    assert abs(payload.alpha) < 0.2


def test_a_payload_is_said_in_the_status():
    scales = Scales.of(HEAVY)
    one, status, said, time = ExtendedKalman(scales), DofStatus(scales, 3.0), [], 0.0
    case = Case(150.0, payload=100.0, loaded=lumped(348.0, 290.0, 43.5, 2.9))
    for piece in trial(case, 0).pieces()[1:]:
        refused = one.step(piece)
        time += piece.dt
        reasons = status.update(one, piece, refused, True).reasons
        if any('the vehicle changed' in reason for reason in reasons):
            said.append(time)
    assert 100.0 < said[0] < 140.0
    assert said[-1] > 149.0


@pytest.mark.parametrize('rest', Rest, ids=lambda rest: rest.name)
def test_rest_moves_nothing(rest):
    assert max(moved(rest, 'ekf', 0, hour=300.0)) < 1.0


def test_units_and_size_change_nothing():
    usual, _ = scaled_error('290 kg, N', 0)
    for name in ('kN', '10 t, same motion'):
        assert scaled_error(name, 0)[0] == pytest.approx(usual, rel=0.01), name


@pytest.mark.parametrize('name', ['both x 4', 'both / 4', 'mass x 4, drags / 4'])
def test_a_guess_off_by_4_does_not_matter(name):
    assert guess_error(name, 0) < 2e-4


@pytest.mark.parametrize('terms', [
    ('alpha',), ('alpha', 'beta'), ('alpha', 'gamma', 'delta'), ('alpha', 'beta', 'gamma')])
def test_left_out_terms_are_zero_and_the_others_right(terms):
    on = [name in terms for name in PARAMETERS]
    truth = tuple(p if used else 0.0 for p, used in zip(SURGE_TRUTH, on))
    # alpha alone has no drag: a thrust without mean leaves a speed that stays
    [found] = identified(replace(MINUTE, truth=truth), 1, replace(HEAVY, terms=terms))
    covariance = np.reshape(found.covariance, (4, 4))
    for i, used in enumerate(on):
        if used:
            assert abs(found.parameters[i] - truth[i]) < 4.5 * found.std[i]
            assert found.std[i] < 0.05 * abs(SURGE_TRUTH[i])
        else:
            assert found.parameters[i] == 0.0
            assert isnan(found.std[i])
            assert not covariance[i].any()


@pytest.mark.parametrize(('noise', 'over'), [(0.005, True), (0.2, False)])
def test_the_start_is_over_once_all_data_lead_to_where_the_filter_is(noise, over):
    """Fixes that are off by 0.2 m tell the parameters less well; a lag may be named yet."""
    one = ExtendedKalman(Scales.of(HEAVY))
    follow(one, trial(replace(MINUTE, duration=70.0), 0, noise).pieces())
    assert (one.state()['start']['next'] == NEVER) == over


@pytest.mark.parametrize('seed', range(3))
def test_what_begins_after_minutes_of_rest_is_gone_through_again(seed):
    """There the thrust only carries the weight, which says nothing of the mass."""
    known = surge_settings(method='ekf')
    settings = replace(known, simulation=replace(known.simulation, dofs={
        'surge': SimulatedDof(290.0, 290.0, 43.5, 15.0)}))
    levels = (15.0,) * 27 + 2 * (150.0, -120.0, 80.0, -150.0, 120.0, -60.0, 100.0, -40.0)
    found = run_stream(Stream(settings), simulate(
        settings, 210.0, seed, {'surge': (Steps(levels, 5.0),)}))
    surge = found[-1].dofs[0]
    low, high = surge.intervals['mass']
    assert low <= 290.0 <= high
    assert surge.status == 'converged', surge.judgement
    assert not any('changed' in reason for one in found for reason in one.dofs[0].reasons)


@pytest.mark.parametrize('step', [0.01, 0.05])
def test_a_depth_in_steps_that_rests_for_minutes_is_not_taken_to_be_exact(step):
    """What never scatters seems to have no noise, and a filter that believes that is lost."""
    known = surge_settings(method='ekf')
    settings = replace(
        known, dofs=('heave',), dof={'heave': HEAVY}, position=InputSettings(),
        depth=InputSettings('/depth'), attitude=InputSettings(),
        thrusters=replace(known.thrusters, allocation=((0.0,), (0.0,), (1.0,), *3 * [(0.0,)])),
        simulation=replace(known.simulation, depth_noise=0.0005, dofs={
            'heave': SimulatedDof(290.0, 290.0, 43.5, 15.0)}))
    levels = (15.0,) * 27 + 2 * (150.0, -120.0, 80.0, -150.0, 120.0, -60.0, 100.0, -40.0)
    stream = Stream(settings)
    found = run_stream(stream, [
        (time, name, (step * round(value[0] / step),) if name == 'depth' else value)
        for time, name, value in simulate(settings, 210.0, 1, {'heave': (Steps(levels, 5.0),)})])
    heave = found[-1].dofs[0]
    low, high = heave.intervals['mass']
    assert low <= 290.0 <= high
    assert high - low < 30.0
    assert heave.status == 'converged', heave.judgement
    assert not any('changed' in reason for one in found for reason in one.dofs[0].reasons)
    for member in stream.state()['dofs']['heave']['bank']['members']:
        noise = member['innovations'][0] * Scales.of(HEAVY).velocity
        assert 0.9 * min(step / 12**0.5, 0.01) < noise < step  # 0.01 is what it begins with


def test_nor_are_fixes_in_steps():
    """The same of surge and sway together, whose fixes are measured in the world."""
    known = surge_settings(method='ekf')
    truth = SimulatedDof(290.0, 290.0, 43.5, 15.0)
    settings = replace(
        known, dofs=('surge', 'sway'), dof={'surge': HEAVY, 'sway': HEAVY},
        current=CurrentSettings(prior=0.02), thrusters=replace(
            known.thrusters, gain=(1.0, 1.0),
            allocation=((1.0, 0.0), (0.0, 1.0), *4 * [(0.0, 0.0)])),
        simulation=replace(known.simulation, position_noise=0.0005,
                           dofs={'surge': truth, 'sway': truth}))
    rest, push = (15.0,) * 27, 2 * (150.0, -120.0, 80.0, -150.0, 120.0, -60.0, 100.0, -40.0)
    stream = Stream(settings)
    run_stream(stream, [
        (time, name, tuple([0.05 * round(20.0 * x) for x in value])
         if name == 'position' else value) for time, name, value in simulate(settings, 210.0, 1, {
            'surge': (Steps((*rest, *push), 5.0),), 'sway': (Steps((*rest, *push[::-1]), 5.0),)})])
    for dof in stream.estimate.dofs:
        low, high = dof.intervals['mass']
        assert low <= 290.0 <= high < 1.3 * low, dof.dof


def test_it_goes_on_after_a_gap():
    one, pieces = ExtendedKalman(Scales.of(HEAVY)), trial(CLEAN, 2).pieces()
    [before] = follow(one, pieces[:1500])
    [after] = follow(one, [pieces[1800].velocity[1], *pieces[1801:]])
    assert prediction_error(after.parameters, after.delay, CLEAN) < 2e-4
    assert all(b <= a for a, b in zip(before.std, after.std))
    assert not isfinite(after.changed_at)


def test_a_gap_in_the_first_seconds_does_no_harm():
    one, pieces = ExtendedKalman(Scales.of(HEAVY)), trial(MINUTE, 2).pieces()
    [found] = follow(one, [*pieces[:100], pieces[130].velocity[1], *pieces[131:]])
    assert all(abs(p - t) < 4.5 * s for p, t, s in zip(found.parameters, TRUE, found.std))


def velocity_sensor(seed, duration=120.0, noise=0.01, dt=0.1, fine=32):
    """Return what the pipe makes of a DVL."""
    time = np.arange(round(duration / dt) * fine + 1) * dt / fine
    thrust = impulse(TRAINING, time)
    true = trajectory(TRUE, 0.0, np.diff(time), np.diff(thrust) / np.diff(time))[::fine]
    measured = true + np.random.default_rng(seed).normal(0.0, noise, len(true))
    forces = np.diff(thrust[::fine]) / dt
    return [float(measured[0]), *(
        Step(dt, (a, 0.5 * (a + b), b), (f,) * 3, b, 0.0, (dt, 0.0), (f, 0.0))
        for a, b, f in zip(measured.tolist(), measured[1:].tolist(), forces.tolist()))]


def test_a_velocity_sensor_does_as_well():
    inside = []
    for seed in range(4):
        [found] = follow(ExtendedKalman(Scales.of(HEAVY)), velocity_sensor(seed))
        assert prediction_error(found.parameters, found.delay, CLEAN) < 3e-3
        held = intervals(found.parameters, found.covariance)
        inside += [held[n][0] <= t <= held[n][1] for n, t in zip(PARAMETERS, SURGE_TRUTH)]
    assert sum(inside) >= 12  # of 16


def test_what_means_nothing_is_refused_and_recovered_from():
    one, pieces = ExtendedKalman(Scales.of(LIGHT)), trial(CLEAN, 3).pieces()
    follow(one, pieces[:1000])
    before = one.parameters
    good = pieces[1000]
    for wrong in ({'mean': nan}, {'mean': inf}, {'velocity': (nan,) * 3}, {'force': (inf,) * 3},
                  {'forces': (nan, 0.0)}, {'mean': 1e30}):
        assert one.step(good.replaced(**wrong)) == 'out_of_range'
        assert one.parameters == before
        assert all(map(isfinite, one.covariance))
    [found] = follow(one, pieces[1001:])
    assert prediction_error(found.parameters, found.delay, CLEAN) < 2e-4


def test_a_state_that_runs_away_is_given_up_and_found_again():
    one, pieces = ExtendedKalman(Scales.of(LIGHT)), trial(CLEAN, 3).pieces()
    follow(one, pieces[:1000])
    before, far = one.parameters, Scales.of(LIGHT).force
    # thrust that no vehicle has, for hours in one step
    wild = Step(1e5, (0.0,) * 3, (5e3 * far,) * 3, 0.0, 0.1, (1e5 - 0.05, 0.05),
                (5e3 * far,) * 2)
    assert one.step(wild) == 'diverged'
    assert one.parameters == before
    [found] = follow(one, pieces[1001:])
    assert prediction_error(found.parameters, found.delay, CLEAN) < 1e-3


def test_fixes_in_bursts_after_a_freeze():
    """Fixes that each begin anew after a gap measure nothing of the motion in 20 s."""
    settings = settings_from({**load(CONFIG / 'jhurov.yaml'), 'dofs': ['surge'], 'depth.topic': '',
                              'simulation.position_rate': 2.0})
    stream = Stream(settings)
    for time, name, value in simulate(settings, 200.0, seed=0):
        if name in stream.inputs and not (
                name == 'position' and time > 19.5e9 and time // 500_000_000 % 6 >= 3):
            stream.receive(Event(time, (Sample(name, value),)))
        if 18e9 < time < 19e9 and stream.adapting:
            stream.enable(False)
        elif time > 19e9 and not stream.adapting:
            stream.enable(True)
    [dof] = stream.estimate.dofs
    assert 1.0 / dof.parameters[0] == pytest.approx(290.0, rel=0.1)


def test_the_tank_recordings_are_predicted(data):
    logs = data / 'bluerov2_tank'
    if not logs.is_dir():
        pytest.skip(f'no {logs}')
    found = online_fits(logs, 'ekf')
    assert {dof: fit for dof, fit in found.items() if not 100 * fit >= LEAST[dof]} == {}


def test_a_log_of_ten_seconds_is_gone_through_as_a_whole_at_its_end(data):
    """As it comes the filter predicts 77 and 11 % of it, output error 91 and 72 %."""
    logs = data / 'subjugator'
    scores, estimate = replayed(
        logs, 'backward4.bag', settings_from(load(logs / 'subjugator.yaml')))
    for dof, least in (('surge', 0.88), ('sway', 0.7)):
        [one] = [one for one in estimate.dofs if one.dof == dof]
        assert scores.score(dof, (*one.parameters, *one.couplings), one.delay,
                            one.thrusters).fit > least


def test_a_coupling_predicts_the_tank_s_yaw_better(data):
    logs = data / 'bluerov2_tank'
    if not logs.is_dir():
        pytest.skip(f'no {logs}')
    coupled, alone = yaw_fit(logs, ('v',)), yaw_fit(logs, ())
    assert coupled > 0.5
    assert coupled > alone + 0.05


def test_the_intervals_hold_for_every_dof_with_held_commands():
    settings = at_rates(settings_from(load(CONFIG / 'jhurov.yaml')), depth=10.0, attitude=10.0)
    errors = []
    for seed in range(4):
        stream = Stream(settings)
        for time, name, value in simulate(settings, 60.0, seed):
            if name in stream.inputs:
                stream.receive(Event(time, (Sample(name, value),)))
        stream.finish()
        for dof in settings.dofs:
            true = settings.simulation.dofs[dof]
            truth = lumped(true.mass, true.quadratic_drag, true.linear_drag, true.bias)
            found = stream.identifier(dof)
            assert 'changed' not in found.note
            errors.append((np.array(found.parameters) - np.array(truth)) / np.array(found.std))
    rms = np.sqrt(np.mean(np.array(errors).reshape(4, -1, 4)**2, axis=0))
    # 1 for exact intervals; of four seeds it is above 2.15 once in a thousand
    assert rms.max() < 2.15


def test_fixes_that_come_fast_are_taken_together_at_no_loss():
    """As from a DVL filter at 100 Hz: their mean is worth as much as all of them."""
    steps = []
    random = np.random.default_rng(1)
    rate, waves = 100.0, TRAINING
    time = np.arange(round(60.0 * rate) + 1) / rate
    force = np.diff(impulse(waves, time)) * rate
    velocity = trajectory(TRUE, 0.0, np.full(len(force), 1.0 / rate), force)
    for k in range(1, len(force)):
        measured = float(velocity[k + 1] + random.normal(0.0, 0.02))
        steps.append(Step(1.0 / rate, (measured,) * 3, (float(force[k]),) * 3, measured,
                          parts=(1.0 / rate, 0.0), forces=(float(force[k]), 0.0)))
    one = ExtendedKalman(Scales.of(HEAVY))
    for step in steps:
        assert one.step(step) == ''
    assert max(abs(np.array(one.parameters) - TRUE) / np.array(one.std)) < 4.0
    assert one.std[0] < 7e-3 * TRUE[0]
    assert one.v_hat == pytest.approx(float(velocity[-1]), abs=0.01)


@pytest.mark.long
@pytest.mark.parametrize('coriolis', [False, True])
def test_what_is_simulated_without_noise_lacks_nothing(coriolis):
    """The errors that are left then hang together: they are of the steps of the filter."""
    settings = settings_from(load(CONFIG / 'odometry_wrench.yaml'))
    stream = Stream(replace(settings, simulation=replace(
        settings.simulation, position_noise=0.0, attitude_noise=0.0, position_rate=20.0,
        coriolis=coriolis)))
    for time, name, value in simulate(stream.settings, 130.0, 1):
        stream.receive(Event(time, (Sample(name, value),)))
    stream.finish()
    for dof in stream.estimate.dofs:
        assert (dof.status, dof.reasons) == ('converged', ())
        assert dof.parameters[0] == pytest.approx(
            1.0 / settings.simulation.dofs[dof.dof].mass, rel=5e-3)
