"""The score of a model in water that moves, against a vehicle whose truth is known."""

from dataclasses import replace
from typing import NamedTuple

import pytest
from rovid_core.model.plant import lumped
from rovid_core.model.samples import Event, Sample
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.inputs import InputSettings, ThrusterSettings
from rovid_core.settings.run import (
    CurrentSettings,
    DofSettings,
    IdentifierSettings,
    Scales,
    Settings,
    SimulatedDof,
    SimulationSettings,
)
from rovid_core.simulation.sensors import simulate
from rovid_core.trials.offline import METHODS
from rovid_core.trials.score import Score, ScoreLog

CURRENT = (0.25, -0.1)
HORIZONTAL = ('surge', 'sway')
TRUTH = {
    'surge': SimulatedDof(20.0, 40.0, 8.0, 0.0, (25.0, 10.0), (0.05, 0.23)),
    'sway': SimulatedDof(30.0, 90.0, 12.0, 0.0, (25.0, 12.0), (0.07, 0.31)),
    'yaw': SimulatedDof(1.5, 2.0, 0.4, 0.0, (0.8, 0.5), (0.03, 0.17))}
KAPPAS = {'surge': ('vr', 1.5), 'sway': ('ur', -2.0 / 3.0), 'yaw': ('uv', -20.0 / 3.0)}
"""Of Kirchhoff: m_v / m_u, -m_u / m_v, (m_u - m_v) / I."""
MODELS = {dof: (*lumped(t.mass, t.quadratic_drag, t.linear_drag, 0.0), KAPPAS[dof][1])
          for dof, t in TRUTH.items()}

SENSORS = {'fixes': {}, 'a DVL over ground': {'velocity': InputSettings('/dvl', 't', 'f')}}


def configured(sensor: str, prior: float = 0.3) -> Settings:
    settings = Settings(
        dofs=tuple(TRUTH), dof={
            d: DofSettings(t.mass, t.quadratic_drag, t.linear_drag, couplings=(KAPPAS[d][0],))
            for d, t in TRUTH.items()},
        position=InputSettings('/fix', 't', 'f'), attitude=InputSettings('/imu', 't', 'f'),
        thrusters=ThrusterSettings(
            topics=('/thrust',), type='t', field='f', gain=(1.0, 1.0, 1.0),
            allocation=tuple((float(i == 0), float(i == 1), float(i == 5)) for i in range(6))),
        identifier=IdentifierSettings(method='aid'), current=CurrentSettings(prior),
        all_methods=True, simulation=SimulationSettings(
            dofs=TRUTH, coriolis=True, current=CURRENT, position_noise=0.0, attitude_noise=0.0,
            velocity_noise=0.0))
    return replace(settings, **SENSORS[sensor])


def played(settings: Settings) -> ScoreLog:
    """Return the log of a drive in a current of which nothing has been found."""
    log = ScoreLog(settings)
    stream = Stream(settings, scorer=log)
    for time, name, value in simulate(settings, 60.0, 1):
        stream.receive(Event(time, (Sample(name, value),)))
    stream.finish()
    return log


class Found(NamedTuple):
    """What a log says of the true model, and the masses that output error finds."""

    alone: dict[str, Score]
    together: dict[str, Score]
    masses: dict[str, float]


def found(log: ScoreLog) -> Found:
    settings = configured('fixes')
    scales = {d: replace(Scales.of(settings.dof[d]), couplings=(KAPPAS[d][0],))
              for d in HORIZONTAL}
    return Found(
        {d: log.score(d, MODELS[d]) for d in HORIZONTAL}, log.score_joint(MODELS),
        {d: 1.0 / METHODS['output_error'](log.records(d), scales[d], settings).parameters[0]
         for d in HORIZONTAL})


@pytest.fixture(scope='module', params=SENSORS)
def logs(request: pytest.FixtureRequest) -> tuple[Found, Found]:
    """Return what a log says before its current is known, and then."""
    log = played(configured(request.param))
    still = found(log)
    log.add_current(0, *CURRENT)
    return still, found(log)


@pytest.mark.long
def test_the_true_model_predicts_the_velocity_over_ground(logs: tuple[Found, Found]) -> None:
    still, known = logs
    for dof in HORIZONTAL:
        assert known.alone[dof].fit > 0.985, dof
        assert still.alone[dof].fit < 0.7, dof


@pytest.mark.long
def test_all_dofs_together_are_simulated_through_the_water(logs: tuple[Found, Found]) -> None:
    still, known = logs
    for dof in MODELS:
        assert known.together[dof].fit > 0.97, dof
        assert known.together[dof].mae < 0.5 * still.together[dof].mae, dof


@pytest.mark.long
def test_offline_methods_find_the_vehicle_through_the_water(logs: tuple[Found, Found]) -> None:
    still, known = logs
    for dof in HORIZONTAL:
        assert known.masses[dof] == pytest.approx(TRUTH[dof].mass, rel=0.01), dof
        assert abs(still.masses[dof] / TRUTH[dof].mass - 1.0) > 0.05, dof


def test_a_tank_keeps_no_axes() -> None:
    log = played(configured('fixes', prior=0.0))
    before = log.score('surge', MODELS['surge'])
    log.add_current(0, *CURRENT)
    assert log.score('surge', MODELS['surge']) == before
