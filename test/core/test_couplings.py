"""Regressors of couplings: measured from the other DOFs, in time, and as the plant has them."""

from collections.abc import Iterator
from dataclasses import replace
import json
import math
from typing import Any

import numpy as np
from numpy.testing import assert_allclose
import pytest
from rovid_core.identify.estimate import Estimate
from rovid_core.model.dofs import THRUSTS
from rovid_core.model.plant import lumped
from rovid_core.model.samples import Event, Sample, Step
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.inputs import InputSettings, ThrusterSettings
from rovid_core.settings.run import (
    CurrentSettings,
    DofSettings,
    IdentifierSettings,
    Scales,
    Settings,
    SettingsError,
    SimulatedDof,
    SimulationSettings,
)
from rovid_core.simulation.sensors import simulate
from rovid_core.trials.offline import METHODS
from rovid_core.trials.score import ScoreLog
from rovid_core.velocity.couplings import MeanVelocities

pytestmark = pytest.mark.long

TRUTH = {
    'surge': SimulatedDof(20.0, 40.0, 8.0, 0.0, (25.0,), (0.05,)),
    'sway': SimulatedDof(30.0, 90.0, 12.0, 0.0, (25.0,), (0.07,)),
    'yaw': SimulatedDof(1.5, 2.0, 0.4, 0.0, (0.8,), (0.03,)),
}
IDEAL = {'surge': ('vr', 30.0 / 20.0), 'sway': ('ur', -20.0 / 30.0), 'yaw': ('uv', -10.0 / 1.5)}
"""Kirchhoff's values of the couplings: m_v / m_u, -m_u / m_v, (m_u - m_v) / I."""


def configured(**changes: object) -> Settings:
    rates = dict.fromkeys(('position_noise', 'attitude_noise', 'velocity_noise',
                           'angular_velocity_noise'), 0.0)
    settings = Settings(
        dofs=tuple(TRUTH),
        dof={d: DofSettings(mass=t.mass, couplings=(IDEAL[d][0],)) for d, t in TRUTH.items()},
        position=InputSettings(topic='/position', type='t', field='f'),
        attitude=InputSettings(topic='/attitude', type='t', field='f'),
        thrusters=ThrusterSettings(
            topics=('/thrusters',), type='t', field='f', gain=(1.0,) * 6,
            allocation=tuple(tuple(float(i == j) for j in range(6)) for i in range(6))),
        # DOFs by themselves
        identifier=IdentifierSettings(method='ekf'), current=CurrentSettings(prior=0.0),
        simulation=SimulationSettings(dofs=TRUTH, coriolis=True, **rates))
    return replace(settings, **changes)


class Steps:
    """Keeps all steps of each DOF."""

    def __init__(self) -> None:
        self.steps: dict[str, list[Step]] = {d: [] for d in TRUTH}

    def begin_run(self, dof: str, time: int, velocity: float, axis: Any) -> None:
        pass

    def add_step(self, dof: str, span: tuple[int, int, int], step: Step, axes: Any) -> None:
        self.steps[dof].append(step)

    def begin_anew(self, dof: str) -> None:
        pass

    def add_commands(self, time: int, raw: tuple[float, ...]) -> None:
        pass

    def add_reference(self, time: int, value: tuple[float, ...]) -> None:
        pass

    def add_current(self, time: int, x: float, y: float) -> None:
        pass

    def set_cutoff(self, cutoff: float) -> None:
        pass


def events(settings: Settings, duration: float, without: str = '') -> Iterator[Event]:
    for time, name, value in simulate(settings, duration, 1):
        if name != without or time < 20e9:
            yield Event(time, (Sample(name, value),))


def quick(settings: Settings) -> Settings:
    """Return settings of the method that costs least: what is made of the sensors is the same."""
    return replace(settings, identifier=IdentifierSettings(method='aid'))


