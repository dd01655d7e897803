"""``rovid replay``: recorded logs through the very pipeline that the live node runs."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
import json
from pathlib import Path
import sys
import textwrap
from typing import Any

from rovid_core.identify.ekf.single.free_prediction import HELD_FIT
from rovid_core.identify.estimate import Estimate
from rovid_core.identify.intervals import Z95
from rovid_core.model.dofs import PARAMETERS, PHYSICAL
from rovid_core.settings.run import Settings
from rovid_ros.commands.arguments import (
    add_json,
    add_logs,
    add_params_file,
    add_part,
    mcap,
    positive,
)
from rovid_ros.commands.long_work import Progress
from rovid_ros.commands.running import (
    check_written,
    CommandError,
    Interrupt,
    Interrupted,
    located_errors,
    locked,
    print_written,
    printing,
    read_settings,
    read_values,
    UsageError,
    warn as warn_on_stderr,
)
from rovid_ros.files.state_file import place_for, restore, save
from rovid_ros.files.whole_files import write_json
from rovid_ros.logs.log import Log, LogMessage, Maker, RECORD
from rovid_ros.logs.player import CONTROL, PipelinePlayer, Player
from rovid_ros.logs.writer import OutputLog, unfinished
from rovid_ros.messages.converter import Converter
from rovid_ros.messages.types import Decoder, WireType
from rovid_ros.results.current import current_text, still_water
from rovid_ros.results.documents import current_document, dofs_document, has_newtons, Result
from rovid_ros.results.outputs import LATCHED, Outputs
from rovid_ros.results.text import (
    NO_NEWTONS,
    NONE,
    number,
    percent,
    quantity,
    table,
    told_delay,
)

DESCRIPTION = (
    'Prints the parameters of each degree of freedom, how well they predict the log, and what '
    'was refused.')


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add what ``rovid replay`` takes."""
    add_params_file(command)
    add_logs(command)
    command.add_argument(
        '--method', default='', metavar='M', help="use this method, not the file's")
    command.add_argument('--output', type=mcap, metavar='OUT.mcap',
                         help='write the output topics, as the node would publish them')
    command.add_argument('--topics', type=lambda text: text.split(','), metavar='T[,T ...]',
                         help='with --output: only these, such as rov/params,rov/velocity; '
                              'without rov/estimate it takes a fraction of the time')
    add_json(command, 'result')
    add_part(command)
    command.add_argument(
        '--state', type=Path, metavar='STATE.json',
        help='begin from this saved state where the file is there, and leave it behind at the '
             'end; the node saves the same file (checkpoint.path)')
    command.add_argument('--ros', action='store_true', help='go through the real node and publish')
    command.add_argument('--rate', type=positive, metavar='R',
                         help='with --ros: R times real time (default: as fast as it goes)')


def run(args: argparse.Namespace) -> None:
    """Run ``rovid replay``."""
    if args.rate is not None and not args.ros:
        raise UsageError('--rate goes with --ros')
    if args.topics and not args.output:
        raise UsageError('--topics goes with --output')
    part = unfinished(args.output) if args.output else None
    check_written([*{args.output, part}, args.json, args.state],
                  [*args.logs, *args.params_file.paths])
    settings = read_settings(args.params_file, args.method, args.logs)
    with locked(args.state):  # against nodes and other replays
        _run(args, settings)


def _run(args: argparse.Namespace, settings: Settings) -> None:
    begin = args.state if args.state and args.state.exists() else None
    topics = _output_topics(args.topics, settings)
    with located_errors(args.params_file):
        player = _node(args, settings) if args.ros else PipelinePlayer(settings)
        result = replay(
            args.logs, settings, player, output=args.output, topics=topics, start=args.start,
            duration=args.duration, state=begin, warn=partial(warn_on_stderr, args.prog))
    told = '' if not args.state else f'begins from {args.state}\n\n' if begin else (
        f'begins from the initial values, as {args.state} was not there\n\n')
    with printing(told + report(result)):
        if args.json:
            write_json(args.json, result.document())
    place = place_for(args.state, player.stream) if args.state else None
    if place:  # last: a replay that fails can be run again from the same state
        if sys.stdout is not None:
            sys.stdout.flush()
        save(place, settings, player.stream.state())
    print_written(args.output, args.json, place)


