"""``rovid export``: write identified parameters for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from rovid_ros.commands.arguments import add_params_file
from rovid_ros.commands.running import (
    check_written,
    print_written,
    read_settings,
    tell,
    UsageError,
)
from rovid_ros.files.whole_files import write_text
from rovid_ros.results.documents import read_estimates
from rovid_ros.results.export import export

DESCRIPTION = (
    'yaml: initial values for a parameter file; csv: a table; sdf: the hydrodynamics plugin of '
    'Gazebo Sim, which needs the dry masses of a parameter file.')


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid export`` takes."""
    add_params_file(command, required=False)
    command.add_argument(
        'estimates', type=Path, metavar='ESTIMATES.json', help='of rovid replay or compare')
    command.add_argument('--format', required=True, choices=('yaml', 'sdf', 'csv'))
    command.add_argument(
        '--output', type=Path, metavar='FILE', help='where to write it (default: print it)')
    command.add_argument(
        '--method', default='', metavar='M', help="of a comparison: take this method's models "
        '(default for each degree of freedom: the lowest mean mae over all logs)')
    command.add_argument('--trained-on', default='', metavar='LOG',
                         help='of a comparison: take models trained on this log')
    command.add_argument('--link', type=_link, metavar='NAME',
                         help='with sdf: the link of the model to act on (default: base_link)')


def run(args: argparse.Namespace) -> None:
    """Run ``rovid export``."""
    if args.link and args.format != 'sdf':
        raise UsageError('--link goes with --format sdf')
    check_written([args.output], [args.estimates, args.params_file])
    settings = read_settings(args.params_file) if args.params_file else None
    models = read_estimates(args.estimates, args.method, args.trained_on)
    made = export(models, args.format, args.estimates, settings=settings,
                  link=args.link or 'base_link')
    for line in made.notes:
        tell(f'{args.prog}: {line}')
    if args.output:
        write_text(args.output, made.text)
        print_written(args.output)
    else:
        print(made.text, end='')


def _link(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise argparse.ArgumentTypeError(f'got {text!r}, takes the name of a link')
    return text
