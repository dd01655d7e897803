"""Tuning: what it is made of does as the pipe does, and finds what was put in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math
from pathlib import Path
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rovid_core.model.samples import Event, Sample
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.inputs import InputSettings
from rovid_core.settings.run import Settings
from rovid_core.simulation.sensors import simulate
from rovid_core.thrust.force_history import ForceHistory
from rovid_core.trials.tuning.cross_validation import choose, FOLDS, part_bounds
from rovid_core.trials.tuning.heading import around_the_best
from rovid_core.trials.tuning.log import CommandedForce, TuningLog
from rovid_core.trials.tuning.reading import reading_settings, TuningError
from rovid_core.trials.tuning.timing import tune_thrust
from rovid_core.trials.tuning.tune import tune, Tuned
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

pytestmark = pytest.mark.long

DELAY, LAG = 0.12, 0.3

Reader = Callable[[Settings], TuningLog]


@pytest.fixture(scope='module')
def surge() -> Settings:
    """Return the paper's vehicle with its surge alone."""
    values = load(Path(__file__).parents[2] / 'config' / 'jhurov.yaml')
    return settings_from({**values, 'dofs': ['surge'], 'simulation.thruster_rate': 10.0,
                          'simulation.attitude_rate': 10.0, 'depth.topic': '',
                          'identifier.method': 'aid'})


def test_commands_that_the_pipe_refuses_are_not_tuned_with(surge: Settings) -> None:
    thrusters = surge.thrusters
    settings = replace(surge, sign=InputSettings('/sign', timeout=1.05))
    log = TuningLog(settings)
    stream = Stream(settings, recorder=log, scorer=log)
    stream.receive(Event(0, (Sample('sign', (-1.0,) * thrusters.count),)))
    for k in range(1, 51):
        stream.receive(Event(k * 10**8, (Sample('thrusters', (2.0,) * thrusters.count),)))
    stream.finish()
    assert stream.rejected['thrusters', 'stale_sign'] == 40
    assert log.commands().tolist() == [[-2.0] * thrusters.count] * 10


def log_of(truth: Settings, duration: float, noise: np.random.Generator | None = None,
           late: dict[str, float] | None = None, **thrusters: float) -> Reader:
    """
    Return what reads the log of a simulated vehicle with some settings.

    Its thrusters differ from those of the settings, and some inputs are stamped late [s]. With
    noise, this stands in the place of the logged commands.
    """
    true = replace(truth, thrusters=replace(truth.thrusters, **thrusters), yaw_offset=0.0)
    samples = list(simulate(true, duration, seed=1))

    def read(settings: Settings) -> TuningLog:
        log = TuningLog(reading_settings(settings))
        stream = Stream(reading_settings(settings), recorder=log, scorer=log)
        half = 0.5 * settings.yaw_offset
        events = []
        for time, name, value in samples:
            if name == 'attitude':  # the wrong offset is added, as the converter does
                x, y, z, w = value
                s, c = math.sin(half), math.cos(half)
                value = (c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z)
            if name == 'thrusters' and noise is not None:
                value = tuple(noise.normal(0.0, 2.0, len(value)).tolist())
            known = settings.thrusters if name == 'thrusters' else settings.input(name)
            apart = (late or {}).get(name, 0.0) - known.latency
            events.append(Event(time + round(1e9 * apart), (Sample(name, value),)))
        for event in sorted(events, key=lambda event: event.time):
            stream.receive(event)
        stream.finish()
        return log
    return read


@pytest.fixture(scope='module')
def delayed(surge: Settings) -> Tuned:
    """Return what is found where delay, lag and 5 degrees of heading are missing."""
    read = log_of(surge, 120.0, delay=DELAY, time_constant=LAG)
    return tune(read, replace(surge, yaw_offset=math.radians(-5.0)))


@pytest.fixture(scope='module')
def rov() -> Settings:
    """Return a BlueROV2 that turns while it goes ahead and sideways."""
    found = settings_from(load(Path(__file__).parents[2] / 'config' / 'bluerov2_ardusub.yaml'))
    return replace(found, dofs=('surge', 'sway', 'yaw'),
                   thrusters=replace(found.thrusters, delay=0.0), simulation=replace(
                       found.simulation, thruster_rate=10.0, attitude_rate=10.0))


def test_a_pause_belongs_to_no_fold() -> None:
    segments = [SimpleNamespace(start=start, ends=[start + 99]) for start in (1000, 100_000)]
    assert part_bounds(segments, 1).tolist() == [  # type: ignore[arg-type]
        1000, 1025, 1050, 1075, 100_000, 100_025, 100_050, 100_075, 100_100]


