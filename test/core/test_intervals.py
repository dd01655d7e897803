"""95 % intervals of lumped and physical parameters: coverage, open ends, what is physical."""

import math

import numpy as np
import pytest
from rovid_core.identify.intervals import (
    intervals,
    KnownUncertainty,
    NO_UNCERTAINTY,
    WithScaleInDoubt,
)
from rovid_core.model.dofs import PARAMETERS, PHYSICAL
from rovid_core.model.plant import lumped, physical

VEHICLE = (290.0, 290.0, 43.5, 20.0)
TRUTH = lumped(*VEHICLE)


def covariance(relative, correlation=0.0):
    """Return the rows of a covariance with the same correlation of alpha with all others."""
    std = np.abs(TRUTH) * relative
    matrix = np.eye(4)
    matrix[0, 1:] = matrix[1:, 0] = correlation
    return tuple((matrix * np.outer(std, std)).ravel().tolist())


def delta_method(parameters, cov):
    """Return the interval of the bias by linearisation, which a ratio should not be given."""
    value = physical(parameters)[3]
    slope = np.array([-value, 0.0, 0.0, -1.0]) / parameters[0]
    half = 1.96 * math.sqrt(slope @ np.reshape(cov, (4, 4)) @ slope)
    return value - half, value + half


@pytest.mark.parametrize('correlation', [0.0, 0.5])
def test_coverage_where_alpha_is_uncertain_by_30_percent(correlation):
    cov = covariance([0.3, 0.2, 0.25, 0.02], correlation)
    draws = np.random.default_rng(1).multivariate_normal(
        TRUTH, np.reshape(cov, (4, 4)), 4000).tolist()
    hits = dict.fromkeys((*PARAMETERS, *PHYSICAL), 0)
    truth = dict(zip((*PARAMETERS, *PHYSICAL), (*TRUTH, *VEHICLE)))
    delta = 0
    for draw in draws:
        for name, (low, high) in intervals(draw, cov).items():
            hits[name] += low <= truth[name] <= high
        low, high = delta_method(draw, cov)
        delta += low <= VEHICLE[3] <= high
    # where alpha may be 0, a bias has two parts, and the interval around both holds more
    for name, count in hits.items():
        assert 0.938 < count / len(draws) < (0.98 if name == 'bias' else 0.962), name
    assert delta / len(draws) < 0.93


def test_a_well_known_alpha_gives_what_the_delta_method_gives():
    cov = covariance([0.002, 0.03, 0.03, 0.03], 0.3)
    assert intervals(TRUTH, cov)['bias'] == pytest.approx(delta_method(TRUTH, cov), rel=1e-3)


def test_the_mass_is_one_over_the_ends_of_alpha():
    found = intervals(TRUTH, covariance([0.2] * 4))
    low, high = found['alpha']
    assert found['mass'] == pytest.approx((1.0 / high, 1.0 / low))


def test_what_the_data_leave_open_is_infinite():
    found = intervals(TRUTH, covariance([0.8, 0.1, 0.1, 0.1]))  # alpha's reaches 0
    assert found['mass'] == (pytest.approx(1.0 / found['alpha'][1]), math.inf)
    # the drags are positive, so only the upper of the two parts that Fieller leaves is left
    low, high = found['quadratic_drag']
    assert 0.0 < low < 290.0
    assert high == math.inf
    # nothing is known: any sign
    found = intervals(TRUTH, covariance([0.8, 9.0, 9.0, 9.0]))
    assert found['bias'] == (-math.inf, math.inf)
    assert found['linear_drag'] == (0.0, math.inf)


def test_drag_ends_at_zero_unless_all_of_it_is_negative():
    cov = covariance([0.01, 2.0, 0.01, 0.1])
    low, high = intervals(TRUTH, cov)['quadratic_drag']
    assert (low, high > 290.0) == (0.0, True)
    wrong = (TRUTH[0], TRUTH[1], -TRUTH[2], TRUTH[3])  # a drag that drives the vehicle
    low, high = intervals(wrong, cov)['linear_drag']
    assert low < -43.5 < high < 0.0


def test_a_left_out_term_has_no_interval():
    cov = list(covariance([0.1] * 4))
    for k in (2, 6, 8, 9, 10, 11, 14):
        cov[k] = 0.0
    found = intervals((TRUTH[0], TRUTH[1], 0.0, TRUTH[3]), cov)
    assert list(found) == ['alpha', 'beta', 'delta', 'mass', 'quadratic_drag', 'bias']


def test_without_a_usable_covariance_there_are_none():
    assert intervals(TRUTH, ()) == {}
    assert intervals(TRUTH, (math.nan,) * 16) == {}
    assert intervals((math.inf, *TRUTH[1:]), covariance([0.1] * 4)) == {}


@pytest.mark.parametrize('alpha', [0.0, 1e-12, -1e-3, 1e-3])
@pytest.mark.parametrize('variance', [1e-30, 1e-6, 1e6])
@pytest.mark.parametrize('theta', [0.0, -1e-9, 1.0])
def test_no_estimate_breaks_it(alpha, variance, theta):
    cov = [0.0] * 16
    cov[::5] = [variance] * 4
    for low, high in intervals((alpha, theta, theta, theta), cov).values():
        assert low <= high


def test_thrust_that_may_not_be_there_widens_mass_and_drag_and_none_of_the_rest():
    known = KnownUncertainty(covariance([0.03, 0.02, 0.02, 0.02]), tuple(
        np.abs(TRUTH) * [0.03, 0.02, 0.02, 0.02]), 0.01, (0.1,))
    doubt = WithScaleInDoubt(known, 0.04 * TRUTH[0])
    assert doubt.std == pytest.approx((0.05 * TRUTH[0], *known.std[1:]))
    assert doubt.covariance == pytest.approx((doubt.std[0]**2, *known.covariance[1:]))
    assert (doubt.delay_std, doubt.couplings_std) == (0.01, (0.1,))
    assert WithScaleInDoubt(NO_UNCERTAINTY, 0.1).covariance == ()
