"""
Identified parameters in the files of controllers and simulators that take all six axes.

All of them have the motion of Fossen (Handbook of Marine Craft, 2011), with diagonal matrices::

    (M_RB + M_A) v' + D_l v + D_q |v| v + g = tau

where M_RB is of the dry vehicle, and M_RB + M_A is the effective mass. They differ in signs. As
derivatives of the force (SNAME, such as Xdu = dX/du') added masses and drags are negative:
``urdf`` and ``ros-params`` of ``blue``. ``uuv_simulator`` has M_A positive and drags negative,
``fossen`` all matrices positive. Diagonal parameters are the same in a body with y left and z up
and in one with y starboard and z down; a bias of heave is weight less buoyancy in both.

urdf
    The ``<hydrodynamics>`` element that auv_controllers reads, by itself or into an existing file,
    of which only the values of identified axes change. There the mass and the moments of inertia
    of the file count, for the controller adds them to the added mass.
ros-params
    A ROS parameter file: ``hydrodynamics`` of ``blue``, or ``~mass``, ``~Ma`` ... of
    ``uuv_simulator``.
fossen
    M, D_l, D_q as six rows of six, and g, in JSON.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import json
import math
from pathlib import Path
import re
from xml.parsers import expat

from rovid_core.model.dofs import DOFS, LINEAR_DOFS
from rovid_core.settings.run import Settings
from rovid_ros.results.documents import Identified
from rovid_ros.results.text import unit

GRAVITY = 9.81
"""[m/s^2] As these programs have it."""

DENSITY = 1028.0
"""[kg/m^3] As uuv_simulator has it: it takes a volume in place of the buoyancy."""

DIALECTS = ('blue', 'uuv_simulator')

ADDED = ('Xdu', 'Ydv', 'Zdw', 'Kdp', 'Mdq', 'Ndr')
LINEAR = ('Xu', 'Yv', 'Zw', 'Kp', 'Mq', 'Nr')
QUADRATIC = ('Xuu', 'Yvv', 'Zww', 'Kpp', 'Mqq', 'Nrr')
INERTIA = ('ixx', 'iyy', 'izz')


class HydrodynamicsError(ValueError):
    """What the format needs is not known or not there; the text is the line to print."""


@dataclass(frozen=True)
class Vehicle:
    """
    What is known of a vehicle, per DOF in the order of ``DOFS``; 0 where it is not.

    Attributes
    ----------
    identified : tuple of bool
        Which DOFs were.
    dry, added, linear, quadratic : tuple of 6 floats
        [kg or kg m^2], [N s/m or N m s/rad], [N s^2/m^2 or N m s^2/rad^2], all positive.
    bias : tuple of 6 floats
        [N or N m]

    """

    identified: tuple[bool, ...]
    dry: tuple[float, ...]
    added: tuple[float, ...]
    linear: tuple[float, ...]
    quadratic: tuple[float, ...]
    bias: tuple[float, ...]

    @property
    def mass(self) -> float:
        """Return the dry mass [kg]."""
        return max(self.dry[:3])

    @property
    def buoyancy(self) -> float:
        """Return the buoyancy [N]; that of heave is weight less buoyancy."""
        return GRAVITY * self.mass - self.bias[2]


def vehicle(models: Sequence[Identified], dry: Callable[[str], float]) -> Vehicle:
    """
    Gather the models of a vehicle.

    Parameters
    ----------
    models : sequence of Identified
        One per degree of freedom.
    dry : callable
        The dry mass or moment of inertia of a DOF, 0 where it is unknown.

    Raises
    ------
    HydrodynamicsError
        If a dry mass is unknown or above the effective mass, or there are several.

    """
    found = {model.dof: model.physical for model in models}
    known = tuple([dry(dof) for dof in DOFS])
    # one mass has three names
    linear = [mass for dof, mass in zip(LINEAR_DOFS, known) if mass]
    if linear and min(linear) != max(linear):
        raise HydrodynamicsError('dry_mass: a vehicle has one mass, those of surge, sway and '
                                 f'heave are {", ".join(f"{m:g}" for m in linear)} kg')
    known = tuple([linear[0] if linear and dof in LINEAR_DOFS else mass
                   for dof, mass in zip(DOFS, known)])
    unknown = [f'{dof}.dry_mass' for dof, mass in zip(DOFS, known) if dof in found and not mass]
    if unknown:
        raise HydrodynamicsError(
            f'{unknown[0]}: is unknown, and the added mass is the effective mass less the '
            f'dry mass: give a --params-file with {", ".join(unknown)}')
    for dof, mass in zip(DOFS, known):
        if dof in found and found[dof]['mass'] < mass:
            kg = unit(dof, 'mass')
            raise HydrodynamicsError(
                f'{dof}.dry_mass: {mass!r} {kg} is above the identified effective mass '
                f'{found[dof]["mass"]!r} {kg}: the added mass cannot be negative')

    def each(name: str) -> tuple[float, ...]:
        return tuple([found[dof][name] if dof in found else 0.0 for dof in DOFS])

    return Vehicle(
        tuple([dof in found for dof in DOFS]), known,
        tuple([found[dof]['mass'] - mass if dof in found else 0.0
               for dof, mass in zip(DOFS, known)]),
        each('linear_drag'), each('quadratic_drag'), each('bias'))


def dry_masses(settings: Settings | None) -> Callable[[str], float]:
    """Return the dry mass of a DOF by the settings, 0 where it is unknown."""
    known = settings.dof if settings else {}
    return lambda dof: known[dof].dry_mass if dof in known else 0.0


def left_out(models: Sequence[Identified], format: str, edits: bool = False) -> list[str]:
    """Return what a format does not say of the models, one line each; ``edits`` a file."""
    lines = []
    others = [dof for dof in DOFS if dof not in {model.dof for model in models}]
    if others:
        lines.append(f'not identified: {", ".join(others)}: '
                     f'{"as they were in the file" if edits else "0"}')
    biases = [model.dof for model in models
              if model.physical['bias'] and (model.dof != 'heave')]
    if biases and format != 'fossen':
        lines.append(f'left out: the bias of {", ".join(biases)}')
    coupled = [f'{model.dof} {" ".join(model.couplings)}' for model in models if model.couplings]
    if coupled:
        lines.append(f'left out: couplings {", ".join(coupled)}; the Coriolis forces among them '
                     'follow from the masses')
    curves = [f'{model.dof} {model.thrusters.curve}' for model in models if model.thrusters.curve]
    if curves:
        lines.append(f'left out: of the thrust that is asked for there is less: '
                     f'{"; ".join(curves)}')
    return lines


# --- JSON for code of one's own


def fossen(found: Vehicle) -> str:
    """Return M, D_l and D_q as rows, and g, so that M v' + D_l v + D_q |v| v + g = tau."""
    mass = [a + b for a, b in zip(found.dry, found.added)]
    matrices = {'M': mass, 'D_l': found.linear, 'D_q': found.quadratic}
    about = {'axes': list(DOFS), 'identified': list(found.identified),
             'frame': 'body, x forward, y left, z up',
             'law': "M v' + D_l v + D_q |v| v + g = tau", 'g': list(found.bias)}
    lines = [f'"{name}": {json.dumps(value)}' for name, value in about.items()]
    for name, values in matrices.items():
        rows = ',\n    '.join([json.dumps(row) for row in _diagonal(values)])
        lines.append(f'"{name}": [\n    {rows}]')
    return '{\n  ' + ',\n  '.join(lines) + '\n}\n'