@pytest.mark.parametrize(('linear', 'lag', 'turns', 'at'), [
    (False, 0.0, False, 0.0), (True, 0.0, False, 0.0), (False, 0.3, False, 0.0),
    (True, 0.3, False, 0.0), (False, 0.3, True, 0.0), (False, 0.0, True, 0.0),
    (False, 0.3, True, 40.0), (False, 0.0, True, 40.0)])
def test_the_force_of_a_log_is_that_of_the_pipe(
        surge: Settings, linear: bool, lag: float, turns: bool, at: float) -> None:
    chain = replace(surge.thrusters, delay=0.12, time_constant=lag, lag_of_turns=turns, lag_at=at,
                    hold='linear' if linear else 'previous')
    thrust = ForceHistory(chain, ('surge',))
    plain = ForceHistory(replace(chain, delay=0.0, time_constant=0.0), ('surge',))
    times = np.cumsum(np.array([30, 70, 50, 400, 20, 50, 50])) * 1_000_000
    commands = [0.3, -1.0, 0.5, 2.0, 2.0, 0.0, 1.0]
    for time, u in zip(times.tolist(), commands):
        thrust.add_commands(time, (u, 0.5 - u, 0.0))
        plain.add_commands(time, (u, 0.5 - u, 0.0))
    forces = np.array([[40.0 * u, 40.0 * (0.5 - u), 1e3] for u in commands]).T
    ends = np.arange(int(times[0]) + 120_000_000, int(times[-1]), 7_000_000)
    rows = np.array([surge.thrusters.allocation[0]])
    impulse = CommandedForce(times, forces, rows, linear, turns, at).impulse(0, ends, 0.12, lag)
    expected = np.array([thrust.integrals((t,))[0][0] for t in ends.tolist()])
    np.testing.assert_allclose(impulse - impulse[0], expected - expected[0], atol=1e-9)


def test_finds_delay_and_lag(delayed: Tuned) -> None:
    keys = {key: change for stage in delayed.stages for key, change in stage.keys.items()}
    assert keys['thrusters.delay'].after == pytest.approx(DELAY, abs=0.03)
    assert keys['thrusters.time_constant'].after == pytest.approx(LAG, abs=0.1)
    assert keys['thrusters.delay'].low <= DELAY <= keys['thrusters.delay'].high


@pytest.mark.parametrize(('turns', 'at'), [(False, 0.0), (True, 0.0), (True, 60.0)])
def test_tells_propellers_whose_turns_lag_from_a_force_that_does(
        surge: Settings, turns: bool, at: float) -> None:
    read = log_of(surge, 120.0, time_constant=LAG, lag_of_turns=turns, lag_at=at)
    changes = tune(read, surge).changes()
    assert changes.get('thrusters.lag_of_turns', False) is turns
    found = changes.get('thrusters.lag_at', 0.0)
    if at:  # the same inertia, told of another force
        changes['thrusters.time_constant'] *= math.sqrt(found / at)  # type: ignore[operator]
    else:
        assert not found
    assert changes['thrusters.time_constant'] == pytest.approx(LAG, abs=0.06)
    # from the other side: what is wrong in the file is put right, what is right stays
    configured = replace(surge, thrusters=replace(
        surge.thrusters, time_constant=LAG, lag_of_turns=True))
    changes = tune(read, configured).changes()
    assert changes.get('thrusters.lag_of_turns', True) is turns
    assert bool(changes.get('thrusters.lag_at', 0.0)) is (at > 0.0)


def test_a_fix_a_second_finds_the_delay_of_thrust_that_changes_sooner(surge: Settings) -> None:
    truth = replace(surge.simulation.dofs['surge'], mass=90.0, forces=(60.0, 50.0),
                    frequencies=(0.05, 0.3))
    slow = replace(surge, simulation=replace(
        surge.simulation, position_rate=1.0, position_noise=0.01, dofs={'surge': truth}))
    changes = tune(log_of(slow, 150.0, delay=0.4), slow).changes()
    assert changes.keys() == {'thrusters.delay', 'thrusters.time_constant'}
    # a fix a second does not tell them apart
    assert sum(changes.values()) == pytest.approx(0.4, abs=0.05)  # type: ignore[arg-type]


def test_finds_the_heading(delayed: Tuned) -> None:
    change = delayed.stages[0].keys['attitude.yaw_offset']
    assert math.degrees(change.before) == pytest.approx(-5.0)
    assert math.degrees(change.after) == pytest.approx(0.0, abs=0.5)


def test_finds_the_dead_band(surge: Settings) -> None:
    tuned = tune(log_of(surge, 90.0, deadband=0.5), surge)
    assert tuned.changes()['thrusters.deadband'] == pytest.approx(0.5, abs=0.15)