def steps_of(settings: Settings, duration: float, without: str = ''
             ) -> tuple[dict[str, list[Step]], Stream]:
    scorer = Steps()
    stream = Stream(settings, scorer=scorer)
    for event in events(settings, duration, without):
        stream.receive(event)
    stream.finish()
    return scorer.steps, stream


SENSORS = {
    'fixes and attitude': {},
    'a velocity and a turning sensor': {
        'velocity': InputSettings(topic='/dvl', type='t', field='f'),
        'angular_velocity': InputSettings(topic='/gyro', type='t', field='f')},
}


@pytest.mark.parametrize('sensors', SENSORS)
def test_with_them_the_coupled_plant_is_linear_in_what_is_measured(sensors: str) -> None:
    """Least squares on the filtered steps finds the masses, and Kirchhoff's couplings."""
    steps, _ = steps_of(quick(configured(**SENSORS[sensors])), 120.0)
    for dof, truth in TRUTH.items():
        taken = steps[dof][100:]
        assert len(taken) > 900
        phi, change = [], []
        for step in taken:
            v = step.velocity[1]
            phi.append([step.force[1], v * abs(v), v, 1.0, *step.filtered_couplings])
            change.append((step.velocity[2] - step.velocity[0]) / step.dt)
        alpha, *_, kappa = np.linalg.lstsq(np.array(phi), np.array(change), rcond=None)[0]
        assert alpha == pytest.approx(1.0 / truth.mass, rel=0.03), dof
        assert kappa == pytest.approx(IDEAL[dof][1], rel=0.05), dof
        without = np.linalg.lstsq(np.array(phi)[:, :4], np.array(change), rcond=None)[0]
        assert abs(without[0] * truth.mass - 1.0) > 0.03 or dof == 'yaw'


def test_a_gyro_says_how_fast_the_vehicle_turns_where_there_is_one() -> None:
    """An attitude with noise of a degree says it worse."""
    exact = configured()
    noisy = replace(exact, simulation=replace(exact.simulation, attitude_noise=0.02))
    gyro = replace(noisy, angular_velocity=InputSettings(topic='/gyro', type='t', field='f'))
    # how fast sway moves is measured with the same attitudes in both
    true, worse, better = [np.array([step.couplings[0][1] for step in steps_of(
        quick(settings), 60.0)[0]['surge'][-500:]]) for settings in (exact, noisy, gyro)]
    assert np.std(better - true) < 0.5 * np.std(worse - true)


def test_attitudes_stand_in_for_a_gyro_that_dies() -> None:
    """What it measures stops; surge and sway go on."""
    steps, _ = steps_of(quick(configured(
        angular_velocity=InputSettings(topic='/gyro', type='t', field='f'))), 60.0,
        without='angular_velocity')
    assert len(steps['yaw']) < 1010  # 20 s
    assert len(steps['surge']) > 570  # of 600


def test_a_gyro_and_the_fixes_do_not_wait_for_each_other() -> None:
    """Yaw, by the gyro at 50 Hz, waits for sway, by fixes at 10 Hz that wait for the gyro."""
    steps, stream = steps_of(quick(configured(
        angular_velocity=InputSettings(topic='/gyro', type='t', field='f'))), 60.0)
    assert len(steps['surge']) > 590 and len(steps['yaw']) > 2900
    assert sum(number for (_, reason), number in stream.rejected.items()
               if reason == 'no_coupling') <= 10  # before the first fixes


def test_without_a_gate_the_turns_are_filtered_as_well() -> None:
    with_gate, without = [
        steps_of(quick(configured(simulation=NOISY, gate=gate)), 30.0)[0] for gate in (8.0, 0.0)]
    assert [s.couplings for s in without['surge']] == [s.couplings for s in with_gate['surge']]


def test_the_parts_of_a_step_lie_in_one_interval_between_fixes_each() -> None:
    steps, _ = steps_of(quick(configured()), 30.0)
    for one, other in zip(steps['surge'][:-1], steps['surge'][1:]):
        assert one.couplings[0][1] == other.couplings[0][0]


