"""``rovid check``: its arguments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rovid_ros.commands import handlers
from rovid_ros.commands.arguments import add_command, duration, not_negative, positive


def add_check(commands: Any) -> None:
    """Add ``rovid check``."""
    command = add_command(
        commands, 'check', handlers.check, 'validate a parameter file',
        'By itself; with logs, against what they hold and what the pipe would make of it; with '
        '--live, against the ROS graph and what comes in some seconds. Prints how the file is '
        'read, then a line for each finding: OK, WARNING or ERROR. Exits with 1 if there is an '
        'ERROR.', params_file=None)
    command.add_argument(
        'params_file', type=Path, metavar='FILE',
        help="the vehicle's parameter file, the same as the node's")
    command.add_argument(
        'logs', nargs='*', default=[], type=Path, metavar='LOG',
        help='.mcap, .db3 or .bag file or rosbag2 directory; several are joined in time order')
    command.add_argument('--live', action='store_true', help='against the ROS graph')
    command.add_argument(
        '--timeout', type=positive, metavar='S',
        help='with --live: listen for S seconds (default: 5)')
    command.add_argument(
        '--namespace', default='', metavar='NS',
        help='with --live: of the node; relative topics are in it')
    command.add_argument(
        '--json', type=Path, metavar='OUT.json', help='write the findings for a program to read')
    command.add_argument(
        '--start', type=not_negative, metavar='S',
        help="begin S seconds after the log's beginning")
    command.add_argument(
        '--duration', type=duration, metavar='S', help='use S seconds of the log')
