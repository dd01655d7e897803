"""A small vehicle that turns, or does not, in water that moves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
import math
from unittest.mock import patch

from rovid_core.model.dofs import Quaternion
from rovid_core.model.samples import Event, Sample
from rovid_core.settings.inputs import InputSettings, ThrusterSettings
from rovid_core.settings.run import (
    DofSettings,
    IdentifierSettings,
    Settings,
    SimulatedDof,
    SimulationSettings,
)
from rovid_core.simulation.coupled_plant import CoupledPlant
from rovid_core.simulation.profiles import Profile, Sinusoid, Steps
from rovid_core.simulation.sensors import simulate
from rovid_core.velocity.attitude_history import from_yaw, product, rotate, rotate_back

CURRENT = (0.15, -0.1)
TRUTH = {'surge': SimulatedDof(17.6, 18.2, 4.0), 'sway': SimulatedDof(24.2, 21.7, 6.2),
         'yaw': SimulatedDof(0.5, 1.6, 0.1)}
STIFF = {**TRUTH, 'yaw': SimulatedDof(500.0, 1e5, 1e4)}
"""One that keeps its heading."""

PUSHES: Profile = {
    'surge': (Steps((9.6, 6.0, 10.8, 3.6, -3.6), 5.0), Sinusoid(3.6, 0.13)),
    'sway': (Steps((0.0, 8.4, -4.8, 0.0, -9.6, 4.8), 4.0), Sinusoid(2.4, 0.17)),
    'yaw': (Steps((0.0, 0.48, 0.0, 0.0), 4.0), Sinusoid(0.12, 0.11))}


APART: Profile = {
    'surge': (Steps((9.0, -9.0, 0.0, 0.0, 0.0, 0.0), 10.0),),
    'sway': (Steps((0.0, 0.0, 8.0, -8.0, 0.0, 0.0), 10.0),),
    'yaw': (Steps((0.0, 0.0, 0.0, 0.0, 1.0, -1.0), 10.0),)}
"""One axis after the other."""


@dataclass(frozen=True)
class Run:
    """A vehicle and its sensors."""

    stiff: bool = False
    input: str = 'position'
    rate: float = 10.0  # [Hz]
    noise: float = 0.005  # [m] or [m/s]
    duration: float = 100.0  # [s]
    pull: tuple[float, float] = (0.0, 0.0)  # of a tether, in the world [N]
    weak: tuple[float, float] = (math.inf, 1.0)  # from when [s] thrust is how much of itself
    runs_down: float = 0.0  # [1/s] share of the thrust at the beginning that is lost per time
    lag: float = 0.0  # [s] of the thrusters of surge and sway
    turns: bool = False  # whether it is their turns that lag
    reverse: float = 1.0  # thrust of surge backwards, relative to one forwards
    apart: bool = False  # one axis is driven after the other
    current: tuple[float, float] = CURRENT  # of the water [m/s]


@lru_cache(maxsize=4)
def events(run: Run) -> tuple[Event, ...]:
    """Return what its sensors say."""
    pushes = {**PUSHES, 'yaw': ()} if run.stiff else APART if run.apart else PUSHES
    with patch.object(CoupledPlant, 'advance', _advanced(run)):
        return tuple([Event(time, (Sample(name, value),)) for time, name, value in simulate(
            settings(run), run.duration, 0, pushes)])


def _advanced(run: Run) -> Callable[..., list[float]]:
    """Return how the plant goes on with a tether, and thrust that is not what is asked for."""
    advance, (since, factor), now = CoupledPlant.advance, run.weak, 0.0
    lagged = [0.0, 0.0]

    def advanced(plant: CoupledPlant, attitude: Quaternion, forces: Sequence[float],
                 dt: float) -> list[float]:
        nonlocal now
        now += dt
        x, y, _ = rotate_back(attitude, (*run.pull, 0.0))
        surge, sway, *rest = forces
        left = (factor if now > since else 1.0) * (1.0 - run.runs_down * now)
        surge, sway = left * surge, left * sway
        if surge < 0.0:
            surge *= run.reverse
        if run.lag:
            for k, force in enumerate((surge, sway)):
                asked = math.copysign(math.sqrt(abs(force)), force) if run.turns else force
                lagged[k] -= math.expm1(-dt / run.lag) * (asked - lagged[k])
            surge, sway = [x * abs(x) if run.turns else x for x in lagged]
        return advance(plant, attitude, [surge + x, sway + y, *rest], dt)

    return advanced


def with_headings_off(run: Run, degrees: float) -> tuple[Event, ...]:
    """Return what the sensors of a run say whose attitudes are turned by an angle."""
    turn = from_yaw(math.radians(degrees))
    return tuple([
        event.replaced(samples=(Sample('attitude', product(turn, event.samples[0].value)),))
        if event.samples[0].input == 'attitude' else event for event in events(run)])


def with_fixes_late(run: Run, late: float) -> tuple[Event, ...]:
    """Return what the sensors of a run say whose fixes are stamped late [s]."""
    return tuple(sorted([
        event.replaced(time=event.time + round(late * 1e9))
        if event.samples[0].input == 'position' else event for event in events(run)],
        key=lambda event: event.time))


def with_lever_arm(run: Run, ahead: float, to_port: float) -> tuple[Event, ...]:
    """Return what the sensors of a run say whose fixes are those of another place in the body."""
    attitude, found = from_yaw(0.0), []
    for event in events(run):
        sample = event.samples[0]
        if sample.input == 'attitude':
            attitude = sample.value
        elif sample.input == 'position':
            arm = rotate(attitude, (ahead, to_port, 0.0))
            event = event.replaced(samples=(Sample(
                'position', tuple([x + y for x, y in zip(sample.value, arm)])),))
        found.append(event)
    return tuple(found)


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
            dofs=truth, coriolis=True, current=run.current, position_rate=run.rate,
            position_noise=run.noise, velocity_rate=run.rate, velocity_noise=run.noise)),
        **{'position': InputSettings(), run.input: used})


def away(current: tuple[float, float]) -> float:
    """Return how far an estimate is from the current [m/s]."""
    return math.dist(current, CURRENT)