def test_a_row_waits_for_a_slower_sensor_and_gives_up_in_event_time() -> None:
    """Yaw steps with the attitude, at 20 Hz, and needs what the fixes give, at 10 Hz."""
    steps, stream = steps_of(quick(configured()), 60.0)
    assert len(steps['yaw']) > 1150
    # the first attitudes come before the first fix
    assert stream.rejected.pop(('attitude', 'no_coupling')) <= 2
    assert not any(reason == 'no_coupling' for _, reason in stream.rejected)
    steps, stream = steps_of(quick(configured()), 60.0, without='position')
    assert stream.rejected[('attitude', 'no_coupling')] > 700
    assert 350 < len(steps['yaw']) < 420


def test_a_mean_does_not_go_on_over_an_interval_that_is_missing() -> None:
    means = MeanVelocities()
    means.memory = 1000
    means.add_mean(0, 10, (1.0, 0.0, 0.0))
    means.add_mean(10, 20, (3.0, 0.0, 0.0))
    assert (means.missing(5, 15), means.mean(5, 15)[0]) == ('', 2.0)
    means.add_mean(30, 40, (5.0, 0.0, 0.0))
    assert means.missing(15, 35) == 'no_coupling'
    assert means.missing(30, 40) == ''


def test_without_couplings_nothing_waits() -> None:
    settings = quick(configured())
    alone = replace(settings, dof={
        **settings.dof, 'yaw': replace(settings.dof['yaw'], couplings=())})
    steps, stream = steps_of(alone, 60.0, without='position')
    assert len(steps['yaw']) > 1150
    assert ('attitude', 'no_coupling') not in stream.rejected


def test_restoring_terms_are_those_of_the_attitude() -> None:
    truth = {'roll': SimulatedDof(2.0, 1.0, 0.5, 0.0, (1.0,), (0.1,))}
    settings = quick(configured(
        dofs=('roll',), dof={'roll': DofSettings(mass=2.0, couplings=('sin_roll',))},
        simulation=replace(configured().simulation, dofs=truth, righting=(8.0, 0.0))))
    scorer = Steps()
    scorer.steps['roll'] = []
    stream = Stream(settings, scorer=scorer)
    for event in events(settings, 60.0):
        stream.receive(event)
    taken = scorer.steps['roll'][100:]
    phi = np.array([[s.force[1], s.velocity[1] * abs(s.velocity[1]), s.velocity[1], 1.0,
                     *s.filtered_couplings] for s in taken])
    found = np.linalg.lstsq(
        phi, np.array([(s.velocity[2] - s.velocity[0]) / s.dt for s in taken]), rcond=None)[0]
    assert_allclose(found[[0, 4]], (0.5, -4.0), rtol=0.05)


@pytest.mark.parametrize('dof, couplings, changes, says', [
    ('surge', ('uv',), {}, "got 'uv', takes vr, wq"),
    ('surge', ('vr', 'vr'), {}, 'names one twice'),
    ('yaw', ('sway_thrust',), {'dofs': ('surge', 'yaw')}, 'sway_thrust needs sway in dofs'),
])
def test_what_there_is_not_is_refused_by_its_key(
        dof: str, couplings: tuple[str, ...], changes: dict[str, object], says: str) -> None:
    settings = configured()
    with pytest.raises(SettingsError, match=f'{dof}.couplings.*{says}'):
        replace(settings, dof={
            **settings.dof, dof: replace(settings.dof[dof], couplings=couplings)}, **changes)


def identified(settings: Settings, duration: float) -> tuple[Estimate, ScoreLog]:
    scores = ScoreLog(settings)
    stream = Stream(settings, scorer=scores)
    for event in events(settings, duration):
        stream.receive(event)
    stream.finish()
    assert stream.estimate is not None
    return stream.estimate, scores


NOISY = replace(
    configured().simulation, position_noise=0.005, attitude_noise=0.002)

