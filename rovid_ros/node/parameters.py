"""The parameters of the node: declared from the table of keys, and set while it runs."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
import time
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rovid_core.settings.run import Settings, SettingsError
from rovid_ros.config.keys import Key, KEYS
from rovid_ros.config.parameter_file import NODE_NAME, scalar
from rovid_ros.config.parameters import changed, check, ROS_PARAMETERS, settings_from
from rovid_ros.node.health.console import WarningLimiter
from rovid_ros.node.lifecycle import ManagedNode

TYPES = {
    'double': Parameter.Type.DOUBLE,
    'bool': Parameter.Type.BOOL,
    'string': Parameter.Type.STRING,
    'double[]': Parameter.Type.DOUBLE_ARRAY,
    'string[]': Parameter.Type.STRING_ARRAY,
}


def valid_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return only the valid values: an unconfigured node starts with a wrong file, too."""
    valid: dict[str, Any] = {}
    for name, value in values.items():
        try:
            valid.update(check({name: value}))
        except SettingsError:
            continue
    return valid


def declare(node: Node, values: Mapping[str, Any]) -> None:
    """
    Declare every key with its value, described as in the table of the keys.

    None is read-only, as all can be set while the node is unconfigured; whether one can be set
    later is in its constraints.
    """
    for key in KEYS:
        parameter, = typed_parameters({key.name: values.get(key.name, key.default)})
        if parameter.value != []:
            node.declare_parameter(
                key.name, parameter.value, _descriptor(key), ignore_override=True)
            continue
        # rclpy takes an empty list for one of bytes, unless the type is given without a value
        node.declare_parameter(key.name, parameter.type_, ignore_override=True)
        node.set_parameters([parameter])
        descriptor = _descriptor(key)
        descriptor.type = parameter.type_.value
        node.set_descriptor(key.name, descriptor)


def _descriptor(key: Key) -> ParameterDescriptor:
    unit = f' [{key.unit}]' if key.unit else ''
    descriptor = ParameterDescriptor(
        description=key.description + unit,
        additional_constraints=f'takes {key.takes}' + (
            '' if key.live else '; only while the node is unconfigured'))
    if key.type == 'double' and key.has_bounds:
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=key.low, to_value=key.high)]
    return descriptor


OWN = {key.name: TYPES[key.type] for key in KEYS}
LIVE = {key.name for key in KEYS if key.live}


