"""A wrong key is named from the data, and a right configuration is not accused."""

from collections.abc import Callable, Collection
from dataclasses import replace
from itertools import product
import math
from pathlib import Path

import numpy as np
import pytest
from rovid_core.inputs.configuration_check import (
    BlockMeans,
    ConfigurationCheck,
    log_likelihood,
)
from rovid_core.model.dofs import DOFS
from rovid_core.model.samples import Event, Motion, Sample
from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import (
    DofSettings,
    IdentifierSettings,
    InputSettings,
    Settings,
    ThrusterSettings,
)
from rovid_core.simulation.sensors import simulate
from rovid_core.thrust.thruster_curve import thruster_models
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

TICK = 100_000_000  # [ns]
DURATION = 180.0  # [s]
AXES = ('surge', 'sway', 'heave', 'yaw')
MASS = {'surge': 20.0, 'sway': 26.0, 'heave': 34.0, 'yaw': 0.6}
DRAG = {'surge': 90.0, 'sway': 140.0, 'heave': 160.0, 'yaw': 1.5}
FORCE = {'surge': 25.0, 'sway': 25.0, 'heave': 30.0, 'yaw': 1.5}
# four level thrusters at 45 degrees, and one upright
ALLOCATION = np.zeros((6, 5))
ALLOCATION[0, :4] = -0.7, -0.7, 0.7, 0.7
ALLOCATION[1, :4] = -0.7, 0.7, -0.7, 0.7
ALLOCATION[2, 4] = 1.0
ALLOCATION[5, :4] = -0.2, 0.2, 0.2, -0.2

Drive = tuple[np.ndarray, np.ndarray, np.ndarray]


