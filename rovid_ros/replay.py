"""``rovid replay``: recorded logs through the very pipe that the live node runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from rovid_ros.log_writer import LogWriter
from rovid_ros.logs import Log, LogMessage, Maker, RECORD
from rovid_ros.message_types import Decoder, WireType
from rovid_ros.outputs import LATCHED, Output, Outputs
from rovid_ros.progress import Progress
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
        MCAP file for the output topics.
    start, duration : float
        Part of the log to use [s], from its beginning.
    warn : callable
        Gets the warnings, one line each.

    Raises
    ------
    LogError, FieldError, ReplayError
        If a log cannot be read, lacks what the settings name, or gives no step.
    Interrupted
        On Ctrl-C and SIGTERM, after the output has been closed properly.

    """
    with ExitStack() as stack:
        stack.callback(feeder.close)
        log = stack.enter_context(Log(logs))
        run = _Run(feeder, settings, _topics(log, feeder.converter, settings, warn))
        if log.recorded:
            _restore(log, feeder.stream)
        interrupt = stack.enter_context(Interrupt(output))
        if output is not None:
            run.writer = stack.enter_context(LogWriter(output))
        begin = log.start + round(start * 1e9)
        span = min((log.end - begin) * 1e-9, duration or float('inf')) or 1.0
        progress = stack.enter_context(Progress('replay', lambda: run.until(begin) / span))
        wanted = [*run.topics, CONTROL] if log.recorded else [*run.topics]
        for message in log.messages(wanted, start, duration, run.maker):
            if interrupt.asked:
                break
            run.take(message)
            progress.tick()
        if not interrupt.asked:
            run.write(feeder.finish())
    if interrupt.asked:
        kept = f'; {output} holds what came of it' if output else ''
        raise Interrupted(
            f'interrupted after {run.duration:.1f} s of the log{kept}', interrupt.code)
    for line in (*log.warnings, *feeder.stream.take_warnings()):
        warn(line)
    return run.result(tuple(logs))


class _Run:
    """The state of one replay: what was read and what came out."""

    def __init__(self, feeder: Feeder, settings: Settings, topics: Mapping[str, str]) -> None:
        self.topics = topics
        self.writer: LogWriter | None = None
        self._feeder = feeder
        self._settings = settings
        self._outputs = Outputs(settings)
        self._steps = 0
        self._messages = 0
        self._first = self._last = 0  # [ns]

    @property
    def duration(self) -> float:
        """Return the time [s] from the first message to the last."""
        return (self._last - self._first) * 1e-9

    def until(self, begin: int) -> float:
        """Return the time [s] from ``begin`` [ns] to the last message."""
        return (self._last - begin) * 1e-9

    def maker(self, topic: str, wire: WireType, decode: Decoder) -> Maker:
        """Return what makes the data of the messages of a topic."""
        if topic == CONTROL:
            return lambda data, time: decode(data)
        return self._feeder.take(self.topics[topic], wire, decode)

    def take(self, message: LogMessage) -> None:
        """Feed one message and write what it released."""
        if self._messages == 0:
            self._first = message.time
        self._last = max(self._last, message.time)
        self._messages += 1
        if message.topic == CONTROL:
            control = json.loads(message.data.data)
            self.write(self._feeder.control(control['control'], control['value']))
            if control['control'] == 'reset':
                self._put(self._outputs.reset(), self._last)  # as the node does
        else:
            topic = self.topics[message.topic]
            if topic != message.topic:
                message = message._replace(topic=topic)
            self.write(self._feeder.feed(message))

    def write(self, estimates: Sequence[Estimate]) -> None:
        """Count the estimates and write the output topics."""
        self._steps += len(estimates)
        if self.writer is None:
            return
        for estimate in estimates:
            self._put(self._outputs.messages(estimate), estimate.time)

    def _put(self, outputs: Sequence[Output], time: int) -> None:
        if self.writer is not None:
            for out in outputs:
                self.writer.write(f'/{out.topic}', out.type, out.fields, self._last, time,
                                  latched=out.topic in LATCHED)

    def result(self, logs: tuple[Path, ...]) -> Result:
        """Return the result, or refuse a log that gave none."""
        estimate = self._feeder.stream.estimate
        if estimate is None:
            raise ReplayError(f'{", ".join(map(str, logs))}: no step: {self._why()}')
        scores = {dof.dof: self._feeder.scores.score(dof.dof, dof.parameters)
                  for dof in estimate.dofs}
        verdicts = {dof.dof: self._feeder.stream.verdict(dof.dof) for dof in estimate.dofs}
        return Result(
            logs, self._settings, self._steps, self._messages, self.duration,
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


def _restore(log: Log, stream: Stream) -> None:
    """Begin where the node began when it recorded this log."""
    state = log.metadata[RECORD].get('state')
    if state:
        try:
            stream.restore(json.loads(state))
        except ValueError as error:
            raise ReplayError(f'the state that the recording began with: {error}') from None
