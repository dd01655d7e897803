"""The messages of a log, faulty or not, over DDS into the node in a process of its own."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf, isfinite
import os
from pathlib import Path
import re
from tempfile import TemporaryDirectory
import time
from typing import Any

import rclpy
from rovid_ros.results.outputs import DIAGNOSTIC_TYPE

from test.support.fault_edits import Messages, SECOND
from test.support.fault_outcomes import Outcome, step_text
from test.support.fault_runs import Bench, cdr
from test.support.live import Peer, rejected_in, write_parameters
from test.support.processes import child_environment, NodeProcess, REPOSITORY

WAIT = 5.0
"""[s] max_wait of a live run: more than the messages of a chunk can get out of order."""

CHUNK = SECOND
"""[ns] of the log that is published at once, before the node has to have taken it."""

QUIET = 10.0
"""[s] without a step after which no more is waited for."""

PACE = 0.05
"""[s] that a chunk takes at least: where no step is to be waited for, seconds of one topic would
otherwise come before those of the next, as no vehicle sends them."""


@contextmanager
def ros() -> Iterator[None]:
    """Be in the ROS graph."""
    rclpy.init(args=[])
    try:
        yield
    finally:
        rclpy.shutdown()


def live(messages: Messages, bench: Bench, expected: Outcome) -> Outcome:
    """
    Publish messages as fast as the node takes them, and return what came of it.

    Parameters
    ----------
    messages : list of LogMessage
        In the order of arrival.
    bench : Bench
        The vehicle.
    expected : Outcome
        Of a replay with ``WAIT``: says how many steps there have to be after each chunk.

    """
    with TemporaryDirectory() as folder, ros():
        # the topics are this run's own: others may run beside it
        run = _Live(bench, Path(folder), f'/fault{os.getpid()}')
        try:
            run.publish(messages, expected)
            return run.end()
        finally:
            run.node.kill()
            run.peer.close()


class _Live:
    """The node, and what it says."""

    def __init__(self, bench: Bench, folder: Path, namespace: str) -> None:
        self._dofs = bench.recording.settings.dofs
        self._namespace = namespace
        self._times: set[int] = set()
        self._never = 0.0  # steps of the replay that were waited for in vain
        values, topics = _values(bench, namespace)
        self.peer = Peer()
        self._states = self.peer.listen(
            f'{namespace}/rov/identifier_state', 'sensor_msgs/msg/JointState')
        self._models = self.peer.listen(
            f'{namespace}/rov/params', 'std_msgs/msg/Float64MultiArray')
        self._health = self.peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
        file = write_parameters(folder / 'parameters.yaml', values)
        self.node = NodeProcess(
            ['--ros-args', '--params-file', file, '-r', f'__ns:={namespace}'],
            child_environment(), folder, REPOSITORY, 'test.support.patient_node')
        self.peer.advertise(topics)

    def publish(self, messages: Messages, expected: Outcome) -> None:
        """Publish chunk by chunk."""
        arrivals = [arrival for arrival, _ in expected.released]
        self._times = {int(step.split()[0]) for step in expected.steps}
        end = messages[0].time + CHUNK
        for message in messages:
            if message.time >= end:
                taken = bisect_right(arrivals, end)
                self._settle(expected.released[taken - 1][1] if taken else 0)
                end = message.time + CHUNK
            self.peer.send(f'{self._namespace}{message.topic}', cdr(message))
        self._settle(expected.released[-1][1] if arrivals else 0)

    def end(self) -> Outcome:
        """Stop the node and return what it said."""
        told = len(self._health)
        self.peer.until(lambda: len(self._own(told)) > 1)  # the first may be older
        rejected = rejected_in(self._own(told)[-1])
        code = self.node.stop()
        self.peer.spin(0.5)  # it waits until all has come, only this side may have to take it
        outcome = Outcome(rejected, _warnings(self.node.output))
        outcome.failed = '' if code == 0 and 'Traceback' not in self.node.output else (
            f'exit code {code}: {self.node.output[-300:]}')
        outcome.not_finite = sum(not all(map(isfinite, m.data)) for m in self._models)
        if self._models:
            last = list(self._models[-1].data)
            outcome.models = {dof: tuple(last[4 * i:4 * i + 4])
                              for i, dof in enumerate(self._dofs)}
        # that a DOF has become stale is told between the steps
        outcome.steps = [step_text(_stamp(s), list(s.velocity), list(s.effort))
                         for s in self._states
                         if _stamp(s) in self._times or all(map(isfinite, s.velocity))]
        return outcome

    def _settle(self, count: float = inf) -> None:
        """Wait for so many steps in all, or until no more come."""
        began = since = time.monotonic()
        steps = len(self._states)
        while (now := time.monotonic()) < began + PACE or (
                len(self._states) < count - self._never and now < since + QUIET):
            self.peer.executor.spin_once(timeout_sec=0.02)
            if len(self._states) != steps:
                steps, since = len(self._states), now
        if count < inf:
            self._never = max(0.0, count - len(self._states))

    def _own(self, since: int) -> list[Any]:
        return [m for m in self._health[since:]
                if any(s.name.startswith(f'{self._namespace}/') for s in m.status)]


def _stamp(state: Any) -> int:
    """Return the time of a message [ns]."""
    return int(state.header.stamp.sec * SECOND + state.header.stamp.nanosec)


def _values(bench: Bench, namespace: str) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the parameters of a live run, and the type of each of its topics."""
    values = {**bench.values, 'max_wait': WAIT}
    topics = {}
    for key, value in bench.values.items():
        name, _, last = key.rpartition('.')
        if last == 'topic' and value:
            values[key] = namespace + value
            values[f'{name}.qos'] = 'reliable'
            topics[namespace + value] = bench.values[f'{name}.type']
    return values, topics


def _warnings(output: str) -> list[str]:
    """Return what the node logged as a warning or an error."""
    return re.findall(r'^\[(?:WARN|ERROR|FATAL)\] \[[\d.]+\] \[[^]]*\]: (.*)$', output, re.M)
