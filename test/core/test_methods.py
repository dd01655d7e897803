"""What every identifier has to do, checked on each of them."""

from dataclasses import replace
import json
import math

from hypothesis import given, settings as hypothesis_settings, strategies as st
import pytest
from rovid_core.identify import make_identifier, METHODS
from rovid_core.identify.aid.adaptive_identifier import Gains, INTEGRATORS
from rovid_core.model.dofs import PARAMETERS
from rovid_core.model.plant import lumped
from rovid_core.model.samples import Step
from rovid_core.settings.run import DofSettings, IdentifierSettings, Scales, SettingsError

from test.support.identifier_steps import DOF, run, steps, TRUTH, values

METHOD_SETTINGS = [
    *(IdentifierSettings(method=name) for name in METHODS),
    *(IdentifierSettings(integrator=name, feedback_gain=-2.0) for name in INTEGRATORS)]


@pytest.fixture(
    params=METHOD_SETTINGS,
    ids=lambda s: f'raw gains, {s.integrator}' if s.feedback_gain else s.method)
def settings(request):
    return request.param


def made(settings, dof):
    raw = Gains.from_time(3.0, Scales.of(dof)).adaptation if settings.feedback_gain else None
    return make_identifier(settings, dof, raw)


def test_it_comes_closer_to_the_truth(settings):
    identifier = made(settings, DOF)
    first = [abs(p / t - 1) for p, t in zip(identifier.parameters, TRUTH)][0]
    run(identifier, steps(2000))
    assert abs(identifier.parameters[0] / TRUTH[0] - 1) < 0.2 * first


def test_same_input_same_bits_and_reading_changes_nothing(settings):
    one, two = made(settings, DOF), made(settings, DOF)
    for step in steps():
        one.step(step)
        two.step(step)
        assert two.state() == two.state()
        _ = two.parameters, two.std, two.v_hat, two.excitation
    assert one.state() == two.state()


def test_what_was_known_at_a_step_stays_what_it_was(settings):
    one, two = made(settings, DOF), made(settings, DOF)
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
    identifier = run(made(settings, DOF), steps())
    first = identifier.state()
    identifier.reset()
    assert identifier.parameters == pytest.approx(lumped(400.0, 150.0, 20.0, 1.0))
    assert run(identifier, steps()).state() == first


def test_state_goes_through_json_to_the_same_bits(settings):
    sequence = steps()
    one = run(made(settings, DOF), sequence[:200])
    two = made(settings, DOF)
    two.restore(json.loads(json.dumps(one.state())))
    assert run(one, sequence[200:]).state() == run(two, sequence[200:]).state()


def test_a_state_out_of_bounds_is_refused(settings):
    identifier = made(settings, DOF)
    state = identifier.state()
    for bad in ([-1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [math.nan] * 4):
        with pytest.raises(ValueError):
            identifier.restore({**state, 'parameters': bad})
    assert identifier.state() == state


def test_frozen_parameters_stay_and_the_state_goes_on(settings):
    identifier = run(made(settings, DOF), steps(100))
    before, v_hat = identifier.parameters, identifier.v_hat
    run(identifier, steps(50), adapt=False)
    assert identifier.parameters == before
    assert identifier.v_hat != v_hat


@pytest.mark.parametrize('terms', [('alpha',), ('alpha', 'beta', 'delta'), ('alpha', 'gamma')])
def test_left_out_terms_are_exactly_zero(settings, terms):
    identifier = run(made(settings, replace(DOF, terms=terms)), steps())
    for name, value in zip(PARAMETERS, identifier.parameters):
        assert (value == 0.0) == (name not in terms)


def test_mirrored_force_and_velocity_mirror_the_bias_alone(settings):
    one = run(made(settings, DOF), steps())
    two = run(made(settings, replace(DOF, bias=-DOF.bias)),
              steps(force=-1.0, velocity=-1.0))
    alpha, beta, gamma, delta = one.parameters
    assert two.parameters == pytest.approx((alpha, beta, gamma, -delta), rel=1e-12)


@pytest.mark.parametrize('k', [1e-3, 7.0, 1e3])
def test_force_in_another_unit_gives_alpha_in_that_unit(settings, k):
    scaled = DofSettings(k * 400.0, k * 150.0, k * 20.0, k * 1.0)
    alpha, *rest = run(made(settings, DOF), steps()).parameters
    other_alpha, *other_rest = run(made(settings, scaled), steps(force=k)).parameters
    assert other_alpha == pytest.approx(alpha / k, rel=1e-9)
    assert other_rest == pytest.approx(rest, rel=1e-9)


def test_velocity_in_another_unit_scales_the_parameters(settings):
    # v' = k v: beta / k, gamma the same, alpha and delta k times
    k = 10.0
    alpha, beta, gamma, delta = run(made(settings, DOF), steps()).parameters
    scaled = DofSettings(400.0 / k, 150.0 / k**2 / k, 20.0 / k, 1.0, typical_velocity=0.5 * k,
                         typical_force=Scales.of(DOF).force)
    a, b, g, d = run(made(settings, replace(
        scaled, quadratic_drag=150.0 / k**2, bias=1.0)), steps(velocity=k)).parameters
    assert (a, b, g, d) == pytest.approx((k * alpha, beta / k, gamma, k * delta), rel=1e-9)


@pytest.mark.long
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


def test_names_that_there_are_not_are_refused():
    for bad in (IdentifierSettings(method='magic'),
                IdentifierSettings(integrator='magic', feedback_gain=-2.0)):
        with pytest.raises(SettingsError, match='magic'):
            made(bad, DOF)
