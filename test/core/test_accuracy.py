"""The figures that the method stands on; ``make figures ARGS=accuracy`` makes all of them."""

from dataclasses import replace

import pytest
from rovid_core import COMPILED
from rovid_core.identify.aid.adaptive_identifier import Gains
from rovid_core.model.dofs import PARAMETERS
from rovid_core.model.lowpass import LowPass
from rovid_core.pipeline import steps
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Scales
from rovid_core.simulation.sensors import simulate

from test.support.surge import (
    exact_case,
    HEAVY,
    LIGHT,
    prediction,
    run,
    surge_log,
    surge_settings,
    SURGE_TRUTH,
    TRAINING,
)


def test_rk4_at_100_hz_finds_the_eq_13_vehicle_and_w_never_grows():
    (alpha, beta), growth = exact_case('rk4', 'stage')
    assert abs(alpha) < 0.01
    assert abs(beta) < 0.01
    assert growth < 1e-9


@pytest.mark.parametrize('integrator', ['euler', 'heun'])
def test_mean_thrust_leaves_no_bias_at_100_hz(integrator):
    (alpha, beta), _ = exact_case(integrator, 'mean')
    assert abs(alpha) < 0.01
    assert abs(beta) < 0.01


def test_textbook_euler_reads_thrust_as_drag():
    (_, beta), _ = exact_case('euler', 'left')
    assert 0.05 < beta < 0.10  # the reason for the mean thrust: 7 % more drag


@pytest.fixture(scope='module')
def logs():
    return [surge_log(seed) for seed in range(2)]


@pytest.mark.long
@pytest.mark.parametrize('initial', [HEAVY, LIGHT], ids=['heavy', 'light'])
def test_default_settings_predict_another_profile_within_1_mm_s(logs, initial):
    for log in logs:
        stream = Stream(surge_settings(initial))
        parameters = run(stream, log)[-1].dofs[0].parameters
        assert prediction(parameters).mae < 0.001
        assert not stream.rejected


@pytest.mark.long
@pytest.mark.parametrize(('time', 'force', 'speed'), [
    (1.0, 0.0, 0.0), (10.0, 0.0, 0.0), (3.0, 385.0, 1.5), (3.0, 43.0, 0.17), (3.0, 43.0, 1.5)])
def test_neither_typical_sizes_nor_adaptation_time_decide(logs, time, force, speed):
    guess = replace(HEAVY, typical_force=force, typical_velocity=speed)
    stream = Stream(surge_settings(guess, adaptation_time=time))
    assert prediction(run(stream, logs[0])[-1].dofs[0].parameters).mae < 0.007


@pytest.mark.skipif(COMPILED, reason='compiled code does not see that a class is replaced')
def test_thrust_that_is_not_filtered_like_the_velocity_is_several_times_worse(monkeypatch):
    # the identifier with raw gains, which takes both filtered
    log = surge_log(0, 120.0)
    gains = Gains.from_time(3.0, Scales.of(HEAVY))
    settings = surge_settings(
        feedback_gain=gains.feedback, adaptation_gains=gains.adaptation, integrator='euler')

    def error():
        return prediction(run(Stream(settings), log)[-1].dofs[0].parameters).mae

    alike = error()

    class ForceUnfiltered(steps.FilteredSource):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            self.force = LowPass(0.0)

    monkeypatch.setattr(steps, 'FilteredSource', ForceUnfiltered)
    assert error() > 4 * alike


def test_without_noise_drag_is_right_whatever_the_low_pass():
    settings = surge_settings()
    settings = replace(settings, simulation=replace(
        settings.simulation, position_noise=0.0, attitude_noise=0.0))
    last = run(Stream(settings), simulate(settings, 200.0, 1))[-1].dofs[0]
    assert last.parameters == pytest.approx(SURGE_TRUTH, rel=0.01)


def test_the_score_of_the_truth_is_noise_and_that_of_the_guess_is_not():
    assert prediction(SURGE_TRUTH, TRAINING).mae == 0.0
    guess = Stream(surge_settings()).state()['dofs']['surge']['parameters']
    assert prediction(guess, TRAINING).mae > 0.05
    assert len(guess) == len(PARAMETERS)
