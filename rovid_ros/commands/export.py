"""``rovid export``: write identified parameters for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from rovid_core.settings.run import Settings
from rovid_ros.commands.arguments import add_params_file
from rovid_ros.commands.running import (
    check_written,
    print_written,
    read_settings,
    tell,
    UsageError,
)
from rovid_ros.files.whole_files import write_text
from rovid_ros.results.documents import Identified, read_estimates
from rovid_ros.results.export import export, FORMATS, notes
from rovid_ros.results.hydrodynamics import (
    DIALECTS,
    dry_masses,
    left_out,
    RobotFile,
    vehicle,
)

DESCRIPTION = (
    'yaml: initial values for a parameter file; csv: a table; sdf: the hydrodynamics plugin of '
    'Gazebo Sim; urdf: the <hydrodynamics> of auv_controllers; ros-params: the parameters of blue '
    'or uuv_simulator; fossen: M, D_l and D_q as matrices, in JSON. All but yaml and csv need the '
    'dry masses of a parameter file.')


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid export`` takes."""
    add_params_file(command, required=False)
    command.add_argument(
        'estimates', type=Path, metavar='ESTIMATES.json', help='of rovid replay or compare')
    command.add_argument('--format', required=True, choices=FORMATS)
    command.add_argument(
        '--output', type=Path, metavar='FILE', help='where to write it (default: print it)')
    command.add_argument(
        '--method', default='', metavar='M', help="of a comparison: take this method's models "
        '(default for each degree of freedom: the lowest mean mae over all logs)')
    command.add_argument('--trained-on', default='', metavar='LOG',
                         help='of a comparison: take models trained on this log')
    command.add_argument('--link', type=_link, metavar='NAME',
                         help='with sdf: the link of the model to act on (default: base_link)')
    command.add_argument('--into', type=Path, metavar='ROBOT.urdf',
                         help='with urdf: a file to edit; only values of identified degrees of '
                              'freedom change, and its own mass and inertia are the dry ones')
    command.add_argument('--dialect', choices=DIALECTS,
                         help='with ros-params: who reads it (default: blue)')


def run(args: argparse.Namespace) -> None:
    """Run ``rovid export``."""
    if args.link and args.format != 'sdf':
        raise UsageError('--link goes with --format sdf')
    if args.into and (args.format != 'urdf' or args.output):
        raise UsageError('--into goes with --format urdf, in place of --output')
    if args.dialect and args.format != 'ros-params':
        raise UsageError('--dialect goes with --format ros-params')
    check_written([args.output, args.into], [
        args.estimates, *(args.params_file.paths if args.params_file else ())])
    settings = read_settings(args.params_file) if args.params_file else None
    models = read_estimates(args.estimates, args.method, args.trained_on)
    if args.into:
        _edit(args, models, settings)
        return
    made = export(models, args.format, args.estimates, settings=settings,
                  link=args.link or 'base_link', dialect=args.dialect or DIALECTS[0])
    for line in made.notes:
        tell(f'{args.prog}: {line}')
    if args.output:
        write_text(args.output, made.text)
        print_written(args.output)
    else:
        print(made.text, end='')


def _edit(args: argparse.Namespace, models: list[Identified], settings: Settings | None) -> None:
    """Put the models into a URDF file."""
    robot = RobotFile(args.into)
    found = vehicle(models, robot.dry if robot.has_element else dry_masses(settings))
    text = robot.edited(found)
    for line in (*notes(models), *left_out(models, args.format, edits=True)):
        tell(f'{args.prog}: {line}')
    write_text(args.into, text)
    print_written(args.into)


def _link(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise argparse.ArgumentTypeError(f'got {text!r}, takes the name of a link')
    return text
