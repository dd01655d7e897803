"""How fast a body turns, from attitudes that are noisy."""

import numpy as np
from numpy.typing import NDArray
import pytest
from rovid_core.velocity.turning_rate import TurningRate

Array = NDArray[np.float64]
DT = 0.05  # [s]


def turned(noise: float, seed: int = 1) -> tuple[Array, Array]:
    """Return the angles [rad] from one attitude to the next as they are, and as measured."""
    times = np.arange(0.0, 300.0, DT)
    rates = 0.05 * np.array([np.sin(1.3 * times), np.sin(0.9 * times), 4.0 * np.sin(0.5 * times)])
    angles = np.cumsum(rates, axis=1) * DT
    measured = angles + noise * np.random.default_rng(seed).standard_normal(angles.shape)
    return np.diff(angles), np.diff(measured)


def followed(rates: TurningRate, rotations: Array) -> Array:
    return np.array([rates.add((x, y, z), DT) for x, y, z in rotations.T.tolist()]).T


def shares(true: Array, taken: Array) -> Array:
    """Return by what a regressor is to be multiplied to be the true one on average, per axis."""
    return np.asarray((true * taken).sum(axis=1) / (taken * taken).sum(axis=1))


def test_without_noise_the_angles_are_as_measured() -> None:
    true, measured = turned(0.0)
    assert followed(TurningRate(), measured) == pytest.approx(true / DT, abs=1e-12)


def test_with_noise_a_regressor_is_hardly_smaller_than_it_seems() -> None:
    """Of roll and pitch the noise of the differences is far more than they turn by."""
    true, measured = turned(0.002)
    of_differences = shares(true / DT, measured / DT)
    assert (of_differences[:2] < 0.4).all()
    assert (shares(true / DT, followed(TurningRate(), measured))[:2] > 0.7).all()


def test_after_a_pause_it_begins_with_the_next_two_attitudes() -> None:
    _, measured = turned(0.002)
    rates = TurningRate()
    followed(rates, measured[:, :500])
    rates.interrupt()
    assert rates.add((1.0, 2.0, 3.0), 0.5) == (2.0, 4.0, 6.0)
    # and goes on from there: not from where it was
    assert rates.add((1.0, 2.0, 3.0), 0.5) == pytest.approx((2.0, 4.0, 6.0))
