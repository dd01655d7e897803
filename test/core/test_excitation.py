"""What a Gram matrix of regressors says about thrust profiles."""

from math import pi, sin

import numpy as np
import pytest
from rovid_core.identify.excitation import add_products, Excitation, Gram, NO_SUMS
from rovid_core.model.plant import advance, lumped
from rovid_core.model.samples import Step
from rovid_core.settings.run import Scales

TRUTH = lumped(290.0, 290.0, 43.5, 2.9)
ALL = (True, True, True, True)
ALL_TERMS = (0, 1, 2, 3)


def driven(force, duration=300.0, active=ALL, noise=0.017, memory=60.0, dt=0.1):
    """Return the monitor of the surge vehicle under a force over time [N]."""
    monitor = Excitation(Scales(150.0, 0.5, TRUTH, active), memory)
    random, v, since = np.random.default_rng(1), 0.0, 0.0
    for k in range(round(duration / dt)):
        tau = force((k + 0.5) * dt)
        new = advance(TRUTH, v, tau, dt)
        middle = 0.5 * (v + new) + noise * float(random.standard_normal())
        monitor.add_steps([Step(dt, (v, middle, new), (tau,) * 3)])
        v, since = new, since + dt
        if since >= 1.0:
            monitor.update_fading()
            since = 0.0
    return monitor


def waves(*parts):
    return lambda t: sum(force * sin(2 * pi * hz * t) for force, hz in parts)


RICH = waves((150.0, 1 / 18), (80.0, 1 / 7.3))


@pytest.mark.parametrize('force', [
    RICH, waves((150.0, 0.025)), waves((150.0, 0.05)),
    lambda t: (150, -40, 80, -150, 20, -90)[int(t / 20) % 6]])
def test_slow_and_large_thrust_tells_everything(force):
    assert driven(force).since_start().reasons == ()


@pytest.mark.parametrize(('force', 'expected'), [
    (lambda t: 0.0, ['no thrust']),
    (lambda t: 2.9, ['no thrust']),  # 2 % of the typical force
    (waves((150.0, 0.25)), ['told apart']),  # fast
    (lambda t: 100.0 if t % 40 < 20 else -100.0, ['told apart']),  # at one speed only
    (waves((30.0, 0.1)), ['told apart']),  # small
    (lambda t: 2.9 + 30.0 * sin(2 * pi * t), ['near zero']),
    (waves((150.0, 0.01)), ['mass cannot']),  # the thrust only balances drag
    (lambda t: 100.0, ['mass cannot', 'bias cannot', 'drag can hardly']),
])
def test_what_a_profile_cannot_tell(force, expected):
    reasons = driven(force).since_start().reasons
    assert len(reasons) == len(expected)
    for reason, text in zip(reasons, expected):
        assert text in reason


def test_terms_that_are_left_out_are_not_missed():
    fast = waves((150.0, 0.25))
    assert driven(fast, active=(True, False, True, True)).since_start().reasons == ()
    assert driven(fast, active=(True, True, False, False)).since_start().active == (0, 1)


def test_information_is_that_of_the_inverse():
    gram = driven(RICH).since_start()
    matrix = np.zeros((4, 4))
    matrix[np.triu_indices(4)] = gram.sums
    matrix = (matrix + np.triu(matrix, 1).T) / gram.sums[9]
    left = [gram.unexplained(i, ALL_TERMS) for i in ALL_TERMS]
    assert left == pytest.approx(1.0 / np.diag(np.linalg.inv(matrix)), rel=1e-9)
    assert all(0.0 <= one <= square for one, square in zip(left, np.diag(matrix)))


def test_a_singular_matrix_has_no_information_and_no_nan():
    gram = driven(lambda t: 150.0, noise=0.0).since_start()
    assert gram.unexplained(0, ALL_TERMS) == pytest.approx(0.0, abs=1e-9)
    empty = Gram((0.0,) * 10, ALL_TERMS)
    assert empty.reasons == ('no step yet',)
    assert [empty.unexplained(i, ALL_TERMS) for i in ALL_TERMS] == [0.0] * 4


def test_accelerations_are_means_over_the_data():
    gram = driven(RICH, noise=0.0).since_start()
    # the vehicle's own acceleration, from its own parameters
    random, v, squares = np.random.default_rng(1), 0.0, []
    for k in range(3000):
        new = advance(TRUTH, v, RICH((k + 0.5) * 0.1), 0.1)
        squares.append(((new - v) / 0.1) ** 2)
        v = new
    assert gram.acceleration(TRUTH) == pytest.approx(np.sqrt(np.mean(squares)), rel=0.01)
    factor = random.normal(size=(4, 4)) * np.abs(TRUTH) * 0.1
    draws = [gram.acceleration(factor @ random.normal(size=4)) ** 2 for _ in range(2000)]
    assert gram.uncertainty((factor @ factor.T).ravel().tolist()) == pytest.approx(
        np.sqrt(np.mean(draws)), rel=0.1)


def test_the_recent_matrix_forgets_and_the_whole_one_does_not():
    monitor = driven(lambda t: RICH(t) if t < 200.0 else 0.0, duration=800.0, noise=0.0)
    assert monitor.update_fading().reasons == ('no thrust',)
    assert monitor.since_start().reasons == ()


def test_sums_of_products_are_the_same_at_once_or_one_by_one():
    random = np.random.default_rng(0)
    steps = [Step(dt, (v,) * 3, (f,) * 3) for dt, v, f in random.normal(size=(200, 3)).tolist()]
    one = NO_SUMS
    for step in steps:
        one = add_products(one, [step], 0.1, 2.0)
    assert add_products(NO_SUMS, steps, 0.1, 2.0) == one
    dt, v, f = np.array([(s.dt, 2.0 * s.velocity[1], 0.1 * s.force[1]) for s in steps]).T
    phi = np.stack([f, v * np.abs(v), v, np.ones_like(v)])
    assert one == pytest.approx((phi * dt @ phi.T)[np.triu_indices(4)])