WRONG = {'surge': (15.0, 30.0, 6.0), 'sway': (40.0, 60.0, 9.0), 'yaw': (2.0, 1.5, 0.3)}
"""Guesses of mass, quadratic and linear drag."""


def guessed(couplings: bool) -> Settings:
    return configured(simulation=NOISY, dof={
        d: DofSettings(*WRONG[d], couplings=(IDEAL[d][0],) if couplings else ()) for d in TRUTH})


def test_the_filter_finds_masses_and_couplings_of_a_vehicle_that_moves_in_all_axes() -> None:
    settings = guessed(couplings=True)
    estimate, scores = identified(settings, 120.0)
    for dof in estimate.dofs:
        assert dof.status == 'converged', dof.judgement
        assert 1.0 / dof.parameters[0] == pytest.approx(TRUTH[dof.dof].mass, rel=0.02)
        kappa, std = dof.couplings[0], dof.couplings_std[0]
        assert kappa == pytest.approx(IDEAL[dof.dof][1], rel=0.02)
        assert 0.0 < std < 0.02 * abs(kappa)
        assert abs(kappa - IDEAL[dof.dof][1]) < 4.0 * std
    joint = scores.score_joint({d.dof: (*d.parameters, *d.couplings) for d in estimate.dofs})
    for d in estimate.dofs:
        alone = scores.score(d.dof, (*d.parameters, *d.couplings)).fit
        assert alone > 0.93
        assert joint[d.dof].fit > alone - 0.01


@pytest.mark.parametrize(('rate', 'prior', 'sensors'), [
    (50.0, 0.0, 'fixes and attitude'), (50.0, 0.3, 'a velocity and a turning sensor'),
    (5.0, 0.0, 'a velocity and a turning sensor')])
def test_they_belong_to_the_span_of_a_measurement(rate: float, prior: float, sensors: str) -> None:
    """What comes fast is taken together, and between what comes slowly velocities are bent."""
    exact = replace(
        configured().simulation, position_rate=rate, attitude_rate=50.0, velocity_rate=rate,
        position_noise=0.001, attitude_noise=0.0003, velocity_noise=0.001,
        angular_velocity_noise=0.001)
    estimate, _ = identified(replace(
        guessed(couplings=True), simulation=exact, current=CurrentSettings(prior=prior),
        **SENSORS[sensors]), 120.0)
    for dof in estimate.dofs:
        assert 1.0 / dof.parameters[0] == pytest.approx(TRUTH[dof.dof].mass, rel=0.007)
        assert dof.couplings[0] == pytest.approx(IDEAL[dof.dof][1], rel=0.007)


def test_without_couplings_no_wrong_mass_is_said_to_have_converged() -> None:
    estimate, _ = identified(guessed(couplings=False), 100.0)
    off = {dof.dof: abs(1.0 / dof.parameters[0] / TRUTH[dof.dof].mass - 1.0)
           for dof in estimate.dofs}
    assert max(off.values()) > 0.5  # it is such a vehicle
    assert not [d.dof for d in estimate.dofs if d.status == 'converged' and off[d.dof] > 0.1]


ARM = 0.1
"""[m] By which the thrust of sway acts ahead of the centre of mass, which nobody has told."""


def with_an_arm(couplings: tuple[str, ...], prior: float = 0.0) -> Estimate:
    """Identify a vehicle whose sway thrust turns it, too."""
    settings = replace(guessed(couplings=True), current=CurrentSettings(prior=prior))
    settings = replace(settings, dof={**settings.dof, 'yaw': replace(
        settings.dof['yaw'], couplings=couplings)})
    rows = [list(row) for row in settings.thrusters.allocation]
    rows[5][1] = ARM
    true = replace(settings, thrusters=replace(
        settings.thrusters, allocation=tuple(map(tuple, rows))))
    stream = Stream(settings)
    for event in events(true, 120.0):
        stream.receive(event)
    stream.finish()
    assert stream.estimate is not None
    return stream.estimate


