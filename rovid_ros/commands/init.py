"""``rovid init``: a configuration from a log that nobody has described."""

from __future__ import annotations

import argparse
from pathlib import Path
import sys

from rovid_ros.commands.arguments import add_logs, add_part, positive
from rovid_ros.commands.long_work import Progress
from rovid_ros.commands.running import (
    check_written,
    CommandError,
    print_written,
    read_settings,
    warn,
)
from rovid_ros.discovery.ardupilot import (
    dataflash_candidates,
    motors,
    paths as dataflash_paths,
    remarks,
)
from rovid_ros.discovery.candidates import Candidate, candidates
from rovid_ros.discovery.configuration import configuration
from rovid_ros.discovery.decisions import decide, Discovery, DiscoveryError
from rovid_ros.discovery.signals import read_signals
from rovid_ros.files.whole_files import write_text
from rovid_ros.logs.dataflash import PARAMETERS
from rovid_ros.logs.log import Log

DESCRIPTION = (
    'Looks at every number in the log and finds what could be position, depth, attitude, '
    'velocity, gyro and thrusters, their units and senses, and a rough model. Writes a parameter '
    'file that runs, with comments, and says what it guessed and what no log can tell.')

_SHORT = {'angular_velocity': 'gyro'}


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid init`` takes."""
    add_logs(command)
    command.add_argument('--output', type=Path, metavar='YOURS.yaml',
                         help='parameter file to write (default: the name of the log)')
    command.add_argument('--ask', action='store_true',
                         help='ask on the terminal where several signals fit')
    command.add_argument('--namespace', metavar='NAME', default='',
                         help='look at the topics below this only, of one vehicle of several')
    command.add_argument('--dry-mass', type=positive, metavar='KG', default=0.0,
                         help='of the vehicle in air, which no log tells')
    command.add_argument('--dry-inertia', type=positive, metavar='KG_M2', default=0.0,
                         help='its moment of inertia about z in air')
    add_part(command)


def run(args: argparse.Namespace) -> None:
    """Run ``rovid init``."""
    output: Path = args.output or Path(f'{args.logs[0].name.partition(".")[0]}.yaml')
    check_written([output], args.logs)
    if args.ask and not sys.stdin.isatty():
        raise CommandError('--ask: there is no terminal to ask on')
    made = discover(args.logs, args.start, args.duration, args.ask, args.prog, args.namespace)
    made.know_dry(args.dry_mass, args.dry_inertia)
    names = ' '.join(map(str, args.logs))
    text = configuration(made, names)
    if output.is_file() and output.read_bytes() != text.encode():
        raise CommandError(f'{output}: is there, and is another configuration; name another with '
                           '--output')
    write_text(output, text)
    read_settings(output)
    print(summary(made))
    print_written(output)
    print(f'next      rovid check {output} {names}\n'
          f'          rovid replay {names} --params-file {output}')


def discover(logs: list[Path], start: float = 0.0, duration: float | None = None,
             ask: bool = False, prog: str = 'rovid init', namespace: str = '') -> Discovery:
    """
    Find out what a log says of its vehicle.

    Parameters
    ----------
    logs : list of Path
        Joined in time order.
    start, duration : float
        Part of them to use [s].
    ask : bool
        Whether to ask on the terminal where several signals fit.
    prog : str
        What warnings begin with.
    namespace : str
        Only the topics below it are looked at.

    Raises
    ------
    CommandError, LogError
        If no configuration can be made, or a log cannot be read.

    """
    with Log(logs) as log, Progress('init', lambda: log.progress) as progress:
        parameters = log.metadata.get(PARAMETERS)
        paths = None if parameters is None else {
            name: fields for name, info in log.topics.items()
            if info.count and (fields := dataflash_paths(name, log.blank(name)))}
        signals = read_signals(log, start, duration, paths, progress.tick)
        unknown = [f'{name} ({info.type})' for name, info in log.topics.items()
                   if info.count and not log.is_readable(name)]
        poses = [name for name, info in log.topics.items()
                 if info.count and info.type == 'tf2_msgs/msg/TFMessage']
        for line in log.warnings:
            warn(prog, line)
    if namespace:
        below = f'/{namespace.strip("/")}/'
        signals = [one for one in signals if one.topic.startswith(below)]
        if not signals:
            raise CommandError(
                f'{", ".join(map(str, logs))}: --namespace: no numbers below {below}')
    found = candidates(signals) if parameters is None else dataflash_candidates(signals)
    try:
        made = decide(found, signals, _ask if ask else _take_the_first,
                      motors(parameters or {}), 'ned' if parameters is not None else '')
    except DiscoveryError as error:
        unread = f'; no definition is at hand of {", ".join(unknown)}' if unknown else ''
        if poses:
            unread += (f'; transforms ({", ".join(poses)}) are not read: record the pose as an '
                       'Odometry or a PoseStamped, too')
        raise CommandError(f'{", ".join(map(str, logs))}: {error}{unread}') from None
    if parameters is not None:
        made.unknown += remarks(signals, found)
    for line in _others_vehicles(log, made):
        warn(prog, line)
    return made


def _others_vehicles(log: Log, made: Discovery) -> list[str]:
    """Return a line for each file that lacks a topic of the configuration."""
    uses: dict[str, list[str]] = {}
    for name, one in made.inputs.items():
        for topic in one.signal.topics or [one.signal.topic]:
            uses.setdefault(topic, []).append(_SHORT.get(name, name))
    lacking: dict[str, list[str]] = {}
    for topic, names in uses.items():
        for file in log.files_without(topic):
            lacking.setdefault(file, []).append(f'{topic} ({", ".join(names)})')
    return [f'{file}: has no {" and no ".join(topics)}, unlike the other logs: is it of the same '
            'vehicle? rovid init takes the logs of one vehicle at a time'
            for file, topics in lacking.items()]


def _take_the_first(name: str, found: list[Candidate]) -> Candidate:
    return found[0]


def _ask(name: str, found: list[Candidate]) -> Candidate:
    """Let the user decide; an empty answer is the first."""
    if len(found) == 1:
        return found[0]
    print(f'{name}:')
    for k, one in enumerate(found, start=1):
        print(f'  {k}  {one.signal.place}  {one.signal.type}, {one.signal.rate:.3g} Hz')
    while True:
        answer = input('which? [1] ').strip() or '1'
        if answer.isdecimal() and 1 <= int(answer) <= len(found):
            return found[int(answer) - 1]


def summary(made: Discovery) -> str:
    """Return what was found, in a few lines."""
    lines = []
    for name, one in made.inputs.items():
        others = ', '.join(dict.fromkeys(
            other.signal.place for other in made.others.get(name, ())[:3]))
        keys = ', '.join(f'{key} {value:.4g}' if isinstance(value, float) else f'{key} {value}'
                         for key, value in one.keys.items() if key != 'pwm')
        lines.append(f'{_SHORT.get(name, name):<10}{one.signal.place}'
                     + (f' ({keys})' if keys else '')
                     + (f'; could be {others}' if others else ''))
    lines.append(f'dofs      {", ".join(made.dofs)}')
    lines += [f'guessed   {line}' for line in made.guesses]
    lines += [f'unknown   {line}' for line in made.unknown]
    return '\n'.join(lines)
