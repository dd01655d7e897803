"""Fixes of an acoustic position: seldom, uneven, late, with pauses, and now and then wrong."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rovid_core.model.samples import Event, Sample
from rovid_core.ordering.cadence import Cadence
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.inputs import InputSettings, ThrusterSettings
from rovid_core.settings.run import (
    CurrentSettings,
    DofSettings,
    IdentifierSettings,
    LEAST_GAP,
    Settings,
    SimulatedDof,
    SimulationSettings,
)
from rovid_core.simulation.sensors import simulate
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

SECOND = 1_000_000_000


def gap_after(intervals: Sequence[float]) -> float:
    cadence, time = Cadence(), 0
    cadence.add_time(time)
    for interval in intervals:
        time += round(interval * SECOND)
        cadence.add_time(time)
    return cadence.gap


@pytest.mark.parametrize(('intervals', 'gap'), [
    ([0.1] * 20, LEAST_GAP), ([1.0] * 2, LEAST_GAP), ([0.9, 1.0, 1.1] * 5, 5.0),
    ([1.0, 1.0, 120.0] * 5, 5.0), ([5.0] * 3, 25.0), ([1.0] * 15 + [5.0] * 8, 25.0),
    ([5.0] * 15 + [0.1] * 12, LEAST_GAP), ([2.0, 0.001] * 10, 10.0),
    ([0.001, 0.001, 2.0] * 10, 10.0), ([0.05] * 3 + [10.0] + [0.05] * 20, LEAST_GAP)])
def test_a_gap_is_five_usual_intervals(intervals: list[float], gap: float) -> None:
    assert gap_after(intervals) == pytest.approx(gap, rel=2e-3)


def test_a_pause_is_no_interval() -> None:
    cadence = Cadence()
    for k in range(5):
        cadence.add_time(k * SECOND)
    cadence.restart()
    assert not cadence.add_time(500 * SECOND)
    for k in range(2, 12):
        cadence.restart()
        cadence.add_time(k * 500 * SECOND)
    assert cadence.interval == 1.0


def vehicle(rate: float, noise: float = 0.05, **changes: object) -> Settings:
    truth = {'surge': SimulatedDof(290.0, 290.0, 43.5, 2.9, (150.0,), (0.03,))}
    settings = Settings(
        dofs=('surge',), dof={'surge': DofSettings(200.0, 200.0, 30.0)},
        position=InputSettings('/fix', 't', 'f'), attitude=InputSettings('/imu', 't', 'f'),
        thrusters=ThrusterSettings(
            topics=('/thrust',), type='t', field='f', gain=(1.0,),
            allocation=tuple((float(i == 0),) for i in range(6))),
        identifier=IdentifierSettings(method='aid'),
        simulation=SimulationSettings(dofs=truth, position_rate=rate, position_noise=noise,
                                      attitude_rate=10.0, thruster_rate=5.0))
    return replace(settings, **changes)  # type: ignore[arg-type]


def run(settings: Settings, duration: float = 120.0, late: float = 0.0, jitter: float = 0.0,
        pause: tuple[float, float] = (0.0, 0.0), echo: float = 0.0,
        then: Settings | None = None) -> Stream:
    """
    Return the stream after fixes that come ``late`` [s], and of which some are echoes.

    Half-way it goes on with other settings where they are given.
    """
    random = np.random.default_rng(1)
    # fixes at uneven times are every so many of fast ones
    period = 1.0 / settings.simulation.position_rate
    fast = replace(settings, simulation=replace(settings.simulation, position_rate=20.0))
    due, events = 0.0, []
    for time, name, value in simulate(fast, duration, 1):
        arrival = time
        if name == 'position':
            t = time / SECOND
            if t < due or pause[0] <= t < pause[1]:
                continue
            due = max(due + period, t) + jitter * random.uniform(-1.0, 1.0)
            arrival += round(late * SECOND)
            if random.random() < echo:
                value = (value[0] + 30.0, *value[1:])
        events.append((arrival, len(events), Event(time, (Sample(name, value),))))
    stream = Stream(settings)
    for k, (_, _, event) in enumerate(sorted(events)):
        if then is not None and k == len(events) // 2:
            stream.change(then, '')
        stream.receive(event)
    stream.finish()
    return stream


def steps(stream: Stream) -> int:
    assert stream.estimate is not None
    return stream.estimate.dofs[0].steps


@pytest.mark.parametrize(('rate', 'least'), [(1.0, 112), (0.2, 18)])
def test_uneven_fixes_are_all_used(rate: float, least: int) -> None:
    stream = run(vehicle(rate), jitter=0.1 / rate)
    assert steps(stream) >= least
    assert not stream.take_warnings()


def test_with_a_gap_that_is_set_they_are_lost_as_before() -> None:
    stream = run(vehicle(1.0, max_gap=1.0), jitter=0.1)
    assert stream.rejected['position', 'gap'] > 30


def test_a_pause_of_a_minute_is_one_gap() -> None:
    stream = run(vehicle(1.0), duration=180.0, pause=(60.0, 120.0))
    assert stream.rejected['position', 'gap'] <= 3
    assert steps(stream) > 105


@pytest.mark.parametrize('changes', [
    {'position': InputSettings('/fix', 't', 'f', latency=2.0)}, {'max_wait': 2.5}])
def test_fixes_that_come_seconds_late_are_used(changes: dict[str, object]) -> None:
    stream = run(vehicle(1.0, **changes), late=2.0)
    assert stream.inputs['position'].count > 115
    assert ('position', 'late') not in stream.rejected


def test_the_others_wait_for_fixes_that_keep_coming_late() -> None:
    stream = run(vehicle(1.0), late=0.6)
    assert stream.rejected['position', 'late'] == 3
    assert steps(stream) > 105
    warning, = stream.take_warnings()
    assert 'position keeps coming' in warning


def test_the_others_wait_longer_for_fixes_that_come_later_than_their_latency() -> None:
    late = {'position': InputSettings('/fix', 't', 'f', latency=2.0)}
    stream = run(vehicle(1.0, **late), late=2.6)
    assert stream.rejected['position', 'late'] == 3
    assert steps(stream) > 105


def test_a_wait_that_has_grown_outlasts_a_change_of_other_settings() -> None:
    stream = run(vehicle(1.0), late=0.6, then=vehicle(1.0, max_speed=3.0))
    assert stream.rejected['position', 'late'] == 3


def test_what_is_too_late_says_what_to_set() -> None:
    stream = run(vehicle(1.0), late=2.0)
    assert stream.inputs['position'].count == 0
    warning, = stream.take_warnings()
    assert 'set max_wait to 2.' in warning
    assert stream.lag('position') == pytest.approx(2.0, abs=0.1)
    # and what it says is enough
    assert run(vehicle(1.0, max_wait=float(warning.rpartition(' ')[2])), late=2.0).inputs[
        'position'].count > 115


def test_what_a_simulator_stamps_is_said_to_be_of_another_clock() -> None:
    stream = run(vehicle(1.0), late=1.7e9)
    warning, = stream.take_warnings()
    assert 'position.stamp: receive' in warning
    assert 'max_wait' not in warning


@pytest.mark.parametrize('rate', [1.0, 0.2])
def test_echoes_are_refused(rate: float) -> None:
    stream = run(vehicle(rate), duration=400.0, echo=0.05)
    refused = sum(stream.rejected.get(('position', reason), 0)
                  for reason in ('outlier', 'too_fast', 'shifted'))
    assert refused >= 0.03 * 400.0 * rate
    assert steps(stream) > 0.85 * 400.0 * rate


@pytest.mark.parametrize('rate', [0.2, 0.1])
def test_a_filter_between_two_fixes_knows_all_of_the_thrust(rate: float) -> None:
    stream = run(vehicle(rate, identifier=IdentifierSettings(method='ekf'),
                         current=CurrentSettings(prior=0.0)), duration=60.0 / rate)
    assert stream.estimate is not None
    dof, = stream.estimate.dofs
    assert 1.0 / dof.parameters[0] == pytest.approx(290.0, rel=0.1)
    low, high = dof.intervals['mass']
    assert low <= 290.0 <= high


def test_the_shipped_configuration_uses_every_fix(repository: Path) -> None:
    settings = settings_from(load(repository / 'config' / 'lbl_slow.yaml'))
    settings = replace(settings, identifier=IdentifierSettings(method='aid'))
    stream = run(settings, duration=90.0, late=1.5, jitter=0.1)
    assert stream.inputs['position'].count >= 87
    assert not stream.rejected
    assert stream.estimate is not None
    assert [dof.steps > 80 for dof in stream.estimate.dofs] == [True] * 4
