"""Which settings a saved state belongs to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rovid_core.settings.run import Settings
from rovid_ros.config.keys import KEYS

_FORCE = ('names', 'offset', 'scale', 'deadband', 'limit', 'model', 'gain', 'reverse',
          'polynomial', 'table_command', 'table_force', 'delay', 'time_constant', 'hold',
          'allocation', 'sign.topic')
_UNITS = ('dofs', 'identifier.method', 'frames', 'depth.scale', 'attitude.unit',
          'attitude.heading',
          *(f'thrusters.{name}' for name in _FORCE))

LONGEST = 60  # characters of a value in a message


def fingerprint(settings: Settings) -> dict[str, Any]:
    """
    Return the keys that give the identified parameters their meaning, with their values.

    These are the method, the degrees of freedom and their terms, what a force and a length are,
    and the initial and typical values, which the identifiers count in. Topics, gains and limits
    can change.
    """
    values = {}
    for key in KEYS:
        if key.name in _UNITS or key.name.partition('.')[0] in settings.dofs and (
                '.initial.' in key.name or '.typical.' in key.name
                or key.name.endswith('.terms')):
            value = _value(settings, key.setting)
            if value is not None:
                values[key.name] = value
    return values


def difference(saved: object, mine: Mapping[str, Any]) -> str:
    """Return in which key a saved fingerprint differs from one's own, '' if in none."""
    if not isinstance(saved, Mapping):
        return 'was made with no settings'
    for name in [*mine, *saved]:
        if saved.get(name) != mine.get(name):
            return (f'was made with {name} {_text(saved.get(name))}, configured is '
                    f'{_text(mine.get(name))}')
    return ''


def _value(settings: Settings, setting: str) -> Any:
    """Return a setting by its dotted name; None for a DOF that there is not."""
    found: Any = settings
    for name in setting.split('.'):
        found = found.get(name) if isinstance(found, Mapping) else getattr(found, name)
        if found is None:
            return None
    return _listed(found)


def _listed(value: Any) -> Any:
    return [_listed(x) for x in value] if isinstance(value, tuple) else value


def _text(value: Any) -> str:
    text = str(value)
    return text if len(text) <= LONGEST else f'{text[:LONGEST]}...'
