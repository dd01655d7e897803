"""The adaptive identifier: with raw gains, with a full Gamma, and with gains from the data."""

from dataclasses import replace
import json
import math

from hypothesis import given, settings as hypothesis_settings, strategies as st
import numpy as np
import pytest
from rovid_core.identify import make_identifier
from rovid_core.identify.aid.adaptive_identifier import AdaptiveIdentifier, Gains, rates
from rovid_core.identify.aid.full_gain import FullGainIdentifier
from rovid_core.identify.aid.self_tuning import SelfTuningIdentifier
from rovid_core.model.plant import advance
from rovid_core.model.samples import Step
from rovid_core.settings.run import IdentifierSettings, Scales, SettingsError

from test.support.identifier_steps import DOF, run, steps, TRUTH, values


@pytest.mark.long
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


@pytest.mark.parametrize(('feedback', 'adaptation'), [
    (0.0, (1.0,) * 4), (1.0, (1.0,) * 4), (math.nan, (1.0,) * 4), (-1.0, (-1.0, 1.0, 1.0, 1.0)),
    (-1.0, (math.inf, 1.0, 1.0, 1.0))])
def test_gains_without_a_proof_are_refused(feedback, adaptation):
    with pytest.raises(SettingsError, match='identifier'):
        Gains(feedback, adaptation)


def test_gains_that_are_too_high_for_the_step_are_divided_then_refused():
    scales = Scales.of(DOF)
    step = Step(0.1, (0.3, 0.3, 0.3), (100.0,) * 3)
    fast = AdaptiveIdentifier(scales, Gains.from_time(0.05, scales), 'euler')
    assert fast.step(step) == ''
    wild_gains = Gains(-2.0, (1.0, 1e9, 1e9, 1e9))
    absurd = AdaptiveIdentifier(scales, wild_gains, 'euler')
    assert absurd.step(step) == 'unstable_step'
    assert absurd.parameters == scales.initial


def self_tuning(typical=1.0, time=3.0):
    scales = Scales.of(DOF)
    return SelfTuningIdentifier(replace(
        scales, force=typical * scales.force, velocity=typical * scales.velocity), time)


def test_a_gamma_that_is_not_positive_is_no_crash():
    """A damaged state may have one."""
    identifier, (first, second) = self_tuning(), steps(2)
    identifier.step(first)
    state = identifier.state()
    state['gamma'] = (1e9 * (np.eye(4) - np.ones((4, 4)))).tolist()
    state['theta_hat'][1] = 0.0  # no quadratic drag
    identifier.restore(state)
    assert identifier.step(second) == 'unstable_step'


def test_what_is_published_is_a_mean_and_w_is_that_of_theta_hat():
    identifier, values = self_tuning(), []
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
    identifier, v, dt = self_tuning(), 0.0, 0.01
    identifier.restart(v)
    first = last = identifier.lyapunov(v, TRUTH)
    gains, changes = identifier.state()['gamma'], 0
    for k in range(7000):
        force = [100.0 * math.sin(2 * math.pi * (k + x) * dt / 15) for x in (0.0, 0.5, 1.0)]
        new = advance(TRUTH, v, force[1], dt)
        identifier.step(Step(dt, (v, 0.5 * (v + new), new), (force[1],) * 3, new,
                             parts=(dt, 0.0), forces=(force[1], 0.0)))
        now, held = identifier.lyapunov(new, TRUTH), identifier.state()['gamma']
        if held == gains:
            assert now <= last + 1e-4 * first
        changes += held != gains
        v, last, gains = new, now, held
    assert changes == 2  # after 20 and 40 s of motion


def test_thrust_far_beyond_all_that_the_gains_were_learned_from():
    """A vehicle that drifts for a minute is in motion; then its thrusters start."""
    identifier = self_tuning()
    drifting = Step(0.1, (-0.08,) * 3, (0.0,) * 3, -0.08, 0.1, (0.05, 0.05))
    run(identifier, [drifting] * 600)
    run(identifier, steps(3000))
    assert identifier.parameters[0] == pytest.approx(TRUTH[0], rel=0.05)


@pytest.mark.parametrize('typical', [1 / 3, 3.0])
def test_typical_sizes_far_off_and_exact_data_give_the_same_model(typical):
    found = run(self_tuning(typical), steps(3000)).parameters
    assert found == pytest.approx(run(self_tuning(), steps(3000)).parameters, rel=0.01)
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
    one = run(self_tuning(), sequence)
    two = self_tuning()
    two.restore(json.loads(json.dumps(one.state())))
    run(two, steps(3000, force=1.25))
    assert two.parameters[0] == pytest.approx(one.parameters[0] / 1.25, rel=0.01)


