"""The table of the keys, and parameters into settings."""

from array import array
from dataclasses import fields
import math
from pathlib import Path
from typing import Any

import pytest
from rovid_core.model.dofs import DOFS
from rovid_core.settings.run import (
    CurrentSettings,
    DofSettings,
    IdentifierSettings,
    INPUTS,
    InputSettings,
    Settings,
    SettingsError,
    SimulatedDof,
    SimulationSettings,
    ThrusterSettings,
)
from rovid_ros.config.keys import BY_NAME, Key, KEYS
from rovid_ros.config.parameters import check, settings_from

LEAST: dict[str, Any] = {
    'dofs': ['surge'], 'surge.initial.mass': 290, 'position.topic': '/fix',
    'attitude.topic': '/attitude', 'thrusters.topic': '/current', 'thrusters.gain': [40, 40],
    'thrusters.allocation': [1, 1, *[0] * 10],
}


def settings(**changes: Any) -> Settings:
    """Return settings of the least parameters with some of ``thrusters_gain=...`` changed."""
    given = {name.replace('__', '.'): value for name, value in changes.items()}
    return settings_from({**LEAST, **given})


def test_every_setting_has_exactly_one_key() -> None:
    places = {'thrusters': ThrusterSettings, 'identifier': IdentifierSettings,
              'current': CurrentSettings, 'simulation': SimulationSettings}
    wanted = {f.name for f in fields(Settings)} - {
        'dof', 'thrusters', 'identifier', 'current', 'simulation', *INPUTS,
        'all_methods'}  # which only a comparison sets
    for place, owner in places.items():
        wanted |= {f'{place}.{f.name}' for f in fields(owner)} - {'simulation.dofs'}
    for name in set(INPUTS) - {'thrusters'}:
        wanted |= {f'{name}.{f.name}' for f in fields(InputSettings)}
        if name not in ('attitude', 'angular_velocity', 'velocity'):  # the sensors of the body
            wanted -= {f'{name}.frames', f'{name}.mounting'}
            if name != 'position':
                wanted -= {f'{name}.sensor_frame'}
        if name not in ('position', 'velocity'):
            wanted -= {f'{name}.lever_arm'}
    for dof in DOFS:
        wanted |= {f'dof.{dof}.{f.name}' for f in fields(DofSettings)}
        wanted |= {f'simulation.dofs.{dof}.{f.name}' for f in fields(SimulatedDof)}
    assert sorted(key.setting for key in KEYS if key.setting) == sorted(wanted)
    assert len(BY_NAME) == len(KEYS)


@pytest.mark.parametrize('key', KEYS, ids=lambda key: key.name)
def test_every_key_is_complete_and_takes_its_default(key: Key) -> None:
    assert key.description and '\n' not in key.description
    assert math.isfinite(key.low) and key.low < key.high < math.inf
    if key.default == ():  # what rcl reads as nothing is what was left out
        assert check({key.name: []}) == check({key.name: None}) == {}
    else:
        assert check({key.name: key.default}) == {key.name: key.default}
        with pytest.raises(SettingsError):
            check({key.name: None})
    with pytest.raises(SettingsError):
        check({key.name: {}})


def test_what_is_left_out_has_its_default() -> None:
    got = settings()
    expected = Settings(
        dofs=('surge',), dof={'surge': DofSettings(mass=290.0)},
        position=InputSettings(topic='/fix'), attitude=InputSettings(topic='/attitude'),
        thrusters=ThrusterSettings(
            topics=('/current',), gain=(40.0, 40.0),
            allocation=((1.0, 1.0), *[(0.0, 0.0)] * 5)))
    assert got == expected


def test_whole_numbers_are_numbers_in_lists_too() -> None:
    got = settings(max_gap=2, position__lever_arm=[1, 0, 0.5])
    assert repr(got.max_gap) == '2.0' and repr(got.position.lever_arm) == (
        '(1.0, 0.0, 0.5)')
    assert check({'thrusters.gain': array('d', [1.0])}) == {'thrusters.gain': (1.0,)}
    assert check({'thrusters.gain': (1,)}) == {'thrusters.gain': (1.0,)}


def test_the_parameters_of_every_node_are_left_alone() -> None:
    ros = {'use_sim_time': True, 'start_type_description_service': False,
           'qos_overrides./parameter_events.publisher.depth': 5}
    assert check(ros) == {}
    with pytest.raises(SettingsError, match='there is no such key'):
        check({'use_sim_tim': True})