def test_finds_a_dead_zone(surge: Settings) -> None:
    changes = tune(log_of(surge, 90.0, dead_zone=0.5), surge).changes()
    assert changes['thrusters.dead_zone'] == pytest.approx(0.5, abs=0.01)
    assert 'thrusters.deadband' not in changes


def test_finds_the_reverse_thrust(surge: Settings) -> None:
    tuned = tune(log_of(surge, 90.0, reverse=0.8), surge)
    assert tuned.changes()['thrusters.reverse'] == pytest.approx(0.8, abs=0.05)
    assert not any(stage.note for stage in tuned.stages if 'thrusters.reverse' in stage.keys)
    before, after = tuned.errors['surge']
    assert after < 0.8 * before


@pytest.mark.long
def test_a_reverse_thrust_that_no_thruster_has_is_told_as_the_end_of_what_is_tried(
        surge: Settings) -> None:
    [stage] = [one for one in tune(log_of(surge, 90.0, reverse=1.8), surge).stages
               if 'thrusters.reverse' in one.keys]
    assert stage.keys['thrusters.reverse'].after == 1.3
    assert stage.note == ('thrusters.reverse: 1.3 is the end of what is tried: something else '
                          'than the thrusters looks like it')


def test_a_coupling_that_is_missing_is_added() -> None:
    config = Path(__file__).parents[2] / 'config'
    truth = settings_from({**load(config / 'odometry_wrench.yaml'),
                           **load(config / 'examples' / 'auv.yaml')})
    settings = replace(
        truth, dofs=('surge', 'sway', 'yaw'),
        dof={dof: replace(its, couplings=()) for dof, its in truth.dof.items()},
        simulation=replace(truth.simulation, thruster_rate=10.0, attitude_rate=10.0,
                           position_rate=10.0))
    tuned = tune(log_of(settings, 90.0), settings)
    changes = tuned.changes()
    assert 'vr' in changes['surge.couplings']  # type: ignore[operator]
    assert 'ur' in changes['sway.couplings']  # type: ignore[operator]
    for before, after in tuned.errors.values():
        assert after < 0.7 * before


def test_with_another_heading_the_log_is_read_again_and_couplings_are_sought(
        surge: Settings) -> None:
    read, offsets = log_of(surge, 90.0), []

    def noted(settings: Settings) -> TuningLog:
        offsets.append(math.degrees(settings.yaw_offset))
        return read(settings)

    tuned = tune(noted, replace(surge, yaw_offset=math.radians(-20.0)))
    assert offsets == [pytest.approx(-20.0), pytest.approx(0.0, abs=0.5)]
    assert [names.key for names in tuned.lists] == ['surge.couplings', 'surge.terms']


def test_finds_how_late_fixes_are_stamped(rov: Settings) -> None:
    read = log_of(rov, 80.0, late={'position': 0.3})
    changes = tune(read, rov).changes()
    assert changes['position.latency'] == pytest.approx(0.3, abs=0.03)
    assert changes['max_wait'] == pytest.approx(0.4, abs=0.03)  # it may come so much later
    assert 'thrusters.latency' not in changes


def test_turns_alone_tell_how_late_fixes_are(rov: Settings) -> None:
    """No DOF has another input, which would tell it by its thrust."""
    plane = replace(rov, dofs=('surge', 'sway'))
    changes = tune(log_of(rov, 80.0, late={'position': 0.3}), plane).changes()
    assert changes['position.latency'] == pytest.approx(0.3, abs=0.03)


@pytest.fixture(scope='module')
def diver() -> Settings:
    """Return the paper's vehicle with surge and heave, which do not turn."""
    return settings_from({
        **load(Path(__file__).parents[2] / 'config' / 'jhurov.yaml'), 'dofs': ['surge', 'heave'],
        'simulation.thruster_rate': 10.0, 'simulation.attitude_rate': 10.0,
        'simulation.depth_rate': 10.0})


@pytest.mark.parametrize('name', ['position', 'depth'])
def test_an_input_whose_dofs_answer_later_than_all_others_is_late(
        diver: Settings, name: str) -> None:
    changes = tune(log_of(diver, 90.0, late={name: 0.3}), diver).changes()
    assert changes == {f'{name}.latency': pytest.approx(0.3, abs=0.03)}


def test_late_fixes_leave_the_delay_of_the_thrust(diver: Settings) -> None:
    changes = tune(log_of(diver, 90.0, late={'position': 0.3}, delay=0.2), diver).changes()
    assert changes.pop('position.latency') == pytest.approx(0.3, abs=0.05)
    assert sum(changes.values()) == pytest.approx(0.2, abs=0.03)  # type: ignore[arg-type]
    assert changes.keys() <= {'thrusters.delay', 'thrusters.time_constant'}