def _output_topics(names: Sequence[str] | None, settings: Settings) -> list[str] | None:
    """Return the output topics that were named, in their order; None for all."""
    if names is None:
        return None
    known = Outputs(settings).topics
    wanted = {name.strip().lstrip('/') for name in names}
    for name in wanted - known.keys():
        raise UsageError(f'--topics: got {name!r}, takes {", ".join(known)}')
    return [name for name in known if name in wanted]


def _node(args: argparse.Namespace, settings: Settings) -> Player:
    """Return the real node, which only here needs ROS."""
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        raise CommandError(f'--ros needs ROS 2, which is not installed here: {error}') from None
    from rovid_ros.node.log_player import NodePlayer
    try:
        values = read_values(args.params_file, args.method, args.logs)
        return NodePlayer(values, settings, args.rate)
    except RuntimeError as error:  # of rcl, such as for an impossible ROS_DOMAIN_ID
        raise CommandError(f'--ros: {error}') from None


def replay(logs: Sequence[Path], settings: Settings, player: Player, *,
           output: Path | None = None, topics: Sequence[str] | None = None,
           start: float = 0.0, duration: float | None = None, state: Path | None = None,
           warn: Callable[[str], None] = lambda line: None) -> Result:
    """
    Play logs through the pipeline.

    Parameters
    ----------
    logs : sequence of Path
        Files or rosbag2 directories, joined in time order.
    player : Player
        Plays the messages; closed at the end.
    output : Path, optional
        MCAP file for the output topics; NAME.part.mcap until it is finished.
    topics : sequence of str, optional
        Those of ``Outputs.topics`` to write, in their order; all unless given.
    start, duration : float
        Part of the log to use [s], from its beginning.
    state : Path, optional
        A saved state to begin from, instead of the one that the node recorded in its own log.
    warn : callable
        Gets the warnings, one line each.

    Raises
    ------
    LogError, FieldError, CommandError
        If a log cannot be read, lacks what the settings name, or gives no step.
    StateError
        If the saved state is damaged or belongs to another configuration.
    Interrupted
        On Ctrl-C and SIGTERM, after the output has been closed properly.

    """
    with ExitStack() as stack:
        stack.callback(player.close)
        log = stack.enter_context(Log(logs))
        run = _Replay(player, settings, _topics(log, player.converter, settings, warn), topics)
        if state is not None:
            restore(state, player.stream)
        elif log.recorded:
            _restore_recorded(log, player, warn)
        if not player.stream.adapting:
            player.repeat_control('enable', 'false')  # so that a node tells it
        interrupt = stack.enter_context(Interrupt(unfinished(output) if output else None))
        if output is not None:
            run.output = OutputLog(output)
            stack.enter_context(run.output)
        begin = log.start + round(start * 1e9)
        span = min((log.end - begin) * 1e-9, duration or float('inf')) or 1.0
        progress = stack.enter_context(
            Progress('replay', lambda: (run.last - begin) * 1e-9 / span))
        wanted = [*run.topics, CONTROL] if log.recorded else [*run.topics]
        run.read(log.messages(wanted, start, duration, run.maker), interrupt, progress)
    if interrupt.asked:
        part = unfinished(output) if output else None
        kept = f'; {part} holds what came of it' if part and part.exists() else ''
        raise Interrupted(
            f'interrupted after {run.duration:.1f} s of the log{kept}', interrupt.code)
    for line in (*log.warnings, *player.stream.take_warnings()):
        warn(line)
    result = replace(run.result(logs), metadata=log.metadata,
                     start=None if log.own_clock else log.start)
    if run.output is not None:
        run.output.finish()
    return result


