"""
``rovid export``: identified parameters for other programs.

yaml
    The initial values of a ROS 2 parameter file, to merge into the vehicle's own.
csv
    A table: one row per degree of freedom, all parameters and their units.
sdf
    Gazebo Sim's hydrodynamics plugin; see :mod:`rovid_ros.export_sdf`.
"""

from __future__ import annotations

from collections.abc import Sequence
import csv
from dataclasses import dataclass
import io
from pathlib import Path
import sys

from rovid_core.model.dofs import PARAMETERS, PHYSICAL
from rovid_core.settings.run import Settings
from rovid_ros.results.export_sdf import sdf
from rovid_ros.results.identified import Identified
from rovid_ros.results.text import number, unit


@dataclass(frozen=True)
class Export:
    """A document and what has to be said about it, one line each."""

    text: str
    notes: tuple[str, ...]


def export(models: Sequence[Identified], format: str, origin: Path, *,
           settings: Settings | None = None, link: str = 'base_link') -> Export:
    """
    Write identified parameters in another format.

    Parameters
    ----------
    models : sequence of Identified
        One per degree of freedom.
    format : str
        yaml, csv or sdf.
    origin : Path
        The file they are from, for a comment.
    settings : Settings, optional
        The vehicle's; sdf takes the dry masses from there.
    link : str
        The name of the link that the plugin acts on; sdf only.

    Raises
    ------
    ExportError
        If a dry mass is unknown or above the effective mass; sdf only.

    """
    notes = [note for model in models for note in _notes(model)]
    if format == 'csv':
        return Export(_csv(models), tuple(notes))
    if format == 'yaml':
        text, more = _yaml(models, origin)
    else:
        text, more = sdf(models, settings, link, origin)
    return Export(text, (*notes, *more))


def _notes(model: Identified) -> list[str]:
    """Return which model it is, where there was a choice, and what is doubtful in it."""
    notes = []
    if model.mae == model.mae:
        notes.append(f'{model.dof}: {model.source}, mean mae {number(model.mae)} '
                     f'{unit(model.dof, "mae")}')
    elif not model.status:
        notes.append(f'{model.dof}: {model.source}, not scored')
    if model.status in ('waiting', 'invalid'):
        was = 'nothing but the initial values' if model.status == 'waiting' else 'not valid'
        notes.append(f'warning: {model.dof}: is {model.status}: these parameters are {was}')
    return notes


def _csv(models: Sequence[Identified]) -> str:
    file = io.StringIO()
    writer = csv.writer(file, lineterminator='\n')
    names = (*PARAMETERS, *PHYSICAL)
    writer.writerow(['dof', *(column for name in names for column in (name, f'{name}_unit'))])
    for model in models:
        values = {**dict(zip(PARAMETERS, model.parameters)), **model.physical}
        row = [(repr(values[name]), _ascii(unit(model.dof, name))) for name in names]
        writer.writerow([model.dof, *(cell for pair in row for cell in pair)])
    return file.getvalue()


def _yaml(models: Sequence[Identified], origin: Path) -> tuple[str, list[str]]:
    lines = [f'# Identified by rovid, from {origin.name!r}: merge it into the parameter file of '
             'the\n# vehicle, in place of its initial values. Masses include the added mass.',
             '/**:', '  ros__parameters:']
    notes = []
    for model in models:
        lines += [f'    {model.dof}:  # {model.source}', '      initial:']
        for name, value in model.physical.items():
            comment = _ascii(unit(model.dof, name))
            if name != 'bias' and value < 0.0:
                notes.append(f'warning: {model.dof}.initial.{name}: takes 0 or more, identified '
                             f'is {value!r}: written as 0')
                comment, value = f'{comment}; identified: {value!r}', 0.0
            lines.append(f'        {name}: {_yaml_number(value)}  # [{comment}]')
    return '\n'.join(lines) + '\n', notes


def _yaml_number(value: float) -> str:
    """Return text that every reader of YAML takes for this very number."""
    if abs(value) < sys.float_info.min:
        return '0.0'  # ROS reads smaller ones as text
    mantissa, exponent, power = repr(value).partition('e')
    return f'{mantissa}{"" if "." in mantissa else ".0"}{exponent}{power}'


def _ascii(text: str) -> str:
    return text.replace('²', '^2')
