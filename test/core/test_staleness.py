"""A degree of freedom without a step for too long has no present velocity, but its model."""

from dataclasses import replace
import math

import pytest
from rovid_core.identify.estimate import DofEstimate, Estimate
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import (
    DofSettings,
    InputSettings,
    Settings,
    SimulatedDof,
    SimulationSettings,
    ThrusterSettings,
)
from rovid_core.simulation.sensors import Measurement, simulate

from test.support.surge import run

SETTINGS = Settings(
    dofs=('surge', 'heave', 'yaw'),
    dof={'surge': DofSettings(400.0), 'heave': DofSettings(500.0), 'yaw': DofSettings(60.0)},
    thrusters=ThrusterSettings(
        topics=('/thrusters',), gain=(1.0,) * 6,
        allocation=tuple(tuple(float(i == j) for j in range(6)) for i in range(6))),
    position=InputSettings('/position'), depth=InputSettings('/depth'),
    attitude=InputSettings('/attitude'), angular_velocity=InputSettings('/gyro'),
    simulation=SimulationSettings(dofs={
        'surge': SimulatedDof(300.0, 300.0, forces=(100.0,), frequencies=(0.1,)),
        'heave': SimulatedDof(400.0, 400.0, forces=(100.0,), frequencies=(0.07,)),
        'yaw': SimulatedDof(50.0, 50.0, forces=(10.0,), frequencies=(0.09,))}))
SECOND = 10**9


@pytest.fixture(scope='module')
def measurements() -> list[Measurement]:
    return list(simulate(SETTINGS, 20.0, 1))


def without(measurements: list[Measurement], name: str, start: float,
            end: float) -> list[Measurement]:
    """Return the measurements without those of an input from ``start`` to ``end`` [s]."""
    return [one for one in measurements
            if one[1] != name or not start <= one[0] * 1e-9 < end]


def of(estimate: Estimate, name: str) -> DofEstimate:
    return next(dof for dof in estimate.dofs if dof.dof == name)


def ages(estimates: list[Estimate], name: str) -> list[tuple[float, float]]:
    """Return time and age [s] wherever a DOF is stale."""
    return [(estimate.now * 1e-9, of(estimate, name).stale_for) for estimate in estimates
            if of(estimate, name).status == 'stale']


FEEDS = {'position': {'surge'}, 'depth': {'heave'}, 'angular_velocity': {'yaw'},
         'attitude': {'surge', 'heave'}}


@pytest.mark.parametrize('name', FEEDS)
def test_what_an_input_feeds_becomes_stale_and_comes_back(
        name: str, measurements: list[Measurement]) -> None:
    estimates = run(Stream(SETTINGS), without(measurements, name, 8.0, 12.0))
    for dof in SETTINGS.dofs:
        found = ages(estimates, dof)
        if dof not in FEEDS[name]:
            assert not found
            continue
        assert found[0][0] == pytest.approx(9.0, abs=0.2)  # max_gap later
        assert found[-1][0] == pytest.approx(12.0, abs=0.4)
        times, durations = zip(*found)
        assert min(durations) > 1.0
        assert durations[-1] - durations[0] == pytest.approx(times[-1] - times[0])


def test_velocity_is_nan_and_the_model_stays_while_stale(
        measurements: list[Measurement]) -> None:
    estimates = run(Stream(SETTINGS), without(measurements, 'position', 8.0, 12.0))
    stale = [of(one, 'surge') for one in estimates if of(one, 'surge').status == 'stale']
    last = [of(one, 'surge') for one in estimates if one.now < 8 * SECOND][-1]
    for dof in stale:
        assert all(map(math.isnan, (dof.velocity, dof.v_hat, dof.dv, dof.force)))
        assert (dof.parameters, dof.uncertainty) == (last.parameters, last.uncertainty)
        assert (dof.time, dof.steps) == (last.time, last.steps)
        assert dof.reasons == (f'no step for {dof.stale_for:.1f} s',)
        assert dof.judgement == last.judgement


