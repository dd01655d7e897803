"""Parameters, checked against the table of the keys, into settings, and what these read where."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
import difflib
import math
import os
import re
from typing import Any

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

# Parameters that every node has: rclpy itself declares them.
ROS_PARAMETERS = re.compile(r'use_sim_time|start_type_description_service|qos_overrides\..+')
MESSAGE_TYPE = re.compile(r'[A-Za-z]\w*/msg/[A-Za-z]\w*', re.ASCII)


def settings_from(values: Mapping[str, Any]) -> Settings:
    """
    Build the settings of a run from parameters by their dotted names.

    Those left out take their defaults; a node's own ROS parameters are ignored. Raises
    SettingsError for a key that there is not and a value that its key does not take; it names the
    key, what it got and what it takes.
    """
    given = check(values)
    tree: dict[str, Any] = {}
    for key in KEYS:
        _put(tree, key, given.get(key.name, key.default))
    dofs = tree.pop('dofs')
    known = {dof: DofSettings(**tree['dof'][dof])
             for dof in dofs if f'{dof}.initial.mass' in given}
    simulation = tree.pop('simulation')
    truth = simulation.pop('dofs')
    inputs: dict[str, Any] = {
        name: InputSettings(**tree[name]) for name in INPUTS if name != 'thrusters'}
    rest = {name: value for name, value in tree.items()
            if name and not isinstance(value, dict)}
    rest.update({name: os.path.expanduser(rest[name])  # as in a shell
                 for name in ('record_path', 'checkpoint_path')})
    return Settings(
        dofs=dofs, dof=known, thrusters=_thrusters(tree['thrusters'], given),
        identifier=IdentifierSettings(**tree['identifier']),
        current=CurrentSettings(**tree['current']),
        simulation=SimulationSettings(dofs=dict(_simulated(truth, given)), **simulation), **inputs,
        **rest)


def changed(settings: Settings, changes: Mapping[str, Any]) -> Settings:
    """
    Return the settings with other values of live keys, all of them or none.

    ``changes`` is by dotted key; an empty list stands for a key that is left out. Raises
    SettingsError as :func:`settings_from`, and for a key that takes no change while the node runs.
    """
    tree: dict[str, Any] = {}
    for name, value in changes.items():
        taken = {name: ()} if _is_left_out(name, value) else check({name: value})
        if name not in taken or not BY_NAME[name].live:
            raise SettingsError(name, 'takes a change only while the node is unconfigured')
        _put(tree, BY_NAME[name], taken[name])
    new = _replaced(settings, tree)
    assert isinstance(new, Settings)
    return new


def _put(tree: dict[str, Any], key: Key, value: Any) -> None:
    """Put a value into a tree of settings, where that of its key is."""
    *path, last = key.setting.split('.')
    for name in path:
        tree = tree.setdefault(name, {})
    tree[last] = value


def _replaced(settings: Any, tree: Mapping[str, Any]) -> Any:
    """Return frozen settings with the leaves of a tree in place of their own."""
    return replace(settings, **{
        name: _replaced(getattr(settings, name), value) if isinstance(value, Mapping) else value
        for name, value in tree.items()})


def check(values: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return the given values in the types of their keys, without ROS' own parameters.

    An empty list, which rcl reads as nothing, stands for a key that is left out where that is the
    default. Raises SettingsError as :func:`settings_from`, for each value by itself.
    """
    checked = {}
    for name, value in values.items():
        if _is_left_out(name, value):
            continue
        if name in BY_NAME:
            checked[name] = _checked(BY_NAME[name], value)
        elif not ROS_PARAMETERS.fullmatch(name):
            raise SettingsError(name, _unknown(name))
    return checked


def _is_left_out(name: str, value: Any) -> bool:
    """Tell whether a value is an empty list, which rcl reads as nothing, as is the default."""
    return name in BY_NAME and BY_NAME[name].default == () and (
        value is None or isinstance(value, (list, tuple, array)) and not len(value))


def _unknown(name: str) -> str:
    inner = [key for key in BY_NAME if key.startswith(f'{name}.')]
    if inner:
        return f'takes keys of its own, such as {inner[0]}'
    misplaced = [key for key in BY_NAME if key.rpartition('.')[2] == name.rpartition('.')[2]]
    close = [key for key in misplaced if key.partition('.')[0] == name.partition('.')[0]]
    near = next((group for group in (close, misplaced) if len(group) == 1),
                difflib.get_close_matches(name, BY_NAME, 1, 0.0))
    return f'there is no such key; the nearest is {near[0]}'


def _checked(key: Key, value: Any) -> Any:
    """Return a value in the type of its key."""
    if key.type.endswith('[]'):
        if not isinstance(value, (list, tuple, array)) or not len(value):
            raise _refused(key, value)
        if key.size and len(value) != key.size:
            raise SettingsError(key.name, f'got {len(value)} entries, takes {key.takes}')
        entries = tuple(_entry(key, entry) for entry in value)
        if key.type == 'string[]' and len(set(entries)) < len(entries):
            twice = next(e for e in entries if entries.count(e) > 1)
            raise SettingsError(key.name, f'names {twice!r} twice')
        return entries
    return _entry(key, value)


