"""The offline methods on trials whose truth is known."""

from dataclasses import replace
from math import inf, sqrt
from statistics import median

from hypothesis import given, settings as hypothesis_settings, strategies as st
import numpy as np
import pytest
from rovid_core.identify.aid.full_gain import FullGainIdentifier
from rovid_core.model.plant import advance, integral, trajectory
from rovid_core.model.samples import Step
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Scales
from rovid_core.simulation.sensors import simulate
from rovid_core.trials.offline import METHODS, subsets, with_acceleration
from rovid_core.trials.output_error import information, noise, output_error
from rovid_core.trials.score import ScoreLog

from test.support.offline_trials import (
    aid,
    bias,
    bound_ratio,
    COMPARED,
    errors_on,
    scores,
    squares,
)
from test.support.surge import HEAVY, run, surge_settings, SURGE_TRUTH
from test.support.tank import offline_fits
from test.support.trials import trial, TRIALS

WAVES = ((150.0, 1 / 18), (80.0, 1 / 7.3))
SCALES = Scales.of(HEAVY)
SETTINGS = surge_settings()


def test_a_record_holds_what_the_sensors_measured():
    log = ScoreLog(SETTINGS)
    measured = list(simulate(replace(SETTINGS, simulation=replace(
        SETTINGS.simulation, attitude_noise=0.0)), 60.0, 4))
    run(Stream(SETTINGS, scorer=log), measured)
    record, = log.records('surge')
    fixes = np.array([v[0] for _, n, v in measured if n == 'position'])
    assert record.position == pytest.approx(
        fixes[1:1 + len(record.position)] - fixes[1], abs=1e-9)
    exact = integral(trajectory(np.array(SURGE_TRUTH), float(record.velocity[:5].mean()),
                          record.dt, record.force), record.dt)[record.nodes]
    assert np.abs(exact - record.position).max() < 0.3  # only the start is not known


@pytest.mark.parametrize(('method', 'tolerance'), [
    ('least_squares', 0.03), ('filtered_least_squares', 0.15), ('aid_offline', 0.05),
    ('output_error', 0.005)])
def test_each_method_finds_the_vehicle(method, tolerance):
    fit = METHODS[method]([trial(SURGE_TRUTH, WAVES, 0, 1e-4)], SCALES, SETTINGS)
    assert fit.parameters[:2] == pytest.approx(SURGE_TRUTH[:2], rel=tolerance)
    assert fit.note == ''


@pytest.mark.long
@pytest.mark.parametrize('method', METHODS)
def test_left_out_terms_are_zero_and_short_trials_give_nothing(method):
    for known in subsets(HEAVY):
        fit = METHODS[method]([trial(SURGE_TRUTH, WAVES, 0)], Scales.of(known), SETTINGS)
        active = Scales.of(known).active
        assert [p == 0.0 for p, on in zip(fit.parameters, active) if not on] == [True] * (
            4 - sum(active))
    short = METHODS[method]([], SCALES, SETTINGS)
    assert 'too short' in short.note


def test_a_rank_deficiency_is_told():
    # constant thrust: the speed is constant, and every term looks like every other
    fit = with_acceleration([trial(SURGE_TRUTH, ((100.0, 1e-6),), 0, 0.0)], SCALES, 0.6)
    assert fit.note.startswith('rank ')
    assert 'of 4' in fit.note


def test_the_identifier_is_no_worse_than_least_squares():
    judge = [((120.0, 1 / 12), (60.0, 1 / 25))]
    best, paper = (errors_on('surge', WAVES, how, judge, seeds=5)[0]
                   for how in (aid, squares))
    assert best <= paper


def medians(dof, k, seeds=3, methods=COMPARED):
    """Return per method the paper's score and the errors on the DOF's trials."""
    return np.median(
        [scores(dof, TRIALS[dof][k], seed, methods) for seed in range(seeds)], axis=0)


@pytest.mark.long
@pytest.mark.parametrize(('dof', 'k'), [('surge', 0), ('surge', 2), ('heave', 0), ('yaw', 1)])
def test_single_sinusoids_of_any_period_suffice(dof, k):
    # slow ones hardly show the mass: only a Gamma that is not diagonal finds it in time
    table = medians(dof, k)
    own = table[:, 1 + k]
    assert own[1] <= own[0], 'no worse than least squares'


@pytest.mark.long
@pytest.mark.parametrize('dof', TRIALS)
def test_large_thrust_gives_a_model_for_all_trials(dof):
    large, small = (medians(dof, k, 2, [aid])[0, 1:].max() for k in (1, -1))
    assert small > 4 * large