def test_what_is_fresh_is_not_changed_by_what_is_stale(measurements: list[Measurement]) -> None:
    """Yaw comes from the gyro alone."""
    full = run(Stream(SETTINGS), measurements)
    broken = run(Stream(SETTINGS), without(measurements, 'position', 8.0, 12.0))
    # as text, for a NaN is equal to itself alone
    assert [repr(of(one, 'yaw')) for one in broken if 2 in one.stepped] == [
        repr(of(one, 'yaw')) for one in full if 2 in one.stepped]


def test_an_input_may_be_silent_for_its_timeout(measurements: list[Measurement]) -> None:
    slow = replace(SETTINGS, position=InputSettings('/position', timeout=3.0))
    found = ages(run(Stream(slow), without(measurements, 'position', 8.0, 12.0)), 'surge')
    assert found[0][0] == pytest.approx(11.0, abs=0.2)


def test_a_timeout_that_changes_counts_at_once(measurements: list[Measurement]) -> None:
    stream = Stream(SETTINGS)
    run(stream, [one for one in measurements if one[0] < SECOND])
    stream.change(replace(SETTINGS, max_gap=3.0), '')
    found = ages(run(stream, without(
        [one for one in measurements if one[0] >= SECOND], 'position', 8.0, 12.0)), 'surge')
    assert found[0][0] == pytest.approx(11.0, abs=0.2)


def test_a_dof_that_has_never_made_a_step_waits(measurements: list[Measurement]) -> None:
    estimates = run(Stream(SETTINGS), without(measurements, 'position', 0.0, 20.0))
    assert {of(one, 'surge').status for one in estimates} == {'waiting'}


@pytest.mark.parametrize('max_gap', [1.0, 30.0])
def test_what_was_before_a_jump_of_time_is_stale(
        max_gap: float, measurements: list[Measurement]) -> None:
    stream = Stream(replace(SETTINGS, max_gap=max_gap, reset_on_time_jump=False))
    run(stream, measurements)
    again = run(stream, without(measurements, 'position', 0.0, 3.0))
    first = of(again[0], 'surge')
    assert (first.status, first.reasons) == ('stale', ('no step since time jumped back',))
    assert math.isnan(first.velocity)
    assert of(again[-1], 'surge').status == 'converging'


def test_nothing_at_all_makes_everything_stale(measurements: list[Measurement]) -> None:
    stream = Stream(SETTINGS)
    assert stream.silent_estimate(0) is None
    last = run(stream, measurements)[-1]
    times = [last.now + round(seconds * SECOND) for seconds in (0.5, 1.5, 60.0)]
    found = [stream.silent_estimate(time) for time in times]
    assert [[dof.status == 'stale' for dof in one.dofs] for one in found if one] == [
        [False] * 3, [True] * 3, [True] * 3]
    assert [(one.stepped, one.time, one.now) for one in found if one] == [
        ((), time, time) for time in times]
    assert stream.estimate == last  # nothing has changed
    ended = stream.silent_estimate(last.now, ended=True)
    assert ended and {dof.status for dof in ended.dofs} == {'stale'}


@pytest.mark.parametrize('sign', ['', '/sign'])
def test_without_a_command_for_its_timeout_there_is_no_step(
        sign: str, measurements: list[Measurement]) -> None:
    """Held commands still make steps for a while, so the last step is younger than they are."""
    stream = Stream(replace(SETTINGS, sign=InputSettings(sign), max_gap=2.0))
    silent = 'sign' if sign else 'thrusters'
    signs = [(time, 'sign', value) for time, name, value in measurements if name == 'thrusters']
    run(stream, without(
        sorted([*measurements, *(signs if sign else [])]), silent, 18.0, 21.0))
    timeout = 2.0 if sign else 1.0
    for seconds, stale in ((timeout - 0.1, False), (timeout + 0.1, True)):
        found = stream.silent_estimate(round((18.0 + seconds) * 1e9))
        assert found
        assert {dof.status == 'stale' for dof in found.dofs} == {stale}
