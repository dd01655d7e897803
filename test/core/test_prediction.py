"""Whole trials at once, against the same step by step."""

import math

import numpy as np
import pytest
from rovid_core.model.lowpass import filtered, LowPass
from rovid_core.model.plant import advance
from rovid_core.model.samples import Step
from rovid_core.model.trajectory import BLOCK_LENGTH, linear_recurrence, trajectory
from rovid_core.settings.run import Settings
from rovid_core.trials.score import Score, ScoreLog

from test.support.surge import surge_settings, SURGE_TRUTH


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


@pytest.mark.parametrize('parameters', [
    SURGE_TRUTH, (1 / 290, -1.0, 0.0, 0.0), (1 / 290, 0.0, -0.15, 0.01), (1 / 290, 0, 0, 0),
    (1 / 290, -1e-9, -1e-9, 0.0), (1 / 290, -1.0, 0.1, 0.0), (1 / 290, -1e4, -1e3, 0.0)])
def test_a_prediction_is_that_of_the_plant(parameters) -> None:
    for count in (0, 1, 3000):
        dt, force = segments(count)
        assert trajectory(parameters, 0.3, dt, force) == pytest.approx(
            one_by_one(parameters, 0.3, dt, force), abs=1e-11)


def test_a_fast_vehicle_is_divided_finely_enough() -> None:
    light = (0.1, -20.0, -5.0, 3.0)
    dt, force = segments(3000)
    fine = one_by_one(light, 0.3, np.repeat(dt / 50, 50), np.repeat(force, 50))[::50]
    assert trajectory(light, 0.3, dt, force) == pytest.approx(fine, abs=2e-3)


@pytest.mark.parametrize('parameters', [
    (0.01, 2.0, 0.2, 0.0), (0.01, 0.0, 50.0, 0.0), (0.01, 1e8, -1.0, 0.0),
    (0.01, -1.0, 1e9, 0.0)])
def test_a_model_that_runs_away_scores_as_badly_as_can_be(
        parameters, recwarn: pytest.WarningsRecorder) -> None:
    log = filled(surge_settings())
    score = log.score('surge', parameters)
    assert score.mae > 1e3
    assert score.fit < -1e3
    assert not recwarn.list


def test_a_run_without_a_step_says_nothing() -> None:
    log = ScoreLog(surge_settings())
    for _ in range(2):
        assert math.isnan(log.score('surge', SURGE_TRUTH).mae)
        assert log.predicted('surge', SURGE_TRUTH) == []
        assert log.series('surge') == ([], [], [])
        log.restarted('surge', 10**18, 0.1)


def test_what_never_changes_has_no_fit() -> None:
    assert Score.of([0.2, 0.3], [0.1, 0.1]).mae == pytest.approx(0.15)
    assert math.isnan(Score.of([0.2, 0.3], [0.1, 0.1]).fit)
    assert Score.of([1.0, 2.0, 4.0], [1.0, 2.0, 3.0]).fit == pytest.approx(1 - math.sqrt(0.5))


def filled(settings: Settings) -> ScoreLog:
    """Return a log of 60 s, at times that have many digits."""
    log = ScoreLog(settings)
    time = 1_700_000_000_000_000_000
    log.restarted('surge', time, 0.0)
    for k in range(600):
        span = (time, time + 50_000_000, time + 100_000_000)
        velocity = math.sin(0.035 * k)
        log.stepped('surge', span, Step(
            0.1, (0.0, 0.0, velocity), (0.0,) * 3, velocity, 0.1, (0.05, 0.05),
            (100.0 * velocity, 90.0)))
        time = span[2]
    return log


def test_a_reference_is_met_between_two_times() -> None:
    log = filled(surge_settings())
    still = (0.0, 0.0, 0.0, 0.0)
    first = 1_700_000_000_000_000_000
    v = one_by_one(SURGE_TRUTH, 0.0, np.array([0.05, 0.05]), np.array([0.0, 90.0]))
    for share in (0.0, 0.25, 0.5, 1.0):
        value = v[1] + share * (v[2] - v[1])
        log.reference(first + 50_000_000 + round(share * 5e7), (value, math.nan, *still))
    log.reference(first - 1, (9.0, *still, 0.0))  # before and after the run
    log.reference(first + 60_000_000_001, (9.0, *still, 0.0))
    log.reference(first, (math.nan, *still, 0.0))
    assert log.score('surge', SURGE_TRUTH).mae < 1e-10
