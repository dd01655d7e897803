"""A small vehicle that turns, or does not, in water that moves."""

from dataclasses import dataclass, replace
from functools import lru_cache
import math

from rovid_core.model.samples import Event, Sample
from rovid_core.settings.inputs import InputSettings, ThrusterSettings
from rovid_core.settings.run import (
    DofSettings,
    IdentifierSettings,
    Settings,
    SimulatedDof,
    SimulationSettings,
)
from rovid_core.simulation.profiles import Profile, Sinusoid, Steps
from rovid_core.simulation.sensors import simulate

CURRENT = (0.15, -0.1)
TRUTH = {'surge': SimulatedDof(17.6, 18.2, 4.0), 'sway': SimulatedDof(24.2, 21.7, 6.2),
         'yaw': SimulatedDof(0.5, 1.6, 0.1)}
STIFF = {**TRUTH, 'yaw': SimulatedDof(500.0, 1e5, 1e4)}
"""One that keeps its heading."""

PUSHES: Profile = {
    'surge': (Steps((9.6, 6.0, 10.8, 3.6, -3.6), 5.0), Sinusoid(3.6, 0.13)),
    'sway': (Steps((0.0, 8.4, -4.8, 0.0, -9.6, 4.8), 4.0), Sinusoid(2.4, 0.17)),
    'yaw': (Steps((0.0, 0.48, 0.0, 0.0), 4.0), Sinusoid(0.12, 0.11))}


@dataclass(frozen=True)
class Run:
    """A vehicle and its sensors."""

    stiff: bool = False
    input: str = 'position'
    rate: float = 10.0  # [Hz]
    noise: float = 0.005  # [m] or [m/s]
    duration: float = 100.0  # [s]


@lru_cache(maxsize=4)
def events(run: Run) -> tuple[Event, ...]:
    """Return what its sensors say."""
    pushes = {**PUSHES, 'yaw': ()} if run.stiff else PUSHES
    return tuple([Event(time, (Sample(name, value),)) for time, name, value in simulate(
        settings(run), run.duration, 0, pushes)])


def settings(run: Run, dofs: tuple[str, ...] = ('surge', 'sway')) -> Settings:
    """Return the settings of a run whose guess is wrong by 1.5 to 2."""
    truth = STIFF if run.stiff else TRUTH
    couplings = {'surge': ('vr',), 'sway': ('ur',), 'yaw': ()}
    used = InputSettings(topic='/measured', type='t', field='f')
    return replace(Settings(
        dofs=dofs,
        dof={dof: DofSettings(1.5 * true.mass, true.quadratic_drag / 1.8, true.linear_drag / 2.0,
                              couplings=couplings[dof]) for dof, true in truth.items()},
        position=InputSettings(topic='/p', type='t', field='f'),
        attitude=InputSettings(topic='/attitude', type='t', field='f'),
        thrusters=ThrusterSettings(
            topics=('/thrusters',), type='t', field='f', gain=(1.0,) * 6,
            allocation=tuple(tuple(float(i == j) for j in range(6)) for i in range(6))),
        identifier=IdentifierSettings(method='ekf'),
        simulation=SimulationSettings(
            dofs=truth, coriolis=True, current=CURRENT, position_rate=run.rate,
            position_noise=run.noise, velocity_rate=run.rate, velocity_noise=run.noise)),
        **{'position': InputSettings(), run.input: used})


def away(current: tuple[float, float]) -> float:
    """Return how far an estimate is from the current [m/s]."""
    return math.dist(current, CURRENT)
