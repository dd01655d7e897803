"""What a covariance in normalised units says in those of the parameters."""

import math

import numpy as np
import pytest
from rovid_core.identify.ekf.extended_kalman import ExtendedKalman
from rovid_core.identify.ekf.normalised_model import FilterUncertainty, NormalisedModel
from rovid_core.settings.run import DofSettings, Scales

UNIT = (0.01, 2.0, 1.0, 0.5)
# alpha to delta, a coupling and the delay
COVARIANCE = np.diag([4.0, 9.0, 16.0, 25.0, 36.0, 0.0025]) + 0.5


def test_covariance_and_deviations_are_in_the_units_of_the_parameters() -> None:
    # a force of 50 N and a velocity of 0.5 m/s
    model = NormalisedModel(Scales(
        50.0, 0.5, (0.1, 0.0, 0.0, 0.0), (True, True, True, False), ('vr',)))
    told = FilterUncertainty(COVARIANCE.tolist(), 2.0, model)
    expected = 2.0 * COVARIANCE[:4, :4] * np.outer(UNIT, UNIT)
    assert np.reshape(told.covariance, (4, 4)) == pytest.approx(expected)
    assert told.std[:3] == pytest.approx(np.sqrt(np.diag(expected))[:3])
    assert math.isnan(told.std[3])
    assert told.delay_std == pytest.approx(math.sqrt(2.0 * 0.5025))
    assert told.couplings_std == pytest.approx((0.5 * math.sqrt(2.0 * 36.5),))


def test_before_any_data_the_deviations_are_those_of_the_guess() -> None:
    """A drag of 2 alpha balances twice the typical force at the typical speed."""
    scales = Scales.of(DofSettings(200.0, 100.0, typical_force=80.0, typical_velocity=0.5))
    told = ExtendedKalman(scales).uncertainty
    assert told.std[0] == pytest.approx(2.0 / 200.0)
    assert told.delay_std == pytest.approx(0.15)