@pytest.mark.parametrize('prior', [0.0, 0.3])
def test_thrust_beside_the_centre_of_mass_is_named_and_found(prior: float) -> None:
    lacking = next(d for d in with_an_arm(('uv',), prior).dofs if d.dof == 'yaw')
    assert lacking.status != 'converged'
    assert abs(TRUTH['yaw'].mass * lacking.parameters[0] - 1.0) > 0.1
    assert 'follows sway thrust' in lacking.reasons[0]
    assert 'add couplings: [uv, sway_thrust]' in lacking.reasons[0]
    complete = next(d for d in with_an_arm(('uv', 'sway_thrust'), prior).dofs if d.dof == 'yaw')
    assert complete.status == 'converged'
    assert complete.parameters[0] == pytest.approx(1.0 / TRUTH['yaw'].mass, rel=0.02)
    (uv, arm), (_, std) = complete.couplings, complete.couplings_std
    assert uv == pytest.approx(IDEAL['yaw'][1], rel=0.05)
    assert arm == pytest.approx(ARM / TRUTH['yaw'].mass, rel=0.02)
    assert abs(arm - ARM / TRUTH['yaw'].mass) < 4.0 * std


def test_a_saved_state_goes_on_with_the_same_bits() -> None:
    settings = guessed(couplings=True)
    taken = list(events(settings, 50.0))
    at = len(taken) // 2
    whole, first, second = Stream(settings), Stream(settings), Stream(settings)
    for event in taken[:at]:
        whole.receive(event)
        first.receive(event)
    second.restore(json.loads(json.dumps(first.state())))
    assert first.estimate is not None
    before = {d.dof: d.couplings for d in first.estimate.dofs}
    assert before == {
        d: second.identifier(d).couplings for d in settings.dofs} and all(before['surge'])
    # both begin anew from the same measurement, and the saved one on another computer
    identifiers = [[stream.identifier(d) for d in settings.dofs] for stream in (first, second)]
    scorer = Steps()
    helper = Stream(settings, scorer=scorer)
    for event in taken[at:]:
        helper.receive(event)
    for dof, one, other in zip(settings.dofs, *identifiers):
        one.restart(0.1)
        other.restart(0.1)
        for step in scorer.steps[dof]:
            assert one.step(step) == other.step(step)
        assert json.dumps(one.state()) == json.dumps(other.state())
        assert one.couplings == other.couplings != before[dof]
        assert one.uncertainty.couplings_std == other.uncertainty.couplings_std


def test_a_state_of_other_couplings_is_refused() -> None:
    settings = configured()
    state = Stream(settings).state()
    Stream(settings).restore(state)
    for couplings in ((), ('wq',), ('vr', 'wq')):
        other = replace(settings, dof={
            **settings.dof, 'surge': replace(settings.dof['surge'], couplings=couplings)})
        with pytest.raises(ValueError, match='other terms of surge'):
            Stream(other).restore(state)


def true_models() -> dict[str, tuple[float, ...]]:
    return {d: (*lumped(t.mass, t.quadratic_drag, t.linear_drag, t.bias), IDEAL[d][1])
            for d, t in TRUTH.items()}


def score_log(settings: Settings, duration: float) -> ScoreLog:
    return identified(quick(settings), duration)[1]


@pytest.fixture(scope='module')
def scores() -> ScoreLog:
    """Return a log of the vehicle without noise, to score models on."""
    return score_log(configured(), 60.0)


def test_the_true_vehicle_predicts_all_of_its_motion_also_with_nothing_measured(
        scores: ScoreLog) -> None:
    models = true_models()
    joint = scores.score_joint(models)
    assert set(joint) == set(TRUTH)
    for dof in TRUTH:
        assert joint[dof].fit > 0.97
        assert scores.score(dof, models[dof]).fit > 0.96
        assert scores.score(dof, models[dof][:4]).fit < 0.8


