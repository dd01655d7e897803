"""Scores of more steps than are held in memory."""

from dataclasses import replace
from itertools import chain
import math
import os

import numpy as np
import pytest
from rovid_core.model.samples import Step
from rovid_core.trials import rows, score
from rovid_core.trials.rows import Rows
from rovid_core.trials.score import Score, ScoreLog

from test.support.surge import surge_settings, SURGE_TRUTH

SETTINGS = surge_settings()
WRONG = (0.004, -0.5, -0.1, 0.01)
PERIOD = 100_000_000  # [ns]

from test.support.memory import lengths


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let 64 rows be many."""
    monkeypatch.setattr(rows, 'BLOCK', 64)
    monkeypatch.setattr(score, 'BLOCK', 64)


def filled(counts: tuple[int, ...], sensor: bool = False, reference: bool = False,
           spill: bool = True) -> ScoreLog:
    """Return the log of runs with so many steps, which begin in the middle of a second."""
    random = np.random.default_rng(0)
    log = ScoreLog(SETTINGS, spill)
    time = 1_700_000_000_000_000_000
    for count in counts:
        log.restarted('surge', time, float(random.normal()))
        for _ in range(count):
            first, second = (int(x) for x in random.integers(20_000_000, PERIOD, 2))
            middle, end = time + first, time + first + (0 if sensor else second)
            force, last, velocity, mean = random.normal(size=4).tolist()
            log.stepped('surge', (time, middle, end), Step(
                (end - time) * 1e-9, (0.0, 0.0, velocity), (0.0,) * 3, mean,
                forces=(100.0 * force, 100.0 * last)))
            if reference:
                log.reference(end - 10_000_000, (velocity, *[math.nan] * 5))
                log.reference(end, (velocity, *[math.nan] * 5))
            time = end
        time += 10 * PERIOD
    return log


def test_rows_come_back_wherever_they_are(small: None) -> None:
    kept = Rows(1, 2)
    for k in range(500):
        for first, last in ((0, k), (k // 3, k // 2), (max(k - 70, 0), k), (k, k)):
            times, values = kept.read(first, last)
            assert times[:, 0].tolist() == list(range(first, last))
            assert values.tolist() == [[0.5 * x, -x] for x in range(first, last)]
        kept.append((k,), (0.5 * k, -k))
    blocks = [times[:, 0].tolist() for times, _ in kept.blocks(10, 490)]
    assert [*chain(*blocks)] == list(range(10, 490))
    assert max(map(len, blocks)) == 64


def test_rows_can_be_read_by_processes_that_were_forked_from_this_one(small: None) -> None:
    kept = Rows(1, 1)
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


@pytest.mark.parametrize('sensor', [False, True])
@pytest.mark.parametrize('reference', [False, True])
@pytest.mark.parametrize('counts', [(), (0,), (5, 0, 63, 64, 65), (1000,), (1, 128, 1, 2)])
@pytest.mark.parametrize('parameters', [SURGE_TRUTH, WRONG])
def test_in_parts_the_score_is_the_same(
        monkeypatch: pytest.MonkeyPatch, sensor: bool, reference: bool, counts: tuple[int, ...],
        parameters: tuple[float, float, float, float]) -> None:
    whole = filled(counts, sensor, reference)
    expected = whole.score('surge', parameters), whole.predicted('surge', parameters)
    monkeypatch.setattr(rows, 'BLOCK', 64)
    monkeypatch.setattr(score, 'BLOCK', 64)
    parts = filled(counts, sensor, reference)
    got = parts.score('surge', parameters), parts.predicted('surge', parameters)
    assert got[0].mae == pytest.approx(expected[0].mae, rel=1e-12, nan_ok=True)
    assert got[0].fit == pytest.approx(expected[0].fit, rel=1e-12, nan_ok=True)
    assert got[1] == pytest.approx(expected[1], rel=1e-10, abs=1e-12)
    assert parts.series('surge') == whole.series('surge')
    for one, other in zip(parts.records('surge'), whole.records('surge'), strict=True):
        assert repr(one) == repr(other)


def test_in_parts_a_model_that_runs_away_scores_as_badly_as_can_be(small: None) -> None:
    for reference in (False, True):
        log = filled((500,), reference=reference)
        assert log.score('surge', (0.004, 3.0, 0.5, 0.0)) == Score(math.inf, -math.inf)


def test_what_is_many_is_not_in_memory(small: None) -> None:
    on_disk, in_memory = (max(lengths(filled((1000,), reference=True, spill=spill)))
                          for spill in (True, False))
    assert on_disk < 4 * 64  # rows of several columns
    assert in_memory > 2000


def test_a_velocity_that_never_changes_has_no_fit(small: None) -> None:
    log = ScoreLog(replace(SETTINGS, cutoff=0.0))
    log.restarted('surge', 0, 0.0)
    for k in range(200):
        log.stepped('surge', (k * PERIOD, k * PERIOD, (k + 1) * PERIOD), Step(
            0.1, (0.0,) * 3, (0.0,) * 3, 0.0))
    assert log.score('surge', WRONG).mae > 0.0
    assert math.isnan(log.score('surge', WRONG).fit)
