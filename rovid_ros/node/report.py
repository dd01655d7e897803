"""What the node tells people: ``/diagnostics`` and the lines of its log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import time

from rclpy.node import Node
from rovid_core.stream import Stream
from rovid_core.values import Estimate
from rovid_ros.limited_log import LimitedWarnings, RefusalLines
from rovid_ros.node.diagnostics import ACTIVE, diagnostics, NodeState
from rovid_ros.node.graph import graph_states
from rovid_ros.node.health import Situation
from rovid_ros.node.recorder import Recorder
from rovid_ros.node.startup import StartupSummary
from rovid_ros.outputs import Output
from rovid_ros.recent import Arrivals, Recent


class Report:
    """
    Watch a stream and say how it does.

    Parameters
    ----------
    node : Node
        Has the log, the clock and the graph.
    stream : Stream
        What runs.
    recorder : Recorder, optional
        What records it.
    live : bool
        False: messages are fed by hand, and the graph has nothing to do with them.
    steady : callable
        The time [s] of a clock that is never set.

    Attributes
    ----------
    arrivals : Arrivals
        To be told of every message.

    """

    def __init__(self, node: Node, stream: Stream,
                 recorder: Recorder | None = None, *, live: bool = True,
                 steady: Callable[[], float] = time.monotonic) -> None:
        self.arrivals = Arrivals()
        self._node = node
        self._log = node.get_logger()
        self._stream = stream
        self._recorder = recorder
        self._live = live
        self._steady = steady
        self._start = self._heard_since = now = steady()
        self._recent = Recent(stream, now)
        self._refusals = RefusalLines(stream, now)
        self._warnings = LimitedWarnings()
        self._summary = StartupSummary(stream.settings)
        self._steps: dict[str, float] = {}
        self._told: set[tuple[str, str, int]] = set()  # topic, problem, publishers

    def activated(self) -> None:
        """Look for the inputs from now on."""
        self._heard_since = self._steady()

    def told(self, estimates: Sequence[Estimate]) -> None:
        """Take what was published, and log the warnings that the stream has."""
        now = self._steady()
        for estimate in estimates:
            for index in estimate.stepped:
                self._steps[self._stream.settings.dofs[index]] = now
        self._warn(self._stream.take_warnings(), now)

    def each_second(self, state: str = ACTIVE) -> Output:
        """Log what is due and return the message for ``/diagnostics``."""
        now = self._steady()
        self._recent.tick(now)
        topics = graph_states(self._stream.settings, self._node) if self._live else {}
        at = Situation(
            self._stream.settings, self._stream, self.arrivals, self._recent, topics,
            self._node.get_clock().now().nanoseconds, now, self._steps)
        if self._live and state == ACTIVE:
            self._introduce(at, now - self._heard_since)
        self._warn([], now)
        self._tell_refused(self._refusals.due(now))
        recorder = self._recorder
        return diagnostics(at, NodeState(
            self._node.get_fully_qualified_name(), state, now - self._start,
            str(recorder.path) if recorder else '', recorder.is_open if recorder else True))

    def finish(self) -> None:
        """Log what is left to tell."""
        self._tell_refused(self._refusals.due(self._steady(), end=True))

    def _introduce(self, at: Situation, elapsed: float) -> None:
        """Say once what is wrong with the publishers of each topic, and the summary."""
        for topic, state in at.topics.items():
            case = topic, state.problem, state.publishers
            if state.text and state.publishers + state.is_wrong and case not in self._told:
                self._told.add(case)
                self._log.warning(f'{" and ".join(state.inputs)}: {state.text}')
        line, complete = self._summary.due(at, elapsed)
        if line and complete:
            self._log.info(line)
        elif line:
            self._log.warning(line)

    def _warn(self, lines: Sequence[str], now: float) -> None:
        for line in self._warnings.allowed(lines, now):
            self._log.warning(line)

    def _tell_refused(self, line: str) -> None:
        if line:
            self._log.warning(line)
