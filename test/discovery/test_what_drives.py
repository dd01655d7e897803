"""What ``rovid init`` finds of thrusters and sensors in logs whose vehicle is known."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
import re

import numpy as np
from numpy.typing import NDArray
import pytest
from rovid_ros.discovery.candidates import candidates
from rovid_ros.discovery.configuration import configuration
from rovid_ros.discovery.decisions import decide
from rovid_ros.discovery.signals import Signal

Array = NDArray[np.float64]


def driven(forces: Array, arm: float = 0.0, step: float = 0.05) -> dict[str, Array]:
    """
    Return how forces ahead, aside, down and about z move a vehicle, seen from an arm ahead.

    Velocities u, v, w and r of what is measured, and the heading.
    """
    mass, drag = np.array([60.0, 90.0, 90.0, 4.0]), np.array([60.0, 110.0, 110.0, 4.0])
    velocity, moved = np.zeros(4), []
    for force in forces:
        turned = np.array([1.5, -0.7, 0.0, 0.0]) * velocity[[1, 0, 2, 3]] * velocity[3]
        velocity = velocity + step * (
            (force - drag * velocity * np.abs(velocity)) / mass + turned)
        moved.append(velocity)
    u, v, w, r = np.array(moved).T
    return {'u': u, 'v': v + arm * r, 'w': w, 'r': r, 'yaw': step * np.cumsum(r)}


def signals_of(moved: Mapping[str, Array], commands: Array, name: str = '/thr',
               pitch: Array | None = None) -> list[Signal]:
    """Return a log of a DVL, an attitude with a gyro and commands, 20 times a second."""
    draw, count = np.random.default_rng(8), len(commands)
    times, zero = 0.05 * np.arange(count), np.zeros(count)
    half, tilt = 0.5 * moved['yaw'], 0.5 * (zero if pitch is None else pitch)
    velocities = np.column_stack([moved[letter] for letter in 'uvw'])
    return [
        Signal('/dvl', 'geometry_msgs/msg/TwistStamped', 'twist.linear', 'vector', times,
               velocities + draw.normal(0.0, 0.01, (count, 3)), rate=20.0),
        Signal('/imu', 'sensor_msgs/msg/Imu', 'orientation', 'quaternion', times,
               np.column_stack([-np.sin(half) * np.sin(tilt), np.cos(half) * np.sin(tilt),
                                np.sin(half) * np.cos(tilt), np.cos(half) * np.cos(tilt)]),
               rate=20.0),
        Signal('/imu', 'sensor_msgs/msg/Imu', 'angular_velocity', 'vector', times,
               np.column_stack([zero, zero, moved['r']]), rate=20.0),
        Signal(name, 'std_msgs/msg/Float64MultiArray', 'data', 'array', times, commands,
               rate=20.0)]


def commanded(sizes: Sequence[float], seed: int = 5) -> Array:
    """Return commands that are held for 2 s each, with some standard deviations."""
    draw = np.random.default_rng(seed)
    return np.repeat(draw.normal(size=(100, len(sizes))) * sizes, 40, axis=0)


@pytest.mark.parametrize(('arm', 'gyro'), [(0.0, True), (-0.4, True), (0.3, True), (-0.4, False)])
def test_a_dvl_that_is_not_in_the_middle_shows_in_turns(arm: float, gyro: bool) -> None:
    forces = commanded([20.0, 20.0, 0.0, 3.0])
    signals = [one for one in signals_of(driven(forces, arm), forces[:, [0, 1, 3]])
               if gyro or one.path != 'angular_velocity']
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    said = [one for one in (*made.guesses, *made.unknown) if 'lever_arm' in one]
    if arm and gyro:
        assert made.inputs['velocity'].keys['lever_arm'] == [pytest.approx(arm, abs=0.05), 0, 0]
        assert ('behind' if arm < 0.0 else 'ahead of') in said[0] and said[0] in made.guesses
        assert made.inputs['angular_velocity'].signal.topic == '/imu'
        assert made.thrusters.rows['sway'] == (0.0, 1.0, 0.0)
        assert made.dofs['sway'].mass == pytest.approx(90.0, rel=0.1)
        assert re.search(r'lever_arm: \[-?0\.\d+, 0\.0, 0\.0\]', configuration(made, 'dive.mcap'))
    else:
        assert 'lever_arm' not in made.inputs['velocity'].keys
        assert len(said) == (1 if arm else 0)
        assert set(said) <= set(made.unknown)


def test_of_thrusters_that_are_driven_together_those_that_are_driven_most_push_most() -> None:
    """Two small ones hold the vehicle level when it is pushed aside."""
    aside = commanded([20.0])
    commands = np.column_stack([aside, aside, 0.1 * aside, -0.1 * aside])
    moved = driven(np.column_stack([0.0 * aside, 2.0 * aside, 0.0 * aside, 0.0 * aside]))
    signals = signals_of(moved, commands)
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    assert made.thrusters.rows['sway'] == (1.0, 1.0)


def test_a_pattern_that_is_known_to_push_nothing_is_no_pattern_that_may_push() -> None:
    """Where one of three gives as much less as the other two give more, nothing moves."""
    drawn, strengths = commanded([1.0, 1.0, 1.0]), np.array([20.0, 10.0, 10.0])
    pattern = np.array([1.0, -1.0, -1.0]) / np.sqrt(3.0)
    commands = strengths * (drawn - 0.5 * np.outer(drawn @ pattern, pattern))
    ahead = commands.sum(axis=1)
    signals = signals_of(driven(np.column_stack([ahead, *[0.0 * ahead] * 3])), commands)
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    assert made.thrusters.rows['surge'] == pytest.approx((1.0, 1.0, 1.0), abs=0.1)


@pytest.mark.parametrize('seed', [5, 6])
def test_a_thruster_that_answers_to_the_motion_a_little_does_not_drive_it(seed: int) -> None:
    """One that holds the depth sees how the vehicle tilts as it speeds up."""
    ahead, draw = commanded([20.0], seed), np.random.default_rng(2)
    moved = driven(np.column_stack([ahead, 0.0 * ahead, 0.0 * ahead, 0.0 * ahead]))
    down = [0.0]
    for faster in np.diff(moved['u']) / 0.05:
        down.append(down[-1] + 0.05 * (4.0 * faster - down[-1]) / 0.3)
    commands = np.column_stack([ahead, np.array(down) + draw.normal(0.0, 0.05, len(down))])
    moved['u'] += draw.normal(0.0, 0.3, len(down))
    signals = signals_of(moved, commands)
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    assert made.thrusters.rows['surge'] == (1.0,)


def test_thrusters_that_are_heard_one_after_the_other_are_driven_together() -> None:
    """Each has its own topic, and is only told when it changes, here every 2 s."""
    asked = commanded([20.0, 20.0, 0.0, 3.0])
    mixed = asked @ np.array([[1.0, 1.0, 1.0, 1.0], [1.0, -1.0, -1.0, 1.0], [0.0] * 4,
                              [1.0, -1.0, 1.0, -1.0]])
    *signals, commands = signals_of(driven(4.0 * asked), mixed)
    new = np.arange(0, len(mixed), 40)
    times = (commands.times[new, np.newaxis] + [0.0, 1e-3, 2e-3, 3e-3]).ravel()
    told = mixed[new].repeat(4, axis=0)
    for k in range(4):  # what is not told yet is as before
        told[k::4][1:, k + 1:] = mixed[new][:-1, k + 1:]
    signals.append(replace(commands, times=times, values=told))
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    for dof, row in (('surge', (1, 1, 1, 1)), ('sway', (1, -1, -1, 1)), ('yaw', (1, -1, 1, -1))):
        assert made.thrusters.rows[dof] == pytest.approx(row, abs=0.1), dof


def depth_of(rising: Array) -> Signal:
    """Return the depth of a vehicle that rises so fast, 20 times a second."""
    return Signal('/depth', 'std_msgs/msg/Float64', 'data', 'number',
                  0.05 * np.arange(len(rising)),
                  (20.0 - 0.05 * np.cumsum(rising))[:, np.newaxis], rate=20.0)


@pytest.mark.parametrize(('turns', 'is_mirrored'), [
    (True, True), (True, False), (False, True), (False, False)])
def test_a_dvl_with_y_to_the_right_shows_in_turns_or_by_the_depth(
        turns: bool, is_mirrored: bool) -> None:
    """The attitude has y to the left."""
    forces = commanded([20.0, 20.0, 20.0, 3.0] if turns else [20.0, 20.0, 20.0, 0.0])
    moved = driven(forces)
    rising = moved['w'].copy()
    if is_mirrored:
        moved['v'], moved['w'] = -moved['v'], -moved['w']
    signals = [*signals_of(moved, forces), depth_of(-rising if turns else rising)]
    commands = signals[3]  # they begin last
    signals[3] = replace(commands, times=commands.times[40:], values=commands.values[40:])
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    assert made.inputs['velocity'].keys.get('frames') == ('ned' if is_mirrored else None)
    if is_mirrored:
        [said] = [one for one in made.guesses if one.startswith('velocity.frames')]
        assert ('in turns' if turns else '/depth') in said
        assert re.search('frames: ned', configuration(made, 'dive.mcap'))
    assert made.thrusters.rows['sway'][1] > 0.9
    assert made.thrusters.rows['heave'][2] > 0.9


def test_heave_of_a_vehicle_that_pitches_is_not_how_fast_its_depth_changes() -> None:
    forces = commanded([40.0, 0.0, 20.0, 0.0])
    pitch = np.repeat(np.random.default_rng(6).uniform(-0.6, 0.6, 40), 100)
    pitch = np.convolve(pitch, np.ones(40) / 40.0, 'same')
    moved = driven(forces)
    rising = np.cos(pitch) * moved['w'] - np.sin(pitch) * moved['u']
    ahead = np.cos(pitch) * moved['u'] + np.sin(pitch) * moved['w']
    _, *signals = signals_of(moved, forces[:, [0, 2]], pitch=pitch)
    path = 0.05 * np.cumsum(np.column_stack([ahead, 0.0 * ahead, rising]), axis=0)
    path += np.random.default_rng(9).normal(0.0, 0.002, path.shape)
    signals += [depth_of(rising), Signal(
        '/lbl', 'geometry_msgs/msg/PointStamped', 'point', 'vector', signals[0].times, path,
        rate=20.0)]
    made = decide(candidates(signals), signals, lambda name, found: found[0])
    assert made.inputs['depth'].signal.topic == '/depth'
    assert made.thrusters.rows['heave'] == (0.0, 1.0)
    assert made.dofs['heave'].mass == pytest.approx(90.0, rel=0.1)
