"""What was done to a running node, told in its own log, and done again in a replay."""

from __future__ import annotations

from collections.abc import Mapping
import json
from typing import Any

from rovid_core.identify.estimate import Estimate
from rovid_core.pipeline.stream import Stream
from rovid_ros.config.parameters import changed

CONTROL = '/rovid/control'
"""Topic of a node's own log that says what was done to it."""

PARAMETERS = 'parameters'
"""The control that says which parameters changed, as JSON by dotted key."""


def apply(stream: Stream, changes: Mapping[str, Any]) -> None:
    """
    Give live keys other values, between two steps.

    Parameters
    ----------
    stream : Stream
        Takes them; told what to record.
    changes : mapping
        Value by dotted key.

    Raises
    ------
    SettingsError
        If they are not taken, which changes nothing.

    """
    stream.change(changed(stream.settings, changes), json.dumps(dict(changes)))


def changes_of(value: str) -> dict[str, Any]:
    """
    Return what a recorded control of ``PARAMETERS`` changed.

    Raises
    ------
    ValueError
        If it is not JSON of values by key.

    """
    changes = json.loads(value)
    if not isinstance(changes, dict):
        raise ValueError(f'a control of parameters that has no keys: {value!r}')
    return changes


def repeat(stream: Stream, name: str, value: str) -> list[Estimate]:
    """
    Do a recorded control again; what was recorded before it is released first.

    Raises
    ------
    ValueError
        For a control that there is not, or parameters that are not taken.

    """
    if name != PARAMETERS:
        return stream.control(name, value)
    estimates = stream.finish()
    apply(stream, changes_of(value))
    return estimates
