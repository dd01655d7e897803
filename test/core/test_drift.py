"""Whether a parameter drifts: the test of a line through the estimates of many dives."""

import numpy as np
import pytest
from rovid_core.trials.drift import holm, trend
import scipy  # of which parts are imported when they are needed

DIVES = 12


def season(seed: int, slope: float = 0.0, scatter: float = 1.0,
           ) -> tuple[list[float], list[float], list[float]]:
    """Return times, estimates and their standard deviations, which differ from dive to dive."""
    random = np.random.default_rng(seed)
    times = np.sort(random.uniform(0.0, 100.0, DIVES))
    stds = random.uniform(0.2, 3.0, DIVES)
    values = 300.0 + slope * times + scatter * random.normal(size=DIVES)
    return times.tolist(), (values + stds * random.normal(size=DIVES)).tolist(), stds.tolist()


def p_of(seed: int, slope: float = 0.0, scatter: float = 1.0) -> float:
    found = trend(*season(seed, slope, scatter))
    assert found is not None
    return found.p


@pytest.mark.parametrize('scatter', [0.0, 1.0, 10.0])
def test_a_drift_is_claimed_by_chance_in_one_of_twenty_seasons_at_most(scatter: float) -> None:
    seasons = 400
    claimed = sum(p_of(seed, scatter=scatter) < 0.05 for seed in range(seasons))
    assert scipy.stats.binom.cdf(claimed, seasons, 0.05) < 0.999
    if scatter:  # without scatter the test is on the safe side
        assert scipy.stats.binom.cdf(claimed, seasons, 0.05) > 0.001


def test_intervals_that_are_too_narrow_make_no_drift() -> None:
    def p(seed: int) -> float:
        times, values, stds = season(seed, scatter=0.0)
        found = trend(times, values, [std / 10.0 for std in stds])
        assert found is not None
        return found.p

    assert scipy.stats.binom.cdf(sum(p(seed) < 0.05 for seed in range(400)), 400, 0.05) < 0.999


def test_a_drift_is_found_and_its_interval_holds() -> None:
    found = [trend(*season(seed, slope=0.1)) for seed in range(100)]
    covered = sum(one.low <= 0.1 <= one.high for one in found if one)
    assert scipy.stats.binom.cdf(covered, 100, 0.95) > 0.001
    assert sum(one.p < 0.05 for one in found if one) > 80


def test_the_scatter_between_dives_is_estimated() -> None:
    found = [trend(*season(seed, scatter=5.0)) for seed in range(100)]
    assert np.median([one.scatter for one in found if one]) == pytest.approx(5.0, rel=0.1)
    assert all(one.count == DIVES for one in found if one)


def test_without_intervals_it_is_an_ordinary_regression() -> None:
    times, values, _ = season(3)
    found, expected = trend(times, values, [0.0] * DIVES), scipy.stats.linregress(times, values)
    assert found is not None
    assert found.slope == pytest.approx(expected.slope)
    assert found.p == pytest.approx(expected.pvalue)
    assert found.mean == pytest.approx(np.mean(values))


@pytest.mark.parametrize('times', [[], [1.0, 2.0], [5.0, 5.0, 5.0]])
def test_too_few_dives_have_no_trend(times: list[float]) -> None:
    assert trend(times, [1.0] * len(times), [0.1] * len(times)) is None


@pytest.mark.parametrize('std', [0.0, 0.1])
@pytest.mark.parametrize('slope', [0.0, 2.0])
def test_a_perfect_line_is_told_as_it_is(slope: float, std: float) -> None:
    times = [0.0, 1.0, 2.0, 3.0]
    found = trend(times, [5.0 + slope * t for t in times], [std] * 4)
    assert found is not None
    assert (found.slope, found.mean) == (pytest.approx(slope), pytest.approx(5.0 + 1.5 * slope))
    assert (found.p < 0.01) == bool(slope)
    assert found.scatter == pytest.approx(0.0, abs=1e-6)


def test_many_tests_together_are_judged_together() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []
