"""What every identifier has to do, checked on each of them."""

from dataclasses import replace
import json
import math

from hypothesis import given, settings as hypothesis_settings, strategies as st
import pytest
from rovid_core.aid import AdaptiveIdentifier, Gains
from rovid_core.dofs import PARAMETERS
from rovid_core.identifier import Scales, Step
from rovid_core.methods import make, METHODS
from rovid_core.plant import advance, lumped
from rovid_core.settings import DofSettings, IdentifierSettings, SettingsError

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
    identifier = make(settings, DOF)
    first = [abs(p / t - 1) for p, t in zip(identifier.parameters, TRUTH)][0]
    run(identifier, steps(2000))
    assert abs(identifier.parameters[0] / TRUTH[0] - 1) < 0.2 * first


def test_same_input_same_bits_and_reading_changes_nothing(settings):
    one, two = make(settings, DOF), make(settings, DOF)
    for step in steps():
        one.step(step)
        two.step(step)
        assert two.state() == two.state()
        _ = two.parameters, two.std, two.v_hat, two.excitation
    assert one.state() == two.state()


def test_reset_then_rerun_is_the_same_as_new(settings):
    identifier = run(make(settings, DOF), steps())
    first = identifier.state()
    identifier.reset()
    assert identifier.parameters == pytest.approx(lumped(400.0, 150.0, 20.0, 1.0))
    assert run(identifier, steps()).state() == first


def test_state_goes_through_json_to_the_same_bits(settings):
    sequence = steps()
    one = run(make(settings, DOF), sequence[:200])
    two = make(settings, DOF)
    two.restore(json.loads(json.dumps(one.state())))
    assert run(one, sequence[200:]).state() == run(two, sequence[200:]).state()


def test_a_state_out_of_bounds_is_refused(settings):
    identifier = make(settings, DOF)
    state = identifier.state()
    for bad in ([-1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [math.nan] * 4):
        with pytest.raises(ValueError):
            identifier.restore({**state, 'parameters': bad})
    assert identifier.state() == state


def test_frozen_parameters_stay_and_the_state_goes_on(settings):
    identifier = run(make(settings, DOF), steps(100))
    before, v_hat = identifier.parameters, identifier.v_hat
    run(identifier, steps(50), adapt=False)
    assert identifier.parameters == before
    assert identifier.v_hat != v_hat


@pytest.mark.parametrize('terms', [('alpha',), ('alpha', 'beta', 'delta'), ('alpha', 'gamma')])
def test_left_out_terms_are_exactly_zero(settings, terms):
    identifier = run(make(settings, replace(DOF, terms=terms)), steps())
    for name, value in zip(PARAMETERS, identifier.parameters):
        assert (value == 0.0) == (name not in terms)


def test_mirrored_force_and_velocity_mirror_the_bias_alone(settings):
    one = run(make(settings, DOF), steps())
    two = run(make(settings, replace(DOF, bias=-DOF.bias)), steps(force=-1.0, velocity=-1.0))
    alpha, beta, gamma, delta = one.parameters
    assert two.parameters == pytest.approx((alpha, beta, gamma, -delta), rel=1e-12)


@pytest.mark.parametrize('k', [1e-3, 7.0, 1e3])
def test_force_in_another_unit_gives_alpha_in_that_unit(settings, k):
    scaled = DofSettings(k * 400.0, k * 150.0, k * 20.0, k * 1.0)
    alpha, *rest = run(make(settings, DOF), steps()).parameters
    other_alpha, *other_rest = run(make(settings, scaled), steps(force=k)).parameters
    assert other_alpha == pytest.approx(alpha / k, rel=1e-9)
    assert other_rest == pytest.approx(rest, rel=1e-9)


def test_velocity_in_another_unit_scales_the_parameters(settings):
    # v' = k v: beta / k, gamma the same, alpha and delta k times
    k = 10.0
    alpha, beta, gamma, delta = run(make(settings, DOF), steps()).parameters
    scaled = DofSettings(400.0 / k, 150.0 / k**2 / k, 20.0 / k, 1.0, typical_velocity=0.5 * k,
                         typical_force=Scales.of(DOF).force)
    a, b, g, d = run(make(settings, replace(
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
    identifier = make(IdentifierSettings(method=method), DOF)
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
            make(bad, DOF)


def test_gains_that_are_too_high_for_the_step_are_divided_then_refused():
    scales = Scales.of(DOF)
    step = Step(0.1, (0.3, 0.3, 0.3), (100.0,) * 3)
    fast = AdaptiveIdentifier(scales, Gains.from_time(0.05, scales), 'euler')
    assert fast.step(step) == ''
    wild_gains = Gains(-2.0, (1.0, 1e9, 1e9, 1e9))
    absurd = AdaptiveIdentifier(scales, wild_gains, 'euler')
    assert absurd.step(step) == 'unstable_step'
    assert absurd.parameters == scales.initial
