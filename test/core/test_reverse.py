"""Weaker thrust and other drag in reverse as parameters of a DOF."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
import json
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import get_typestore, Stores
from rovid_core.identify.ekf.planar.filter_with_current import PlanarFilter
from rovid_core.identify.ekf.planar.layout import Row
from rovid_core.identify.ekf.single.delayed_force import DelayedForce
from rovid_core.identify.ekf.single.linearised_filter import LinearisedFilter
from rovid_core.identify.estimate import Estimate
from rovid_core.model.dofs import OWN
from rovid_core.model.plant import advance, midpoint_trajectory, sensitivities, trajectory
from rovid_core.model.samples import Event, PlanarPiece, Sample
from rovid_core.model.thrusters import Thrusters
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import (
    CurrentSettings,
    DofSettings,
    IdentifierSettings,
    InputSettings,
    Scales,
    Settings,
    SimulatedDof,
    SimulationSettings,
    ThrusterSettings,
)
from rovid_core.simulation.sensors import simulate
from rovid_core.trials.joint_simulation import ForceSegment, JointModel
from rovid_core.trials.offline import METHODS
from rovid_core.trials.score import ScoreLog
from rovid_core.trials.tuning.log import TuningLog
from rovid_core.trials.tuning.reading import reading_settings
from rovid_core.trials.tuning.tune import tune
from rovid_ros.model import Model
from rovid_ros.results.documents import dofs_document, read_estimates
from rovid_ros.results.outputs import ARRAY_TYPE, DIAGNOSTIC_TYPE, Outputs

pytestmark = pytest.mark.long

MASS, DRAG, ASTERN, WEAKER = 20.0, 40.0, 1.5, 0.7
KAPPAS = {'reverse_thrust': (WEAKER - 1.0) / MASS, 'reverse_drag': (1.0 - ASTERN) * DRAG / MASS}


def vehicle(*couplings: str, method: str = 'ekf', prior: float = 0.0) -> Settings:
    """Return one whose guess is off, with surge alone or in water that may move."""
    return Settings(
        dofs=('surge',), dof={'surge': DofSettings(
            15.0, 30.0, 6.0, typical_force=20.0, couplings=couplings)},
        position=InputSettings(topic='/position', type='t', field='f'),
        attitude=InputSettings(topic='/attitude', type='t', field='f'),
        thrusters=ThrusterSettings(
            topics=('/thrusters',), type='t', field='f', gain=(1.0,), allocation=(
                (1.0,), *[(0.0,)] * 5)),
        identifier=IdentifierSettings(method=method), current=CurrentSettings(prior=prior),
        simulation=SimulationSettings(dofs={'surge': SimulatedDof(
            MASS, DRAG, 8.0, 1.0, (20.0, 12.0, 8.0), (0.03, 0.07, 0.19))}))


def true(settings: Settings, name: str) -> Settings:
    """Return the settings of a vehicle that has one of ``OWN``."""
    if name == 'reverse_thrust':
        return replace(settings, thrusters=replace(settings.thrusters, reverse=WEAKER))
    surge = replace(settings.simulation.dofs['surge'], reverse_drag=ASTERN)
    return replace(settings, simulation=replace(settings.simulation, dofs={'surge': surge}))


def identified(settings: Settings, name: str, duration: float) -> tuple[Estimate, ScoreLog]:
    scores = ScoreLog(settings)
    stream = Stream(settings, scorer=scores)
    for time, input, value in simulate(true(settings, name), duration, 1):
        stream.receive(Event(time, (Sample(input, value),)))
    stream.finish()
    assert stream.estimate is not None
    return stream.estimate, scores


@pytest.mark.parametrize('method', ['ekf', 'aid'])
@pytest.mark.parametrize('name', OWN)
def test_is_found_with_the_mass(name: str, method: str) -> None:
    # ``aid`` follows few directions quickly, and drag in reverse is hardly one of its own
    estimate, scores = identified(
        vehicle(name, method=method), name, 150.0 if method == 'ekf' else 400.0)
    surge, = estimate.dofs
    assert surge.status == 'converged', surge.judgement
    assert 1.0 / surge.parameters[0] == pytest.approx(MASS, rel=0.02)
    assert surge.couplings[0] == pytest.approx(KAPPAS[name], rel=0.05)
    if method == 'ekf':
        assert 0.0 < surge.couplings_std[0] < 0.03 * abs(KAPPAS[name])
    assert not [reason for reason in surge.judgement.reasons if 'reverse' in reason]
    # a simulator that knows it predicts as well, by the row itself and by all rows together
    model = (*surge.parameters, *surge.couplings)
    own, joint = scores.score('surge', model), scores.score_joint({'surge': model})['surge']
    assert own.fit > 0.93
    assert joint.fit == pytest.approx(own.fit, abs=2e-3)
    assert scores.score('surge', surge.parameters).fit < own.fit - 0.05


@pytest.mark.parametrize('ahead', [True, False])
def test_what_is_found_of_the_thrusters_is_in_every_result(ahead: bool, tmp_path: Path) -> None:
    """The propellers may be mounted the other way about: then forward thrust is the weaker one."""
    settings = vehicle()
    if not ahead:
        settings = replace(settings, thrusters=replace(
            settings.thrusters, allocation=((-1.0,), *[(0.0,)] * 5)))
    estimate, scores = identified(settings, 'reverse_thrust', 150.0)
    surge, = estimate.dofs
    assert surge.status == 'converged', surge.judgement
    assert 1.0 / surge.parameters[0] == pytest.approx(MASS, rel=0.02)
    weaker = WEAKER if ahead else 1.0 / WEAKER
    assert surge.thrusters == (0.0, 0.0, pytest.approx(weaker, rel=0.02), 0.0, False, 0.0)
    assert ('reverse thrust' if ahead else 'forward thrust') in ' '.join(surge.reasons)
    # scores of the row by itself are taken with it
    score = scores.score('surge', surge.parameters, surge.delay, surge.thrusters)
    assert score.fit > 0.93
    assert scores.score('surge', surge.parameters, surge.delay).fit < score.fit - 0.05
    drawn = scores.predicted('surge', surge.parameters, surge.delay, surge.thrusters)
    assert drawn != scores.predicted('surge', surge.parameters, surge.delay)
    # it is in the JSON, which comes back
    path = tmp_path / 'out.json'
    document = dofs_document(settings, estimate)
    path.write_text(json.dumps({'dofs': document}))
    assert document['surge']['thrusters']['reverse'] == surge.thrusters.reverse
    assert read_estimates(path)[0].thrusters == surge.thrusters
    # and in the messages: a controller asks for more where there is less
    messages = {one.topic: one for one in Outputs(settings).messages(estimate)}
    types = get_typestore(Stores.LATEST)
    model = Model.from_message(types.deserialize_cdr(messages['rov/model'].cdr, ARRAY_TYPE))
    pushed = model.force('surge', -1.0 if ahead else 1.0, 0.0)
    assert abs(pushed) == pytest.approx(MASS / WEAKER, rel=0.1)
    told = types.deserialize_cdr(messages['rov/estimate'].cdr, DIAGNOSTIC_TYPE).status[0].values
    assert {one.key: one.value for one in told}['reverse'] == repr(surge.thrusters.reverse)


def test_what_is_lost_with_speed_counts_in_every_score() -> None:
    """Of a row by itself, and of all together."""
    estimate, scores = identified(vehicle('reverse_drag'), 'reverse_drag', 60.0)
    surge, = estimate.dofs
    model, fading = (*surge.parameters, *surge.couplings), Thrusters(loss=1.0)
    own = scores.score('surge', model, thrusters=fading)
    assert own.fit < scores.score('surge', model).fit - 0.02
    joint = scores.score_joint({'surge': model}, thrusters={'surge': fading})
    assert joint['surge'].fit == pytest.approx(own.fit, abs=2e-3)


@pytest.mark.parametrize('name', OWN)
def test_without_it_the_note_says_what_to_add(name: str) -> None:
    estimate, _ = identified(vehicle(), name, 150.0)
    said = ' '.join(estimate.dofs[0].judgement.reasons)
    assert name.replace('_', ' ') in said
    assert ('add couplings: [reverse_drag]' in said) == (name == 'reverse_drag')
    assert ('see thrusters.reverse' in said) == (name == 'reverse_thrust')


@pytest.mark.parametrize('name', OWN)
def test_output_error_finds_it(name: str) -> None:
    settings = vehicle(name, method='aid')
    _, scores = identified(settings, name, 150.0)
    fit = METHODS['output_error'](
        scores.records('surge'), Scales.of(settings.dof['surge']), settings)
    assert 1.0 / fit.parameters[0] == pytest.approx(MASS, rel=0.01)
    assert fit.couplings[0] == pytest.approx(KAPPAS[name], rel=0.02)


def test_the_filter_of_surge_and_sway_finds_both_at_once() -> None:
    """In water that may move, while the vehicle goes along an arc."""
    settings = vehicle(*OWN, prior=0.2)
    arc = replace(settings, dofs=('surge', 'yaw'), dof={
        **settings.dof, 'yaw': DofSettings(1.5, 2.0, 0.4)})
    surge = replace(settings.simulation.dofs['surge'], reverse_drag=ASTERN)
    turning = SimulatedDof(1.5, 2.0, 0.4, 0.0, (0.8,), (0.01,))
    rows = ((1.0, 0.0), *[(0.0, 0.0)] * 4, (0.0, 1.0))
    arc = replace(
        arc, simulation=replace(settings.simulation, dofs={'surge': surge, 'yaw': turning}),
        thrusters=replace(settings.thrusters, gain=(1.0, 1.0), allocation=rows))
    estimate, _ = identified(arc, 'reverse_thrust', 200.0)
    found = estimate.dofs[0]
    assert found.status == 'converged', found.judgement
    assert 1.0 / found.parameters[0] == pytest.approx(MASS, rel=0.02)
    for kappa, std, name in zip(found.couplings, found.couplings_std, OWN):
        assert abs(kappa - KAPPAS[name]) < 3.0 * std < 0.3 * abs(KAPPAS[name])


def test_tuning_adds_the_drag_and_leaves_the_thrust_to_the_thrusters() -> None:
    settings = vehicle(method='aid')
    for name, key, value in (('reverse_drag', 'surge.couplings', ('reverse_drag',)),
                             ('reverse_thrust', 'thrusters.reverse', WEAKER)):
        log = TuningLog(reading_settings(settings))
        stream = Stream(reading_settings(settings), recorder=log, scorer=log)
        for time, input, sample in simulate(true(settings, name), 90.0, 1):
            stream.receive(Event(time, (Sample(input, sample),)))
        stream.finish()
        changes = tune(lambda _, log=log: log, settings).changes()
        assert list(changes) == [key]
        assert changes[key] == value or changes[key] == pytest.approx(value, abs=0.03)


# --- what all of it is made of


THETA = (0.5, -0.5, -0.2, 0.01, -0.15, -0.2, 0.04)  # alpha to delta, those of ``OWN``, delay


def held(count: int) -> Iterator[tuple[DelayedForce, float, float]]:
    """Commands that jump within a step, forwards and backwards."""
    random, force = np.random.default_rng(3), DelayedForce()
    force.add([(0.1, 0.0)] * 3, held=True)
    for k in range(count):
        force.add([(0.04, float(random.normal(-0.3))), (0.06, float(random.normal(-0.3)))],
                  held=True)
        yield force, (k + 2) * 0.1, (k + 3) * 0.1


@pytest.mark.parametrize('i', range(len(THETA) - 1))
def test_sensitivities_of_the_filter_are_derivatives(i: int) -> None:
    ends, small = [], 1e-5
    for sign in (-1.0, 0.0, 1.0):
        theta = [x + sign * small * (k == i) for k, x in enumerate(THETA)]
        filter = LinearisedFilter(theta, [1.0] * 7, 0.0, own=(4, 5))
        for force, start, end in held(40):
            filter.move(force, start, end, (0.0, 0.0))
        ends.append((filter.motion[:2], [row[i] for row in filter.sensitivities[:2]]))
    assert ends[1][0][1] < -0.1  # it goes backwards
    for k in range(2):
        derivative = (ends[2][0][k] - ends[0][0][k]) / (2.0 * small)
        assert ends[1][1][k] == pytest.approx(derivative, rel=0.05, abs=0.01)


ROWS = (Row(0, 7, 0.5, -1, (), own=(4, 5)), Row(7, 14, 0.4, -1, (), own=(12, 11)))
BOTH = [*THETA, 0.6, -0.4, -0.1, -0.03, -0.2, -0.1, 0.03, 0.1, -0.05]


@pytest.mark.parametrize('i', [i for i in range(len(BOTH)) if i not in (6, 13)])
def test_sensitivities_of_the_filter_of_surge_and_sway_are_derivatives(i: int) -> None:
    ends, small = [], 1e-5
    for sign in (-1.0, 0.0, 1.0):
        theta = [x + sign * small * (k == i) for k, x in enumerate(BOTH)]
        filter = PlanarFilter(ROWS, theta, [0.0] * 16)
        for force, start, end in held(40):
            filter.move((force, force), start, end, [
                PlanarPiece(1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.2)], ((0.0, 0.0), (0.0, 0.0)), 0.0)
        ends.append((filter.motion[:4].tolist(), filter.sensitivities[:4, i].tolist()))
    assert max(ends[1][0][2:]) < -0.05  # it goes backwards
    derivative = [(b - a) / (2.0 * small) for a, b in zip(ends[0][0], ends[2][0])]
    size = max(map(abs, derivative))
    assert ends[1][1] == pytest.approx(derivative, rel=0.05, abs=0.02 * size)


def test_a_weaker_force_moves_as_weaker_thrusters_do() -> None:
    weaker = THETA[4] / THETA[0]
    theta = (*THETA[:5], 0.0, THETA[6])
    ends = []
    for known in (False, True):
        single = LinearisedFilter(
            theta if known else (*theta[:4], 0.0, *theta[5:]), [1.0] * 7, 0.0, own=(4, 5))
        both = [*(theta if known else (*theta[:4], 0.0, *theta[5:])), *BOTH[7:]]
        planar, force = PlanarFilter(ROWS, both, [0.0] * 16), DelayedForce()
        for push in np.random.default_rng(3).normal(-0.3, 1.0, 80).tolist():
            force.add([(0.04, push if known else push + weaker * min(push, 0.0))], held=True)
            start, end = force.end - 0.06, force.end - 0.02  # two commands in a step
            if start > 0.1:
                single.move(force, start, end, (0.0, 0.0))
                planar.move((force, force), start, end, [
                    PlanarPiece(1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)], ((0.0, 0.0),) * 2, 0.0)
        ends.append([*single.motion[:2], planar.motion[0], planar.motion[2]])
    assert ends[0] == pytest.approx(ends[1], rel=1e-9)


PLANT, REVERSE = (0.05, -2.0, -0.4, 0.02), -0.8


def test_trajectories_follow_the_law() -> None:
    dt, force = np.full(400, 0.05), np.random.default_rng(0).uniform(-60.0, 50.0, 400)
    fine = [0.3]
    for f in np.repeat(force, 50):
        fine.append(advance(PLANT, fine[-1], f, 0.001, REVERSE))
    expected = np.array(fine[::50])
    assert (expected < -0.2).any()
    assert trajectory(PLANT, 0.3, dt, force, REVERSE) == pytest.approx(expected, abs=1e-3)
    v = midpoint_trajectory(np.array(PLANT), 0.3, dt, force, REVERSE)
    assert v == pytest.approx(expected, abs=2e-3)
    w = 0.5 * (v[:-1] + v[1:])
    found = sensitivities(np.array(PLANT), v, dt, force,
                          np.array([np.minimum(w, 0.0) * np.abs(w)]), REVERSE)
    step = 1e-5
    for column, change, more in ((0, (step, 0.0, 0.0, 0.0), 0.0), (1, (0.0, step, 0.0, 0.0), 0.0),
                                 (4, (0.0, 0.0, 0.0, 0.0), step)):
        ahead, behind = (midpoint_trajectory(
            np.array(PLANT) + sign * np.array(change), 0.3, dt, force, REVERSE + sign * more)
            for sign in (1.0, -1.0))
        numeric = (ahead - behind) / (2.0 * step)
        assert found[:, column] == pytest.approx(numeric, rel=1e-3, abs=1e-3)


def test_rows_together_follow_the_law() -> None:
    force = np.random.default_rng(1).uniform(-60.0, 50.0, 50)
    expected, weaker = [0.3], 0.3 * PLANT[0]
    for f in force:
        push = f if f > 0.0 else (1.0 - weaker / PLANT[0]) * f
        for _ in range(100):
            expected.append(advance(PLANT, expected[-1], push, 0.001, REVERSE))
    model = JointModel(['surge'], [(*PLANT, REVERSE, -weaker)],
                       [('reverse_drag', 'reverse_thrust')])
    segments = [ForceSegment(0, begins=0.3), *[
        ForceSegment(100_000_000 * (k + 1), f, (9.0, 9.0)) for k, f in enumerate(force.tolist())]]
    found = [v for _, v in model.simulate([iter(segments)])]
    assert found == pytest.approx(expected[100::100], abs=1e-4)


def test_drag_never_pushes() -> None:
    """A fit may find more than there is; the law takes what is left of it as 0."""
    dt, force = np.full(50, 0.1), np.full(50, -10.0)
    free = trajectory((0.05, 0.0, -0.4, 0.0), -0.1, dt, force)
    assert trajectory((0.05, -2.0, -0.4, 0.0), -0.1, dt, force, 3.0) == pytest.approx(free)