@pytest.mark.long
def test_only_heave_has_a_bias():
    for dof in TRIALS:
        found = np.array([bias(dof, seed) for seed in range(3)])
        _, delta, with_it, without, score, score_without = np.median(found, axis=0)
        significant = abs(delta) > 4 * found[:, 1].std(ddof=1)
        assert significant == (dof == 'heave')
        assert (score_without > 1.1 * score) == (dof == 'heave')
        assert (without > 2 * with_it) == (dof == 'heave')


def test_w_with_a_full_gamma_never_grows():
    dt, count = 0.01, 3000
    t = np.arange(2 * count + 1) * dt / 2
    force = 100.0 * np.sin(t)
    v = trajectory(np.array(SURGE_TRUTH), 0.0, np.full(2 * count, dt / 2),
                 0.5 * (force[:-1] + force[1:]))
    # a Gamma under which the drags soon meet their bounds
    spread = np.array([[0.004, 0.1, 0.3, 0.0], [0.0, 3.0, 4.0, 0.1], [0.0, 0.0, 1.0, 0.0],
                       [0.0, 0.0, 0.0, 0.1]])
    identifier = FullGainIdentifier(SCALES, 1.0, spread.T @ spread)
    identifier.restart(0.0)
    energy = [identifier.lyapunov(0.0, SURGE_TRUTH)]
    for k in range(0, 2 * count, 2):
        mean = (force[k] + 4.0 * force[k + 1] + force[k + 2]) / 6.0
        assert not identifier.step(Step(dt, tuple(v[k:k + 3]), tuple(force[k:k + 3]), v[k + 2],
                                        parts=(dt, 0.0), forces=(mean, 0.0)))
        energy.append(identifier.lyapunov(v[k + 2], SURGE_TRUTH))
    assert np.diff(energy).max() < 1e-5 * energy[0]
    assert energy[-1] < 0.9 * energy[0]


def test_the_noise_of_unfiltered_velocities_leaves_no_bias():
    # the noise of two neighbouring differences is correlated, and so is v_hat with it
    slow = ((30.0, 0.025),)
    assert errors_on('surge', slow, aid, [slow], seeds=3)[0] < 0.001


@pytest.mark.long
def test_output_error_attains_the_bound():
    ratio, bound = bound_ratio(8)
    assert ratio.max() < 1.6  # 200 seeds are in the benchmark; 8 scatter
    assert bound.max() < 0.002


def test_output_error_stands_outliers():
    clean = trial(SURGE_TRUTH, WAVES, 3)
    wild = clean.position.copy()
    wild[::50] += 1.0
    fit = output_error([replace(clean, position=wild)], SCALES, SCALES.initial)
    assert fit.parameters == pytest.approx(SURGE_TRUTH, rel=0.02)


def test_the_noise_is_that_of_the_fixes_also_with_outliers():
    record = trial(SURGE_TRUTH, WAVES, 5)
    assert noise([record]) == pytest.approx(0.005, rel=0.1)
    wild = record.position.copy()
    wild[::50] += 1.0
    assert noise([replace(record, position=wild)]) == pytest.approx(0.005, rel=0.2)


def test_slow_and_large_thrust_says_more():
    def bound(force, hz):
        record = trial(SURGE_TRUTH, ((force, hz),), 0)
        return np.sqrt(np.diag(information([record], SCALES, SURGE_TRUTH).covariance))

    assert (bound(150.0, 0.025)[:3] < bound(150.0, 0.25)[:3]).all()
    assert (bound(150.0, 0.05) < bound(30.0, 0.05)).all()


@pytest.mark.long
def test_the_tank_is_predicted(data):
    fits = offline_fits(data / 'bluerov2_tank')
    limits = {'surge': (0.034, 0.69), 'sway': (0.034, 0.61), 'heave': (0.026, 0.59),
              'yaw': (0.127, 0.36)}
    for dof, (mae, fit) in limits.items():
        assert fits[dof][0] <= mae + 5e-5, dof
        assert fits[dof][1] >= fit, dof


drags = st.tuples(st.floats(1e-3, 10.0), st.floats(1e-3, 100.0), st.floats(0.0, 10.0),
                  st.floats(-5.0, 5.0))


@given(drags, st.floats(-20.0, 20.0), st.floats(0.0, 1e4),
       st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(1e-3, 5.0)), max_size=30))
@hypothesis_settings(max_examples=300, deadline=None)
def test_bounded_thrust_gives_bounded_velocity(model, start, largest, steps):
    """Appendix of the paper: the bound is where the drag outweighs the largest thrust."""
    alpha, quadratic, linear, delta = model
    push = alpha * largest + abs(delta)
    bound = (sqrt(linear**2 + 4 * quadratic * push) - linear) / (2 * quadratic)
    v = start
    for share, dt in steps:
        v = advance((alpha, -quadratic, -linear, delta), v, share * largest, dt)
        assert abs(v) <= max(abs(start), bound) * (1 + 1e-3) + 1e-9
    assert median([abs(v), 0.0, inf]) == abs(v)
