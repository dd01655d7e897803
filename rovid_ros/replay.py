"""``rovid replay``: recorded logs through the very pipe that the live node runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

from rovid_core.settings import Settings
from rovid_core.stream import Stream
from rovid_core.values import Estimate
from rovid_ros.convert import Converter
from rovid_ros.feeder import Feeder
from rovid_ros.interrupt import Interrupt, Interrupted
from rovid_ros.logs import Log, LogMessage, Maker, RECORD
from rovid_ros.message_types import Decoder, WireType
from rovid_ros.output_file import OutputFile, part_of
from rovid_ros.outputs import LATCHED, Output, Outputs
from rovid_ros.progress import Progress
from rovid_ros.replay_checkpoint import Read, ReplayCheckpoint
from rovid_ros.summary import summary

CONTROL = '/rovid/control'


class ReplayError(ValueError):
    """A log that gives nothing to identify from; the text is the line to print."""


@dataclass(frozen=True)
class Result:
    """
    What a replay gave.

    Attributes
    ----------
    steps : int
        Number of estimates, each of which the node would publish.
    messages : int
        Number of messages read.
    duration : float
        Time [s] from the first of them to the last.
    dofs : dict
        Per DOF, as in the JSON: see ``summary``.
    rejected : dict
        (input, reason) -> how many.

    """

    logs: tuple[Path, ...]
    settings: Settings
    steps: int
    messages: int
    duration: float
    dofs: Mapping[str, Mapping[str, Any]]
    rejected: Mapping[tuple[str, str], int]

    def document(self) -> dict[str, Any]:
        """Return what ``--json`` writes."""
        reasons: dict[str, int] = {}
        for (_, reason), count in sorted(self.rejected.items()):
            reasons[reason] = reasons.get(reason, 0) + count
        return {
            'method': self.settings.identifier.method, 'steps': self.steps,
            'duration_s': self.duration, 'rejected': reasons, 'dofs': self.dofs}


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
        run = _Run(feeder, settings, _topics(log, feeder.converter, settings, warn))
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


def _interrupted(run: _Run, output: Path | None, checkpoint: ReplayCheckpoint | None) -> str:
    """Return what is left of an interrupted replay."""
    part = part_of(output) if output else None
    kept = f'; {part} holds what came of it' if part and part.exists() else ''
    more = f'; {checkpoint.path} is where it goes on' if checkpoint else ''
    return f'interrupted after {run.duration:.1f} s of the log{kept}{more}'


class _Run:
    """The state of one replay: what was read and what came out."""

    def __init__(self, feeder: Feeder, settings: Settings, topics: Mapping[str, str]) -> None:
        self.topics = topics
        self.writer: OutputFile | None = None
        self.read = Read()
        self._feeder = feeder
        self._settings = settings
        self._outputs = Outputs(settings)
        self._again = 0

    def memory(self) -> dict[str, object]:
        """Return what remembers something, beside the feeder and ``read``."""
        return {'outputs': self._outputs}

    def go_on(self) -> None:
        """
        Leave out the messages that an earlier call has read.

        They are decoded again, for what that says of the log, but what an input refuses of
        them has been counted.
        """
        self._again = self.read.here

    @property
    def duration(self) -> float:
        """Return the time [s] from the first message to the last."""
        return (self.read.last - self.read.first) * 1e-9

    def until(self, begin: int) -> float:
        """Return the time [s] from ``begin`` [ns] to the last message."""
        return (self.read.last - begin) * 1e-9

    def take_all(self, messages: Iterable[LogMessage], interrupt: Interrupt, progress: Progress,
                 checkpoint: ReplayCheckpoint | None) -> None:
        """Feed messages up to the last or to a signal, and save what to go on from."""
        before = self._again
        for message in messages:
            if interrupt.asked:
                break
            if self._again:
                self._again -= 1
            else:
                self.take(message)
                if checkpoint is not None and checkpoint.is_due:
                    checkpoint.save(self.writer)
            progress.tick()
        if checkpoint is not None and not (interrupt.asked and self.read.here == before):
            checkpoint.save(self.writer, complete=not interrupt.asked)
        if not interrupt.asked:
            self.write(self._feeder.finish())

    def maker(self, topic: str, wire: WireType, decode: Decoder) -> Maker:
        """Return what makes the data of the messages of a topic."""
        if topic == CONTROL:
            return lambda data, time: decode(data)
        make = self._feeder.take(self.topics[topic], wire, decode)
        if not self._again:
            return make
        return lambda data, time: decode(data) if self._again else make(data, time)

    def take(self, message: LogMessage) -> None:
        """Feed one message and write what it released."""
        read = self.read
        if read.messages == 0:
            read.first = message.time
        read.last = max(read.last, message.time)
        read.messages += 1
        read.here += 1
        if message.topic == CONTROL:
            name, value = _control(message)
            try:
                self.write(self._feeder.control(name, value))
            except (ValueError, RecursionError) as error:
                raise ReplayError(f'{CONTROL}: {error}') from None
            if name == 'reset':
                self._put(self._outputs.reset(), read.last)  # as the node does
        else:
            topic = self.topics[message.topic]
            if topic != message.topic:
                message = message._replace(topic=topic)
            self.write(self._feeder.feed(message))

    def write(self, estimates: Sequence[Estimate]) -> None:
        """Count the estimates and write the output topics."""
        self.read.steps += len(estimates)
        if self.writer is None:
            return
        for estimate in estimates:
            self._put(self._outputs.messages(estimate), estimate.time)

    def _put(self, outputs: Sequence[Output], time: int) -> None:
        if self.writer is not None:
            for out in outputs:
                self.writer.write(f'/{out.topic}', out.type, out.fields, self.read.last, time,
                                  latched=out.topic in LATCHED)

    def result(self, names: Sequence[Path | str]) -> Result:
        """Return the result, or refuse a log that gave none."""
        estimate, logs = self._feeder.stream.estimate, tuple(map(Path, names))
        if estimate is None:
            raise ReplayError(f'{", ".join(map(str, logs))}: no step: {self._why()}')
        scores = {dof.dof: self._feeder.scores.score(dof.dof, dof.parameters)
                  for dof in estimate.dofs}
        verdicts = {dof.dof: self._feeder.stream.verdict(dof.dof) for dof in estimate.dofs}
        return Result(
            logs, self._settings, self.read.steps, self.read.messages, self.duration,
            summary(self._settings, estimate, scores, verdicts),
            dict(self._feeder.stream.rejected))

    def _why(self) -> str:
        stream = self._feeder.stream
        parts = [*self._feeder.converter.details.values()]
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


def _control(message: LogMessage) -> tuple[str, str]:
    """Return name and value of a recorded control."""
    try:
        control = json.loads(message.data.data)
        return str(control['control']), str(control['value'])
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise ReplayError(f'{CONTROL}: has what is no control of a node') from None


def _restore(log: Log, stream: Stream) -> None:
    """Begin where the node began when it recorded this log."""
    state = log.metadata[RECORD].get('state')
    if state:
        try:
            stream.restore(json.loads(state))
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
            raise ReplayError(f'the state that the recording began with: {error}') from None