@pytest.mark.parametrize(('key', 'value', 'message'), [
    ('thrusters.gian', 1, 'there is no such key; the nearest is thrusters.gain'),
    ('max_wai', 1, 'there is no such key; the nearest is max_wait'),
    ('gain', [1.0], 'there is no such key; the nearest is thrusters.gain'),
    ('surge.mass', 1, 'there is no such key; the nearest is surge.initial.mass'),
    ('position.cutoff', 1, 'there is no such key; the nearest is velocity.cutoff'),
    ('position', '/fix', 'takes keys of its own, such as position.topic'),
    ('max_gap', 'long', "got the text 'long', takes a number from 0 to 3600 [s]"),
    ('max_gap', True, 'got the truth value true, takes a number from 0 to 3600 [s]'),
    ('max_gap', math.nan, 'got nan, takes a number from 0 to 3600 [s]'),
    ('surge.typical.force', math.inf, 'got inf, takes a number'),
    ('max_gap', -1, 'got -1, takes a number from 0 to 3600 [s]'),
    ('max_gap', [1.0], 'got a list of 1 entries, takes a number'),
    ('reset_on_time_jump', 1, 'got 1, takes true or false'),
    ('position.topic', False, 'got the truth value false, takes text; write text'),
    ('position.type', 'PointStamped', "got 'PointStamped', takes package/msg/Type"),
    ('frames', 'NED', "got 'NED', takes one of 'enu', 'ned'; did you mean 'ned'?"),
    ('identifier.method', 'rls', "got 'rls', takes one of 'aid', 'ekf'"),
    ('dofs', ['surge', 'have'], "got 'have', takes a list of surge, sway, heave, roll, pitch, "
                                "yaw; did you mean 'heave'?"),
    ('dofs', 'surge', "got the text 'surge', takes a list of surge"),
    ('dofs', ['yaw', 'yaw'], "names 'yaw' twice"),
    ('surge.terms', [], 'got an empty list, takes a list of alpha'),
    ('surge.terms', None, 'got nothing (ROS reads an empty list as nothing), takes a list'),
    ('thrusters.gain', [], 'takes one number per thruster, got none'),
    ('thrusters.gain', [1, '2'], "got the text '2', takes a list of numbers"),
    ('thrusters.gain', 40.0, 'got 40.0, takes a list of numbers'),
    ('thrusters.names', [1, 2], 'got 1, takes a list of texts; write text that looks like'),
    ('position.lever_arm', [1.0, 2.0], 'got 2 entries, takes a list of 3 numbers from -100'),
    ('surge.terms', ['alpha', 'epsilon'], "got 'epsilon', takes a list of alpha, beta"),
    # what only shows beside other keys
    ('thrusters.allocation', [1.0] * 11, 'takes 6 rows x 2 thrusters = 12 numbers, got 11'),
    ('thrusters.topics', ['/a', '/b'], 'and thrusters.topic exclude each other'),
    ('simulation.sway.bias', 1, ''),
    ('simulation.surge.forces', [1.0], ''),
    ('thrusters.names', ['one'], 'has 1 entries for 2 thrusters'),
])
def test_refused_with_the_key_what_it_got_and_what_it_takes(
        key: str, value: Any, message: str) -> None:
    with pytest.raises(SettingsError) as refused:
        settings_from({**LEAST, key: value})
    if message:
        assert str(refused.value).startswith(f'{key}: {message}')
    assert '\n' not in str(refused.value)


def test_what_is_required() -> None:
    for name in LEAST:
        with pytest.raises(SettingsError):
            settings_from({n: v for n, v in LEAST.items() if n != name})
    with pytest.raises(SettingsError, match=r'surge\.initial\.mass: is required'):
        settings_from({n: v for n, v in LEAST.items() if n != 'surge.initial.mass'})


def test_one_topic_per_thruster() -> None:
    given = {**LEAST, 'thrusters.topics': ['/a', '/b']}
    del given['thrusters.topic']
    assert settings_from(given).thrusters.topics == ('/a', '/b')


@pytest.mark.parametrize('gain', [None, [1, 1, 1, 1, 1, 2]])
def test_a_wrench_needs_no_allocation(gain: list[float] | None) -> None:
    given = {n: v for n, v in LEAST.items()
             if n not in ('thrusters.gain', 'thrusters.allocation')}
    given['thrusters.type'] = 'geometry_msgs/msg/WrenchStamped'
    if gain:
        given['thrusters.gain'] = gain
    thrusters = settings_from(given).thrusters
    assert thrusters.gain == tuple(gain or [1] * 6)
    assert thrusters.allocation == tuple(
        tuple(float(i == j) for j in range(6)) for i in range(6))


def test_the_truth_of_a_simulation() -> None:
    assert settings().simulation.dofs == {}
    got = settings(simulation__yaw__mass=90, simulation__yaw__forces=[20],
                   simulation__yaw__frequencies=[0.1], simulation__depth_rate=5)
    assert got.simulation.dofs == {
        'yaw': SimulatedDof(mass=90.0, forces=(20.0,), frequencies=(0.1,))}
    assert got.simulation.depth_rate == 5.0


def test_values_go_where_they_belong() -> None:
    got = settings(
        velocity__cutoff=0.7, velocity__max=4, depth__scale=-1e-4, depth__offset=10,
        depth__topic='/p', attitude__unit='deg', attitude__yaw_offset=0.1,
        thrusters__sign__topic='/s', record__path='r.mcap', checkpoint__path='~/c.json',
        checkpoint__period=5,
        surge__typical__velocity=0.4, surge__initial__bias=-3, surge__terms=['alpha', 'beta'],
        identifier__feedback_gain=-2, identifier__adaptation_gains=[1, 2, 3, 4])
    assert (got.cutoff, got.max_speed, got.depth_scale, got.depth_offset) == (0.7, 4, -1e-4, 10)
    assert (got.heading_unit, got.yaw_offset, got.sign.topic) == ('deg', 0.1, '/s')
    assert (got.record_path, got.checkpoint_period) == ('r.mcap', 5)
    assert got.checkpoint_path == str(Path.home() / 'c.json')
    assert got.dof['surge'] == DofSettings(
        mass=290, bias=-3, typical_velocity=0.4, terms=('alpha', 'beta'))
    assert got.identifier.adaptation_gains == (1, 2, 3, 4)