def test_a_latency_that_only_turns_want_is_not_taken(rov: Settings) -> None:
    """
    Noise of fixes a second apart looks like 0.6 s here; heave and yaw know better.

    What the masses owe to it is said.
    """
    noisy = replace(rov, simulation=replace(
        rov.simulation, position_rate=1.0, position_noise=0.1))
    tuned = tune(log_of(noisy, 180.0, late={'position': 0.3}), noisy)
    assert 'position.latency' not in tuned.changes()
    stage = next(stage for stage in tuned.stages if 'position.latency' in stage.keys)
    # what turns alone want does not have in it what stays
    assert math.isnan(stage.keys['position.latency'].low)
    found = re.match(r'position.latency: (\S+) to (\S+) s predict this log alike, but change the '
                     r'mass of surge by -\d+ to .* measure the latency', stage.note)
    assert found and float(found[1]) <= 0.3 <= float(found[2])


def test_a_latency_that_is_known_changes_no_mass(rov: Settings) -> None:
    tuned = tune(log_of(rov, 80.0), rov)
    assert not any(stage.note for stage in tuned.stages if 'position.latency' in stage.keys)


def test_an_attitude_that_is_stamped_late_is_told_from_fixes_that_are_not(rov: Settings) -> None:
    changes = tune(log_of(rov, 80.0, late={'attitude': 0.3}), rov).changes()
    assert changes['attitude.latency'] == pytest.approx(0.3, abs=0.03)
    assert 'position.latency' not in changes


def test_finds_how_late_commands_are_stamped(surge: Settings) -> None:
    changes = tune(log_of(surge, 90.0, late={'thrusters': 0.3}), surge).changes()
    # a lag that is not there could make up for more of it
    lag = changes.get('thrusters.time_constant', 0.0)
    assert changes['thrusters.latency'] - lag == pytest.approx(  # type: ignore[operator]
        0.3, abs=0.03)
    assert 'position.latency' not in changes


def test_one_input_that_is_stamped_early_makes_no_late_commands(diver: Settings) -> None:
    assert tune(log_of(diver, 90.0, late={'depth': -0.4}), diver).changes() == {}


@pytest.mark.parametrize(('other', 'delay'), [(0.97, 0.35), (1.03, 0.0)])
def test_commands_are_late_only_where_no_dof_says_otherwise(
        surge: Settings, other: float, delay: float) -> None:
    """One under control may answer before its thrust; another, unclearly, may say no."""
    def answering(share: float) -> Any:
        random = np.random.default_rng(1).normal(0.0, 0.2, (FOLDS, 4))
        return SimpleNamespace(name='surge', fit=lambda commanded, pairs: SimpleNamespace(
            errors=np.array([np.exp(random - random.mean()) * share if early == (-0.35, 0.0)
                             else np.ones((FOLDS, 4)) for early in pairs])))

    found = tune_thrust([answering(0.3), answering(other)], None, surge,
                        lambda do, items: [do(k) for k in items], lambda share: None)
    assert found.pair == (-delay, 0.0)


def test_couplings_with_a_velocity_that_no_dof_is_identified_from() -> None:
    found = settings_from({
        **load(Path(__file__).parents[2] / 'config' / 'jhurov.yaml'), 'dofs': ['yaw'],
        'simulation.thruster_rate': 10.0, 'simulation.attitude_rate': 10.0,
        'yaw.couplings': ['v']})
    assert 'yaw' in tune(log_of(found, 90.0), found).errors


def test_a_term_that_a_log_can_do_without_stays(surge: Settings) -> None:
    """Another log may want it, and without it the intervals of the others are too narrow."""
    truth = surge.simulation.dofs['surge']
    without = replace(surge, simulation=replace(surge.simulation, dofs={
        'surge': replace(truth, linear_drag=0.0, bias=0.0)}))
    tuned = tune(log_of(without, 90.0), without)
    assert tuned.changes() == {}


def test_a_term_that_is_missing_is_added(surge: Settings) -> None:
    settings = replace(surge, dof={'surge': replace(surge.dof['surge'], terms=('alpha', 'gamma'))})
    tuned = tune(log_of(settings, 90.0), settings)
    assert 'beta' in tuned.changes()['surge.terms']  # type: ignore[operator]
    before, after = tuned.errors['surge']
    assert after < 0.8 * before


def test_says_what_was_gained(delayed: Tuned) -> None:
    before, after = delayed.errors['surge']
    assert after < 0.6 * before


