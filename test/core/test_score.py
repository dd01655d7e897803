"""The score of a model, also on more steps than are held in memory."""

from dataclasses import replace
from itertools import chain
import math
import os
from typing import Any

import numpy as np
import pytest
from rovid_core.model.lag import turns_of
from rovid_core.model.plant import advance, Array
from rovid_core.model.samples import Step
from rovid_core.model.thrusters import Thrusters
from rovid_core.settings.run import Settings
from rovid_core.trials.score import Score, ScoreLog
from rovid_core.trials.spilling_table import SpillingTable

from test.support.memory import lengths
from test.support.surge import surge_settings, SURGE_TRUTH

SETTINGS = surge_settings()
WRONG = (0.004, -0.5, -0.1, 0.01)
PERIOD = 100_000_000  # [ns]
BLOCK = 64
KINDS: tuple[dict[str, Any], ...] = {}, {'turns': True}, {'turns': True, 'lag_at': 100.0}
"""Rows that are held in memory."""


def filled(counts: tuple[int, ...], sensor: bool = False, reference: bool = False,
           block: int = BLOCK) -> ScoreLog:
    """Return the log of runs with so many steps, which begin in the middle of a second."""
    random = np.random.default_rng(0)
    log = ScoreLog(SETTINGS, block)
    time = 1_700_000_000_000_000_000
    for count in counts:
        log.begin_run('surge', time, float(random.normal()))
        for _ in range(count):
            first, second = (int(x) for x in random.integers(20_000_000, PERIOD, 2))
            middle, end = time + first, time + first + (0 if sensor else second)
            force, last, velocity, mean = random.normal(size=4).tolist()
            log.add_step('surge', (time, middle, end), Step(
                (end - time) * 1e-9, (0.0, 0.0, velocity), (0.0,) * 3, mean,
                forces=(100.0 * force, 100.0 * last)))
            if reference:
                log.add_reference(end - 10_000_000, (velocity, *[math.nan] * 5))
                log.add_reference(end, (velocity, *[math.nan] * 5))
            time = end
        time += 10 * PERIOD
    return log


