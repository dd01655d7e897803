"""What a controller reads: one message with the model, and whether it may be used."""

from collections.abc import Callable
from dataclasses import replace
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rovid_core.identify import METHODS
from rovid_core.identify.estimate import Estimate
from rovid_core.identify.intervals import Z95
from rovid_core.identify.status import STATUSES
from rovid_core.model.dofs import PHYSICAL
from rovid_core.model.plant import advance
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import InputSettings, Settings
from rovid_core.simulation.sensors import Measurement, simulate
from rovid_ros.logs.log import Log
from rovid_ros.logs.writer import OutputLog
from rovid_ros.model import Model
from rovid_ros.results.outputs import Output, Outputs

from test.support.surge import run, surge_log, surge_settings, SURGE_TRUTH

SETTINGS = surge_settings(method='ekf')
LENGTH = 150.0  # [s]


@pytest.fixture(scope='module')
def estimates() -> list[Estimate]:
    return run(Stream(SETTINGS), surge_log(1, LENGTH))


@pytest.fixture
def read(tmp_path: Path) -> Callable[[Output], Any]:
    """Return what writes a message to a log and reads it back, as others get it."""
    def read(output: Output) -> Any:
        log = OutputLog(tmp_path / 'out.mcap')
        with log:
            log.write_raw(f'/{output.topic}', output.type, output.cdr, 1)
            log.finish()
        with Log([tmp_path / 'out.mcap']) as written:
            return next(written.messages([f'/{output.topic}'])).data

    return read


def message(settings: Settings, estimate: Estimate) -> Output:
    return next(output for output in Outputs(settings).messages(estimate)
                if output.topic == 'rov/model')


def test_a_row_has_the_numbers_of_the_estimate(
        estimates: list[Estimate], read: Callable[[Output], Any]) -> None:
    last = estimates[-1]
    dof, surge = last.dofs[0], Model.from_message(read(message(SETTINGS, last)))['surge']
    assert surge.stamp == last.dofs[0].time * 1e-9
    assert surge.age == pytest.approx((last.now - dof.time) * 1e-9)
    assert 0.0 < surge.age < 0.2
    assert (surge.status, surge.valid, surge.updated) == (dof.status, dof.valid, True)
    assert (surge.alpha, surge.beta, surge.gamma, surge.delta) == dof.parameters
    assert surge.mass == 1.0 / dof.parameters[0]
    assert [surge.std[name] for name in ('alpha', 'beta', 'gamma', 'delta')] == list(dof.std)
    assert (surge.velocity, surge.v_hat, surge.force) == (dof.velocity, dof.v_hat, dof.force)
    assert (surge.delay, surge.std['delay']) == (dof.delay, dof.delay_std)
    assert (surge.velocity_delay, surge.v_hat_delay) == (dof.velocity_delay, dof.v_hat_delay)
    assert surge.velocity_delay > surge.v_hat_delay
    assert 0.9 < surge.fit < 1.0
    for name in PHYSICAL:  # of a well known model the first order is as good as Fieller's
        low, high = dof.intervals[name]
        assert 2.0 * Z95 * surge.std[name] == pytest.approx(high - low, rel=0.1)


def test_the_numbers_of_a_status_stay_what_they_are() -> None:
    """Programs in other languages have them written down."""
    assert dict(enumerate(STATUSES)) == {
        0: 'waiting', 1: 'unexcited', 2: 'converging', 3: 'converged', 4: 'frozen', 5: 'invalid',
        6: 'stale'}


def test_the_first_seconds_are_not_valid_and_what_is_valid_is_right(
        estimates: list[Estimate]) -> None:
    valid = [one for one in estimates if one.dofs[0].valid]
    assert 20.0 < valid[0].time * 1e-9 < LENGTH - 20.0
    assert len(valid) > 0.95 * len([one for one in estimates if one.time >= valid[0].time])
    for one in valid:
        assert 1.0 / one.dofs[0].parameters[0] == pytest.approx(1.0 / SURGE_TRUTH[0], rel=0.1)


@pytest.mark.parametrize('method', METHODS)
def test_the_velocities_are_as_late_as_they_say(method: str) -> None:
    settings = replace(surge_settings(method=method), reference=InputSettings('/reference'))
    log = list(simulate(settings, 100.0, 1))
    times, true = np.array([(time, value[0]) for time, name, value in log
                            if name == 'reference']).T
    dofs = [one.dofs[0] for one in run(Stream(settings), log)][600:]
    lags = np.arange(-0.2, 0.5, 0.01)
    for name in ('velocity', 'v_hat'):
        found = np.array([getattr(dof, name) for dof in dofs])
        at = np.array([dof.time for dof in dofs])
        errors = [np.std(found - np.interp(at - 1e9 * lag, times, true)) for lag in lags]
        told = getattr(dofs[-1], f'{name}_delay')
        assert lags[np.argmin(errors)] == pytest.approx(told, abs=0.02), name


