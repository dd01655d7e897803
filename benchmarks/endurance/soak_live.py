"""The node on DDS for long, with the sensors of a simulated vehicle at 50 Hz."""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import TemporaryDirectory
import time
from typing import Any

from rovid_core.settings.run import Settings
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.results.outputs import DIAGNOSTIC_TYPE

from benchmarks.endurance.soak_outcome import Soak
from test.support.fault_live import ros
from test.support.live import Peer, rejected_in, write_parameters
from test.support.processes import child_environment, NodeProcess, REPOSITORY, resident
from test.support.sensors import at_rates, encoded, sensed, stamp
from test.support.trials import CONFIG

RATE = 50.0  # [Hz] of every sensor


def live(duration: float) -> Soak:
    """Publish for a time [s] of the wall clock and watch the node's process."""
    values = load(CONFIG / 'jhurov.yaml')
    settings = at_rates(settings_from(values), position=RATE, depth=RATE, attitude=RATE,
                        thruster=RATE)
    with TemporaryDirectory() as folder, ros():
        run = _Run(values, Path(folder), f'/soak{os.getpid()}')
        try:
            return run.publish(settings, duration)
        finally:
            run.node.kill()
            run.peer.close()


class _Run:
    """The node and its peer, who keeps only the last of what it hears."""

    def __init__(self, values: dict[str, Any], folder: Path, namespace: str) -> None:
        self.peer = Peer()
        self._namespace = namespace
        self._heard = self.peer.listen(
            f'{namespace}/rov/params', 'std_msgs/msg/Float64MultiArray')
        self._health = self.peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
        self._count = 0
        self._refused: dict[str, int] = {}
        self._last: Any = None
        self._inputs = ('position', 'depth', 'attitude', 'thrusters')
        self._dofs = values['dofs']
        topics = {namespace + values[f'{name}.topic']: values[f'{name}.type']
                  for name in self._inputs}
        own = {f'{name}.topic': namespace + values[f'{name}.topic'] for name in self._inputs}
        file = write_parameters(folder / 'parameters.yaml', {**values, **own})
        self.node = NodeProcess(
            ['--ros-args', '--params-file', file, '-r', f'__ns:={namespace}'],
            child_environment(), folder, REPOSITORY)
        self.peer.advertise(topics)

    def publish(self, settings: Settings, duration: float) -> Soak:
        """Send what the vehicle measures when it is due."""
        soak = Soak(f'{duration:g} s of the node on DDS, ekf', duration)
        sent: dict[str, int] = {}
        minute = min(60.0, duration / 20.0)
        begin = sample_due = time.time_ns()
        first = None
        for message in sensed(settings, duration):
            first = message.time if first is None else first
            due = begin + message.time - first
            while (left := (due - time.time_ns()) * 1e-9) > 0.0:
                self.peer.executor.spin_once(timeout_sec=left)
            cdr = encoded(message)
            stamp(cdr, due)
            self.peer.send(self._namespace + message.topic, bytes(cdr))
            sent[message.topic] = sent.get(message.topic, 0) + 1
            if due >= sample_due:
                self._take()
                soak.memory.append(((due - begin) * 1e-9, resident(self.node.process.pid)))
                sample_due += round(1e9 * minute)
        soak.memory.append((duration, resident(self.node.process.pid)))
        self.peer.spin(2.0)  # /diagnostics comes each second
        self.node.stop()  # what it holds comes out
        self.peer.settle(self._heard)
        self._take()
        sources = {settings.input(name).topic for name in self._inputs[:3]}
        soak.steps = self._count
        # two measurements make the first velocity, which the filters start from
        soak.missed = sum(sent[topic] - 2 for topic in sources) - self._count
        soak.refused = self._refused
        data = list(self._last.data)
        soak.models = {dof: tuple(data[4 * i:4 * i + 4]) for i, dof in enumerate(self._dofs)}
        return soak

    def _take(self) -> None:
        self._count += len(self._heard)
        if self._heard:
            self._last = self._heard[-1]
        self._heard.clear()
        for message in self._health:
            if any(status.name.startswith(f'{self._namespace}/') for status in message.status):
                self._refused = rejected_in(message)
        self._health.clear()
