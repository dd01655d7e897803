"""Parameters that change while the node runs: what is asked for is judged as a whole."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rovid_core.settings import Settings, SettingsError
from rovid_ros.keys import KEYS
from rovid_ros.node.lifecycle import ManagedNode
from rovid_ros.node.parameters import declare, ros_own, sound, TYPES
from rovid_ros.parameters import changed, check, settings_from

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