def _diagonal(values: Sequence[float]) -> list[list[float]]:
    return [[x if i == j else 0.0 for j in range(6)] for i, x in enumerate(values)]


# --- ROS parameters


def ros_params(found: Vehicle, dialect: str, origin: Path) -> str:
    """Return a parameter file of ``blue`` or of ``uuv_simulator``."""
    head = f'# Identified by rovid, from {origin.name!r}; {", ".join(DOFS)}'
    if dialect == 'uuv_simulator':
        rows = ',\n     '.join(map(_numbers, _diagonal(found.added)))
        return '\n'.join([
            head, f'mass: {found.mass!r}', f'volume: {found.buoyancy / GRAVITY / DENSITY!r}',
            f'density: {DENSITY!r}',
            f'inertial: {{{", ".join(f"{a}: {x!r}" for a, x in zip(INERTIA, found.dry[3:]))}, '
            'ixy: 0.0, ixz: 0.0, iyz: 0.0}',
            f'Ma: [{rows}]', f'linear_damping: {_negative(found.linear)}',
            f'quad_damping: {_negative(found.quadratic)}', ''])
    return '\n'.join([
        head, '/**:', '  ros__parameters:', '    hydrodynamics:',
        f'      mass: {found.mass!r}', f'      weight: {GRAVITY * found.mass!r}',
        f'      buoyancy: {found.buoyancy!r}',
        f'      moments_of_inertia: {_numbers(found.dry[3:])}',
        f'      added_mass: {_negative(found.added)}',
        f'      linear_damping: {_negative(found.linear)}',
        f'      quadratic_damping: {_negative(found.quadratic)}', ''])


