"""
``rovid export``: identified parameters for other programs.

yaml
    The initial values of a ROS 2 parameter file, to merge into the vehicle's own.
csv
    A table: one row per degree of freedom, all parameters and their units, couplings last.
sdf
    Gazebo Sim's hydrodynamics plugin.
urdf, ros-params, fossen
    See ``hydrodynamics.py``.

The plugin puts on the link, per degree of freedom, in the frame of the link (without the
Coriolis forces between DOFs, which it makes from the added masses, and without a current)::

    f = a v' + l v + q |v| v          a: xDotU ... nDotR, l: xU ... nR, q: xUabsU ... nRabsR

(``Hydrodynamics::PreUpdate``, gz-sim 7.5 and newer: the total wrench goes on the link with a
minus, and each of its terms has one), so all of them are negative or 0, as in Fossen's and
SNAME's notation. With the link's own mass m the motion is::

    m v' = tau + a v' + l v + q |v| v

and that of rovid is, with the effective mass M::

    M v' = tau - d_L v - d_Q v|v| - b

Hence a = -(M - m) with m = ``<dof>.dry_mass``, l = -d_L, q = -d_Q. The bias b has no place
in the plugin.

The link's axes have to be those of rovid: x forward, y left, z up, the convention of ROS and
of Gazebo. All these parameters are on the diagonal, and so are the same in a body frame with
y right and z down.

The plugin takes v' from the step before: where the added mass is not below the link's own, the
simulation diverges (gazebosim/gz-sim#1923), whatever the time step. DART, Gazebo's usual
engine, takes added mass in the link's ``<fluid_added_mass>`` instead, with positive values:
this is always stable, and is given in a comment.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import csv
from dataclasses import dataclass
import io
import math
from pathlib import Path
import re
import sys
import textwrap
from xml.sax.saxutils import escape

from rovid_core.model.dofs import DOFS, PARAMETERS, PHYSICAL
from rovid_core.settings.run import Settings
from rovid_ros.results.documents import Identified
from rovid_ros.results.hydrodynamics import (
    DIALECTS,
    dry_masses,
    fossen,
    left_out,
    ros_params,
    urdf,
    vehicle,
)
from rovid_ros.results.text import NO_NEWTONS, number, quantity, unit

_AXES = dict(zip(DOFS, ('xU', 'yV', 'zW', 'kP', 'mQ', 'nR')))
"""Force and velocity of each DOF in the notation of SNAME."""

_DRY = dict(zip(DOFS, ('mass', 'mass', 'mass', 'ixx', 'iyy', 'izz')))
_ADDED = dict(zip(DOFS, ('xx', 'yy', 'zz', 'pp', 'qq', 'rr')))
"""Elements in a link's ``<inertial>`` and in its ``<fluid_added_mass>``."""


FORMATS = ('yaml', 'sdf', 'csv', 'urdf', 'ros-params', 'fossen')


@dataclass(frozen=True)
class Export:
    """A document and what has to be said about it, one line each."""

    text: str
    notes: tuple[str, ...]


def export(models: Sequence[Identified], format: str, origin: Path, *,
           settings: Settings | None = None, link: str = 'base_link',
           dialect: str = DIALECTS[0]) -> Export:
    """
    Write identified parameters in another format.

    Parameters
    ----------
    models : sequence of Identified
        One per degree of freedom.
    format : str
        One of ``FORMATS``.
    origin : Path
        The file they are from, for a comment.
    settings : Settings, optional
        The vehicle's; all but yaml and csv take the dry masses from there.
    link : str
        The name of the link that the plugin acts on; sdf only.
    dialect : str
        Of ros-params, one of ``DIALECTS``.

    Raises
    ------
    HydrodynamicsError
        If a dry mass is unknown or above the effective mass; not for yaml and csv.

    """
    about = notes(models)
    if format == 'csv':
        return Export(_csv(models), tuple(about))
    if format == 'yaml':
        text, more = _yaml(models, origin)
    elif format == 'sdf':
        text, more = _sdf(models, settings, link, origin)
    else:
        found = vehicle(models, dry_masses(settings))
        more = left_out(models, format)
        text = ros_params(found, dialect, origin) if format == 'ros-params' else (
            urdf if format == 'urdf' else fossen)(found)
    return Export(text, (*about, *more))