def _entry(key: Key, value: Any) -> Any:
    kind = key.type.removesuffix('[]')
    if kind == 'double':
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise _refused(key, value)
        if not (math.isfinite(value) and key.low <= value <= key.high):
            raise _refused(key, value)
        return float(value)
    if kind == 'bool':
        if not isinstance(value, bool):
            raise _refused(key, value)
        return value
    if not isinstance(value, str):
        raise _refused(key, value)
    if key.choices and value not in key.choices:
        near = difflib.get_close_matches(value.lower(), key.choices, 1)
        hint = f'; did you mean {near[0]!r}?' if near else ''
        raise SettingsError(key.name, f'got {value!r}, takes {key.takes}{hint}')
    if key.name.endswith('.type') and value and not MESSAGE_TYPE.fullmatch(value):
        raise SettingsError(key.name, f'got {value!r}, takes package/msg/Type, such as '
                                      'geometry_msgs/msg/PointStamped')
    return value


def _refused(key: Key, value: Any) -> SettingsError:
    if value is None:
        got = 'nothing (ROS reads an empty list as nothing)'
    elif isinstance(value, bool):
        got = f'the truth value {str(value).lower()}'
    elif isinstance(value, (list, tuple, array)):
        got = f'a list of {len(value)} entries' if len(value) else 'an empty list'
    elif isinstance(value, str):
        got = f'the text {value!r}'
    else:
        got = f'{value!r}'
    hint = ''
    if key.type.startswith('string') and isinstance(value, (bool, int, float)):
        hint = '; write text that looks like something else in quotes'
    if key.type.endswith('[]') and got == 'an empty list':
        hint = '; leave the key out'
    return SettingsError(key.name, f'got {got}, takes {key.takes}{hint}')


def _thrusters(tree: dict[str, Any], given: Mapping[str, Any]) -> ThrusterSettings:
    topic = given.get('thrusters.topic', '')
    if topic and tree['topics']:
        raise SettingsError('thrusters.topics', 'and thrusters.topic exclude each other')
    tree['topics'] = tree['topics'] or ((topic,) if topic else ())
    flat = tree['allocation']
    is_wrench = 'Wrench' in tree['type'] and not flat and len(tree['gain']) in (0, 6)
    if is_wrench:  # force and moment already: one "thruster" per DOF
        tree['gain'] = tree['gain'] or (1.0,) * 6
        flat = tuple(float(i == j) for i in range(6) for j in range(6))
    n = max(1, len(tree['gain']))
    tree['allocation'] = tuple(flat[i:i + n] for i in range(0, len(flat), n))
    return ThrusterSettings(**tree)


def _simulated(truth: Mapping[str, Any],
               given: Mapping[str, Any]) -> Iterator[tuple[str, SimulatedDof]]:
    for dof in DOFS:
        prefix = f'simulation.{dof}.'
        # what is as by default is in each file that ``ros2 param dump`` has made
        if not any(given.get(key.name, key.default) != key.default for key in KEYS
                   if key.name.startswith(prefix)):
            continue
        simulated = SimulatedDof(**truth[dof])
        if not simulated.mass:
            raise SettingsError(f'{prefix}mass', f'takes a number above 0, as {prefix[:-1]} is '
                                                 'simulated')
        forces, frequencies = simulated.forces, simulated.frequencies
        if len(forces) != len(frequencies):
            raise SettingsError(
                f'{prefix}frequencies',
                f'got {len(frequencies)} for {len(forces)} forces, takes one for each')
        yield dof, simulated


@dataclass(frozen=True, slots=True)
class Source:
    """Where an input's samples come from; one topic of several is a ``part``."""

    input: str
    topic: str
    type: str
    field: str
    stamp: str
    latency: int  # [ns]
    part: int

    @property
    def section(self) -> str:
        """Return the section of the input in the parameter file."""
        return section(self.input)


def sources(settings: Settings) -> list[Source]:
    """Return what to read, in the order of INPUTS."""
    found = []
    for name in INPUTS:
        if name in settings.used_inputs():
            given = given_of(settings, name)
            found += [
                Source(name, topic, given.type, given.field, given.stamp,
                       round(given.latency * 1e9), part)
                for part, topic in enumerate(topics_of(settings, name))]
    return found


def given_of(settings: Settings, name: str) -> InputSettings | ThrusterSettings:
    """Return what is given of an input; both kinds say type, field, stamp, latency and QoS."""
    return settings.thrusters if name == 'thrusters' else settings.input(name)


def topics_of(settings: Settings, name: str) -> tuple[str, ...]:
    """Return the topics of an input: one, or one per thruster."""
    return settings.thrusters.topics if name == 'thrusters' else (settings.input(name).topic,)


def inputs_of(settings: Settings, topic: str) -> list[str]:
    """Return the inputs that a topic feeds."""
    return [name for name in settings.used_inputs() if topic in topics_of(settings, name)]


def section(name: str) -> str:
    """Return the section of an input in the parameter file."""
    return 'thrusters.sign' if name == 'sign' else name
