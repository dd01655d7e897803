"""Arguments that several commands take, and what a value on the command line may be."""

from __future__ import annotations

import argparse
from dataclasses import replace
import difflib
import math
from pathlib import Path
import re
from typing import Any, NoReturn

from rovid_core.model.dofs import DOFS
from rovid_ros.commands.running import wrong_usage

MIN_DURATION = 1e-3  # [s] a shorter part of a log holds no message
MAX_NUMBER = 1e9  # a longer time [s] does not fit the time stamps of ROS; nothing else is so large


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, with the nearest of the choices."""

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, **options)

    def error(self, message: str) -> NoReturn:
        found = re.fullmatch(r".*invalid choice: '(.*)' \(choose from (.*)\)", message)
        near = found and difflib.get_close_matches(found[1], re.findall(r'[\w-]+', found[2]), 1)
        hint = f'; did you mean {near[0]!r}?' if near else ''
        wrong_usage(self.prog, message + hint)


class Version(argparse.Action):
    """Print the version, which only then is looked up."""

    def __call__(self, parser: argparse.ArgumentParser, *given: Any) -> NoReturn:
        """Print it and exit."""
        from rovid_ros import build
        print(f'{parser.prog} {build()}')
        parser.exit()


class AddToSource(argparse.Action):
    """Add a file or an override to where the parameters come from."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace,
                 value: Any, option: str | None = None) -> None:
        """Add it."""
        from rovid_ros.config.parameter_file import ParameterSource  # only for who needs it
        known = getattr(namespace, self.dest) or ParameterSource()
        if isinstance(value, Path):
            known = replace(known, paths=(*known.paths, value))
        else:
            known = replace(known, overrides=(*known.overrides, value))
        setattr(namespace, self.dest, known)


def add_params_file(command: argparse.ArgumentParser, required: bool = True) -> None:
    """Let a command take ``--params-file`` and ``-p``, several times each, as the node does."""
    command.add_argument(
        '--params-file', type=Path, required=required, metavar='FILE', action=AddToSource,
        help="the vehicle's parameter file, the same as the node's; of several, the later wins")
    command.add_argument('-p', metavar='KEY:=VALUE', action=AddToSource, dest='params_file',
                         help='a parameter that wins over the files')


def add_logs(command: argparse.ArgumentParser, nargs: str = '+') -> None:
    """Let a command take logs that are parts of one."""
    command.add_argument(
        'logs', nargs=nargs, default=[], type=Path, metavar='LOG',
        help='.mcap, .db3, .bag or .BIN file, or rosbag2 directory; several are joined in time '
             'order')


def add_part(command: argparse.ArgumentParser) -> None:
    """Let a command take the same part of each of its logs."""
    command.add_argument('--start', type=not_negative, default=0.0, metavar='S',
                         help="begin S seconds after the log's beginning")
    command.add_argument('--duration', type=duration, metavar='S', help='use S seconds of the log')


def add_json(command: argparse.ArgumentParser, what: str) -> None:
    """Let a command write ``what`` with ``--json``."""
    command.add_argument(
        '--json', type=Path, metavar='OUT.json', help=f'write the {what} for a program to read')


def not_negative(text: str) -> float:
    """Return a number from 0."""
    return _number(text, 0.0)


def positive(text: str) -> float:
    """Return a number above 0."""
    return _number(text, 0.0, strict=True)


def duration(text: str) -> float:
    """Return a length of time [s] that can hold a message."""
    return _number(text, MIN_DURATION)


def seed(text: str) -> int:
    """Return a whole number from 0."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f'got {text!r}, takes a whole number from 0')
    return int(text)


def count(text: str) -> int:
    """Return a whole number from 1."""
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f'got {text!r}, takes a whole number from 1')
    return int(text)


def mcap(text: str) -> Path:
    """Return the path of an MCAP file to write."""
    return _named(text, '.mcap')


def html(text: str) -> Path:
    """Return the path of a report to write."""
    return _named(text, '.html')


def dofs(text: str) -> tuple[str, ...]:
    """Return degrees of freedom, separated by commas."""
    return tuple([_dof(name.strip(), text) for name in text.split(',')])


def per_dof(text: str) -> dict[str, float]:
    """Return numbers above 0 by DOF; one without a name is under ''."""
    values: dict[str, float] = {}
    for part in text.split(','):
        name, equals, value = part.rpartition('=')
        dof = _dof(name.strip(), text) if equals else ''
        if dof in values:
            raise argparse.ArgumentTypeError(f'got {text!r}, which says {dof or "it"} twice')
        values[dof] = positive(value.strip())
    return values


def factor(text: str) -> float:
    """Return a factor from 1 to 10."""
    value = _number(text, 1.0)
    if value > 10.0:
        raise argparse.ArgumentTypeError(f'got {text!r}, takes a factor from 1 to 10')
    return value


def _named(text: str, suffix: str) -> Path:
    """Return the path of a file to write; one without a suffix can be a device."""
    path = Path(text)
    if path.suffix not in ('', suffix):
        raise argparse.ArgumentTypeError(f'got {text!r}, takes a name that ends in {suffix}')
    return path


def _dof(name: str, text: str) -> str:
    if name not in DOFS:
        near = difflib.get_close_matches(name, DOFS, 1)
        hint = f'; did you mean {near[0]!r}?' if near else ''
        raise argparse.ArgumentTypeError(f'got {text!r}, takes some of {", ".join(DOFS)}{hint}')
    return name


def _number(text: str, low: float, strict: bool = False) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= MAX_NUMBER or (strict and value == low):
        raise argparse.ArgumentTypeError(
            f'got {text!r}, takes a number {"above" if strict else "from"} {low:g} '
            f'up to {MAX_NUMBER:g}')
    return value
