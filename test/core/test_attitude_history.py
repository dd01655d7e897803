"""What is known of the attitude between two samples, and of velocities in the world."""

from dataclasses import replace
import math
from random import Random

import pytest
from rovid_core.model.samples import Motion
from rovid_core.settings.inputs import InputSettings
from rovid_core.settings.run import DofSettings, IdentifierSettings
from rovid_core.velocity.attitude_history import (
    angles_of,
    AttitudeHistory,
    from_angles,
    from_yaw,
    rotate,
    rotate_back,
    rotation_between,
    SharedMotion,
)
from rovid_core.velocity.velocity_source import VelocitySource

from test.support.surge import surge_settings

SECOND = 1_000_000_000
NOISE = 0.02  # [rad] of an attitude


def history(*seconds: float) -> AttitudeHistory:
    """Return attitudes whose heading [rad] is their time [s]; the timeout is 1 s."""
    attitudes = AttitudeHistory(SECOND, 100 * SECOND)
    for second in seconds:
        attitudes.add_sample(round(second * SECOND), from_yaw(second))
    return attitudes


@pytest.mark.parametrize('pitch', [0.5 * math.pi, -0.5 * math.pi, 0.3])
def test_the_angles_of_an_attitude_make_it_again(pitch: float) -> None:
    attitude = from_angles(0.3, pitch, 0.7)
    left = rotation_between(from_angles(*angles_of(attitude)), attitude)
    assert left == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_between_two_attitudes_the_heading_is_interpolated() -> None:
    attitudes = history(0.0, 1.0, 2.0)
    for second in (0.0, 0.25, 1.0, 1.75):
        assert attitudes.missing(round(second * SECOND)) == ''
        assert attitudes.at(round(second * SECOND)) == pytest.approx(from_yaw(second))
    assert attitudes.missing(2 * SECOND + 1) == 'later'
    assert attitudes.missing(-1) == 'no_attitude'


def test_nothing_is_known_within_a_gap() -> None:
    attitudes = history(0.0, 0.5, 1.6, 1.8)
    assert attitudes.missing(SECOND) == 'no_attitude'
    assert attitudes.missing(round(0.5 * SECOND)) == attitudes.missing(round(1.7 * SECOND)) == ''


def test_an_attitude_that_has_jumped_is_not_joined_with_the_one_before() -> None:
    attitudes = history(0.0, 0.5)
    attitudes.restart_from(SECOND, from_yaw(3.0))
    assert attitudes.missing(round(0.75 * SECOND)) == 'no_attitude'
    assert attitudes.missing(round(0.25 * SECOND)) == 'no_attitude'
    assert attitudes.at(SECOND) == from_yaw(3.0)


def test_a_heading_turns_the_bow_to_port_and_the_short_way_round() -> None:
    assert rotate(from_yaw(math.pi / 2.0), (1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0))
    assert rotate_back(from_yaw(math.pi / 2.0), (0.0, 1.0, 0.0)) == pytest.approx((1.0, 0.0, 0.0))
    assert rotation_between(from_yaw(3.0), from_yaw(-3.0))[2] == pytest.approx(
        2.0 * math.pi - 6.0)
    assert rotation_between(from_yaw(-3.0), from_yaw(3.0))[2] == pytest.approx(
        6.0 - 2.0 * math.pi)


def test_velocities_of_other_inputs_are_used_for_their_timeout() -> None:
    shared = SharedMotion(surge_settings())  # 1 s
    for k in range(4):
        shared.add_depth(k * SECOND // 4, -0.5 * k / 4)
    shared.horizontal = SECOND, 0.25, -0.75
    assert shared.vertical_velocity(SECOND, SECOND // 4) == pytest.approx(-0.5)
    last = 3 * SECOND // 4
    assert shared.vertical_velocity(last + SECOND, SECOND // 4) == pytest.approx(-0.5)
    assert shared.vertical_velocity(last + SECOND + 1, SECOND // 4) is None
    assert shared.horizontal_velocity(2 * SECOND) == (0.25, -0.75)
    assert shared.horizontal_velocity(2 * SECOND + 1) == (0.0, 0.0)
    shared.forget_depths()
    assert shared.vertical_velocity(SECOND, SECOND // 4) is None


def test_a_velocity_is_that_of_the_middle_and_what_is_too_fast_reaches_nobody() -> None:
    settings = surge_settings()
    shared = SharedMotion(settings)
    for k in range(9):
        shared.attitude.add_sample(k * SECOND // 2, from_yaw(0.0))
    source = VelocitySource(settings, 'position', shared)
    for second, x in enumerate((0.0, 0.5, 100.0)):
        source.add_sample(second * SECOND, (x, 0.25 * x, 0.0))
    assert source.next_velocity(4 * SECOND) == 'first'
    motion = source.next_velocity(4 * SECOND)
    assert isinstance(motion, Motion)
    assert (motion.start, motion.time, motion.end) == (0, SECOND // 2, SECOND)
    assert motion.velocity == pytest.approx((0.5,))
    assert source.next_velocity(4 * SECOND) == 'too_fast'
    assert shared.horizontal == (SECOND, 0.5, 0.125)


@pytest.mark.parametrize('tilting', [0.0, 0.1])
def test_an_angle_of_the_body_drifts_by_the_noise_of_the_others(tilting: float) -> None:
    """What heading and path differ by in the end is what the steps state, or a little less."""
    settings = replace(surge_settings(), dofs=('yaw',), dof={'yaw': DofSettings(1.0)},
                       attitude=InputSettings('/a'), identifier=IdentifierSettings('ekf'))
    random, drifts, stated = Random(1), [], []
    for _ in range(60):
        shared = SharedMotion(settings)
        source = VelocitySource(settings, 'attitude', shared)
        path = variance = 0.0
        for k in range(400):
            roll, pitch, yaw = (random.gauss(0.0, NOISE) for _ in range(3))
            attitude = from_angles(roll + tilting * math.sin(0.3 * k), pitch, yaw)
            shared.attitude.add_sample(k * SECOND // 20, attitude)
            source.add_sample(k * SECOND // 20, attitude)
            motion = source.next_velocity(k * SECOND // 20)
            if isinstance(motion, Motion):
                path += motion.velocity[0] * (motion.end - motion.start) * 1e-9
                variance += motion.path_noise[0]**2
        first_and_last = 2.0 * NOISE**2
        drifts.append(path * path)
        stated.append(variance + first_and_last)
    assert 1.0 <= sum(stated) / sum(drifts) < 8.0
    assert sum(stated) > 1.2 * 60 * 2.0 * NOISE**2