def drive(seed: int, axes: Collection[str] = AXES) -> Drive:
    """
    Return thruster forces, headings and world velocities of a vehicle with couplings.

    It is driven along some axes, and hardly pushed along the others.
    """
    random = np.random.default_rng(seed)
    n = round(DURATION * 1e9 / TICK)
    t = np.arange(n) * TICK * 1e-9
    pushed = ALLOCATION[[DOFS.index(a) for a in AXES]]
    wanted = np.array([FORCE[a] * np.sin(2 * np.pi * np.cumsum(
        random.uniform(0.03, 0.15, 1 + n // 80).repeat(80)[:n]) * TICK * 1e-9 + random.uniform(
            0.0, 6.0)) * (1.0 if a in axes else 0.01) for a in AXES])
    commands = np.linalg.pinv(pushed) @ wanted
    v, heading = np.zeros(4), random.uniform(-3.0, 3.0)
    headings, world = np.empty(n), np.empty((n, 4))
    for k in range(len(t)):
        force = 0.9 * pushed @ commands[:, k] + random.normal(0.0, 1.0, 4) * [1.0, 1.0, 1.0, 0.05]
        force[0] += MASS['sway'] * v[1] * v[3]
        force[1] -= MASS['surge'] * v[0] * v[3]
        drag = np.array([DRAG[a] for a in AXES]) * abs(v) * v
        v = v + (force - drag) / np.array([MASS[a] for a in AXES]) * TICK * 1e-9
        heading += v[3] * TICK * 1e-9
        c, s = math.cos(heading), math.sin(heading)
        headings[k] = heading
        world[k] = c * v[0] - s * v[1], s * v[0] + c * v[1], v[2], v[3]
    # the noise of fixes, in velocities
    world[:, :3] += np.diff(random.normal(0.0, 0.005, (n + 1, 3)), axis=0) / (TICK * 1e-9)
    return commands.T, headings, world


def settings_of(allocation: np.ndarray, depth: bool = False) -> Settings:
    return Settings(
        dofs=AXES, dof={a: DofSettings(MASS[a]) for a in AXES},
        position=InputSettings('/p'), attitude=InputSettings('/a'),
        depth=InputSettings('/d') if depth else InputSettings(),
        thrusters=ThrusterSettings(
            ('/t',), gain=(1.0,) * 5, allocation=tuple(map(tuple, allocation.tolist()))))


def warnings(data: Drive, allocation: np.ndarray = ALLOCATION, *, depth: bool = False,
             heading: Callable[[float], float] = float, flipped: tuple[int, ...] = (),
             late: float = 0.0, settings: Settings | None = None,
             lost: Callable[[int], bool] = lambda k: False) -> list[str]:
    """Return what is told of a drive; ``flipped`` are world z or the vehicle's y."""
    commands, headings, world = data
    told: list[str] = []
    settings = settings or settings_of(allocation, depth)
    check = ConfigurationCheck(settings, thruster_models(settings.thrusters), told.append)
    for k, (command, true, (x, y, z, turned)) in enumerate(zip(commands, headings, world)):
        if lost(k):
            continue
        start, end = k * TICK, (k + 1) * TICK
        seen = heading(true)
        c, s = math.cos(seen), math.sin(seen)
        u, v = c * x + s * y, c * y - s * x
        rate = turned * (heading(true + 1e-6) - seen) / 1e-6
        if 1 in flipped:
            v, rate = -v, -rate
        if 2 in flipped:
            z = -z
        check.add_commands(start + round(late * 1e9), command.tolist())
        for input, body in (('position', (u, v, z)), ('attitude', (0.0, 0.0, rate)),
                            *([('depth', (u, v, z))] if depth else [])):
            check.add_motion(input, Motion(start, end, (start + end) // 2, (), body=body), seen)
    check.look()
    return told


@pytest.fixture(scope='module')
def data() -> Drive:
    return drive(1)


def exchanged(j: int, k: int) -> np.ndarray:
    allocation = ALLOCATION.copy()
    allocation[:, [j, k]] = allocation[:, [k, j]]
    return allocation


def turned(rows: tuple[int, ...], columns: tuple[int, ...]) -> np.ndarray:
    allocation = ALLOCATION.copy()
    allocation[np.ix_(rows, columns)] *= -1.0
    return allocation


MISTAKES = {
    'exchanged thrusters': ({'allocation': exchanged(0, 1)}, 'exchange thrusters 1 and 2'),
    'exchanged upright thruster': ({'allocation': exchanged(2, 4)}, 'exchange thrusters 3 and 5'),
    'one sign': ({'allocation': turned((5,), (2,))}, 'sign of thruster 3 in its row yaw'),
    'one thruster': ({'allocation': turned((0, 1, 5), (3,))}, 'turn the sign of thruster 4'),
    'a row': ({'allocation': turned((1,), (0, 1, 2, 3))}, 'turn the sign of its row sway'),
    'all signs': ({'allocation': -ALLOCATION}, 'thrusters.gain: turn all signs'),
    'heading off by 90 degrees': ({'heading': lambda psi: psi + 0.5 * math.pi},
                                  'attitude.yaw_offset: add -1.5708 rad'),
    'compass': ({'heading': lambda psi: 0.5 * math.pi - psi}, 'attitude.heading'),
    'mirrored heading': ({'heading': lambda psi: -psi}, 'attitude.heading'),
    'north-east-down': ({'flipped': (1, 2)}, 'frames: the messages may be ned'),
    'north-east-down beside a GPS': (
        {'heading': lambda psi: 0.5 * math.pi - psi,
         'allocation': turned((1, 5), (0, 1, 2, 3)), 'depth': True},
        'frames: the messages may be ned, apart from the position'),
    'depth': ({'flipped': (2,), 'depth': True}, 'depth.scale'),
    'late': ({'late': -1.5}, 'thrusters.delay, or a latency: the motion is about 1'),
}


@pytest.mark.parametrize('name', MISTAKES)
def test_a_mistake_is_named(name: str, data: Drive) -> None:
    how, text = MISTAKES[name]
    line, = warnings(data, **how)  # type: ignore[arg-type]
    assert text in line


@pytest.mark.parametrize('seed', range(8))
def test_a_right_configuration_is_not_accused(seed: int) -> None:
    assert warnings(drive(seed), depth=bool(seed % 2)) == []


def test_a_factor_cannot_be_seen(data: Drive) -> None:
    assert warnings(data, 3.0 * ALLOCATION) == []


@pytest.mark.parametrize(('typical', 'named'), [(2.0, True), (60.0, False)])
def test_thrust_that_only_holds_a_dof_accuses_nothing(
        typical: float, named: bool, data: Drive) -> None:
    """That of a controller follows the motion, against it: as thrust of the wrong sign does."""
    wrong = settings_of(turned((5,), (0, 1, 2, 3)))
    yaw = DofSettings(MASS['yaw'], typical_force=typical)
    told = warnings(data, settings=replace(wrong, dof={**wrong.dof, 'yaw': yaw}))
    assert any('row yaw' in line for line in told) is named


@pytest.mark.parametrize('right', [True, False])
def test_a_vehicle_that_is_driven_ahead_alone_does_not_go_sideways(right: bool) -> None:
    """What moves along an axis that is only held has to be explained, too, whatever it is."""
    settings = settings_of(ALLOCATION)
    told = warnings(drive(3, ['surge']), settings=replace(settings, dof={
        axis: DofSettings(MASS[axis], typical_force=FORCE[axis]) for axis in AXES}),
        heading=lambda psi: psi + (0.0 if right else math.pi / 2))
    assert any('attitude.yaw_offset' in line for line in told) is not right


@pytest.mark.parametrize('seed', range(6))
def test_the_law_is_the_one_that_fits_best_of_those_that_a_vehicle_has(seed: int) -> None:
    """A term that is left out first may be one that the best law has."""
    random = np.random.default_rng(seed)
    path, force = 0.1 * np.cumsum(random.normal(size=61)), random.normal(size=(60, 2))
    if seed % 2:
        force[:, 1] = force[:, 0]  # of these there are many that fit alike
    v, after, other = path[:-1], path[1:], random.normal(size=60)
    fits = []
    for used in product((False, True), repeat=4):
        terms = np.array([*np.array([*force.T, v, -v * abs(v)])[list(used)], np.ones(60), other])
        factors = np.linalg.lstsq(terms.T, after, rcond=1e-9)[0]
        if not np.any(factors[:-2] < -1e-12):
            fits.append(abs(after - factors @ terms))
    error = min(fits, key=lambda one: one @ one)
    found = log_likelihood(np.stack([v, after], axis=1), force, [other])
    np.testing.assert_allclose(found, -math.log(error.mean()) - error / error.mean(), atol=1e-8)


def test_little_data_say_nothing(data: Drive) -> None:
    short = tuple(x[:200] for x in data)
    assert warnings(short, -ALLOCATION) == []  # type: ignore[arg-type]


def test_what_is_alike_is_named_together() -> None:
    """The sign of the only upright thruster and that of its row are one and the same."""
    line, = warnings(drive(2), turned((2,), (4,)))
    assert 'its row heave' in line and 'thruster 5' in line


def test_components_of_a_wrench_are_not_exchanged(data: Drive) -> None:
    """Which of them is which the message says, unlike the order of thrusters."""
    commands, *motion = data
    wrenches = commands @ ALLOCATION.T
    wrenches[:, [1, 2]] = wrenches[:, [2, 1]]
    for scale, named in ((1.0, False), (2.0, True)):
        allocation = tuple(map(tuple, (scale * np.eye(6)).tolist()))
        told = warnings((wrenches, *motion), settings=replace(
            settings_of(ALLOCATION), thrusters=ThrusterSettings(
                ('/w',), gain=(1.0,) * 6, allocation=allocation)))
        assert ('exchange thrusters 2 and 3' in ''.join(told)) == named


def test_a_gap_hides_nothing(data: Drive) -> None:
    line, = warnings(data, settings=replace(settings_of(-ALLOCATION), max_gap=1.0),
                     lost=lambda k: k % 200 < 20)  # two seconds in twenty
    assert 'thrusters.gain' in line


def test_thrust_without_motion_says_nothing() -> None:
    check = ConfigurationCheck(settings_of(ALLOCATION), [float] * 5, (told := []).append)
    for k in range(2000):
        check.add_commands(k * TICK, [1.0] * 5)
        check.add_motion('attitude', Motion(k * TICK, k * TICK, k * TICK, ()), 0.0)
    check.look()
    assert told == []


def test_what_waits_for_another_input_is_bounded() -> None:
    """A command that holds for a year costs nothing, nor does thrust without any motion."""
    blocks = BlockMeans(1)
    blocks.add(0, 10**9 * 86400 * 365, [1.0])
    assert blocks.blocks == {}
    for k in range(20_000):
        blocks.add(k * 10 * TICK, (k + 1) * 10 * TICK, [1.0])
    assert len(blocks.blocks) <= 600 and max(blocks.blocks) == 39_999


@pytest.mark.long
@pytest.mark.parametrize(('axis', 'size', 'frequency'), [
    ('surge', 120.0, 1.0 / 6.0), ('surge', 40.0, 0.05), ('heave', 100.0, 0.03)])
def test_one_sinusoid_on_one_axis_accuses_nothing(
        axis: str, size: float, frequency: float, repository: Path) -> None:
    """A law of blocks that is a little later fits a little better; so does one heading more."""
    settings = settings_from(load(repository / 'config' / 'jhurov.yaml'))
    pushed = {dof: replace(one, forces=(size if dof == axis else 1e-3,), frequencies=(frequency,))
              for dof, one in settings.simulation.dofs.items()}
    stream = Stream(replace(settings, identifier=IdentifierSettings('aid'), simulation=replace(
        settings.simulation, dofs=pushed)))
    for time, name, value in simulate(stream.settings, 150.0, 1):
        stream.receive(Event(time, (Sample(name, value),)))
    stream.finish()
    assert not stream.take_warnings()
