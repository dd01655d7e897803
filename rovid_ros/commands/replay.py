"""``rovid replay``: recorded logs through the very pipe that the live node runs."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
import json
from pathlib import Path

from rovid_core.pipeline.stream import Stream
from rovid_core.settings.run import Settings
from rovid_core.trials.score import ScoreLog
from rovid_ros.commands.arguments import (
    add_json,
    add_logs,
    add_params_file,
    add_part,
    mcap,
    positive,
)
from rovid_ros.commands.controls import CONTROL
from rovid_ros.commands.feeder import Feeder, PipeFeeder
from rovid_ros.commands.long_work import Progress
from rovid_ros.commands.replay_checkpoint import ReplayCheckpoint
from rovid_ros.commands.replay_run import ReplayError, ReplayRun, Result
from rovid_ros.commands.running import (
    check_written,
    CommandError,
    Interrupt,
    Interrupted,
    located_errors,
    print_written,
    read_settings,
    read_values,
    UsageError,
    warn as warn_on_stderr,
)
from rovid_ros.files.output_log import OutputFile, part_of
from rovid_ros.files.whole_files import write_json
from rovid_ros.logs.log import Log, RECORD
from rovid_ros.messages.convert import Converter
from rovid_ros.results.text import report

DESCRIPTION = (
    'Prints the parameters of each degree of freedom, how well they predict the log, and what '
    'was refused.')


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid replay`` takes."""
    add_params_file(command)
    add_logs(command)
    command.add_argument(
        '--method', default='', metavar='M', help="use this method, not the file's")
    command.add_argument(
        '--output', type=mcap, metavar='OUT.mcap',
        help='write the output topics, as the node would publish them')
    add_json(command, 'result')
    add_part(command)
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


def run(args: argparse.Namespace) -> None:
    """Run ``rovid replay``."""
    if args.rate is not None and not args.ros:
        raise UsageError('--rate goes with --ros')
    if args.checkpoint and args.ros:
        raise UsageError('--checkpoint does not go with --ros')
    if args.append and not args.checkpoint:
        raise UsageError('--append goes with --checkpoint')
    unfinished = part_of(args.output) if args.output else None
    check_written([*{args.output, unfinished}, args.json, args.checkpoint],
                  [*args.logs, args.params_file])
    settings = read_settings(args.params_file, args.method)
    checkpoint = ReplayCheckpoint(
        args.checkpoint, args.append, settings.checkpoint_period) if args.checkpoint else None

    with located_errors(args.params_file):
        # a state that can be gone on from holds the steps so far, which then are not in a file
        feeder = _node(args, settings) if args.ros else PipeFeeder(
            settings, ScoreLog(settings, spill=checkpoint is None))
        result = replay(
            args.logs, settings, feeder, output=args.output, start=args.start,
            duration=args.duration, checkpoint=checkpoint, warn=partial(warn_on_stderr, args.prog))
    print(report(result))  # first: it is not lost where the JSON cannot be written
    if args.json:
        write_json(args.json, result.document())
    print_written(args.output, args.json)


def _node(args: argparse.Namespace, settings: Settings) -> Feeder:
    """Return the real node, which only here needs ROS."""
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        raise CommandError(f'--ros needs ROS 2, which is not installed here: {error}') from None
    from rovid_ros.node.log_feeder import NodeFeeder
    try:
        return NodeFeeder(read_values(args.params_file, args.method), settings, args.rate)
    except RuntimeError as error:  # of rcl, such as for an impossible ROS_DOMAIN_ID
        raise CommandError(f'--ros: {error}') from None