def test_only_all_together_feels_the_mistakes_of_the_others(scores: ScoreLog) -> None:
    models = true_models()
    models['yaw'] = (2.0 * models['yaw'][0], *models['yaw'][1:])
    assert scores.score('surge', models['surge']).fit > 0.96
    assert scores.score_joint(models)['surge'].fit < 0.9


def test_of_dofs_that_are_not_simulated_the_measured_regressors_are_taken(
        scores: ScoreLog) -> None:
    models = true_models()
    models.pop('yaw')
    found = scores.score_joint(models)
    for dof in ('surge', 'sway'):  # vr and ur, with r as measured
        assert found[dof].fit == pytest.approx(scores.score(dof, models[dof]).fit, abs=1e-4)


def test_a_model_that_runs_away_has_no_fit(scores: ScoreLog) -> None:
    models = {d: (*m[:1], 0.0, 0.0, 0.0, 50.0) for d, m in true_models().items()}
    assert {s.fit for s in scores.score_joint(models).values()} == {-math.inf}


def test_a_score_of_all_together_needs_no_more_memory_than_a_block() -> None:
    settings = quick(configured())
    whole, parts = ScoreLog(settings), ScoreLog(settings, block=50)
    for scores in (whole, parts):
        stream = Stream(settings, scorer=scores)
        for event in events(settings, 30.0):
            stream.receive(event)
        stream.finish()
    models = true_models()
    expected = whole.score_joint(models)
    for dof, found in parts.score_joint(models).items():
        assert found.fit == pytest.approx(expected[dof].fit, abs=1e-12)


@pytest.mark.parametrize('sensors', SENSORS)
def test_output_error_finds_masses_and_couplings(sensors: str) -> None:
    settings = replace(guessed(couplings=True), **SENSORS[sensors])
    scores = score_log(settings, 80.0)
    for dof, truth in TRUTH.items():
        scales = Scales.of(settings.dof[dof])
        fit = METHODS['output_error'](scores.records(dof), scales, settings)
        assert 1.0 / fit.parameters[0] == pytest.approx(truth.mass, rel=0.03), dof
        assert fit.couplings[0] == pytest.approx(IDEAL[dof][1], rel=0.03)
        assert 0.0 < fit.couplings_std[0] < 0.03 * abs(fit.couplings[0])
        without = METHODS['output_error'](
            scores.records(dof), replace(scales, couplings=()), settings)
        assert without.couplings == ()
        assert abs(truth.mass * without.parameters[0] - 1.0) > 0.05
        quick = METHODS['least_squares'](scores.records(dof), scales, settings)
        assert quick.couplings == ()


def test_what_is_watched_is_what_would_be_configured_and_nothing_waits_for_it() -> None:
    with_all = configured()
    without = replace(with_all, dof={
        name: replace(dof, couplings=()) for name, dof in with_all.dof.items()})
    assert without.watched('surge') == ('vr', 'wq', 'cos_heading', 'sin_heading')
    assert with_all.watched('surge') == ('wq', 'cos_heading', 'sin_heading')
    as_configured, _ = steps_of(with_all, 30.0)
    as_watched, _ = steps_of(without, 30.0)
    for dof, (name, _) in IDEAL.items():
        column = without.watched(dof).index(name)
        both = [(step.couplings[0][0], other.watched[column])
                for step, other in zip(as_configured[dof][5:], as_watched[dof][5:])]
        measured, watched = np.array(both).T
        # yaw is measured more often than the velocities that it is watched with
        assert watched == pytest.approx(measured, abs=0.1 * np.ptp(measured)
                                        if dof == 'yaw' else 1e-12)
    # without positions for a while yaw goes on, and what is not known is 0
    lost, _ = steps_of(without, 30.0, without='position')
    assert len(lost['yaw']) == len(as_watched['yaw'])
    assert not any(x for x, name in zip(lost['yaw'][-1].watched, without.watched('yaw'))
                   if name not in THRUSTS)