def test_what_is_right_stays(surge: Settings) -> None:
    tuned = tune(log_of(surge, 90.0), surge)
    assert not tuned.changes().keys() & {
        'thrusters.delay', 'thrusters.time_constant', 'attitude.yaw_offset',
        'thrusters.deadband', 'thrusters.latency', 'position.latency', 'attitude.latency'}


@pytest.mark.parametrize(('duration', 'commands', 'why'), [
    (60.0, 1.0, r'59\.[0-9] s of steps, takes 60 s'), (120.0, 0.0, 'no thrust that changes')])
def test_a_log_that_tells_nothing(
        surge: Settings, duration: float, commands: float, why: str) -> None:
    truth = surge.simulation.dofs['surge']
    still = replace(surge.simulation, dofs={
        'surge': replace(truth, forces=tuple(commands * f for f in truth.forces))})
    settings = replace(surge, simulation=still)
    with pytest.raises(TuningError, match=why):
        tune(log_of(settings, duration), settings)


def test_a_motion_without_its_thrust_tells_nothing(surge: Settings) -> None:
    read = log_of(surge, 70.0, np.random.default_rng(1))
    with pytest.raises(TuningError, match='does not explain'):
        tune(read, surge)


def test_the_luckiest_of_many_gains_nothing() -> None:
    rng = np.random.default_rng(2)
    wins = [choose([1.0 + 0.1 * rng.standard_normal((1000, 8, 1))], 0).is_better
            for _ in range(100)]
    assert sum(wins) < 10


def test_a_clear_gain_is_taken() -> None:
    scores = 1.0 + 0.02 * np.random.default_rng(3).standard_normal((50, 8, 1))
    scores[7] -= 0.2
    choice = choose([scores], 0)
    assert choice.index == 7
    assert choice.is_better
    assert choice.gain == pytest.approx(0.2, abs=0.05)


def test_a_part_that_is_hard_to_predict_hides_no_gain() -> None:
    errors = np.tile(0.01 * (1.0 + 0.1 * np.random.default_rng(4).random((8, 4))), (2, 1, 1))
    errors[1] *= 0.95
    errors[:, 3, 1] *= 100.0
    errors[1, 3, 1] *= 1.1
    assert choose([errors], 0).is_better


def test_a_dof_counts_as_much_as_another_whatever_its_unit() -> None:
    errors = 1.0 + 0.02 * np.random.default_rng(5).random((2, 8, 4))
    slow = 1e-3 * errors * np.array([1.0, 0.8])[:, None, None]
    choice = choose([errors, slow], 0)
    assert choice.is_better
    assert choice.gain == pytest.approx(1.0 - 0.8 ** 0.5, abs=0.01)


def test_a_part_without_steps_counts_for_nothing() -> None:
    errors = 1.0 + 0.02 * np.random.default_rng(6).random((2, 8, 4))
    errors[1] *= 0.9
    errors[:, 2:6, 1:] = np.nan
    choice = choose([errors], 0)
    assert choice.is_better
    assert choice.gain == pytest.approx(0.1, abs=0.01)


def test_a_gain_at_the_cost_of_one_dof_is_contradicted() -> None:
    errors = 1.0 + 0.02 * np.random.default_rng(7).random((2, 8, 4))
    better, worse = (errors * np.array([1.0, x])[:, None, None] for x in (0.6, 1.1))
    choice = choose([better, worse], 0)
    assert choice.is_better
    assert choice.contradicted
    assert not choose([better, errors], 0).contradicted


def test_what_is_as_good_is_near_the_best() -> None:
    values = [0.0, -0.3, -0.2, -0.1, 0.1, 0.2, 1.6]
    scores = np.full((len(values), 8, 1), 0.05)
    scores[[1, 2, 5]] += 0.1  # clearly worse
    scores[6, 2:5, 0] = 1.0, 0.8, 0.3  # far worse, on few blocks
    choice = choose([scores], 0)
    assert 6 in choice.as_good  # its scatter is as large as its mean
    assert around_the_best(values, choice) == [-0.1, 0.0, 0.1]


def test_what_is_as_good_goes_on_behind_half_a_turn() -> None:
    degrees = [0, -180, -165, -150, 150, 165, 168, 172]
    scores = np.full((len(degrees), 8, 1), 0.05)
    scores[[0, 3, 4]] += 0.1
    choice = choose([scores], 0)
    assert degrees[choice.index] == -180
    found = around_the_best(np.radians(degrees).tolist(), choice)
    assert np.degrees(found) == pytest.approx([-195, -192, -188, -180, -165])
