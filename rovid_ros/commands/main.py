"""
The command ``rovid``: its subcommands.

A subcommand's modules are imported when it runs, so that ``rovid --help`` is instant and
a missing library only stops the command that needs it.
"""

from __future__ import annotations

from collections.abc import Sequence
import sys

from rovid_ros.commands import (
    check_arguments as check,
    log_arguments as logs,
    model_arguments as models,
)
from rovid_ros.commands.arguments import Parser, Version, wrong_usage
from rovid_ros.commands.ending import DONE, guarded, USAGE


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


def _parser() -> Parser:
    parser = Parser(
        prog='rovid', description='Identify mass, drag and bias of an underwater vehicle '
        'from a log of its positions and thruster commands.')
    parser.add_argument('--version', action=Version, nargs=0, help='show the version and exit')
    parser.set_defaults(run=None, prog=parser.prog)
    commands = parser.add_subparsers(title='commands', metavar='COMMAND')
    check.add_check(commands)
    logs.add_replay(commands)
    logs.add_compare(commands)
    models.add_simulate(commands)
    logs.add_tune(commands)
    models.add_plan(commands)
    models.add_export(commands)
    return parser
