"""The filter of the extended Kalman filter in plain floats is that of matrices."""

from hypothesis import given, settings as hypothesis_settings, strategies as st
import numpy as np
import pytest
from rovid_core.identify.ekf.linearised_filter import (
    diagonal,
    ForceImpulse,
    packed,
    row,
    SIZE,
    Transition,
    updated,
    widened,
    with_motion,
)

numbers = st.floats(-2.0, 2.0)


def symmetric(size, draw):
    factor = np.array(draw(st.lists(numbers, min_size=size * size, max_size=size * size)))
    return factor.reshape(size, size) @ factor.reshape(size, size).T


def matrix(p):
    return np.array([row(p, i) for i in range(SIZE)])


@given(st.data())
@hypothesis_settings(max_examples=50)
def test_a_covariance_after_a_step_is_f_p_f(data):
    p = symmetric(SIZE, data.draw)
    share, bend, keep, s, t, u, w = data.draw(st.tuples(*[numbers] * 7))
    motion = np.eye(SIZE)
    motion[0, 1:] = share, bend * s, bend * t, bend * u, bend, bend * w
    motion[1, 1:] = keep, share * s, share * t, share * u, share, share * w
    noise = np.zeros((SIZE, SIZE))
    noise[0, 0], noise[0, 1], noise[1, 0], noise[1, 1] = 0.1, 0.2, 0.2, 0.3
    transition = Transition(share, bend, keep, (s, t, u, w))
    found = transition.covariance(packed((p + p.T).tolist()), (0.1, 0.2, 0.3))
    expected = motion @ (p + p.T) @ motion.T + noise
    assert matrix(found) == pytest.approx(expected, rel=1e-12, abs=1e-10)
    assert transition.of(tuple(p[0].tolist())) == pytest.approx(
        motion @ p[0], rel=1e-12, abs=1e-12)


@given(st.data())
@hypothesis_settings(max_examples=50)
def test_a_covariance_after_a_measurement_is_less_by_r_r(data):
    p = symmetric(SIZE, data.draw)
    p = p + p.T
    r = np.array(data.draw(st.tuples(*[numbers] * SIZE)))
    change = np.outer(r, r)
    q = packed(p.tolist())
    assert (matrix(q) == p).all()
    assert (matrix(updated(q, tuple(r.tolist()), True)) == p - change).all()
    change[2:, 2:] = 0.0
    assert (matrix(updated(q, tuple(r.tolist()), False)) == p - change).all()
    assert (matrix(widened(q, r[:3])) == p + np.diag([*r[:3], 0.0, 0.0, 0.0, 0.0])).all()
    kept = p.copy()
    kept[:2], kept[:, :2] = 0.0, 0.0
    kept[0, 0], kept[1, 1] = 3.0, 4.0
    assert (matrix(with_motion(q, (3.0, 4.0))) == kept).all()


def test_only_a_symmetric_matrix_is_a_covariance():
    assert (matrix(diagonal(range(SIZE))) == np.diag(range(SIZE))).all()
    wrong = np.eye(SIZE)
    wrong[0, 1] = 1.0
    with pytest.raises(ValueError, match='not a covariance'):
        packed(wrong.tolist())
    with pytest.raises(ValueError, match='not a covariance'):
        packed(np.eye(SIZE - 1).tolist())


def parabola(times, values, i, time):
    return np.polyval(np.polyfit(times[i - 1:i + 2], values[i - 1:i + 2], 2), time)


def test_an_impulse_is_the_mean_of_the_parabolas_on_either_side():
    random, impulses = np.random.default_rng(0), ForceImpulse()
    spans, forces = random.uniform(0.02, 0.1, 400), random.normal(size=400)
    for span, force in zip(spans.tolist(), forces.tolist()):
        impulses.add((span,), (force,))
    times = np.concatenate([[0.0], np.cumsum(spans)])
    values = np.concatenate([[0.0], np.cumsum(spans * forces)])
    for i in range(380, 399):
        for share in (0.0, 0.3, 0.9):
            time = times[i] + share * (times[i + 1] - times[i])
            both = [parabola(times, values, k, time) for k in (i, i + 1)]
            assert impulses.at(time) == pytest.approx(np.mean(both), abs=1e-9)
    # the last span has nothing after it, and then the force stays as it is
    time = 0.5 * (times[399] + times[400])
    assert impulses.at(time) == pytest.approx(parabola(times, values, 399, time), abs=1e-9)
    assert impulses.at(times[400] + 2.0) == pytest.approx(values[400] + 2.0 * forces[399])
    same = ForceImpulse()
    same.restore(impulses.state())
    begin = impulses.state()[0][0]
    for time in np.linspace(begin - 0.1, times[400] + 0.1, 1000).tolist():
        assert same.at(time) == impulses.at(time)
    assert begin > times[400] - 9.0  # it does not grow
