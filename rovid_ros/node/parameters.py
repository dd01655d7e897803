"""The parameters of the node: where they come from, and how ROS shows them."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rovid_core.settings.run import Settings, SettingsError
from rovid_ros.config.keys import Key, KEYS, LARGE
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import changed, check, settings_from
from rovid_ros.node.lifecycle import ManagedNode

NODE_NAME = 'identifier_node'

ROS_OWN = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')
"""Parameters that rclpy itself declares."""

TYPES = {
    'double': Parameter.Type.DOUBLE,
    'bool': Parameter.Type.BOOL,
    'string': Parameter.Type.STRING,
    'double[]': Parameter.Type.DOUBLE_ARRAY,
    'string[]': Parameter.Type.STRING_ARRAY,
}


def read_files(arguments: Sequence[str]) -> tuple[list[str], dict[str, Any]]:
    """
    Read the parameter files that the command line names, by the reader of all commands.

    rcl itself turns an empty list into nothing, dies on a list of integers and doubles, and
    says neither file nor key.

    Parameters
    ----------
    arguments : sequence of str
        Command line, with ``--ros-args``.

    Returns
    -------
    rest : list of str
        The command line without the parameter files, and with what rclpy itself takes of them
        in front.
    values : dict
        Their other parameters, dotted; a later file wins.

    Raises
    ------
    ParameterFileError
        If one cannot be read; it names file and line.

    """
    rest, files = _take_files(arguments)
    name, namespace = _full_name(rest)
    values: dict[str, Any] = {}
    for file in files:
        values.update(load(file, name, namespace))
    # handed to a node these would win over the command line
    own = [f'{key}:={str(values.pop(key)).lower()}' for key in ROS_OWN
           if isinstance(values.get(key), bool)]
    if own:
        rest[1:1] = ['--ros-args', *(word for one in own for word in ('-p', one)), '--']
    return rest, values


def ros_own(values: Mapping[str, Any]) -> list[Parameter[Any]]:
    """Return those values that rclpy itself takes, as overrides for a node."""
    return [Parameter(name, value=value) for name, value in values.items()
            if name.startswith(ROS_OWN)]


def sound(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return those values that their keys take, for a node that is to wait with a wrong file."""
    taken: dict[str, Any] = {}
    for name, value in values.items():
        try:
            taken.update(check({name: value}))
        except SettingsError:
            continue
    return taken


def declare(node: Node, values: Mapping[str, Any]) -> None:
    """
    Declare every key with its value, described as in the table of the keys.

    Those that are not live are read-only.

    Parameters
    ----------
    node : Node
        Gets the parameters.
    values : mapping
        Checked values by dotted key; the others have their default.

    """
    for key in KEYS:
        value = _value(key, values.get(key.name, key.default))
        if value != []:
            node.declare_parameter(key.name, value, _descriptor(key), ignore_override=True)
            continue
        # rclpy takes an empty list for one of bytes, unless it is told the type by itself
        kind = TYPES[key.type]
        node.declare_parameter(key.name, kind, ignore_override=True)
        node.set_parameters([Parameter(key.name, kind, [])])
        descriptor = _descriptor(key)
        descriptor.type = kind.value
        node.set_descriptor(key.name, descriptor)


def _take_files(arguments: Sequence[str]) -> tuple[list[str], list[Path]]:
    rest: list[str] = []
    files: list[Path] = []
    in_ros = False
    tokens = iter(arguments)
    for token in tokens:
        if token in ('--ros-args', '--'):
            in_ros = token == '--ros-args'
        if in_ros and token == '--params-file':
            file = next(tokens, None)
            if file is not None:
                files.append(Path(file))
                continue
        rest.append(token)
    return rest, files


def _full_name(arguments: Sequence[str]) -> tuple[str, str]:
    """Return name and namespace of the node after the remapping rules."""
    name, namespace = NODE_NAME, '/'
    for flag, rule in zip(arguments, arguments[1:]):
        if flag not in ('-r', '--remap'):
            continue
        source, _, target = rule.removeprefix(f'{NODE_NAME}:').partition(':=')
        if source in ('__node', '__name'):
            name = target
        elif source == '__ns':
            namespace = f'/{target.strip("/")}'
    return name, namespace