class ParameterNode(ManagedNode):
    """
    A managed node with all parameters of the table.

    While it is unconfigured all can be set, each judged by itself; together they are judged when
    it is configured, which a wrong one makes fail. Later only the live ones can be set.
    ``-p`` overrides win over ``values``. With ``autostart`` it starts whatever the parameter says.
    Raises ValueError if it starts by itself and something is wrong with a parameter.
    """

    def __init__(self, values: Mapping[str, Any], *, autostart: bool) -> None:
        self.configured = False
        self._lines = WarningLimiter()
        self.changes: dict[str, Any] = {}  # of live keys, since the node was made
        self._given = dict(values)
        self.found: dict[str, Any] = {}  # what the node looked up by itself; it was not given
        self._declared = False
        super().__init__(NODE_NAME, [Parameter(name, value=value) for name, value in values.items()
                                     if ROS_PARAMETERS.fullmatch(name)])
        try:
            self._given.update((name, p.value) for name, p in self._parameter_overrides.items())
            if not self._given:
                raise SettingsError(
                    'dofs', 'no parameters at all; give --ros-args --params-file FILE')
            autostart = autostart or self._given.get('autostart') is not False
            declare(self, check(self._given) if autostart else valid_values(self._given))
            self._declared = True
            if autostart:
                self.start()
        except BaseException:
            self.resources.close()
            self.destroy_node()
            raise

    def initial_settings(self) -> Settings:
        """
        Return the settings before any change of a live key.

        Raises SettingsError where they are wrong, also with those changes.
        """
        try:
            return settings_from({**self._given, **self.found})
        except SettingsError:
            return settings_from({**self._given, **self.found, **self.changes})

    def current_settings(self) -> Settings:
        """Return the settings that a change applies to; raises as ``initial_settings``."""
        return changed(self.initial_settings(), self.changes)

    def apply_changes(self, changes: Mapping[str, Any]) -> None:
        """Go on with other values, by dotted key, which have been checked."""
        raise NotImplementedError

    def show_changes(self, changes: Mapping[str, Any]) -> None:
        """Let the parameters show values that were changed by a service or a replayed log."""
        self.changes.update(changes)
        self.show(changes)

    def show_found(self, found: Mapping[str, Any]) -> None:
        """Go on with values of keys that were not given, and let the parameters show them."""
        self.found = dict(found)
        self.show(found)

    def show(self, values: Mapping[str, Any]) -> None:
        """Let the parameters show what nobody has changed; it does not outlast a clean-up."""
        super().set_parameters_atomically(typed_parameters(values))

    def set_parameters(self, parameter_list: list[Parameter[Any]]) -> list[SetParametersResult]:
        """Set one parameter after the other."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(
            self, parameter_list: list[Parameter[Any]]) -> SetParametersResult:
        """Set all parameters or none: what is wrong is refused as in a parameter file."""
        values = own_values(parameter_list)
        strangers = {p.name: p.value for p in parameter_list if not self.has_parameter(p.name)}
        if not (self._declared and (values or strangers)):
            return super().set_parameters_atomically(parameter_list)
        try:
            check(strangers)  # names the nearest key
            if self.configured:
                values = self._changing(values)
                changed(self.current_settings(), values)
            else:
                check(values)
        except SettingsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        others = [parameter for parameter in parameter_list if parameter.name not in OWN]
        before = own_values(map(self.get_parameter, values))
        result = super().set_parameters_atomically(others + typed_parameters(values))
        if result.successful and values:
            live = {name: value for name, value in values.items() if name in LIVE}
            self.changes.update(live)
            self._given.update({name: value for name, value in values.items()
                                if name not in LIVE})
            self.apply_changes(live)
            for line in self._lines.allowed(
                    [f'set {name}: {value}' for name, value in values.items()
                     if value != before[name]], time.monotonic()):
                self.get_logger().info(line)
        return result

    def _changing(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Leave out what is not live and has that value already, as all has in a saved file."""
        try:
            shown = own_values(typed_parameters(values))
        except (TypeError, ValueError):  # it is refused with the key's own words
            shown = {}
        return {name: value for name, value in values.items() if name in LIVE
                or own_values([self.get_parameter(name)])[name] != shown.get(name)}


def own_values(parameters: Iterable[Parameter[Any]]) -> dict[str, Any]:
    """Return the plain values of those parameters that are in the table of the keys."""
    return {p.name: _plain(p) for p in parameters if p.name in OWN}


def _plain(parameter: Parameter[Any]) -> Any:
    """
    Return the value of a parameter as a parameter file has it.

    ``ros2 param`` takes ``1e-5``, and a list with such a number, for a text: these are read as in
    a file. A list that is deleted is an empty one, for that is what rcl takes that for.
    """
    value = parameter.value
    if isinstance(value, str):
        return _number(parameter)
    if value is None and OWN[parameter.name] in (
            Parameter.Type.DOUBLE_ARRAY, Parameter.Type.STRING_ARRAY):
        return []
    return list(value) if isinstance(value, (list, tuple, array)) else value


def _number(parameter: Parameter[Any]) -> Any:
    """Return the number, or the numbers, of a text where such are meant; else the text."""
    kind, text = OWN[parameter.name], parameter.value.strip()
    if kind == Parameter.Type.DOUBLE:
        numbers = [scalar(text)]
    elif kind == Parameter.Type.DOUBLE_ARRAY and text.startswith('[') and text.endswith(']'):
        numbers = [scalar(entry.strip()) for entry in text[1:-1].split(',')]
    else:
        return parameter.value
    if any(type(number) not in (int, float) for number in numbers):
        return parameter.value
    return numbers[0] if kind == Parameter.Type.DOUBLE else numbers


def typed_parameters(values: Mapping[str, Any]) -> list[Parameter[Any]]:
    """Return checked values as parameters of the declared types: 2 becomes the double 2.0."""
    made = []
    for name, value in values.items():
        kind = OWN[name]
        if kind == Parameter.Type.DOUBLE:
            value = float(value)
        elif kind == Parameter.Type.DOUBLE_ARRAY:
            value = [float(entry) for entry in value]
        elif kind == Parameter.Type.STRING_ARRAY:
            value = list(value)
        made.append(Parameter(name, kind, value))
    return made
