"""The commands that read logs: their arguments."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rovid_ros.commands import handlers
from rovid_ros.commands.arguments import add_command, duration, mcap, not_negative, positive


def add_replay(commands: Any) -> None:
    """Add ``rovid replay``."""
    command = add_command(
        commands, 'replay', handlers.replay, 'identify from recorded logs',
        'Prints the parameters of each degree of freedom, how well they predict the log, and '
        'what was refused.')
    _add_logs(command)
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


def add_compare(commands: Any) -> None:
    """Add ``rovid compare``."""
    command = add_command(
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


def add_tune(commands: Any) -> None:
    """Add ``rovid tune``."""
    command = add_command(
        commands, 'tune', handlers.tune, 'find delay, lag, heading offset, cutoff and gains',
        'Tries them on blocks of the log that the model was not identified from, and writes a '
        'parameter file with what clearly predicts better; the rest of the file stays as it is.')
    _add_logs(command)
    command.add_argument(
        '--output', type=Path, required=True, metavar='TUNED.yaml',
        help='parameter file to write')
    command.add_argument(
        '--method', default='', metavar='M',
        help="tune for this method, not the file's; gains are those of aid")
    command.add_argument(
        '--json', type=Path, metavar='OUT.json', help='write the result for a program to read')
    _add_part(command)


def _add_logs(command: argparse.ArgumentParser) -> None:
    """Let a command take logs that are parts of one."""
    command.add_argument(
        'logs', nargs='+', type=Path, metavar='LOG',
        help='.mcap, .db3 or .bag file or rosbag2 directory; several are joined in time order')


def _add_part(command: argparse.ArgumentParser) -> None:
    """Let a command take the same part of each of its logs."""
    command.add_argument(
        '--start', type=not_negative, default=0.0, metavar='S',
        help="begin S seconds after the log's beginning")
    command.add_argument(
        '--duration', type=duration, metavar='S', help='use S seconds of the log')