class _Replay:
    """What was read from the logs so far, and what came out."""

    def __init__(self, player: Player, settings: Settings, topics: Mapping[str, str],
                 written: Sequence[str] | None) -> None:
        self.topics = topics
        self.output: OutputLog | None = None
        self.last = 0  # [ns] when the newest message was received
        self._first = 0  # [ns] when the first one was
        self._messages = 0
        self._steps = 0
        self._player = player
        self._settings = settings
        self._outputs = Outputs(settings)
        self._written = [*self._outputs.topics] if written is None else written
        self._channels: list[int] = []  # of these topics in the output

    @property
    def duration(self) -> float:
        """Return the time [s] from the first message to the last."""
        return (self.last - self._first) * 1e-9

    def maker(self, topic: str, wire: WireType, decode: Decoder) -> Maker:
        """Return what makes the data of the messages of a topic."""
        if topic == CONTROL:
            return lambda data, time: decode(data)
        return self._player.maker(self.topics[topic], wire, decode)

    def read(self, messages: Iterable[LogMessage], interrupt: Interrupt,
             progress: Progress) -> None:
        """Play messages up to the last one or to a signal."""
        for message in messages:
            if interrupt.asked:
                return
            self._add_message(message)
            progress.tick()
        if not interrupt.asked:
            self._write(self._player.finish())

    def result(self, logs: Sequence[Path]) -> Result:
        """Return the result, or refuse a log that gave none."""
        stream = self._player.stream
        estimate = stream.estimate
        if estimate is None:
            raise CommandError(f'{", ".join(map(str, logs))}: no step: {self._why_no_step()}')
        models = {dof.dof: (*dof.parameters, *dof.couplings) for dof in estimate.dofs}
        delays = {dof.dof: dof.delay for dof in estimate.dofs}
        thrusters = {dof.dof: dof.thrusters for dof in estimate.dofs}
        scores = {dof: self._player.scores.score(dof, model, delays[dof], thrusters[dof])
                  for dof, model in models.items()}
        joint = self._player.scores.score_joint(models, delays, thrusters)
        verdicts = {dof.dof: stream.verdict(dof.dof) for dof in estimate.dofs}
        judgements = {dof.dof: stream.judgement(dof.dof) for dof in estimate.dofs}
        return Result(
            tuple(logs), self._settings, self._steps, self._messages, self.duration,
            dofs_document(self._settings, estimate, scores, verdicts, joint, judgements),
            dict(stream.rejected), current_document(self._settings, estimate.current))

    def _add_message(self, message: LogMessage) -> None:
        """Add one message and write what it released."""
        if self._messages == 0:
            self._first = message.time
        if message.time > self.last:
            self.last = message.time
        self._messages += 1
        if message.topic == CONTROL:
            name, value = _control(message)
            try:
                self._write(self._player.repeat_control(name, value))
            except (ValueError, RecursionError) as error:
                raise CommandError(f'{CONTROL}: {error}') from None
            if name == 'reset':
                for out in self._outputs.reset():  # as the node does
                    if self.output is not None and out.topic in self._written:
                        self._write_one(out.topic, out.cdr, self.last)
        else:
            topic = self.topics[message.topic]
            if topic != message.topic:
                message = message._replace(topic=topic)
            estimates = self._player.add_message(message)
            if estimates:
                self._write(estimates)

    def _write(self, estimates: Sequence[Estimate]) -> None:
        """Count the estimates and write the output topics."""
        self._steps += len(estimates)
        if self.output is None:
            return
        for estimate in estimates:
            messages = self._outputs.encoded(estimate, self._written)
            if self._channels:
                self.output.write_together(self._channels, messages, self.last, estimate.time)
            else:
                self._channels = [self._write_one(topic, cdr, estimate.time)
                                  for topic, cdr in zip(self._written, messages)]

    def _write_one(self, topic: str, cdr: bytes, time: int) -> int:
        """Write a message of an output topic; return its channel."""
        assert self.output is not None
        return self.output.write_raw(f'/{topic}', self._outputs.topics[topic], cdr, self.last,
                                     publish_time=time, latched=topic in LATCHED)

    def _why_no_step(self) -> str:
        stream = self._player.stream
        parts = [*self._player.converter.details.values()]
        for name in self._settings.used_inputs():
            refused = ', '.join(f'{count:,} {reason}' for (which, reason), count
                                in sorted(stream.rejected.items()) if which == name)
            parts.append(f'{name} {stream.inputs[name].count:,} taken'
                         + (f', refused {refused}' if refused else ''))
        steps = ', '.join(f'{which}: {count:,} {reason}' for (which, reason), count
                          in sorted(stream.rejected.items()) if which not in stream.inputs)
        return '; '.join([*parts, steps] if steps else parts)


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