def _value(key: Key, value: Any) -> Any:
    """Return the value in the key's type."""
    if key.type == 'double':
        return float(value)
    if key.type.endswith('[]'):
        element = float if key.type == 'double[]' else str
        return [element(entry) for entry in value]
    return value


def _descriptor(key: Key) -> ParameterDescriptor:
    unit = f' [{key.unit}]' if key.unit else ''
    descriptor = ParameterDescriptor(
        description=key.description + unit, additional_constraints=f'takes {key.takes}',
        read_only=not key.live)
    if key.type == 'double' and (key.low, key.high) != (-LARGE, LARGE):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=key.low, to_value=key.high)]
    return descriptor


LIVE = {key.name: TYPES[key.type] for key in KEYS if key.live}


class ParameterNode(ManagedNode):
    """
    A managed node with all parameters of the table, whose live ones can be set as it runs.

    Parameters
    ----------
    name : str
        Of the node.
    values : mapping
        Parameters by dotted key; ``-p`` overrides win.
    autostart : bool
        True: start whatever the parameter says.

    Attributes
    ----------
    changes : dict
        What live keys have been set to since the beginning; they last as long as the node.

    Raises
    ------
    ValueError
        If it starts by itself and something is wrong with a parameter.

    """

    def __init__(self, name: str, values: Mapping[str, Any], *, autostart: bool) -> None:
        self.changes: dict[str, Any] = {}
        self._given = dict(values)
        self._declared = False
        super().__init__(name, ros_own(values))
        try:
            self._given.update((name, p.value) for name, p in self._parameter_overrides.items())
            if not self._given:
                raise SettingsError(
                    'dofs', 'no parameters at all; give --ros-args --params-file FILE')
            autostart = autostart or self._given.get('autostart') is not False
            declare(self, check(self._given) if autostart else sound(self._given))
            self._declared = True
            if autostart:
                self.start()
        except BaseException:
            self.made.close()
            self.destroy_node()
            raise

    def initial(self) -> Settings:
        """Return the settings at the beginning; raises SettingsError where they are wrong."""
        return settings_from(self._given)

    def present(self) -> Settings:
        """Return the settings that a change is judged with; raises as ``initial``."""
        return changed(self.initial(), self.changes)

    def change(self, changes: Mapping[str, Any]) -> None:
        """Take other values, by dotted key, that have been judged."""
        raise NotImplementedError

    def note(self, changes: Mapping[str, Any]) -> None:
        """Let the parameters say what has become of them by other ways."""
        self.changes.update(changes)
        super().set_parameters_atomically(typed(changes))

    def set_parameters(self, parameter_list: list[Parameter[Any]]) -> list[SetParametersResult]:
        """Set one parameter after the other."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(
            self, parameter_list: list[Parameter[Any]]) -> SetParametersResult:
        """Set all parameters or none: what is wrong is refused as in a parameter file."""
        changes = asked(parameter_list)
        if not (self._declared and changes):
            return super().set_parameters_atomically(parameter_list)
        try:
            changed(self.present(), changes)
        except SettingsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        others = [parameter for parameter in parameter_list if parameter.name not in changes]
        result = super().set_parameters_atomically(others + typed(changes))
        if result.successful:
            self.changes.update(changes)
            self.change(changes)
        return result


def asked(parameters: Iterable[Parameter[Any]]) -> dict[str, Any]:
    """Return the plain values of those parameters that are live."""
    return {p.name: list(p.value) if isinstance(p.value, (list, tuple, array)) else p.value
            for p in parameters if p.name in LIVE}


def typed(values: Mapping[str, Any]) -> list[Parameter[Any]]:
    """Return checked values as parameters of the declared types: a double may come whole."""
    made = []
    for name, value in values.items():
        kind = LIVE[name]
        if kind == Parameter.Type.DOUBLE:
            value = float(value)
        elif kind == Parameter.Type.DOUBLE_ARRAY:
            value = [float(entry) for entry in value]
        made.append(Parameter(name, kind, value))
    return made