def test_what_is_stale_or_frozen_or_at_rest(
        estimates: list[Estimate], read: Callable[[Output], Any]) -> None:
    stream = Stream(SETTINGS)
    log = surge_log(1, LENGTH)
    last = run(stream, log)[-1]
    later = last.now + 5 * 10**9
    stale = stream.silent_estimate(later)
    assert stale
    assert (last.dofs[0].valid, stale.dofs[0].valid) == (True, False)
    told = Model.from_message(read(message(SETTINGS, stale)))['surge']
    assert told.age == pytest.approx((later - last.dofs[0].time) * 1e-9)
    assert told.stamp == last.dofs[0].time * 1e-9

    stream.enable(False)
    frozen = run(stream, moved(log, later, 30.0))
    assert {one.dofs[0].status for one in frozen} == {'frozen'}
    assert all(one.dofs[0].valid for one in frozen)
    stream.enable(True)
    stream.reset()
    assert not run(stream, moved(log, frozen[-1].now + 10**9, 5.0))[-1].dofs[0].valid


def moved(log: list[Measurement], start: int, duration: float) -> list[Measurement]:
    return [(time + start, name, value) for time, name, value in log if time < duration * 1e9]


def test_without_a_step_there_is_an_empty_row(read: Callable[[Output], Any]) -> None:
    for output in Outputs(SETTINGS).reset():
        if output.topic == 'rov/model':
            surge = Model.from_message(read(output))['surge']
    assert (surge.status, surge.valid, surge.updated) == ('waiting', False, False)
    assert math.isnan(surge.stamp)
    assert math.isnan(surge.velocity)
    assert surge.mass == pytest.approx(SETTINGS.dof['surge'].mass)


def test_the_force_gives_the_acceleration(
        estimates: list[Estimate], read: Callable[[Output], Any]) -> None:
    model = Model.from_message(read(message(SETTINGS, estimates[-1])))
    parameters = estimates[-1].dofs[0].parameters
    for acceleration, velocity in ((0.1, 0.5), (-0.2, 0.3), (0.0, -0.4), (0.0, 0.0)):
        force = model.force('surge', acceleration, velocity)
        rate = (advance(parameters, velocity, force, 1e-4) - velocity) / 1e-4
        assert rate == pytest.approx(acceleration, abs=1e-4)


def test_couplings_are_columns_and_count_in_the_force(
        read: Callable[[Output], Any]) -> None:
    settings = replace(
        SETTINGS, dofs=('surge', 'yaw'),
        dof={'surge': replace(SETTINGS.dof['surge'], couplings=('vr',)),
             'yaw': replace(SETTINGS.dof['surge'], couplings=('v', 'uv'))},
        velocity=InputSettings('/dvl'))
    fields = next(one for one in Outputs(settings).reset() if one.topic == 'rov/model')
    surge, yaw = Model.from_message(read(fields)).dofs.values()
    assert (list(surge.couplings), list(yaw.couplings)) == (['vr'], ['v', 'uv'])
    known = Model({'yaw': replace(yaw, couplings={'v': -0.5, 'uv': 2.0})})
    pushed = known.force('yaw', 0.1, 0.2, {'v': 0.3, 'uv': 0.06})
    assert pushed == pytest.approx(
        known.force('yaw', 0.1, 0.2) - yaw.mass * (-0.5 * 0.3 + 2.0 * 0.06))
    with pytest.raises(ValueError, match="yaw has no coupling 'vr', has v, uv"):
        known.force('yaw', 0.0, 0.0, {'vr': 1.0})


def test_a_reverse_thrust_and_drag_are_found_from_force_and_velocity(
        estimates: list[Estimate], read: Callable[[Output], Any]) -> None:
    plain = Model.from_message(read(message(SETTINGS, estimates[-1])))['surge']
    other = replace(plain, couplings={
        'reverse_thrust': -0.3 * plain.alpha, 'reverse_drag': 0.5 * plain.beta})
    assert other.force_for(0.1, 0.5) == plain.force_for(0.1, 0.5)
    wanted = plain.force_for(-0.1, -0.5) + 0.5 * plain.beta * 0.25 / plain.alpha
    assert other.force_for(-0.1, -0.5) == pytest.approx(wanted / 0.7)


def test_what_thrusters_lose_with_speed_is_asked_for_besides(
        estimates: list[Estimate], read: Callable[[Output], Any]) -> None:
    plain = Model.from_message(read(message(SETTINGS, estimates[-1])))['surge']
    assert plain.loss == 0.0
    other = replace(plain, loss=2.0)
    for acceleration, velocity in ((0.1, 0.5), (-0.2, 0.3), (0.0, -0.4)):
        asked = other.force_for(acceleration, velocity)
        given = asked - 2.0 * math.sqrt(abs(asked)) * velocity
        assert given == pytest.approx(plain.force_for(acceleration, velocity))


@pytest.mark.parametrize('topic', ['rov/params', 'rov/identifier_state'])
def test_another_message_is_refused_in_a_line(
        topic: str, estimates: list[Estimate], read: Callable[[Output], Any]) -> None:
    other = read(next(one for one in Outputs(SETTINGS).messages(estimates[-1])
                      if one.topic == topic))
    with pytest.raises(ValueError, match='not a message of /rov/model'):
        Model.from_message(other)
