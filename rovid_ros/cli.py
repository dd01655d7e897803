"""
The command ``rovid``: its subcommands and their arguments.

A subcommand's modules are imported when it runs, so that ``rovid --help`` is instant and
a missing library only stops the command that needs it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
import sys
import textwrap
from typing import Any

from rovid_ros import __version__, handlers
from rovid_ros.arguments import (
    dofs,
    duration,
    factor,
    mcap,
    not_negative,
    Parser,
    per_dof,
    positive,
    seed,
    wrong_usage,
)
from rovid_ros.command import DONE, guarded, USAGE


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run the command.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; those of the process when left out.

    Returns
    -------
    code : int
        0 done, 1 the input is at fault, 2 wrong usage, 130 Ctrl-C, 143 SIGTERM.

    """
    if sys.stdout is not None and hasattr(sys.stdout, 'reconfigure'):
        sys.stdout.reconfigure(errors='replace')
    parser = _parser()
    try:
        args, unknown = parser.parse_known_args(argv)
        if unknown:
            wrong_usage(args.prog, f'unrecognized arguments: {" ".join(unknown)}')
    except SystemExit as stop:
        return int(stop.code or DONE)
    if args.run is None:
        parser.print_help(sys.stderr)
        return USAGE
    return guarded(args.prog, lambda: args.run(args))


def _profile(text: str) -> Any:
    from rovid_ros.profile_text import parse_profile
    try:
        return parse_profile(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _link(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise argparse.ArgumentTypeError(f'got {text!r}, takes the name of a link')
    return text


def _parser() -> Parser:
    parser = Parser(
        prog='rovid', description='Identify mass, drag and bias of an underwater vehicle '
        'from a log of its positions and thruster commands.')
    parser.add_argument('--version', action='version', version=f'rovid {__version__}')
    parser.set_defaults(run=None, prog=parser.prog)
    commands = parser.add_subparsers(title='commands', metavar='COMMAND')
    _add_replay(commands)
    _add_compare(commands)
    _add_simulate(commands)
    _add_tune(commands)
    _add_plan(commands)
    _add_export(commands)
    return parser


def _command(commands: Any, name: str, run: Callable[[argparse.Namespace], None],
             does: str, more: str, params_file: bool = True) -> Parser:
    command: Parser = commands.add_parser(
        name, help=does, description=f'{does[0].upper()}{does[1:]}. {more}')
    command.add_argument(
        '--params-file', type=Path, required=params_file, metavar='FILE',
        help="the vehicle's parameter file, the same as the node's")
    command.set_defaults(run=run, prog=command.prog)
    return command


def _add_part(command: argparse.ArgumentParser) -> None:
    """Let a command take the same part of each of its logs."""
    command.add_argument(
        '--start', type=not_negative, default=0.0, metavar='S',
        help="begin S seconds after the log's beginning")
    command.add_argument(
        '--duration', type=duration, metavar='S', help='use S seconds of the log')


def _add_replay(commands: Any) -> None:
    command = _command(
        commands, 'replay', handlers.replay, 'identify from recorded logs',
        'Prints the parameters of each degree of freedom, how well they predict the log, and '
        'what was refused.')
    command.add_argument(
        'logs', nargs='+', type=Path, metavar='LOG',
        help='.mcap, .db3 or .bag file or rosbag2 directory; several are joined in time order')
    command.add_argument(
        '--method', default='', metavar='M', help="use this method, not the file's")
    command.add_argument(
        '--output', type=mcap, metavar='OUT.mcap',
        help='write the output topics, as the node would publish them')
    command.add_argument(
        '--json', type=Path, metavar='OUT.json', help='write the result for a program to read')
    _add_part(command)
    command.add_argument(
        '--checkpoint', type=Path, metavar='STATE.json',
        help='save the state every checkpoint.period and at the end or Ctrl-C; where the file is '
             'there, go on from it')
    command.add_argument(
        '--append', action='store_true',
        help='with --checkpoint: the state is of earlier logs, and these follow them')
    command.add_argument(
        '--ros', action='store_true', help='go through the real node and publish')
    command.add_argument(
        '--rate', type=positive, metavar='R',
        help='with --ros: R times real time (default: as fast as it goes)')


def _add_compare(commands: Any) -> None:
    command = _command(
        commands, 'compare', handlers.compare, 'identify by every method and score every model',
        'Each log is a trial by itself: every method is trained on it, and each model predicts '
        'every log from its thrust alone.')
    command.add_argument(
        'logs', nargs='+', type=Path, metavar='LOG',
        help='.mcap, .db3 or .bag file, or rosbag2 directory')
    command.add_argument(
        '--validate', nargs='+', type=Path, metavar='LOG',
        help='logs to predict only, not to train on')
    command.add_argument(
        '--report', type=Path, metavar='OUT.html', help='write a report to look at and to send')
    command.add_argument(
        '--json', type=Path, metavar='OUT.json', help='write the models for a program to read')
    _add_part(command)


def _add_simulate(commands: Any) -> None:
    from rovid_ros.profile_text import GRAMMAR
    command = _command(
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


def _add_tune(commands: Any) -> None:
    command = _command(
        commands, 'tune', handlers.tune, 'find delay, lag, heading offset, cutoff and gains',
        'Tries them on blocks of the log that the model was not identified from, and writes a '
        'parameter file with what clearly predicts better; the rest of the file stays as it is.')
    command.add_argument(
        'logs', nargs='+', type=Path, metavar='LOG',
        help='.mcap, .db3 or .bag file or rosbag2 directory; several are joined in time order')
    command.add_argument(
        '--output', type=Path, required=True, metavar='TUNED.yaml',
        help='parameter file to write')
    command.add_argument(
        '--method', default='', metavar='M',
        help="tune for this method, not the file's; gains are those of aid")
    command.add_argument(
        '--json', type=Path, metavar='OUT.json', help='write the result for a program to read')
    _add_part(command)


def _add_plan(commands: Any) -> None:
    command = _command(
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


def _add_export(commands: Any) -> None:
    command = _command(
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


if __name__ == '__main__':
    sys.exit(main())