def _negative(values: Sequence[float]) -> str:
    return _numbers([0.0 - x for x in values])


def _numbers(values: Sequence[float]) -> str:
    return f'[{", ".join(map(repr, values))}]'


# --- the element in a URDF


def urdf(found: Vehicle) -> str:
    """Return the element by itself."""
    moments = dict(zip(INERTIA, found.dry[3:]))
    center = {'x': 0.0, 'y': 0.0, 'z': 0.0}
    return '\n'.join([
        '<hydrodynamics>', '  <inertial>', f'    {_tag("mass", {"value": found.mass})}',
        f'    {_tag("inertia", moments)}', f'    {_tag("center_of_gravity", center)}',
        f'    {_tag("added_mass", _minus(ADDED, found.added))}', '  </inertial>', '  <damping>',
        f'    {_tag("linear", _minus(LINEAR, found.linear))}',
        f'    {_tag("quadratic", _minus(QUADRATIC, found.quadratic))}', '  </damping>',
        '  <hydrostatics>', f'    {_tag("buoyancy", {"value": found.buoyancy})}',
        f'    {_tag("center_of_buoyancy", center)}', '  </hydrostatics>', '</hydrodynamics>', ''])


def _tag(name: str, values: Mapping[str, float]) -> str:
    return f'<{name} {" ".join(f"{key}={_quoted(x)}" for key, x in values.items())}/>'


def _quoted(value: float) -> str:
    return f'"{value!r}"'


def _minus(names: Sequence[str], values: Sequence[float]) -> dict[str, float]:
    return {name: 0.0 - x for name, x in zip(names, values)}


