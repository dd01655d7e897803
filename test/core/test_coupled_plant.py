"""The simulated vehicle whose degrees of freedom act on each other, against mechanics."""

from collections.abc import Callable
from dataclasses import replace
import math

import numpy as np
from numpy.testing import assert_allclose
import pytest
from rovid_core.model.dofs import DOFS
from rovid_core.settings.inputs import InputSettings, ThrusterSettings
from rovid_core.settings.run import (
    DofSettings,
    Settings,
    SettingsError,
    SimulatedDof,
    SimulationSettings,
)
from rovid_core.simulation.coupled_plant import CoupledPlant
from rovid_core.simulation.sensors import simulate
from rovid_core.thrust.thruster_curve import thruster_model
from rovid_core.velocity.attitude_history import from_yaw, product, rotate

LEVEL = (0.0, 0.0, 0.0, 1.0)

PLANAR = {'surge': SimulatedDof(520.0), 'sway': SimulatedDof(620.0), 'yaw': SimulatedDof(110.0)}


def matrix() -> tuple[float, ...]:
    mass = np.zeros((6, 6))
    mass[np.ix_([0, 1, 5], [0, 1, 5])] = [[520, -20, -5], [-20, 620, -40], [-5, -40, 110]]
    return tuple(mass.ravel().tolist())


def configured(simulation: SimulationSettings) -> Settings:
    dofs = tuple(simulation.dofs)
    return Settings(
        dofs=dofs, dof={d: DofSettings(mass=simulation.dofs[d].mass) for d in dofs},
        position=InputSettings(topic='/position', type='t', field='f'),
        attitude=InputSettings(topic='/attitude', type='t', field='f'),
        reference=InputSettings(topic='/truth', type='t', field='f'),
        thrusters=ThrusterSettings(
            topics=('/thrusters',), type='t', field='f', gain=(1.0,) * 6,
            allocation=tuple(tuple(float(i == j) for j in range(6)) for i in range(6))),
        simulation=simulation)


def plant(simulation: SimulationSettings) -> CoupledPlant:
    return CoupledPlant(configured(simulation), np.random.default_rng(1))


def last(settings: Settings, name: str, duration: float) -> tuple[float, ...]:
    return [value for _, input, value in simulate(settings, duration, 1) if input == name][-1]


def test_coriolis_does_no_work_and_keeps_the_momentum_in_the_world() -> None:
    """Kirchhoff's equations of a body in an ideal fluid at rest."""
    vehicle = plant(SimulationSettings(dofs=PLANAR, coriolis=True, mass_matrix=matrix()))
    mass = np.array(matrix()).reshape(6, 6)
    vehicle.velocity = [0.7, -0.3, 0.0, 0.0, 0.0, 0.5]
    attitude = LEVEL

    def energy() -> float:
        return float(np.array(vehicle.velocity) @ mass @ vehicle.velocity)

    def momentum() -> tuple[float, float, float]:
        x, y, z = (mass @ vehicle.velocity)[:3]
        return rotate(attitude, (x, y, z))

    before = energy(), momentum()
    for _ in range(2000):
        mean = vehicle.advance(attitude, (0.0, 0.0, 0.0), 0.005)
        attitude = product(attitude, from_yaw(mean[5] * 0.005))
    assert abs(vehicle.velocity[0] - 0.7) > 0.1  # it did turn
    assert energy() == pytest.approx(before[0], rel=1e-9)
    assert_allclose(momentum(), before[1], atol=1e-2)


def test_without_couplings_it_is_the_vehicle_of_the_identifiers() -> None:
    dofs = {'surge': SimulatedDof(290.0, 290.0, 43.5, 2.9, (150.0,), (0.05,)),
            'yaw': SimulatedDof(90.0, 70.0, 13.5, 0.5, (20.0,), (0.07,))}
    alone = configured(SimulationSettings(dofs=dofs))
    mass = np.diag([290.0, 0.0, 0.0, 0.0, 0.0, 90.0])
    coupled = configured(SimulationSettings(dofs=dofs, mass_matrix=tuple(mass.ravel().tolist())))
    assert_allclose(last(coupled, 'reference', 60.0), last(alone, 'reference', 60.0), atol=1e-9)


def test_a_vehicle_without_thrust_drifts_with_the_water() -> None:
    dofs = {d: SimulatedDof(10.0, 40.0, 5.0) for d in ('surge', 'sway')}
    x, y, _ = last(configured(SimulationSettings(dofs=dofs, current=(0.2, -0.1))), 'position', 30)
    assert_allclose((x, y), (6.0, -3.0), atol=0.05)