def _restore_recorded(log: Log, player: Player, warn: Callable[[str], None]) -> None:
    """Begin where the node began when it recorded this log, if that was with this method."""
    recorded = log.metadata[RECORD].get('state')
    if recorded:
        try:
            said = player.restore(json.loads(recorded))
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
            raise CommandError(f'the state that the recording began with: {error}') from None
        if said:
            warn(said)


def _control(message: LogMessage) -> tuple[str, str]:
    """Return name and value of a recorded control."""
    try:
        control = json.loads(message.data.data)
        return str(control['control']), str(control['value'])
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise CommandError(f'{CONTROL}: has what is no control of a node') from None


def report(result: Result) -> str:
    """Return what ``rovid replay`` prints."""
    dofs = result.dofs
    method = result.settings.identifier.method
    if method == 'aid' and result.settings.identifier.adaptation_gains:
        method += f' ({result.settings.identifier.integrator}, raw gains)'
    spanning = 'spanning ' if len(result.logs) > 1 else ''  # the gaps between them count
    parts = [
        f'{_names(result.logs)}: {spanning}{result.duration:,.1f} s, '
        f'{result.messages:,} messages, {result.steps:,} steps of {method}',
        table(_status_rows(dofs), left=2),
        _legend(dofs),
        _current_line(result),
        table(_physical_rows(dofs)),
        table(_lumped_rows(dofs)),
        _couplings_table(dofs),
        _checklist(result.settings, dofs),
        f'refused   {_refused(result.rejected)}',
    ]
    return '\n\n'.join(part for part in parts if part)