def notes(models: Sequence[Identified]) -> list[str]:
    """Return which models they are, where there was a choice, and what is doubtful in them."""
    lines = []
    for model in models:
        if not math.isnan(model.mae):
            lines.append(f'{model.dof}: {model.source}, mean mae {number(model.mae)} '
                         f'{unit(model.dof, "mae")}')
        elif not model.status:
            lines.append(f'{model.dof}: {model.source}, not scored')
        if model.status in ('waiting', 'invalid'):
            was = 'nothing but the initial values' if model.status == 'waiting' else 'not valid'
            lines.append(f'warning: {model.dof}: is {model.status}: these parameters are {was}')
    if any(not model.newtons for model in models):
        lines.append(f'warning: {NO_NEWTONS}')
    return lines


def _csv(models: Sequence[Identified]) -> str:
    file = io.StringIO()
    writer = csv.writer(file, lineterminator='\n')
    names = (*PARAMETERS, *PHYSICAL)
    couplings = list(dict.fromkeys(name for model in models for name in model.couplings))
    writer.writerow(['dof', *(column for name in names for column in (name, f'{name}_unit')),
                     *(f'kappa_{name}' for name in couplings)])
    for model in models:
        values = {**dict(zip(PARAMETERS, model.parameters)), **model.physical}
        row = [(repr(values[name]), _unit(model, name)) for name in names]
        writer.writerow([model.dof, *(cell for pair in row for cell in pair),
                         *(repr(model.couplings[name]) if name in model.couplings else ''
                           for name in couplings)])
    return file.getvalue()


def _yaml(models: Sequence[Identified], origin: Path) -> tuple[str, list[str]]:
    lines = [f'# Identified by rovid, from {origin.name!r}: merge it into the parameter file of '
             'the\n# vehicle, in place of its initial values. Masses include the added mass.',
             '/**:', '  ros__parameters:']
    notes = []
    for model in models:
        lines += [f'    {model.dof}:  # {model.source}', '      initial:']
        for name, value in model.physical.items():
            comment = _unit(model, name)
            if name != 'bias' and value < 0.0:
                notes.append(f'warning: {model.dof}.initial.{name}: takes 0 or more, identified '
                             f'is {value!r}: written as 0')
                comment, value = f'{comment}; identified: {value!r}', 0.0
            lines.append(f'        {name}: {_yaml_number(value)}  # [{comment}]')
        if model.thrusters.curve:
            lines.append(f'      # of the thrusters as they are found: {model.thrusters.curve}')
        if model.couplings:  # without them these masses and drags are not right
            kappas = ', '.join(f'{name} {kappa!r}' for name, kappa in model.couplings.items())
            lines.append(
                f'      couplings: [{", ".join(model.couplings)}]  # identified: {kappas}')
    return '\n'.join(lines) + '\n', notes


def _yaml_number(value: float) -> str:
    """Return text that every reader of YAML takes for this very number."""
    if abs(value) < sys.float_info.min:
        return '0.0'  # ROS reads smaller ones as text
    mantissa, exponent, power = repr(value).partition('e')
    return f'{mantissa}{"" if "." in mantissa else ".0"}{exponent}{power}'


def _unit(model: Identified, name: str) -> str:
    return unit(model.dof, name, model.newtons).replace('²', '^2')


def _quantity(model: Identified, name: str) -> str:
    return quantity(model.dof, name, model.physical, model.newtons)


