"""Regressors of couplings: measured from the other DOFs, in time, and as the plant has them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose
import pytest
from rovid_core.model.samples import Event, Sample, Step
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.inputs import InputSettings, ThrusterSettings
from rovid_core.settings.run import (
    DofSettings,
    IdentifierSettings,
    Settings,
    SettingsError,
    SimulatedDof,
    SimulationSettings,
)
from rovid_core.simulation.sensors import simulate

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
        identifier=IdentifierSettings(method='ekf'),
        simulation=SimulationSettings(dofs=TRUTH, coriolis=True, **rates))
    return replace(settings, **changes)


class Steps:
    """Keeps all steps of each DOF."""

    def __init__(self) -> None:
        self.steps: dict[str, list[Step]] = {d: [] for d in TRUTH}

    def begin_run(self, dof: str, time: int, velocity: float) -> None:
        pass

    def add_step(self, dof: str, span: tuple[int, int, int], step: Step) -> None:
        self.steps[dof].append(step)

    def add_reference(self, time: int, value: tuple[float, ...]) -> None:
        pass

    def set_cutoff(self, cutoff: float) -> None:
        pass


def events(settings: Settings, duration: float, without: str = '') -> Iterator[Event]:
    for time, name, value in simulate(settings, duration, 1):
        if name != without or time < 20e9:
            yield Event(time, (Sample(name, value),))


def steps_of(settings: Settings, duration: float = 120.0, without: str = ''
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
    steps, _ = steps_of(configured(**SENSORS[sensors]))
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


def test_the_parts_of_a_step_lie_in_one_interval_between_fixes_each() -> None:
    steps, _ = steps_of(configured(), 30.0)
    for one, other in zip(steps['surge'][:-1], steps['surge'][1:]):
        assert one.couplings[0][1] == other.couplings[0][0]


def test_a_row_waits_for_a_slower_sensor_and_gives_up_in_event_time() -> None:
    """Yaw steps with the attitude, at 20 Hz, and needs what the fixes give, at 10 Hz."""
    steps, stream = steps_of(configured(), 60.0)
    assert len(steps['yaw']) > 1150
    # the first attitudes come before the first fix
    assert stream.rejected.pop(('attitude', 'no_coupling')) <= 2
    assert not any(reason == 'no_coupling' for _, reason in stream.rejected)
    steps, stream = steps_of(configured(), 60.0, without='position')
    assert stream.rejected[('attitude', 'no_coupling')] > 700
    assert 350 < len(steps['yaw']) < 420


def test_without_couplings_nothing_waits() -> None:
    settings = configured()
    alone = replace(settings, dof={
        **settings.dof, 'yaw': replace(settings.dof['yaw'], couplings=())})
    steps, stream = steps_of(alone, 60.0, without='position')
    assert len(steps['yaw']) > 1150
    assert ('attitude', 'no_coupling') not in stream.rejected


def test_restoring_terms_are_those_of_the_attitude() -> None:
    truth = {'roll': SimulatedDof(2.0, 1.0, 0.5, 0.0, (1.0,), (0.1,))}
    settings = configured(
        dofs=('roll',), dof={'roll': DofSettings(mass=2.0, couplings=('sin_roll',))},
        simulation=replace(configured().simulation, dofs=truth, righting=(8.0, 0.0)))
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
])
def test_what_there_is_not_is_refused_by_its_key(
        dof: str, couplings: tuple[str, ...], changes: dict[str, object], says: str) -> None:
    settings = configured()
    with pytest.raises(SettingsError, match=f'{dof}.couplings.*{says}'):
        replace(settings, dof={
            **settings.dof, dof: replace(settings.dof[dof], couplings=couplings)}, **changes)