def test_a_frozen_identifier_keeps_mean_and_theta_hat_and_gains():
    identifier = run(self_tuning(), steps(300))
    before = identifier.state()
    after = run(identifier, steps(300), adapt=False).state()
    moved = dict.fromkeys(('v_hat', 'measured', 'excitation'))
    assert {**after, **moved} == {**before, **moved}


@pytest.mark.parametrize(('key', 'bad'), [
    ('theta_hat', [-1.0, 0.0, 0.0, 0.0]), ('gamma', [[1.0]]), ('sums', [math.nan] * 10),
    ('gamma', [[-1.0] * 4] * 4), ('next', 0.0)])
def test_a_broken_state_of_the_mean_is_refused(key, bad):
    identifier = run(self_tuning(), steps(300))
    state = identifier.state()
    with pytest.raises(ValueError):
        identifier.restore({**state, key: bad})
    assert identifier.state() == state


def test_the_rates_are_those_of_the_paper():
    """Eq. 7 and 11, by hand."""
    v_hat, v, tau, a, gains = -0.5, -0.75, 20.0, -2.0, (0.1, 0.2, 0.3, 0.4)
    theta = (0.005, -1.5, -0.25, -0.125)
    dv, phi = v_hat - v, (tau, -0.25, v_hat, 1.0)
    assert rates(a, gains, (v_hat, *theta), v, tau) == pytest.approx(
        (a * dv + sum(p * x for p, x in zip(theta, phi)),
         *[-g * dv * x for g, x in zip(gains, phi)]))


def test_without_adaptation_only_v_hat_moves():
    identifier = AdaptiveIdentifier(Scales.of(DOF), Gains(-2.0, (1e-5, 0.5, 0.5, 0.1)))
    identifier.restart(0.4)
    before = identifier.theta_hat
    step = Step(0.1, (0.2, 0.2, 0.2), (50.0, 50.0, 50.0))
    assert not identifier.step(step, adapt=False)
    assert identifier.theta_hat == before
    assert identifier.v_hat != 0.4
    assert not identifier.step(step)
    assert all(p != q for p, q in zip(identifier.theta_hat, before))


@pytest.mark.parametrize(('integrator', 'order'), [('euler', 1), ('heun', 2), ('rk4', 4)])
def test_an_integrator_has_its_order(integrator, order):
    """Half the step makes the error smaller by a power of two."""
    def end(pieces):
        identifier = AdaptiveIdentifier(
            Scales.of(DOF), Gains(-1.0, (1e-6, 0.1, 0.1, 0.1)), integrator)
        identifier.restart(0.3)
        h = 1.0 / pieces
        for k in range(pieces):
            v, f = ([g((k + x) * h) for x in (0.0, 0.5, 1.0)] for g in (
                lambda t: 0.3 + 0.2 * math.sin(t), lambda t: 100.0 * math.cos(t)))
            assert not identifier.step(Step(h, tuple(v), tuple(f)))
        return identifier.v_hat

    exact = end(1024)
    coarse, fine = (abs(end(n) - exact) for n in (16, 32))
    assert math.log2(coarse / fine) == pytest.approx(order, abs=0.35)


@pytest.mark.parametrize('dt', [0.1, 1.0, 5.0])
@pytest.mark.parametrize('gain', [0.1, 1.0])
def test_w_never_grows_however_long_the_step(dt, gain):
    """A vehicle that obeys the midpoint rule itself; W then falls by eq. 12 alone."""
    scales = Scales.of(DOF)
    identifier = FullGainIdentifier(scales, 2.0, gain * np.diag(np.square(scales.regressor)))
    alpha, beta, gamma, delta = TRUTH
    v = 0.0
    identifier.restart(v)
    first = last = identifier.lyapunov(v, TRUTH)
    for k in range(200):
        force = 150.0 * math.sin(0.35 * (k + 0.5))
        target, linear = v + 0.5 * dt * (alpha * force + delta), 1.0 - 0.5 * dt * gamma
        w = 2.0 * target / (linear + math.sqrt(linear**2 - 2.0 * dt * beta * abs(target)))
        v = 2.0 * w - v
        assert not identifier.step(Step(dt, (v,) * 3, (force,) * 3, v, parts=(dt, 0.0),
                                        forces=(force, 0.0)))
        now = identifier.lyapunov(v, TRUTH)
        assert now <= last + 1e-12 * first
        last = now
    assert last < 0.9 * first