def _sdf(models: Sequence[Identified], settings: Settings | None, link: str,
        origin: Path) -> tuple[str, list[str]]:
    """Return the plugin's element and what has to be said about it, one line each."""
    found = {model.dof: model for model in models}
    whole = vehicle(models, dry_masses(settings))
    dry, added = [{dof: masses[DOFS.index(dof)] for dof in found}
                  for masses in (whole.dry, whole.added)]
    left_out = 'bias, which the plugin does not have: ' + ', '.join(
        f'{dof} {_quantity(model, "bias")}' for dof, model in found.items())
    left_out += '; that of heave is weight less buoyancy' if 'heave' in found else ''
    coupled = [f'{dof} {" ".join(model.couplings)}' for dof, model in found.items()
               if model.couplings]
    if coupled:
        left_out += (f'; couplings: {", ".join(coupled)}: the plugin makes the Coriolis forces '
                     'among them of the masses by itself')
    curves = [f'{dof} {model.thrusters.curve}' for dof, model in found.items()
              if model.thrusters.curve]
    if curves:
        left_out += f'; that of the thrust asked for there is less: {", ".join(curves)}'
    lines = [
        '<plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">',
        _comment(f'Identified by rovid, from {origin.name!r}. For Gazebo Sim 7.5 or newer, and '
                 'a link with x forward, y left, z up that has the dry '
                 f'{", ".join(_dry_texts(dry))}. Negative values slow down.'),
        _comment(f'Left out: {left_out}.'),
        f'  <link_name>{escape(link)}</link_name>']
    for dof in DOFS:
        lines += _elements(dof, found.get(dof), added.get(dof, 0.0))
    elements = ''.join(f' <{_ADDED[dof]}>{value!r}</{_ADDED[dof]}>'
                       for dof, value in added.items())
    lines += [
        _comment('Better with the DART engine, and needed where the added mass is not below the '
                 "link's own: leave out the ...Dot... elements, and put into the link's inertial "
                 f'element <fluid_added_mass>{elements} </fluid_added_mass>'),
        '</plugin>']
    notes = [f'left out: {left_out}', *_identified_notes(found), *_mass_notes(dry, added)]
    return '\n'.join(lines) + '\n', notes


def _elements(dof: str, model: Identified | None, added: float) -> Iterator[str]:
    axis = _AXES[dof]
    force, speed = axis[0], axis[1]
    if model is None:
        yield _comment(f'{dof}: not identified')
        drags = (0.0, 0.0)
    else:
        yield _comment(f'{dof}: {model.source}')
        drags = (model.physical['linear_drag'], model.physical['quadratic_drag'])
    names = (f'{force}Dot{speed}', axis, f'{axis}abs{speed}')
    for name, value in zip(names, (added, *drags)):
        yield f'  <{name}>{0.0 - value!r}</{name}>'


def _identified_notes(found: Mapping[str, Identified]) -> Iterator[str]:
    others = [dof for dof in DOFS if dof not in found]
    if others:
        yield f'not identified and so 0: {", ".join(others)}'
    for dof, model in found.items():
        for name in ('linear_drag', 'quadratic_drag'):
            if model.physical[name] < 0.0:
                yield (f'warning: {dof}: the {name.replace("_", " ")} is '
                       f'{_quantity(model, name)}: it drives the vehicle instead of '
                       'slowing it down')


def _mass_notes(dry: Mapping[str, float], added: Mapping[str, float]) -> Iterator[str]:
    unstable = [dof for dof in dry if added[dof] >= dry[dof]]
    if unstable:
        yield (f'warning: {", ".join(unstable)}: the added mass is not below the dry mass: the '
               "plugin's way to put it on diverges; take <fluid_added_mass> from the last comment")


def _dry_texts(dry: Mapping[str, float]) -> list[str]:
    texts = [f'{_DRY[dof]} {value:g} {unit(dof, "mass")}' for dof, value in dry.items()]
    return list(dict.fromkeys(texts))


def _comment(text: str) -> str:
    """Return an XML comment, which cannot have two hyphens in a row."""
    lines = textwrap.wrap(re.sub('-(?=-)', '- ', text), 90, break_long_words=False,
                          break_on_hyphens=False)
    return f'  <!-- {chr(10).join(lines)} -->'.replace('\n', '\n       ')
