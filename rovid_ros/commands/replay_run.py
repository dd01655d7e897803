"""What one replay does with the messages of its logs, and what came of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

from rovid_core.identify.estimate import Estimate
from rovid_core.settings.run import Settings
from rovid_ros.commands.controls import CONTROL
from rovid_ros.commands.feeder import Feeder
from rovid_ros.commands.long_work import Progress
from rovid_ros.commands.replay_checkpoint import Read, ReplayCheckpoint
from rovid_ros.commands.running import Interrupt
from rovid_ros.files.output_log import OutputFile
from rovid_ros.logs.log import LogMessage, Maker
from rovid_ros.messages.types import Decoder, WireType
from rovid_ros.results.outputs import LATCHED, Output, Outputs
from rovid_ros.results.summary import summary


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


class ReplayRun:
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


def _control(message: LogMessage) -> tuple[str, str]:
    """Return name and value of a recorded control."""
    try:
        control = json.loads(message.data.data)
        return str(control['control']), str(control['value'])
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise ReplayError(f'{CONTROL}: has what is no control of a node') from None
