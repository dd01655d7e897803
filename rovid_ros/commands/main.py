"""
The command ``rovid`` and the list of its subcommands.

The subcommand NAME is the module ``rovid_ros.commands.NAME``. It has ``DESCRIPTION``, what its
help says after the line in ``COMMANDS``; ``add_arguments``, which fills its parser; and ``run``,
which does the work. A module is imported only when its subcommand is on the command line, so
that ``rovid --help`` is instant and a missing library stops only the command that needs it.
"""

from __future__ import annotations

from collections.abc import Sequence
import os
import sys

# What each subcommand does, in the order of ``rovid --help``.
COMMANDS = {
    'init': 'write a parameter file from a log',
    'check': 'validate a parameter file',
    'replay': 'identify from recorded logs',
    'compare': 'identify by every method and score every model',
    'survey': 'identify every dive of a season and test what drifts',
    'simulate': 'write the log of a simulated vehicle',
    'tune': 'find delay, lag, dead-band, reverse thrust, heading offset, couplings and terms',
    'plan': 'propose the thrust profile to drive next',
    'export': 'write identified parameters for other programs',
}


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run the command and return the exit code.

    It is 0 done, 1 the input is at fault, 2 wrong usage, 130 Ctrl-C, 143 SIGTERM.
    """
    try:  # also an import can be interrupted
        return _main(sys.argv[1:] if argv is None else list(argv))
    except KeyboardInterrupt:
        print('rovid: interrupted', file=sys.stderr)
        return 130


def _main(arguments: list[str]) -> int:
    from rovid_ros.commands.running import open_standard_files, run_to_exit_code
    open_standard_files()
    if sys.stdout is not None and hasattr(sys.stdout, 'reconfigure'):
        sys.stdout.reconfigure(errors='replace')
    # The matrices are small: the threads of numpy cost more than they give, and take the cores
    # from the processes that work in parallel. It is read when numpy is imported.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    name = next((word for word in arguments if not word.startswith('-')), '')
    prog = f'rovid {name}' if name in COMMANDS else 'rovid'
    return run_to_exit_code(prog, lambda: _run(arguments, name))


def _run(arguments: list[str], name: str) -> None:
    from importlib import import_module

    from rovid_ros.commands.arguments import Parser, Version
    from rovid_ros.commands.running import USAGE, wrong_usage
    parser = Parser(
        prog='rovid', description='Identify mass, drag and bias of an underwater vehicle '
        'from a log of its positions and thruster commands.')
    parser.add_argument('--version', action=Version, nargs=0, help='show the version and exit')
    parser.set_defaults(run=None, prog=parser.prog)
    subparsers = parser.add_subparsers(title='commands', metavar='COMMAND')
    for command, does in COMMANDS.items():
        subparser = subparsers.add_parser(command, help=does)
        if command == name:
            module = import_module(f'rovid_ros.commands.{name}')
            subparser.description = f'{does[0].upper()}{does[1:]}. {module.DESCRIPTION}'
            module.add_arguments(subparser)
            subparser.set_defaults(run=module.run, prog=subparser.prog)
    args, unknown = parser.parse_known_args(arguments)
    if unknown:
        wrong_usage(args.prog, f'unrecognized arguments: {" ".join(unknown)}')
    if args.run is None:
        parser.print_help(sys.stderr)
        raise SystemExit(USAGE)
    args.run(args)
