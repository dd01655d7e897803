"""Whole trials at once, against the same step by step."""

import math

import numpy as np
import pytest
from rovid_core.model.lowpass import filtered, LowPass
from rovid_core.model.plant import (
    advance,
    BLOCK_LENGTH,
    linear_recurrence,
    lumped,
    midpoint_trajectory,
    physical,
    sensitivities,
    trajectory,
)

from test.support.surge import SURGE_TRUTH


def segments(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return lengths, some of them 0, and forces."""
    rng = np.random.default_rng(count)
    dt = np.maximum(rng.uniform(-0.01, 0.1, count), 0.0)
    return dt, 150.0 * np.sin(0.35 * np.cumsum(dt)) + rng.normal(0.0, 30.0, count)


def one_by_one(parameters, start: float, dt: np.ndarray, force: np.ndarray) -> list[float]:
    v = [start]
    for h, f in zip(dt, force):
        v.append(advance(parameters, v[-1], f, h))
    return v


def test_what_slows_a_vehicle_down_comes_to_its_linear_drag() -> None:
    """At once, and step by step where the drag has the wrong sign."""
    dt, force = segments(400)
    slowing = np.linspace(0.0, 0.5, 400)
    for truth in (SURGE_TRUTH, (*SURGE_TRUTH[:2], 0.01, SURGE_TRUTH[3])):
        alpha, beta, gamma, delta = truth
        v = [0.1]
        for h, f, s in zip(dt.tolist(), force.tolist(), slowing.tolist()):
            v.append(advance((alpha, beta, gamma - s, delta), v[-1], f, h))
        assert trajectory(truth, 0.1, dt, force, slowing=slowing) == pytest.approx(v, abs=1e-6)


@pytest.mark.parametrize('count', [
    0, 1, BLOCK_LENGTH - 1, BLOCK_LENGTH, BLOCK_LENGTH + 1, BLOCK_LENGTH**2 + 5, 5000])
def test_a_recurrence_is_the_loop(count: int) -> None:
    rng = np.random.default_rng(count)
    factor, added = rng.uniform(-1.0, 1.0, count), rng.normal(size=(3, count))
    expected, x = np.zeros((3, count)), np.zeros(3)
    for k in range(count):
        expected[:, k] = x = factor[k] * x + added[:, k]
    assert linear_recurrence(factor, added) == pytest.approx(expected, abs=1e-12)
    assert linear_recurrence(factor, added[0]) == pytest.approx(expected[0], abs=1e-12)


@pytest.mark.parametrize('cutoff', [0.0, 0.6, 8.0])  # 8 Hz is clamped on long steps
def test_the_low_pass_of_a_trial_is_that_of_its_steps(cutoff: float) -> None:
    dt, signal = segments(500)
    lowpass = LowPass(cutoff)
    expected = [lowpass.step(h, (u,))[0] for h, u in zip(dt, signal)]
    assert filtered(cutoff, dt, signal) == pytest.approx(expected, abs=1e-9)


def test_a_cutoff_above_the_rate_of_the_samples_is_clamped() -> None:
    """A fast cutoff is what 0.4 of the rate is, for a step and for a trial."""
    weight = 1.0 - math.exp(-2.0 * math.pi * 0.4)
    for cutoff, dt in ((0.6, 10.0), (8.0, 0.1), (0.4, 1.0)):
        lowpass = LowPass(cutoff)
        lowpass.step(0.0, (0.0,))
        assert lowpass.step(dt, (1.0,)) == pytest.approx((weight,), abs=1e-12)
        assert filtered(cutoff, np.full(2, dt), np.array([0.0, 1.0]))[1] == pytest.approx(
            weight, abs=1e-12)
    lowpass = LowPass(0.5)
    lowpass.step(0.0, (0.0,))
    assert lowpass.step(0.1, (1.0,)) == pytest.approx((1.0 - math.exp(-0.1 * math.pi),))
    assert lowpass.clamped == 0


def test_signs_and_units_of_the_plant() -> None:
    """A bias pulls back, drag slows down whatever the direction, and both forms agree."""
    parameters = lumped(200.0, 300.0, 40.0, 10.0)
    assert parameters == (0.005, -1.5, -0.2, -0.05)
    assert physical(parameters) == pytest.approx((200.0, 300.0, 40.0, 10.0))
    assert all(map(math.isnan, physical((0.0, -1.0, -1.0, 0.0))))
    assert advance(parameters, 0.0, 10.0, 1.0) == 0.0
    assert advance(parameters, 0.0, 0.0, 0.1) == pytest.approx(-0.005, rel=0.02)
    for v in (0.5, -0.5):
        ahead = advance((0.005, -1.5, 0.0, 0.0), v, 0.0, 1.0)
        assert ahead == pytest.approx(v / (1.0 + 1.5 * abs(v)), rel=1e-3)  # in closed form


@pytest.mark.parametrize('parameters', [
    SURGE_TRUTH, (1 / 290, -1.0, 0.0, 0.0), (1 / 290, 0.0, -0.15, 0.01), (1 / 290, 0, 0, 0),
    (1 / 290, -1e-9, -1e-9, 0.0), (1 / 290, -1.0, 0.1, 0.0), (1 / 290, -1e4, -1e3, 0.0)])
def test_a_trajectory_is_that_of_the_plant(parameters) -> None:
    for count in (0, 1, 3000):
        dt, force = segments(count)
        assert trajectory(parameters, 0.3, dt, force) == pytest.approx(
            one_by_one(parameters, 0.3, dt, force), abs=1e-11)


def test_a_fast_vehicle_is_divided_finely_enough() -> None:
    light = (0.1, -20.0, -5.0, 3.0)
    dt, force = segments(3000)
    fine = one_by_one(light, 0.3, np.repeat(dt / 50, 50), np.repeat(force, 50))[::50]
    assert trajectory(light, 0.3, dt, force) == pytest.approx(fine, abs=2e-3)


def test_a_midpoint_trajectory_is_that_of_the_plant():
    rng = np.random.default_rng(0)
    dt, force = rng.uniform(0.02, 0.08, 500), rng.uniform(-200.0, 200.0, 500)
    v = [0.3]
    for h, f in zip(dt, force):
        v.append(advance(SURGE_TRUTH, v[-1], f, h))
    assert midpoint_trajectory(np.array(SURGE_TRUTH), 0.3, dt, force) == pytest.approx(v, abs=2e-4)


def test_the_sensitivities_are_the_derivatives():
    rng = np.random.default_rng(1)
    dt, force = np.full(200, 0.05), rng.uniform(-200.0, 200.0, 200)
    truth = np.array(SURGE_TRUTH)
    v = midpoint_trajectory(truth, 0.2, dt, force)
    found = sensitivities(truth, v, dt, force)
    for i in range(4):
        step = 1e-5 * abs(truth[i])
        change = np.zeros(4)
        change[i] = step
        numeric = (midpoint_trajectory(truth + change, 0.2, dt, force)
                   - midpoint_trajectory(truth - change, 0.2, dt, force)) / (2 * step)
        assert found[:, i] == pytest.approx(numeric, rel=1e-4, abs=1e-6 * np.abs(numeric).max())
    numeric = (midpoint_trajectory(truth, 0.2 + 1e-6, dt, force)
               - midpoint_trajectory(truth, 0.2 - 1e-6, dt, force)) / 2e-6
    assert found[:, 4] == pytest.approx(numeric, rel=1e-4, abs=1e-6)
