"""What every identifier has to do, checked on each of them."""

from dataclasses import replace
import json
import math

from hypothesis import given, settings as hypothesis_settings, strategies as st
import numpy as np
import pytest
from rovid_core.identify import make_identifier, METHODS
from rovid_core.identify.aid.adaptive_identifier import AdaptiveIdentifier, Gains
from rovid_core.identify.aid.self_tuning import SelfTuningIdentifier
from rovid_core.model.dofs import PARAMETERS
from rovid_core.model.plant import advance, lumped
from rovid_core.model.samples import Step
from rovid_core.settings.run import DofSettings, IdentifierSettings, Scales, SettingsError

DOF = DofSettings(400.0, 150.0, 20.0, 1.0)
TRUTH = lumped(290.0, 290.0, 43.5, 2.9)
METHOD_SETTINGS = [
    *(IdentifierSettings(integrator=name) for name in ('euler', 'heun', 'rk4')),
    *(IdentifierSettings(method=name) for name in METHODS if name != 'aid')]


@pytest.fixture(
    params=METHOD_SETTINGS,
    ids=lambda s: f'aid-{s.integrator}' if s.method == 'aid' else s.method)
def settings(request):
    return request.param


def steps(count=400, dt=0.1, force=1.0, velocity=1.0):
    """Return a vehicle under two sinusoids, with force and velocity scaled."""
    out, v = [], 0.0
    for k in range(count):
        t = (k + 0.5) * dt
        f = 150 * math.sin(2 * math.pi * t / 18) + 80 * math.sin(2 * math.pi * t / 7.3)
        new = advance(TRUTH, v, f, dt)
        out.append(Step(
            dt, (velocity * v, velocity * 0.5 * (v + new), velocity * new), (force * f,) * 3,
            mean=velocity * new, interval=dt, parts=(0.5 * dt, 0.5 * dt),
            forces=(force * f, force * f)))
        v = new
    return out


def run(identifier, sequence, adapt=True):
    for step in sequence:
        assert identifier.step(step, adapt) == ''
    return identifier


def test_it_comes_closer_to_the_truth(settings):
    identifier = make_identifier(settings, DOF)
    first = [abs(p / t - 1) for p, t in zip(identifier.parameters, TRUTH)][0]
    run(identifier, steps(2000))
    assert abs(identifier.parameters[0] / TRUTH[0] - 1) < 0.2 * first


def test_same_input_same_bits_and_reading_changes_nothing(settings):
    one, two = make_identifier(settings, DOF), make_identifier(settings, DOF)
    for step in steps():
        one.step(step)
        two.step(step)
        assert two.state() == two.state()
        _ = two.parameters, two.std, two.v_hat, two.excitation
    assert one.state() == two.state()


def test_what_was_known_at_a_step_stays_what_it_was(settings):
    one, two = make_identifier(settings, DOF), make_identifier(settings, DOF)
    run(one, steps(200))
    run(two, steps(200))
    before = one.uncertainty
    run(one, steps(200))
    one.restart(0.0)
    one.reset()
    # read only now, and of a method that has gone on: the same bits
    after = two.uncertainty
    assert (*before.covariance, *map(repr, before.std), repr(before.delay_std)) == (
        *after.covariance, *map(repr, after.std), repr(after.delay_std))


def test_reset_then_rerun_is_the_same_as_new(settings):
    identifier = run(make_identifier(settings, DOF), steps())
    first = identifier.state()
    identifier.reset()
    assert identifier.parameters == pytest.approx(lumped(400.0, 150.0, 20.0, 1.0))
    assert run(identifier, steps()).state() == first


def test_state_goes_through_json_to_the_same_bits(settings):
    sequence = steps()
    one = run(make_identifier(settings, DOF), sequence[:200])
    two = make_identifier(settings, DOF)
    two.restore(json.loads(json.dumps(one.state())))
    assert run(one, sequence[200:]).state() == run(two, sequence[200:]).state()


