"""
The command ``rovid``: its subcommands and their arguments.

A subcommand's modules are imported when it runs, so that ``rovid --help`` is instant and
a missing library only stops the command that needs it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
import math
from pathlib import Path
import sys
from typing import Any, NoReturn, TYPE_CHECKING

from rovid_ros import __version__
from rovid_ros.command import (
    check_written,
    CommandError,
    DONE,
    guarded,
    read_settings,
    read_values,
    USAGE,
    UsageError,
)

if TYPE_CHECKING:
    from rovid_core.settings import Settings
    from rovid_ros.feeder import Feeder


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        print(f'{self.prog}: {message} (see {self.prog} --help)', file=sys.stderr)
        raise SystemExit(USAGE)


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
        0 done, 1 the input is at fault, 2 wrong usage, 130 interrupted.

    """
    if sys.stdout is not None and hasattr(sys.stdout, 'reconfigure'):
        sys.stdout.reconfigure(errors='replace')
    parser = _parser()
    try:
        args = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or DONE)
    if args.run is None:
        parser.print_help(sys.stderr)
        return USAGE
    return guarded(args.prog, lambda: args.run(args))


def _replay(args: argparse.Namespace) -> None:
    from rovid_ros.feeder import PipeFeeder
    from rovid_ros.json_file import write_json
    from rovid_ros.replay import replay
    from rovid_ros.report import report
    if args.rate is not None and not args.ros:
        raise UsageError('--rate goes with --ros')
    check_written([args.output, args.json], [*args.logs, args.params_file])
    settings = read_settings(args.params_file, args.method)

    def warn(line: str) -> None:
        print(f'{args.prog}: warning: {line}', file=sys.stderr)

    feeder = _node(args, settings) if args.ros else PipeFeeder(settings)
    result = replay(
        args.logs, settings, feeder, output=args.output, start=args.start,
        duration=args.duration, warn=warn)
    if args.json:
        write_json(args.json, result.document())
    print(report(result))
    for path in filter(None, (args.output, args.json)):
        print(f'written   {path}')


def _simulate(args: argparse.Namespace) -> None:
    from rovid_ros.simulate import simulate_log
    check_written([args.output], [args.params_file])
    settings = read_settings(args.params_file)
    count = simulate_log(settings, args.output, args.duration, args.seed, args.profile)
    print(f'{args.output}: {args.duration:,.1f} s, {count:,} messages, seed {args.seed}\n'
          f'identify it with: rovid replay {args.output} --params-file {args.params_file}')


def _node(args: argparse.Namespace, settings: Settings) -> Feeder:
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        raise CommandError(f'--ros needs ROS 2, which is not installed here: {error}') from None
    from rovid_ros.node_replay import NodeFeeder
    try:
        return NodeFeeder(read_values(args.params_file, args.method), settings, args.rate)
    except RuntimeError as error:  # of rcl, such as for an impossible ROS_DOMAIN_ID
        raise CommandError(f'--ros: {error}') from None


def _number(text: str, low: float, strict: bool) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value < low or (strict and value == low):
        takes = f'a number {"above" if strict else "from"} {low:g}'
        raise argparse.ArgumentTypeError(f'got {text!r}, takes {takes}')
    return value


def _not_negative(text: str) -> float:
    return _number(text, 0.0, False)


def _positive(text: str) -> float:
    return _number(text, 0.0, True)


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f'got {text!r}, takes a whole number from 0')
    return int(text)


def _profile(text: str) -> Any:
    from rovid_ros.simulate import parse_profile
    try:
        return parse_profile(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _parser() -> _Parser:
    parser = _Parser(
        prog='rovid', description='Identify mass, drag and bias of an underwater vehicle '
        'from a log of its positions and thruster commands.')
    parser.add_argument('--version', action='version', version=f'rovid {__version__}')
    parser.set_defaults(run=None)
    commands = parser.add_subparsers(title='commands', metavar='COMMAND')
    _add_replay(commands)
    _add_simulate(commands)
    return parser


def _command(commands: Any, name: str, run: Callable[[argparse.Namespace], None],
             does: str, more: str) -> _Parser:
    command: _Parser = commands.add_parser(
        name, help=does, description=f'{does[0].upper()}{does[1:]}. {more}')
    command.add_argument(
        '--params-file', type=Path, required=True, metavar='FILE',
        help="the vehicle's parameter file, the same as the node's")
    command.set_defaults(run=run, prog=command.prog)
    return command


def _add_replay(commands: Any) -> None:
    command = _command(
        commands, 'replay', _replay, 'identify from recorded logs',
        'Prints the parameters of each degree of freedom, how well they predict the log, and '
        'what was refused.')
    command.add_argument(
        'logs', nargs='+', type=Path, metavar='LOG',
        help='.mcap, .db3 or .bag file or rosbag2 directory; several are joined in time order')
    command.add_argument(
        '--method', default='', metavar='M', help="use this method, not the file's")
    command.add_argument(
        '--output', type=Path, metavar='OUT.mcap',
        help='write the output topics, as the node would publish them')
    command.add_argument(
        '--json', type=Path, metavar='OUT.json', help='write the result for a program to read')
    command.add_argument(
        '--start', type=_not_negative, default=0.0, metavar='S',
        help="begin S seconds after the log's beginning")
    command.add_argument(
        '--duration', type=_positive, metavar='S', help='use S seconds of the log')
    command.add_argument(
        '--ros', action='store_true', help='go through the real node and publish')
    command.add_argument(
        '--rate', type=_positive, metavar='R',
        help='with --ros: R times real time (default: as fast as it goes)')


def _add_simulate(commands: Any) -> None:
    command = _command(
        commands, 'simulate', _simulate, 'write the log of a simulated vehicle',
        'Its parameters are those under "simulation" in the file; the log says them under the '
        'MCAP metadata rovid_truth. The same seed gives the same file.')
    command.add_argument('--output', type=Path, required=True, metavar='OUT.mcap')
    command.add_argument(
        '--duration', type=_positive, default=600.0, metavar='S',
        help='length [s] (default: 600)')
    command.add_argument(
        '--seed', type=_seed, default=1, metavar='N', help='of the noise (default: 1)')
    command.add_argument(
        '--profile', type=_profile, metavar='P',
        help='thrust amplitudes [N or N m] @ frequencies [Hz], such as '
             'surge=120@0.083+60@0.04,yaw=20@0.05')