VECTORED = ThrusterSettings(
    topics=('/thrusters',), type='t', field='f', gain=(1.0,) * 4,
    allocation=((0.7, 0.7, 0.7, 0.7), (0.7, -0.7, -0.7, 0.7), *[(0.0,) * 4] * 3,
                (0.2, -0.2, 0.2, -0.2)))


def asked(settings: Settings, duration: float, reverse: float, dead_band: float
          ) -> Iterator[Event]:
    """Yield the events of thrusters that are asked for more where they give less."""
    for event in events(settings, duration):
        sample, = event.samples
        if sample.input == 'thrusters':
            sample = sample.replaced(value=tuple([
                (x / reverse if x < 0.0 else x) + math.copysign(dead_band, x)
                for x in sample.value]))
        yield event.replaced(samples=(sample,))


@pytest.mark.parametrize('prior', [0.0, 0.3])  # DOFs by themselves, or surge and sway together
@pytest.mark.parametrize(('reverse', 'dead_band', 'said', 'shares'), [
    (1.0, 0.0, '', {}),
    (0.8, 0.0, 'the reverse thrust of each thruster: about ', dict.fromkeys(TRUTH, 0.8)),
    (1.0, 1.0, 'a dead band of each thruster, together of about ',
     {'surge': 2.8, 'sway': 2.8, 'yaw': 0.8})])
def test_what_thrusters_lack_that_drive_several_axes_is_told_of_each_of_them(
        prior: float, reverse: float, dead_band: float, said: str,
        shares: dict[str, float]) -> None:
    """No function of the force on one axis is what is missing."""
    settings = replace(guessed(couplings=True), thrusters=VECTORED,
                       current=CurrentSettings(prior=prior))
    assert settings.sharing == settings.dofs
    stream = Stream(settings)
    for event in asked(settings, 200.0, reverse, dead_band):
        stream.receive(event)
    stream.finish()
    assert stream.estimate is not None
    sizes = {}
    for dof in stream.estimate.dofs:
        low, high = 1.0 / np.array(dof.intervals['alpha'])[::-1]
        assert low < TRUTH[dof.dof].mass < high
        reasons = '; '.join(dof.judgement.reasons)
        if not said:
            assert dof.status == 'converged'
            assert reasons in (
                '', 'the model does not explain all of the motion: the intervals are wider')
        elif said in reasons:
            sizes[dof.dof] = float(reasons.partition(said)[2].split()[0])
    assert sizes == pytest.approx({dof: shares[dof] for dof in sizes}, rel=0.3)
    assert len(sizes) > 1 or not said


@pytest.mark.parametrize('sensors', SENSORS)
def test_a_step_says_what_each_thruster_did(sensors: str) -> None:
    """Over each piece in which the force is held, or over both parts, where it is not."""
    held = replace(guessed(couplings=False), thrusters=VECTORED, **SENSORS[sensors])
    lagged = replace(held, thrusters=replace(VECTORED, time_constant=0.01))
    sums: dict[str, list[Any]] = {dof: [] for dof in TRUTH}
    for settings in (held, lagged):
        for dof, steps in steps_of(settings, 20.0)[0].items():
            assert {bool(step.pieces) for step in steps} == {settings is held}
            for step in steps:
                assert len(step.each) == (len(step.pieces) or 2)
            sums[dof].append(sum(
                length * np.array(each) for step in steps for length, each in zip(
                    [length for length, _ in step.pieces]
                    or (step.parts if step.interval else (step.dt, 0.0)), step.each)))
    for one, other in sums.values():
        assert one == pytest.approx(other, abs=0.1)
        assert abs(one[0]) > 0.5 < one[2]
    plain = replace(held, identifier=IdentifierSettings(method='aid'))
    assert not plain.sharing
    assert {step.each for step in steps_of(plain, 5.0)[0]['surge']} == {()}