def test_a_state_out_of_bounds_is_refused(settings):
    identifier = make_identifier(settings, DOF)
    state = identifier.state()
    for bad in ([-1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [math.nan] * 4):
        with pytest.raises(ValueError):
            identifier.restore({**state, 'parameters': bad})
    assert identifier.state() == state


def test_frozen_parameters_stay_and_the_state_goes_on(settings):
    identifier = run(make_identifier(settings, DOF), steps(100))
    before, v_hat = identifier.parameters, identifier.v_hat
    run(identifier, steps(50), adapt=False)
    assert identifier.parameters == before
    assert identifier.v_hat != v_hat


@pytest.mark.parametrize('terms', [('alpha',), ('alpha', 'beta', 'delta'), ('alpha', 'gamma')])
def test_left_out_terms_are_exactly_zero(settings, terms):
    identifier = run(make_identifier(settings, replace(DOF, terms=terms)), steps())
    for name, value in zip(PARAMETERS, identifier.parameters):
        assert (value == 0.0) == (name not in terms)


def test_mirrored_force_and_velocity_mirror_the_bias_alone(settings):
    one = run(make_identifier(settings, DOF), steps())
    two = run(make_identifier(settings, replace(DOF, bias=-DOF.bias)),
              steps(force=-1.0, velocity=-1.0))
    alpha, beta, gamma, delta = one.parameters
    assert two.parameters == pytest.approx((alpha, beta, gamma, -delta), rel=1e-12)


@pytest.mark.parametrize('k', [1e-3, 7.0, 1e3])
def test_force_in_another_unit_gives_alpha_in_that_unit(settings, k):
    scaled = DofSettings(k * 400.0, k * 150.0, k * 20.0, k * 1.0)
    alpha, *rest = run(make_identifier(settings, DOF), steps()).parameters
    other_alpha, *other_rest = run(make_identifier(settings, scaled), steps(force=k)).parameters
    assert other_alpha == pytest.approx(alpha / k, rel=1e-9)
    assert other_rest == pytest.approx(rest, rel=1e-9)


def test_velocity_in_another_unit_scales_the_parameters(settings):
    # v' = k v: beta / k, gamma the same, alpha and delta k times
    k = 10.0
    alpha, beta, gamma, delta = run(make_identifier(settings, DOF), steps()).parameters
    scaled = DofSettings(400.0 / k, 150.0 / k**2 / k, 20.0 / k, 1.0, typical_velocity=0.5 * k,
                         typical_force=Scales.of(DOF).force)
    a, b, g, d = run(make_identifier(settings, replace(
        scaled, quadratic_drag=150.0 / k**2, bias=1.0)), steps(velocity=k)).parameters
    assert (a, b, g, d) == pytest.approx((k * alpha, beta / k, gamma, k * delta), rel=1e-9)


wild = st.floats(allow_nan=True, allow_infinity=True)
values = st.one_of(wild, st.sampled_from(
    [0.0, 1.0, -1.0, 1e300, -1e300, math.inf, math.nan, 1e-300, 1e12]))


@given(st.data())
@hypothesis_settings(max_examples=300, deadline=None)
def test_nothing_makes_it_leave_its_bounds(data):
    integrator = data.draw(st.sampled_from(['euler', 'heun', 'rk4']))
    gains = Gains(-data.draw(st.floats(1e-6, 1e6)),
                  tuple(data.draw(st.floats(0.0, 1e12)) for _ in range(4)))
    identifier = AdaptiveIdentifier(Scales.of(DOF), gains, integrator)
    low, high = identifier.bounds
    for _ in range(data.draw(st.integers(1, 20))):
        v0, v1, f = (data.draw(values) for _ in range(3))
        dt = data.draw(st.sampled_from([1e-9, 0.001, 0.1, 1.0, 100.0]))
        identifier.step(Step(dt, (v0, 0.5 * v0 + 0.5 * v1, v1), (f, f, f)))
        for p, bottom, top in zip(identifier.parameters, low, high):
            assert bottom <= p <= top
        assert math.isfinite(identifier.excitation)
    identifier.restart(0.0)
    assert math.isfinite(identifier.v_hat)


@pytest.mark.parametrize('method', METHODS)
@given(data=st.data())
@hypothesis_settings(max_examples=100, deadline=None)
def test_nothing_measured_makes_any_method_leave_its_bounds(method, data):
    identifier = make_identifier(IdentifierSettings(method=method), DOF)
    low, high = Scales.of(DOF).bounds()
    for _ in range(data.draw(st.integers(1, 30))):
        v0, v1, mean, f, g = (data.draw(values) for _ in range(5))
        dt = data.draw(st.sampled_from([1e-9, 0.001, 0.1, 1.0, 100.0]))
        identifier.step(Step(
            dt, (v0, 0.5 * v0 + 0.5 * v1, v1), (f, f, f), mean,
            data.draw(st.sampled_from([0.0, dt])), (0.25 * dt, 0.75 * dt), (f, g)))
        for p, bottom, top in zip(identifier.parameters, low, high):
            assert bottom <= p <= top
        assert math.isfinite(identifier.excitation)
        assert all(map(math.isfinite, identifier.covariance))
    identifier.restart(0.0)
    assert identifier.v_hat == 0.0


@pytest.mark.parametrize(('feedback', 'adaptation'), [
    (0.0, (1.0,) * 4), (1.0, (1.0,) * 4), (math.nan, (1.0,) * 4), (-1.0, (-1.0, 1.0, 1.0, 1.0)),
    (-1.0, (math.inf, 1.0, 1.0, 1.0))])
def test_gains_without_a_proof_are_refused(feedback, adaptation):
    with pytest.raises(SettingsError, match='identifier'):
        Gains(feedback, adaptation)


def test_names_that_there_are_not_are_refused():
    for bad in (IdentifierSettings(method='magic'), IdentifierSettings(integrator='magic')):
        with pytest.raises(SettingsError, match='magic'):
            make_identifier(bad, DOF)


def test_gains_that_are_too_high_for_the_step_are_divided_then_refused():
    scales = Scales.of(DOF)
    step = Step(0.1, (0.3, 0.3, 0.3), (100.0,) * 3)
    fast = AdaptiveIdentifier(scales, Gains.from_time(0.05, scales), 'euler')
    assert fast.step(step) == ''
    wild_gains = Gains(-2.0, (1.0, 1e9, 1e9, 1e9))
    absurd = AdaptiveIdentifier(scales, wild_gains, 'euler')
    assert absurd.step(step) == 'unstable_step'
    assert absurd.parameters == scales.initial


def averaged(typical=1.0, time=3.0):
    scales = Scales.of(DOF)
    return SelfTuningIdentifier(replace(
        scales, force=typical * scales.force, velocity=typical * scales.velocity), time, 'heun')


def test_what_is_published_is_a_mean_and_w_is_that_of_theta_hat():
    identifier, values = averaged(), []
    for k, step in enumerate(steps(1000)):
        identifier.step(step)
        if k >= 600:
            values.append((identifier.theta_hat[0], identifier.parameters[0]))
    assert np.ptp([p for _, p in values]) < 0.5 * np.ptp([t for t, _ in values])
    low, high = np.min(values, axis=0)[0], np.max(values, axis=0)[0]
    assert low < values[-1][1] < high
    dv = identifier.v_hat - 0.1
    assert identifier.lyapunov(0.1, TRUTH) == identifier.energy(dv, identifier.theta_hat, TRUTH)
    assert identifier.lyapunov(0.1, TRUTH) != identifier.energy(dv, identifier.parameters, TRUTH)


def test_w_does_not_grow_on_exact_data_while_the_gains_are_held():
    identifier, v, dt = averaged(), 0.0, 0.01
    identifier.restart(v)
    first = last = identifier.lyapunov(v, TRUTH)
    gains, changes = identifier.state()['gamma'], 0
    for k in range(7000):
        force = [100.0 * math.sin(2 * math.pi * (k + x) * dt / 15) for x in (0.0, 0.5, 1.0)]
        new = advance(TRUTH, v, force[1], dt)
        identifier.step(Step(dt, (v, 0.5 * (v + new), new), (force[1],) * 3))
        now, held = identifier.lyapunov(new, TRUTH), identifier.state()['gamma']
        if held == gains:
            assert now <= last + 1e-4 * first
        changes += held != gains
        v, last, gains = new, now, held
    assert changes == 2  # after 20 and 40 s of motion


def test_thrust_far_beyond_all_that_the_gains_were_learned_from():
    """A vehicle that drifts for a minute is in motion; then its thrusters start."""
    identifier = averaged()
    drifting = Step(0.1, (-0.08,) * 3, (0.0,) * 3)
    run(identifier, [drifting] * 600)
    refused = [bool(identifier.step(step)) for step in steps(3000)]
    assert 0 < sum(refused) < 20
    assert identifier.parameters[0] == pytest.approx(TRUTH[0], rel=0.05)


@pytest.mark.parametrize('typical', [1 / 3, 3.0])
def test_typical_sizes_far_off_and_exact_data_give_the_same_model(typical):
    found = run(averaged(typical), steps(3000)).parameters
    assert found == pytest.approx(run(averaged(), steps(3000)).parameters, rel=0.01)
    assert found[0] == pytest.approx(TRUTH[0], rel=0.02)


def test_raw_gains_are_never_rescaled_and_nothing_is_averaged():
    gains = (1e-5, 1.0, 1.0, 0.1)
    raw = make_identifier(
        IdentifierSettings(feedback_gain=-2.0, adaptation_gains=gains), DOF, gains)
    before = raw.energy(0.0, (0.0,) * 4, TRUTH)
    run(raw, steps(1000))
    assert raw.energy(0.0, (0.0,) * 4, TRUTH) == before
    assert raw.parameters == raw.theta_hat


def test_a_restored_mean_follows_a_vehicle_that_changes():
    sequence = steps(3000)
    one = run(averaged(), sequence)
    two = averaged()
    two.restore(json.loads(json.dumps(one.state())))
    run(two, [step._replace(force=tuple(1.25 * f for f in step.force)) for step in sequence])
    assert two.parameters[0] == pytest.approx(one.parameters[0] / 1.25, rel=0.01)


def test_a_frozen_identifier_keeps_mean_and_theta_hat_and_gains():
    identifier = run(averaged(), steps(300))
    before = identifier.state()
    after = run(identifier, steps(300), adapt=False).state()
    assert {**after, 'v_hat': 0, 'excitation': 0} == {**before, 'v_hat': 0, 'excitation': 0}


@pytest.mark.parametrize(('key', 'bad'), [
    ('theta_hat', [-1.0, 0.0, 0.0, 0.0]), ('gamma', [[1.0]]), ('sums', [math.nan] * 10),
    ('gamma', [[-1.0] * 4] * 4), ('next', 0.0)])
def test_a_broken_state_of_the_mean_is_refused(key, bad):
    identifier = run(averaged(), steps(300))
    state = identifier.state()
    with pytest.raises(ValueError):
        identifier.restore({**state, key: bad})
    assert identifier.state() == state
