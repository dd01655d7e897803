"""One parameter: its name, type, default, unit, range and meaning."""

from __future__ import annotations

from dataclasses import dataclass, fields, MISSING
from typing import Any

LARGE = 1e12
"""Bound of a number that needs none; it still keeps NaN and infinity out."""

# type, size and default of a key by the annotation of its setting
_TYPES: dict[str, tuple[str, int, Any]] = {
    'float': ('double', 0, 0.0),
    'bool': ('bool', 0, False),
    'str': ('string', 0, ''),
    'tuple[float, ...]': ('double[]', 0, ()),
    'tuple[float, float, float]': ('double[]', 3, ()),
    'tuple[str, ...]': ('string[]', 0, ()),
    'tuple[tuple[float, ...], ...]': ('double[]', 0, ()),
}


@dataclass(frozen=True)
class Key:
    """
    One parameter.

    Attributes
    ----------
    name : str
        As in the parameter file, dotted: ``thrusters.gain``.
    setting : str
        Where its value goes in :class:`rovid_core.settings.Settings`, dotted.
    type : str
        double, bool, string, double[] or string[].
    default : bool, float, str or tuple
        Its value when it is not given.
    description : str
        What it means.
    unit : str
        Unit, '' if it has none.
    low, high : float
        Range of a number, or of each number of an array.
    choices : tuple of str
        The texts that it takes; none: any.
    size : int
        Number of entries of an array; 0: any.
    live : bool
        Whether the node takes another value while it runs.

    """

    name: str
    setting: str
    type: str
    default: Any
    description: str
    unit: str = ''
    low: float = -LARGE
    high: float = LARGE
    choices: tuple[str, ...] = ()
    size: int = 0
    live: bool = False

    @property
    def takes(self) -> str:
        """Return what the key takes, to end a sentence with."""
        unit = f' [{self.unit}]' if self.unit else ''
        bounds = ''
        if (self.low, self.high) != (-LARGE, LARGE):
            bounds = f' from {self.low:g} to {self.high:g}'
        count = f'{self.size} ' if self.size else ''
        return {
            'double': f'a number{bounds}{unit}',
            'bool': 'true or false',
            'string': 'one of ' + ', '.join(repr(c) for c in self.choices) if self.choices
                      else 'text',
            'double[]': f'a list of {count}numbers{bounds}{unit}',
            'string[]': 'a list of ' + (', '.join(self.choices) if self.choices else 'texts'),
        }[self.type]


def key_of(name: str, setting: str, owner: type, description: str, unit: str = '',
           low: float = -LARGE, high: float = LARGE, choices: tuple[str, ...] = (),
           live: bool = False) -> Key:
    """Return the key of a setting, with the type and default of the owner's field."""
    field = {f.name: f for f in fields(owner)}[setting.rpartition('.')[2]]
    kind, size, default = _TYPES[str(field.type)]
    if field.default is not MISSING:
        default = field.default
    return Key(name, setting, kind, default, description, unit, low, high, choices, size,
               live)


def in_group(group: str, owner: type, name: str, description: str, unit: str = '',
             low: float = -LARGE, high: float = LARGE, choices: tuple[str, ...] = (),
             live: bool = False) -> Key:
    """Return the key of a setting that has the same name in the file as in the settings."""
    dotted = f'{group}.{name}'
    return key_of(dotted, dotted, owner, description, unit, low, high, choices, live)