def test_rows_come_back_wherever_they_are() -> None:
    kept = SpillingTable(1, 2, block=BLOCK)
    for k in range(500):
        for first, last in ((0, k), (k // 3, k // 2), (max(k - 70, 0), k), (k, k)):
            times, values = kept.read(first, last)
            assert times[:, 0].tolist() == list(range(first, last))
            assert values.tolist() == [[0.5 * x, -x] for x in range(first, last)]
        kept.append((k,), (0.5 * k, -k))
    blocks = [times[:, 0].tolist() for times, _ in kept.blocks(10, 490)]
    assert [*chain(*blocks)] == list(range(10, 490))
    assert max(map(len, blocks)) == 64


def test_rows_can_be_read_by_processes_that_were_forked_from_this_one() -> None:
    kept = SpillingTable(1, 1, block=BLOCK)
    for k in range(5000):
        kept.append((k,), (k,))
    children = []
    for _ in range(4):
        child = os.fork()
        if not child:
            right = all(kept.read(0, 5000)[0][:, 0].tolist() == list(range(5000))
                        for _ in range(20))
            os._exit(0 if right else 1)
        children.append(child)
    assert [os.waitpid(child, 0)[1] for child in children] == [0, 0, 0, 0]


@pytest.mark.long
@pytest.mark.parametrize('sensor', [False, True])
@pytest.mark.parametrize('reference', [False, True])
@pytest.mark.parametrize('counts', [(), (0,), (5, 0, 63, 64, 65), (1000,), (1, 128, 1, 2)])
@pytest.mark.parametrize('parameters', [SURGE_TRUTH, WRONG])
def test_in_parts_the_score_is_the_same(
        sensor: bool, reference: bool, counts: tuple[int, ...],
        parameters: tuple[float, float, float, float]) -> None:
    whole = filled(counts, sensor, reference, block=100_000)
    expected = whole.score('surge', parameters), whole.predicted('surge', parameters)
    parts = filled(counts, sensor, reference)
    got = parts.score('surge', parameters), parts.predicted('surge', parameters)
    assert got[0].mae == pytest.approx(expected[0].mae, rel=1e-12, nan_ok=True)
    assert got[0].fit == pytest.approx(expected[0].fit, rel=1e-12, nan_ok=True)
    assert got[1] == pytest.approx(expected[1], rel=1e-10, abs=1e-12)
    assert parts.series('surge') == whole.series('surge')
    for one, other in zip(parts.records('surge'), whole.records('surge'), strict=True):
        assert repr(one) == repr(other)


def test_in_parts_a_model_that_runs_away_scores_as_badly_as_can_be() -> None:
    for reference in (False, True):
        log = filled((500,), reference=reference)
        assert log.score('surge', (0.004, 3.0, 0.5, 0.0)) == Score(math.inf, -math.inf)


def test_references_of_another_clock_with_the_same_times_are_not_compared() -> None:
    """A log of two dives of a vehicle that does not know the date."""
    first, both = (filled((300,), reference=True, block=100_000) for _ in range(2))
    second, [run] = ScoreLog(SETTINGS, 100_000), first.runs['surge']
    both.restart()
    for log in (both, second):
        log.begin_run('surge', run.start, -run.velocity)
        for (middle, end), (before, after, velocity, mean) in zip(*(
                column.T.tolist() for column in run.columns)):
            log.add_step('surge', (0, middle, end), Step(
                0.1, (0.0, 0.0, -velocity), (0.0,) * 3, -mean, forces=(-before, -after)))
            log.add_reference(end, (1.0 - velocity, *[math.nan] * 5))
    # of the first dive there are twice as many
    assert both.score('surge', SURGE_TRUTH).mae == pytest.approx(
        (2.0 * first.score('surge', SURGE_TRUTH).mae
         + second.score('surge', SURGE_TRUTH).mae) / 3.0, rel=1e-3)


def test_what_is_many_is_not_in_memory() -> None:
    on_disk, in_memory = (max(lengths(filled((1000,), reference=True, block=block)))
                          for block in (BLOCK, 100_000))
    assert on_disk < 9 * BLOCK  # rows of several columns
    assert in_memory > 7000


def test_a_velocity_that_never_changes_has_no_fit() -> None:
    log = ScoreLog(replace(SETTINGS, cutoff=0.0), block=BLOCK)
    log.begin_run('surge', 0, 0.0)
    for k in range(200):
        log.add_step('surge', (k * PERIOD, k * PERIOD, (k + 1) * PERIOD), Step(
            0.1, (0.0,) * 3, (0.0,) * 3, 0.0))
    assert log.score('surge', WRONG).mae > 0.0
    assert math.isnan(log.score('surge', WRONG).fit)


def one_by_one(parameters, start: float, dt: np.ndarray, force: np.ndarray) -> list[float]:
    v = [start]
    for h, f in zip(dt, force):
        v.append(advance(parameters, v[-1], f, h))
    return v


@pytest.mark.parametrize('parameters', [
    (0.01, 2.0, 0.2, 0.0), (0.01, 0.0, 50.0, 0.0), (0.01, 1e8, -1.0, 0.0),
    (0.01, -1.0, 1e9, 0.0)])
def test_a_model_that_runs_away_scores_as_badly_as_can_be(
        parameters, recwarn: pytest.WarningsRecorder) -> None:
    log = minute(SETTINGS)
    score = log.score('surge', parameters)
    assert score.mae > 1e3
    assert score.fit < -1e3
    assert not recwarn.list


def test_a_run_without_a_step_says_nothing() -> None:
    log = ScoreLog(SETTINGS)
    for _ in range(2):
        assert math.isnan(log.score('surge', SURGE_TRUTH).mae)
        assert log.predicted('surge', SURGE_TRUTH) == []
        assert log.series('surge') == ([], [], [])
        log.begin_run('surge', 10**18, 0.1)


def test_what_never_changes_has_no_fit() -> None:
    assert Score.of([0.2, 0.3], [0.1, 0.1]).mae == pytest.approx(0.15)
    assert math.isnan(Score.of([0.2, 0.3], [0.1, 0.1]).fit)
    assert Score.of([1.0, 2.0, 4.0], [1.0, 2.0, 3.0]).fit == pytest.approx(1 - math.sqrt(0.5))


def minute(settings: Settings) -> ScoreLog:
    """Return a log of 60 s, at times that have many digits."""
    log = ScoreLog(settings)
    time = 1_700_000_000_000_000_000
    log.begin_run('surge', time, 0.0)
    for k in range(600):
        span = (time, time + 50_000_000, time + 100_000_000)
        velocity = math.sin(0.035 * k)
        log.add_step('surge', span, Step(
            0.1, (0.0, 0.0, velocity), (0.0,) * 3, velocity, 0.1, (0.05, 0.05),
            (100.0 * velocity, 90.0)))
        time = span[2]
    return log


def test_a_reference_is_met_between_two_times() -> None:
    log = minute(SETTINGS)
    still = (0.0, 0.0, 0.0, 0.0)
    first = 1_700_000_000_000_000_000
    v = one_by_one(SURGE_TRUTH, 0.0, np.array([0.05, 0.05]), np.array([0.0, 90.0]))
    for share in (0.0, 0.25, 0.5, 1.0):
        value = v[1] + share * (v[2] - v[1])
        log.add_reference(first + 50_000_000 + round(share * 5e7), (value, math.nan, *still))
    log.add_reference(first - 1, (9.0, *still, 0.0))  # before and after the run
    log.add_reference(first + 60_000_000_001, (9.0, *still, 0.0))
    log.add_reference(first, (math.nan, *still, 0.0))
    assert log.score('surge', SURGE_TRUTH).mae < 1e-10


def felt_later(felt: Array, fine: float, angle: float, block: int) -> ScoreLog:
    """
    Return the log of a vehicle that feels a force each ``fine`` [s].

    At 10 Hz the log has sines of multiples of an angle; its references are the true velocities.
    """
    v = one_by_one(SURGE_TRUTH, 0.0, np.full(len(felt), fine), felt)
    log, each = ScoreLog(SETTINGS, block), round(0.1 / fine)
    log.begin_run('surge', 0, float(v[0]))
    count = len(felt) // each
    for k in range(count):
        force = 100.0 * math.sin(k * angle)
        end = (k + 1) * PERIOD
        log.add_step('surge', (end - PERIOD, end - PERIOD // 2, end), Step(
            0.1, (0.0,) * 3, (0.0,) * 3, 0.0, 0.1, (0.05, 0.05), (force, force)))
        if 5 < k < count - 5:
            log.add_reference(end, (float(v[(k + 1) * each]), *[math.nan] * 5))
    return log


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('block', [BLOCK, 100_000])
def test_the_thrust_lags_as_the_method_says(block: int, kind: dict[str, Any]) -> None:
    """In what a method finds, the delay has the lag in it."""
    fine, lag, delay, seconds = 0.01, 0.3, 0.1, 40.0
    time = np.arange(round(seconds / fine)) * fine
    asked = 100.0 * np.sin(np.maximum(np.floor((time - delay + 1e-9) / 0.1), 0.0) * 0.3)
    follows = turns_of(asked[0]) if kind else float(asked[0])
    felt = []
    for one in asked.tolist():
        before = follows
        if 'lag_at' in kind:
            rate = (one - before * abs(before)) / (2.0 * lag * math.sqrt(kind['lag_at']))
        else:
            rate = ((turns_of(one) if kind else one) - before) / lag
        follows += fine * rate
        middle = 0.5 * (before + follows)
        felt.append(middle * abs(middle) if kind else middle)
    log = felt_later(np.array(felt), fine, 0.3, block)
    right, *others = [log.score('surge', SURGE_TRUTH, delay + lag, Thrusters(lag, **one)).mae
                      for one in (kind, *[one for one in KINDS if one is not kind])]
    assert right < 2e-3
    assert min(others) > 2.0 * right
    assert log.score('surge', SURGE_TRUTH, delay + lag, Thrusters()).mae > 2.0 * right


@pytest.mark.parametrize('delay', [0.0, 0.137, -0.26])
@pytest.mark.parametrize('block', [BLOCK, 100_000])
def test_the_thrust_acts_as_late_as_the_method_says(delay: float, block: int) -> None:
    """The vehicle feels at 50 Hz what the log has at 10 Hz."""
    fine, seconds = 0.02, 40.0
    time = np.arange(round(seconds / fine)) * fine
    # held for as long as a step of the log, which is cut at other times
    felt = 100.0 * np.sin(np.floor((time - delay + 1e-9) / 0.1) * 0.1)
    log = felt_later(felt, fine, 0.1, block)
    errors = {d: log.score('surge', SURGE_TRUTH, d).mae for d in (delay, delay + 0.1)}
    assert errors[delay] < 2e-3 < 5e-3 < errors[delay + 0.1]
    assert log.score('surge', SURGE_TRUTH, math.nan) == log.score('surge', SURGE_TRUTH)