def _checklist(settings: Settings, dofs: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what to look at where a model predicts worse than a constant, '' if none does."""
    worse = [dof for dof, values in dofs.items()
             if (values['fit'] or 0.0) < 0.0 and values['status'] != 'unexcited']
    if not worse:
        return ''
    heading = 'yaw_offset, heading and unit' if settings.attitude.topic else 'topic'
    return '\n'.join([
        f'The fit of {", ".join(worse)} is below 0: a constant predicts better. Look at, in this '
        'order:',
        '  1. the warnings above: rovid check FILE LOG tells which key they are about',
        f'  2. the signs in thrusters.allocation, frames, and attitude.{heading}',
        '  3. thrusters.offset (the command of no thrust) and the order of the thrusters',
        '  4. the stamps: latency of each input, thrusters.delay',
        '  5. whether the log moves it: one axis at a time, much thrust, 10 to 50 s a cycle',
    ])


def _current_line(result: Result) -> str:
    """Return what is known of the current of the water, or that it is taken to be still."""
    if result.current:
        return _filled(current_text(result.current))
    said = still_water(result.settings)
    return f'current of the water: {said}' if said else ''


def _names(logs: Sequence[Path]) -> str:
    more = f' and {len(logs) - 2} more' if len(logs) > 2 else ''
    return ', '.join(map(str, logs[:2])) + more


def _status_rows(dofs: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    joint = any('fit_joint' in values for values in dofs.values())
    rows = [['', 'status', 'steps', 'mae', 'fit', *(['all together'] if joint else [])]]
    for dof, values in dofs.items():
        fits = [values['fit'], *([values.get('fit_joint')] if joint else [])]
        if values['status'] == 'unexcited':  # its model is the guess, which predicts nothing
            fits = [None] * len(fits)
        rows.append([dof, values['status'], f'{values["steps"]:,}', quantity(dof, 'mae', values),
                     *map(percent, fits)])
    return rows


def _legend(dofs: Mapping[str, Mapping[str, Any]]) -> str:
    lines = []
    alike: dict[str, list[str]] = {}  # DOFs by what all of their data say
    for dof, values in dofs.items():
        verdict = values['verdict']
        reasons = [reason for reason in values['reasons'] if reason not in verdict]
        if reasons:
            lines.append(_filled(f'{dof} is {values["status"]}: {"; ".join(reasons)}'))
        if verdict:
            alike.setdefault(verdict, []).append(dof)
        delayed = values['delay_s']
        if delayed and abs(delayed['value']) > 3.0 * delayed['std']:  # else it may be 0
            lines.append(f'{dof}: {told_delay(delayed["value"], delayed["std"])}')
    lines += [_filled(f'{", ".join(names)}, from all of the data: {verdict}')
              for verdict, names in alike.items()]
    if not all(map(has_newtons, dofs.values())):
        lines.append(_filled(NO_NEWTONS))
    lines.append(
        'mae = mean |v_sim - v|, fit = 1 - rms(v_sim - v) / std(v), where v_sim is what the '
        'model\npredicts from the logged thrust alone.')
    poor = [dof for dof, values in dofs.items() if (values['fit'] or 0.0) < 0.0]
    if poor:
        lines.append(f'{", ".join(poor)}: a fit below 0 is worse than a constant: the model says '
                     'nothing of the vehicle.')
    low = [dof for dof, values in dofs.items() if values['status'] == 'converged'
           and values['intervals'] and (values['fit'] or 0.0) < HELD_FIT[1]]
    if low:
        lines.append(_filled(
            f'{", ".join(low)}: the status speaks of the last minute, with the noise of what is '
            'measured taken off; fit is of the whole log, noise and all. Where they disagree the '
            'fixes are coarse, or the vehicle was another one before.'))
    if any('fit_joint' in values for values in dofs.values()):
        lines.append(
            'Of a DOF with couplings, fit takes the other DOFs as they were measured; all '
            'together\nsimulates them too, as a simulator or a controller does.')
    return '\n'.join(lines)


def _filled(line: str) -> str:
    return textwrap.fill(line, 99, subsequent_indent='  ', break_long_words=False)


def _physical_rows(dofs: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    rows = [['', 'effective mass', 'quadratic drag', 'linear drag', 'bias']]
    for dof, values in dofs.items():
        newtons = has_newtons(values)
        rows.append([dof, *(quantity(dof, name, values, newtons) for name in PHYSICAL)])
        if values['intervals']:
            rows.append(['95 %', *(_interval(values['intervals'][name]) for name in PHYSICAL)])
    return rows


def _interval(interval: Sequence[float | None] | None) -> str:
    """Return an interval; an end that the data leave open is infinite."""
    if interval is None:
        return NONE
    low, high = interval
    return f'{"-inf" if low is None else number(low)} .. {"inf" if high is None else number(high)}'


def _lumped_rows(dofs: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    rows = [['', *PARAMETERS]]
    for dof, values in dofs.items():
        newtons = has_newtons(values)
        rows.append([dof, *(quantity(dof, name, values, newtons) for name in PARAMETERS)])
        if values['std']:
            rows.append(['', *(
                NONE if values['std'][name] is None
                else f'± {quantity(dof, name, values["std"], newtons)}' for name in PARAMETERS)])
    return rows


def _couplings_table(dofs: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the couplings of all DOFs with their 95 % intervals, '' if there are none."""
    rows = [['coupling', 'kappa', '95 %']]
    for dof, values in dofs.items():
        known = values.get('couplings', {})
        for name in known:
            if f'{name}_std' in known:
                kappa, std = known[name], known[f'{name}_std']
                rows.append([f'{dof} {name}', number(kappa), NONE if None in (kappa, std) else (
                    _interval((kappa - Z95 * std, kappa + Z95 * std)))])
    return table(rows) if len(rows) > 1 else ''


def _refused(rejected: Mapping[tuple[str, str], int]) -> str:
    by_input: dict[str, list[str]] = {}
    for (name, reason), count in sorted(rejected.items()):
        by_input.setdefault(name, []).append(f'{count:,} {reason}')
    parts = [f'{name}: {", ".join(counts)}' for name, counts in by_input.items()]
    return '\n          '.join(parts) or 'nothing'
