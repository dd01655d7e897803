"""The commands around a model: simulate one, plan the next trial, export: their arguments."""

from __future__ import annotations

import argparse
from pathlib import Path
import textwrap
from typing import Any

from rovid_ros.commands import handlers
from rovid_ros.commands.arguments import add_command, dofs, duration, factor, mcap, per_dof, seed
from rovid_ros.commands.profile_grammar import GRAMMAR


def add_simulate(commands: Any) -> None:
    """Add ``rovid simulate``."""
    command = add_command(
        commands, 'simulate', handlers.simulate, 'write the log of a simulated vehicle',
        'Its parameters are those under "simulation" in the file; the log says them under the '
        'MCAP metadata rovid_truth. The same seed gives the same file.')
    command.formatter_class = argparse.RawDescriptionHelpFormatter
    command.description = textwrap.fill(str(command.description), 78)
    command.epilog = GRAMMAR
    command.add_argument(
        '--output', type=mcap, required=True, metavar='OUT.mcap',
        help="{} in the name is the trial's number, such as trials/{}.mcap; without it, several "
             'trials go to OUT-1.mcap, OUT-2.mcap, ...')
    command.add_argument(
        '--duration', type=duration, default=600.0, metavar='S',
        help='length of each trial [s] (default: 600)')
    command.add_argument(
        '--seed', type=seed, default=1, metavar='N',
        help='of the noise (default: 1); of several trials the first has N, the next N+1, ...')
    command.add_argument(
        '--profile', type=_profile, action='append', metavar='P',
        help='thrust of a trial, see below; each further --profile is another trial')


def add_plan(commands: Any) -> None:
    """Add ``rovid plan``."""
    command = add_command(
        commands, 'plan', handlers.plan, 'propose the thrust profile to drive next',
        'Of the profiles that keep the limits it takes the one after which the least certain of '
        'mass, drags and bias is most certain, also where the model is wrong. Limits are one '
        'NUMBER for surge, sway and heave, or DOF=NUMBER[,DOF=NUMBER ...].')
    command.add_argument(
        'estimates', nargs='?', type=Path, metavar='ESTIMATES.json',
        help="of rovid replay or compare (default: the parameter file's initial values)")
    command.add_argument(
        '--dofs', type=dofs, default=(), metavar='DOF,...', help='plan these only')
    command.add_argument(
        '--duration', type=duration, default=300.0, metavar='S',
        help='length of the trial [s] (default: 300)')
    command.add_argument(
        '--max-force', type=per_dof, default={}, metavar='N',
        help='largest thrust [N or N m] (default: typical.force)')
    command.add_argument(
        '--max-speed', type=per_dof, default={}, metavar='V',
        help='largest speed [m/s or rad/s] (default: velocity.max)')
    command.add_argument(
        '--room', type=per_dof, default={}, metavar='M',
        help='largest distance from the start, to either side [m or rad] (default: no limit)')
    command.add_argument(
        '--factor', type=factor, default=2.0, metavar='F',
        help='by how much the mass and drags of the model may be wrong (default: 2)')
    command.add_argument(
        '--output', type=Path, metavar='FILE',
        help='write the profile: .csv: time and thrust; .yaml: the text for rovid simulate')
    command.add_argument(
        '--json', type=Path, metavar='OUT.json', help='write the plan for a program to read')


def add_export(commands: Any) -> None:
    """Add ``rovid export``."""
    command = add_command(
        commands, 'export', handlers.export, 'write identified parameters for other programs',
        'yaml: initial values for a parameter file; csv: a table; sdf: the hydrodynamics plugin '
        'of Gazebo Sim, which needs the dry masses of a parameter file.', params_file=False)
    command.add_argument(
        'estimates', type=Path, metavar='ESTIMATES.json', help='of rovid replay or compare')
    command.add_argument('--format', required=True, choices=('yaml', 'sdf', 'csv'))
    command.add_argument(
        '--output', type=Path, metavar='FILE', help='where to write it (default: print it)')
    command.add_argument(
        '--method', default='', metavar='M', help="of a comparison: take this method's models "
        '(default for each degree of freedom: the lowest mean mae over all logs)')
    command.add_argument(
        '--trained-on', default='', metavar='LOG',
        help='of a comparison: take models trained on this log')
    command.add_argument(
        '--link', type=_link, metavar='NAME',
        help='with sdf: the link of the model to act on (default: base_link)')


def _profile(text: str) -> Any:
    from rovid_ros.commands.profile_text import parse_profile
    try:
        return parse_profile(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _link(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise argparse.ArgumentTypeError(f'got {text!r}, takes the name of a link')
    return text
