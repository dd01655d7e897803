"""What the node reports once a second: ``/diagnostics`` and the lines of its log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math
import time
from typing import NamedTuple

from rclpy.node import Node
from rovid_core.identify.estimate import DofEstimate, Estimate
from rovid_core.model.plant import physical
from rovid_core.pipeline.stream import Stream
from rovid_ros.config.parameters import topics_of
from rovid_ros.files.state_file import Checkpoint
from rovid_ros.node.health.diagnostics import ACTIVE, diagnostics, NodeState
from rovid_ros.node.health.graph import graph_states, rivals, TopicState
from rovid_ros.node.health.levels import (
    Arrivals,
    Counts,
    counts_text,
    difference,
    dof_level,
    HealthData,
    input_level,
    last_estimate,
    rate_text,
    RecentCounts,
)
from rovid_ros.node.recorder import Recorder
from rovid_ros.results.outputs import OK, Output, STALE
from rovid_ros.results.text import number, percent, unit

REPEAT = 10.0  # [s] What happens to one of them again sooner, is not told
CHANGED = 'the vehicle changed'  # how a method's note about that begins


class HealthMonitor:
    """
    Observes a stream and reports how it does.

    Unless ``live``, messages come from a log, so the publishers in the graph do not matter.
    ``steady`` returns the time [s] of a clock that is never set.
    """

    def __init__(self, node: Node, stream: Stream, recorder: Recorder | None,
                 checkpoint: Checkpoint, *, live: bool = True,
                 steady: Callable[[], float] = time.monotonic) -> None:
        self.arrivals = Arrivals()
        self._node = node
        self._log = node.get_logger()
        self._stream = stream
        self._recorder, self._checkpoint = recorder, checkpoint
        self._live = live
        self._steady = steady
        self._start = self._expected_since = now = steady()
        self._recent = RecentCounts(stream, now)
        self._refusals = RefusalSummary(stream, now)
        self._warnings = WarningLimiter()
        self._summary = StartupSummary()
        self._events = Events()
        self._topics: Mapping[str, TopicState] = {}
        self._steps: dict[str, float] = {}
        self._logged: set[tuple[str, str, int]] = set()  # topic, problem, publishers
        self._rivals = ''  # who else publishes the outputs, a second ago

    def expect_inputs(self) -> None:
        """Count the time until the inputs come from now on."""
        self._expected_since = self._steady()
        self._events = Events()

    def add_estimates(self, estimates: Sequence[Estimate]) -> None:
        """Note the steps of estimates, and log the warnings that the stream has."""
        now = self._steady()
        for estimate in estimates:
            for index in estimate.stepped:
                self._steps[self._stream.settings.dofs[index]] = now
        self._warn(self._stream.take_warnings(), now)

    def update(self, state: str = ACTIVE) -> Output:
        """Log what is due and return the message for ``/diagnostics``."""
        now = self._steady()
        self._recent.update(now)
        if self._live:
            self._topics = graph_states(self._stream.settings, self._node)
        data = self._data(now)
        if self._live and state == ACTIVE:
            self._report_inputs(data, now - self._expected_since)
        self._warn([], now)
        self._log_refused(self._refusals.due(now))
        recorder, checkpoint = self._recorder, self._checkpoint
        return diagnostics(data, NodeState(
            self._node.get_fully_qualified_name(), state, now - self._start,
            str(recorder.path) if recorder else '', recorder.is_open if recorder else True,
            str(checkpoint.path) if checkpoint.is_kept else ''))

    def finish(self) -> None:
        """Log what was refused since the last line about it, and what was found."""
        now = self._steady()
        self._log_refused(self._refusals.due(now, end=True))
        result = result_text(self._data(now))
        if result and self._live:
            self._log.info(f'result: {result}')

    def report_events(self) -> None:
        """Log what has happened since the last call."""
        for line in self._events.lines(self._data(self._steady())):
            self._tell(line)

    def _data(self, now: float) -> HealthData:
        return HealthData(
            self._stream, self.arrivals, self._recent, self._topics,
            self._node.get_clock().now().nanoseconds, now, self._steps)

    def _report_inputs(self, data: HealthData, elapsed: float) -> None:
        """Log once what is wrong with the publishers of each topic, and the summary."""
        for topic, state in data.topics.items():
            case = topic, state.problem, state.publishers
            if state.text and state.publishers + state.is_wrong and case not in self._logged:
                self._logged.add(case)
                self._log.warning(f'{" and ".join(state.inputs)}: {state.text}')
        others, before = rivals(self._node), self._rivals
        self._rivals = others
        if others and others != before:
            self._log.warning(others)
        summary = self._summary.due(data, elapsed)
        if summary:
            self._tell(summary)

    def _tell(self, line: Line) -> None:
        if line.is_warning:  # of one call rclpy takes one severity only
            self._log.warning(line.text)
        else:
            self._log.info(line.text)

    def _warn(self, lines: Sequence[str], now: float) -> None:
        for line in self._warnings.allowed(lines, now):
            self._log.warning(line)

    def _log_refused(self, line: str) -> None:
        if line:
            self._log.warning(line)


SUMMARY_TIMEOUT = 5.0  # [s] the summary is logged after this time even if inputs are still missing
RATE_MESSAGES = 5  # messages that each topic needs before its rate goes into the summary


class StartupSummary:
    """One line about the inputs, which come and which do not; again when one has come."""

    def __init__(self) -> None:
        self._missing: set[str] | None = None  # when it was last said

    def due(self, data: HealthData, elapsed: float) -> Line | None:
        """
        Return the line if there is something to say; as long as inputs are missing it warns.

        ``elapsed`` is the time since the start [s].
        """
        missing = {name for name in data.settings.used_inputs() if not _is_there(data, name)}
        if self._missing is None:
            has_rates = all(data.arrivals.count(topic) >= RATE_MESSAGES for topic in data.topics)
            if elapsed < SUMMARY_TIMEOUT and (missing or not has_rates):
                return None
        elif not self._missing - missing:  # none of the missing has come
            return None
        # only ever fewer, so that what comes and goes does not fill the log
        self._missing = missing if self._missing is None else self._missing & missing
        return Line(_inputs_text(data, missing), bool(missing))


def _is_there(data: HealthData, name: str) -> bool:
    topics = topics_of(data.settings, name)
    return all(data.arrivals.count(topic) for topic in topics) and (
        data.recent.used(name) > 0 or not data.recent.refused(name))


def _inputs_text(data: HealthData, missing: set[str]) -> str:
    found, lost = [], []
    for name in data.settings.used_inputs():
        if name in missing:
            level, message = input_level(data, name)
            lost.append(f'{name} ({message})' if level != OK else name)
            continue
        topics = topics_of(data.settings, name)
        kinds = {data.topics[topic].type.rpartition('/')[2] for topic in topics
                 if topic in data.topics}
        found.append(f'{name} {rate_text(data.rate(name))}' + (
            f' ({", ".join(sorted(kinds))})' if kinds else ''))
    line = f'inputs: {", ".join(found) or "none"}'
    return f'{line}; missing: {", ".join(lost)}' if lost else line


# [s] Between two lines about what was refused; the limits of all lines are per period
PERIOD = 10.0
MAX_WARNINGS = 10  # largest number of warnings in one period


class RefusalSummary:
    """One line per period about what was refused in it, none when nothing was."""

    def __init__(self, stream: Stream, now: float) -> None:
        self._stream = stream
        self._since = now
        self._before: Counts = dict(stream.rejected)

    def due(self, now: float, end: bool = False) -> str:
        """Return the line if a period is over (or at the ``end``) and there is one, or ''."""
        elapsed = now - self._since
        if elapsed < PERIOD and not end:
            return ''
        counts = difference(self._before, self._stream.rejected)
        self._since, self._before = now, dict(self._stream.rejected)
        return f'refused in the last {elapsed:.0f} s: {counts_text(counts)}' if counts else ''


class WarningLimiter:
    """Lets the same warning through once a period, and at most ``MAX_WARNINGS`` in all."""

    def __init__(self) -> None:
        self._since = float('-inf')
        self._logged: set[str] = set()
        self._withheld = 0

    def allowed(self, lines: Sequence[str], now: float) -> list[str]:
        """Return which of the lines may be logged at ``now`` [s], and how many were not before."""
        result: list[str] = []
        if now - self._since >= PERIOD:
            if self._withheld:
                result.append(f'{self._withheld} more lines were not logged')
            self._since, self._withheld = now, 0
            self._logged.clear()
        for line in lines:
            if line in self._logged:
                continue
            if len(self._logged) >= MAX_WARNINGS:
                self._withheld += 1
                continue
            self._logged.add(line)
            result.append(line)
        return result


class Line(NamedTuple):
    """A line for the console."""

    text: str
    is_warning: bool


@dataclass
class _Seen:
    """How an input or DOF was when one looked last."""

    good: bool = True
    since: float = math.nan  # when it became not good
    changed: bool = False
    told: float = -math.inf  # when its last line was told that it is not good
    silenced: bool = False  # whether that is not told yet


class Events:
    """
    Tells of each change once; what comes and goes all the time is told once per ``REPEAT``.

    An input is silent or back. A DOF is valid, is so no more, or its vehicle has changed. What
    went too soon after the last time and stays away is told when that time has passed.
    """

    def __init__(self) -> None:
        self._inputs: dict[str, _Seen] = {}
        self._dofs: dict[str, _Seen] = {}

    def lines(self, data: HealthData) -> list[Line]:
        """Return what has changed, the inputs first: they are the cause."""
        found = [line for name in data.settings.used_inputs()
                 for line in self._of_input(data, name)]
        return found + [line for dof in data.settings.dofs for line in self._of_dof(data, dof)]

    def _of_input(self, data: HealthData, name: str) -> list[Line]:
        level, message = input_level(data, name)
        seen = self._inputs.setdefault(name, _Seen())
        if level == STALE:
            return _gone(seen, data.steady, f'{name}: {message}')
        if not seen.good:
            return _back(seen, data.steady,
                         f'{name}: back after {data.steady - seen.since:.0f} s')
        return []

    def _of_dof(self, data: HealthData, name: str) -> list[Line]:
        dof = last_estimate(data.stream, name)
        if dof is None:
            return []
        seen = self._dofs.setdefault(name, _Seen(good=False))
        found = []
        changed = any(CHANGED in reason for reason in dof.judgement.reasons)
        if changed and not seen.changed:
            found.append(Line(f'{name}: {dof.judgement.reasons[0]}', True))
        seen.changed = changed
        level, message = dof_level(data, name)
        valid, newtons = dof.valid and level != STALE, data.settings.thrusters.newtons
        if valid and not seen.good:
            found += _back(seen, data.steady, f'{name}: valid, {model_text(dof, newtons)}')
        elif not valid:
            found += _gone(seen, data.steady, f'{name}: no longer valid: {message}')
        return found


def _gone(seen: _Seen, now: float, text: str) -> list[Line]:
    if seen.good:
        seen.good, seen.since, seen.silenced = False, now, True
    if not seen.silenced or now - seen.told < REPEAT:
        return []
    seen.told, seen.silenced = now, False
    return [Line(text, True)]


def _back(seen: _Seen, now: float, text: str) -> list[Line]:
    seen.good = True
    return [] if seen.silenced else [Line(text, False)]


def model_text(dof: DofEstimate, newtons: bool) -> str:
    """Return mass and fit in a few words."""
    mass, std = physical(dof.parameters)[0], dof.physical_std[0]
    known = f' ± {number(std)}' if math.isfinite(std) else ''
    fit = f', fit {percent(dof.fit)}' if math.isfinite(dof.fit) else ''
    return f'mass {number(mass)}{known} {unit(dof.dof, "mass", newtons)}{fit}'


def result_text(data: HealthData) -> str:
    """Return what was found of all DOFs in one line, '' if there was no step."""
    dofs = [dof for name in data.settings.dofs if (dof := last_estimate(data.stream, name))]
    return '; '.join(f'{dof.dof} {dof.judgement.status} after {dof.steps:,} steps, '
                     f'{model_text(dof, data.settings.thrusters.newtons)}' for dof in dofs)