def replay(logs: Sequence[Path], settings: Settings, feeder: Feeder, *,
           output: Path | None = None, start: float = 0.0, duration: float | None = None,
           checkpoint: ReplayCheckpoint | None = None,
           warn: Callable[[str], None] = lambda line: None) -> Result:
    """
    Feed logs through the pipe.

    Parameters
    ----------
    logs : sequence of Path
        Files or rosbag2 directories, joined in time order.
    settings : Settings
        The run.
    feeder : Feeder
        Takes the messages; closed at the end.
    output : Path, optional
        MCAP file for the output topics; NAME.part.mcap until it is finished.
    start, duration : float
        Part of the log to use [s], from its beginning.
    checkpoint : ReplayCheckpoint, optional
        What to go on from, and where to save what another call can go on from.
    warn : callable
        Gets the warnings, one line each.

    Raises
    ------
    LogError, FieldError, ReplayError
        If a log cannot be read, lacks what the settings name, or gives no step.
    CheckpointError, OutputError
        If what there is to go on from does not fit, or its output is not there any more.
    Interrupted
        On Ctrl-C and SIGTERM, after the output has been closed properly.

    """
    with ExitStack() as stack:
        stack.callback(feeder.close)
        log = stack.enter_context(Log(logs))
        run = ReplayRun(feeder, settings, _topics(log, feeder.converter, settings, warn))
        if checkpoint is not None:
            checkpoint.begin(log, (start, duration), feeder, run.read, run.memory(), output)
            run.go_on()
        if log.recorded and not run.read.messages:
            _restore(log, feeder.stream)
        interrupt = stack.enter_context(Interrupt(part_of(output) if output else None))
        if output is not None:
            run.writer = OutputFile(output, checkpoint.written if checkpoint else (0, 0))
            stack.enter_context(run.writer)
        begin = log.start + round(start * 1e9)
        span = min((log.end - begin) * 1e-9, duration or float('inf')) or 1.0
        progress = stack.enter_context(Progress('replay', lambda: run.until(begin) / span))
        wanted = [*run.topics, CONTROL] if log.recorded else [*run.topics]
        messages = log.messages(wanted, start, duration, run.maker)
        run.take_all(messages, interrupt, progress, checkpoint)
    if interrupt.asked:
        raise Interrupted(_interrupted(run, output, checkpoint), interrupt.code)
    for line in (*log.warnings, *feeder.stream.take_warnings()):
        warn(line)
    result = run.result((*(checkpoint.earlier if checkpoint else ()), *logs))
    if run.writer is not None:
        run.writer.finish()
    return result


def _interrupted(run: ReplayRun, output: Path | None, checkpoint: ReplayCheckpoint | None) -> str:
    """Return what is left of an interrupted replay."""
    part = part_of(output) if output else None
    kept = f'; {part} holds what came of it' if part and part.exists() else ''
    more = f'; {checkpoint.path} is where it goes on' if checkpoint else ''
    return f'interrupted after {run.duration:.1f} s of the log{kept}{more}'


def _topics(log: Log, converter: Converter, settings: Settings,
            warn: Callable[[str], None]) -> dict[str, str]:
    """Return the topics to read: the log's name, which has a slash, to the configured one."""
    names = {f'/{topic.lstrip("/")}': topic for topic in converter.topics}
    wanted = {name: converter.topics[topic] for name, topic in names.items()}
    optional = f'/{settings.reference.topic.lstrip("/")}'
    others = [settings.input(name).topic for name in settings.used_inputs()
              if name not in ('thrusters', 'reference')] + [*settings.thrusters.topics]
    if optional in names and names[optional] not in others:
        there = log.topics.get(optional)
        if there is None or there.count == 0:
            warn(f'no messages on {optional} (reference): scored against the velocity '
                 'that was identified from')
            del names[optional], wanted[optional]
    log.require(wanted)
    for name, topic in names.items():
        converter.check_type(topic, log.blank(name))
    return names


def _restore(log: Log, stream: Stream) -> None:
    """Begin where the node began when it recorded this log."""
    state = log.metadata[RECORD].get('state')
    if state:
        try:
            stream.restore(json.loads(state))
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
            raise ReplayError(f'the state that the recording began with: {error}') from None