class RobotFile:
    """
    A URDF (or xacro) file, whose ``<hydrodynamics>`` is edited with all else left as it is.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    HydrodynamicsError
        If it is not XML, or has several of the element or one that lacks a part.
    OSError
        If it cannot be read.

    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._data = path.read_bytes()
        try:
            self._data.decode()
        except UnicodeDecodeError as error:
            raise HydrodynamicsError(
                f'{path}: is not UTF-8 text (byte {error.start} of the file)') from None
        self._tags: dict[tuple[str, str], int] = {}  # where a tag begins, by parent and name
        self._root_end = -1
        open_tags: list[str] = []
        elements = 0
        parser = expat.ParserCreate()

        def start(name: str, attributes: dict[str, str]) -> None:
            nonlocal elements
            elements += name == 'hydrodynamics'
            if 'hydrodynamics' in open_tags:
                self._tags[open_tags[-1], name] = parser.CurrentByteIndex
            open_tags.append(name)

        def end(name: str) -> None:
            open_tags.pop()
            if not open_tags:
                self._root_end = parser.CurrentByteIndex

        parser.StartElementHandler, parser.EndElementHandler = start, end
        try:
            parser.Parse(self._data, True)
        except expat.ExpatError as error:
            raise HydrodynamicsError(f'{path}: is not XML: {error}') from None
        if elements > 1:
            raise HydrodynamicsError(f'{path}: has {elements} <hydrodynamics>, takes one')
        self.has_element = elements == 1
        if self.has_element:
            self._check_parts()

    def _check_parts(self) -> None:
        for parent, name in (('inertial', 'mass'), ('inertial', 'inertia'),
                             ('inertial', 'added_mass'), ('damping', 'linear'),
                             ('damping', 'quadratic'), ('hydrostatics', 'buoyancy')):
            if (parent, name) not in self._tags:
                raise HydrodynamicsError(
                    f'{self._path}: its <hydrodynamics> has no <{parent}><{name}>')

    def dry(self, dof: str) -> float:
        """Return the dry mass or moment of inertia of a DOF; HydrodynamicsError if none is."""
        tag, name = ('mass', 'value') if dof in LINEAR_DOFS else (
            'inertia', INERTIA[DOFS.index(dof) - 3])
        text = self._attribute(self._tag('inertial', tag), name)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 <= value < math.inf:
            raise HydrodynamicsError(f'{self._path}: {name} of its <{tag}> is {text!r}, takes a '
                                     'number: the added mass is the effective mass less that')
        return value

    def edited(self, found: Vehicle) -> str:
        """Return the file with the values of the identified DOFs."""
        if not self.has_element:
            if self._data[self._root_end:self._root_end + 2] != b'</':
                raise HydrodynamicsError(f'{self._path}: has no element to put it into')
            indented = ''.join(f'  {line}\n' for line in urdf(found).splitlines())
            end = self._root_end
            return (self._data[:end] + indented.encode() + self._data[end:]).decode()
        changes: dict[tuple[str, str], dict[str, float]] = {
            ('inertial', 'added_mass'): _minus(ADDED, found.added),
            ('damping', 'linear'): _minus(LINEAR, found.linear),
            ('damping', 'quadratic'): _minus(QUADRATIC, found.quadratic)}
        changes = {where: {name: x for (name, x), known in zip(values.items(), found.identified)
                           if known} for where, values in changes.items()}
        if found.identified[2]:
            changes['hydrostatics', 'buoyancy'] = {'value': found.buoyancy}
        data = self._data
        # from the end, so that the places before stay where they are
        for where in sorted(changes, key=lambda where: -self._tags[where]):
            tag = old = self._tag(*where)
            for name, value in changes[where].items():
                tag = _with_attribute(tag, name, value)
            at = self._tags[where]
            data = data[:at] + tag + data[at + len(old):]
        return data.decode()

    def _tag(self, parent: str, name: str) -> bytes:
        """Return the text of a start tag."""
        at = self._tags[parent, name]
        found = re.match(rb'<(?:[^>"\']|"[^"]*"|\'[^\']*\')*>', self._data[at:])
        assert found is not None  # it was parsed
        return found[0]

    def _attribute(self, tag: bytes, name: str) -> str:
        found = re.search(rb'\s' + name.encode() + rb'\s*=\s*("[^"]*"|\'[^\']*\')', tag)
        return found[1][1:-1].decode('utf-8', 'replace') if found else ''


def _with_attribute(tag: bytes, name: str, value: float) -> bytes:
    """Return a start tag with another value of an attribute, which is added if it lacks it."""
    text = f'{name}={_quoted(value)}'.encode()
    new, count = re.subn(rb'(?<=\s)' + name.encode() + rb'\s*=\s*("[^"]*"|\'[^\']*\')',
                         lambda match: text, tag)
    if count:
        return new
    return re.sub(rb'\s*(/?>)$', lambda match: b' ' + text + match[1], tag)