@pytest.mark.parametrize(('change', 'end'), [
    # after a whole turn, or tide, it is back; after a quarter it is at the middle of its circle,
    # which has a radius of 0.2 m/s T / 2 pi
    ({'current_turn': 100.0}, lambda r: (r, r)), ({'current_tide': 100.0}, lambda r: (r, 0.0))])
def test_the_water_turns_and_has_tides(
        change: dict[str, float], end: Callable[[float], tuple[float, float]]) -> None:
    dofs = {d: SimulatedDof(10.0, 40.0, 50.0) for d in ('surge', 'sway')}
    settings = configured(SimulationSettings(dofs=dofs, current=(0.2, 0.0), **change))
    fixes = [value[:2] for _, input, value in simulate(settings, 100.1, 1) if input == 'position']
    assert_allclose(fixes[250], end(20.0 / (2.0 * math.pi)), atol=0.05)
    assert_allclose(fixes[1000], (0.0, 0.0), atol=0.05)


def test_a_vehicle_that_is_pushed_sideways_is_measured_over_ground() -> None:
    dofs = {'surge': SimulatedDof(10.0, 40.0, 5.0), 'sway': SimulatedDof(10.0, 40.0, 5.0)}
    truth = last(configured(SimulationSettings(dofs=dofs, current=(0.2, -0.1))), 'reference', 10)
    assert_allclose(truth[:2], (0.2, -0.1), atol=1e-12)


@pytest.mark.parametrize(('lock', 'measured'), [('ground', 0.2), ('water', 0.0)])
def test_a_dvl_measures_what_it_is_locked_to(lock: str, measured: float) -> None:
    dofs = {d: SimulatedDof(10.0, 40.0, 5.0) for d in ('surge', 'sway')}
    settings = replace(
        configured(SimulationSettings(dofs=dofs, current=(0.2, 0.0), velocity_noise=0.0)),
        velocity=InputSettings(topic='/dvl', type='t', field='f'), relative_to=lock)
    assert_allclose(last(settings, 'velocity', 1.0), (measured, 0.0, 0.0), atol=1e-12)


def test_roll_rights_itself_as_a_pendulum() -> None:
    vehicle = plant(SimulationSettings(dofs={'roll': SimulatedDof(2.0)}, righting=(8.0, 0.0)))
    attitude = (math.sin(0.005), 0.0, 0.0, math.cos(0.005))
    for _ in range(round(math.pi / 0.001)):  # a period of 2 pi / sqrt(8 / 2)
        rate = vehicle.advance(attitude, (0.0,), 0.001)[3]
        half = 0.5 * rate * 0.001
        attitude = product(attitude, (math.sin(half), 0.0, 0.0, math.cos(half)))
    assert 2.0 * math.asin(attitude[0]) == pytest.approx(0.01, rel=1e-2)


def test_drag_backwards_and_the_unknown_force() -> None:
    dofs = {'surge': SimulatedDof(10.0, 40.0, reverse_drag=1.5)}
    vehicle = plant(SimulationSettings(dofs=dofs))
    for force, terminal in ((10.0, 0.5), (-15.0, -0.5)):
        for _ in range(4000):
            vehicle.advance(LEVEL, (force,), 0.01)
        assert vehicle.velocity[0] == pytest.approx(terminal, rel=1e-6)

    vehicle = plant(SimulationSettings(dofs={'surge': SimulatedDof(1.0, disturbance=2.0)}))
    speeds = []
    for _ in range(60_000):
        before = vehicle.velocity[0]
        vehicle.advance(LEVEL, (0.0,), 0.05)
        speeds.append((vehicle.velocity[0] - before) / 0.05)
    assert np.std(speeds) == pytest.approx(2.0, rel=0.15)
    assert np.corrcoef(speeds[60:], speeds[:-60])[0, 1] == pytest.approx(math.exp(-1.0), abs=0.1)


def test_a_negative_command_may_push_less() -> None:
    settings = configured(SimulationSettings(dofs=PLANAR)).thrusters
    force = thruster_model(replace(settings, reverse=0.8, deadband=0.1))
    assert (force(2.0), force(-2.0), force(-0.05)) == (2.0, -1.6, 0.0)


@pytest.mark.parametrize('mass', [(1.0, 2.0), (*matrix()[:-1], -1.0),
                                  (1.0, 9.0, *matrix()[2:])])
def test_an_impossible_mass_matrix_is_named(mass: tuple[float, ...]) -> None:
    with pytest.raises(SettingsError, match='simulation.mass_matrix'):
        plant(SimulationSettings(dofs=PLANAR, mass_matrix=mass))


def test_all_dofs_are_known_to_it() -> None:
    assert plant(SimulationSettings(
        dofs={d: SimulatedDof(1.0) for d in DOFS})).dofs == DOFS
