"""
The live node beside a node that only passes positions on.

``python -m benchmarks.speed.latency``

From the sending of a position to the arrival of ``rov/params`` at a subscriber, and the time
that the cores work for the node. Both nodes, what publishes and what listens are processes of
their own; the nodes have their turns one after the other at each rate, so that what else the
machine does hits both alike.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
import os
from pathlib import Path
from statistics import median
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

import numpy as np
from rovid_ros.config.parameter_file import load
from rovid_ros.node.transport.message_types import import_type
from rovid_ros.node.transport.publishers import latched, reliable
from rovid_ros.results.outputs import LATCHED, TOPICS

from benchmarks.speed.commands import ratios
from benchmarks.speed.latency_sensors import Ask, rates, serve
from test.support.answers import delays_between, delays_of, UNANSWERED
from test.support.fault_live import ros
from test.support.live import Peer, write_parameters
from test.support.processes import child_environment, NodeProcess, REPOSITORY, run_time
from test.support.trials import CONFIG

RATES = (10.0, 100.0, 1000.0)
SETTLING, IDLE = 5.0, 10.0
"""[s] Nodes are left alone for, and then an idle one is watched for."""

PASSING = 'passing on'
ONE, ALL = 'rov/params', 'all topics'
OUTPUTS: dict[str, tuple[str, ...]] = {ONE: ('rov/params',), ALL: tuple(TOPICS)}
QUEUE = 5000
PAUSE = 0.3
"""[s] Between two looks at what has come, so that who listens takes no time from the nodes."""


@dataclass(frozen=True)
class Turn:
    """What came of one node at one rate: latencies [ms], share of a core, positions."""

    p50: float
    p99: float
    cpu: float
    sent: int
    answered: int


class Bench:
    """
    All processes, for as long as the measurements last.

    Parameters
    ----------
    names : sequence of str
        Of the nodes: ``PASSING`` or a method.
    folder : Path
        For the parameter files.

    """

    def __init__(self, names: Sequence[str], folder: Path) -> None:
        self.values = load(CONFIG / 'jhurov.yaml')
        self._spaces = {name: f'/latency{os.getpid()}_{i}' for i, name in enumerate(names)}
        self._peer = Peer()
        self.nodes = {name: self._node(name, folder) for name in self._spaces}
        context = get_context('spawn')
        self._pipe, theirs = context.Pipe()
        self._sensors = context.Process(
            target=serve, args=(theirs, self.values, tuple(self._spaces.values())))
        self._sensors.start()
        self._answer()

    def close(self) -> None:
        """End all processes."""
        self._pipe.send(None)
        self._sensors.join()
        for node in self.nodes.values():
            node.kill()
        self._peer.close()

    def idle(self) -> dict[str, float]:
        """Return the share of a core that each node takes while nothing comes."""
        before = {name: run_time(node.process.pid) for name, node in self.nodes.items()}
        time.sleep(IDLE)
        return {name: (run_time(node.process.pid) - before[name]) / IDLE
                for name, node in self.nodes.items()}

    def turn(self, name: str, rate: float, duration: float, outputs: Sequence[str]) -> Turn:
        """Let a node have its turn."""
        space = self._spaces[name]
        subscriptions = {topic: self._peer.node.create_subscription(
            import_type(TOPICS[topic]), f'{space}/{topic}', lambda *_: None,
            latched(1) if topic in LATCHED and topic != 'rov/params' else reliable(QUEUE),
            raw=True) for topic in outputs}
        self._pipe.send(Ask(space, rate, duration))
        self._answer()
        time.sleep(0.5)  # discovery; nobody spins: what comes is looked at afterwards
        pid = self.nodes[name].process.pid
        before, began = run_time(pid), time.monotonic()
        self._pipe.send('go')
        came: list[tuple[int, bytes]] = []
        while not self._pipe.poll(PAUSE):
            _take(subscriptions, came)
        sent = self._answer()
        cpu = (run_time(pid) - before) / (time.monotonic() - began)
        time.sleep(PAUSE)
        _take(subscriptions, came)
        for subscription in subscriptions.values():
            self._peer.node.destroy_subscription(subscription)
        return _turn(sent, came, cpu, passing=name == PASSING)

    def _node(self, name: str, folder: Path) -> NodeProcess:
        space = self._spaces[name]
        values = {key: space + value if key.endswith('.topic') and value else value
                  for key, value in self.values.items()}
        own = {'max_wait': 0.0} if name == PASSING else {
            'max_wait': 0.0, 'identifier.method': name}
        place = folder / space.lstrip('/')
        place.mkdir()
        file = write_parameters(place / 'parameters.yaml', {**values, **own})
        return NodeProcess(
            ['--ros-args', '--params-file', file, '-r', f'__ns:={space}'],
            child_environment(), place, REPOSITORY,
            *(('benchmarks.speed.pass_through',) if name == PASSING else ()))

    def _answer(self) -> Any:
        assert self._pipe.poll(120.0), 'waited in vain'
        return self._pipe.recv()


def _take(subscriptions: dict[str, Any], came: list[tuple[int, bytes]]) -> None:
    """Take all that waits; of the parameters, also when the middleware had received them [ns]."""
    for topic, subscription in subscriptions.items():
        with subscription.handle:
            while taken := subscription.handle.take_message(subscription.msg_type, True):
                cdr, info = taken
                if topic == ONE:
                    came.append((info['received_timestamp'], cdr))


def _turn(sent: Sequence[tuple[str, int]], came: Sequence[tuple[int, bytes]], cpu: float,
          passing: bool) -> Turn:
    positions = [moment for name, moment in sent if name == 'position']
    if passing:
        delays = delays_between(positions, [arrival for arrival, _ in came])
    else:
        positions = positions[UNANSWERED:]
        delays = delays_of(sent, came)
    p50, p99 = np.percentile(delays, [50, 99]) / 1e6
    return Turn(float(p50), float(p99), cpu, len(positions), len(delays))


Turns = dict[tuple[float, str, str], list[Turn]]
"""By rate, subscribers and node."""


def measure(bench: Bench, names: Sequence[str], runs: int, duration: float) -> Turns:
    """Let all have their turns ``runs`` times."""
    found: Turns = {}
    for run in range(runs):
        for rate in RATES:
            for heard, outputs in OUTPUTS.items():
                for name in names:
                    turn = bench.turn(name, rate, duration, outputs)
                    found.setdefault((rate, heard, name), []).append(turn)
        print(f'run {run + 1} of {runs}', file=sys.stderr)
    return found


def table(found: Turns) -> str:
    """Return latency and CPU, and their ratios to those of the node that passes on."""
    lines = ['| Hz | subscribers | node | p50 [ms] | ratio | lowest to highest | CPU | ratio | '
             'lowest to highest | answered |', '|---|---|---|---|---|---|---|---|---|---|']
    for (rate, heard, name), turns in found.items():
        base = found[rate, heard, PASSING]
        latency = _ratios([t.p50 for t in turns], [t.p50 for t in base])
        cpu = _ratios([t.cpu for t in turns], [t.cpu for t in base])
        answered = sum(t.answered for t in turns) / sum(t.sent for t in turns)
        lines.append(
            f'| {rate:g} | {heard} | {name} | {median(t.p50 for t in turns):.2f} | {latency} | '
            f'{100 * median(t.cpu for t in turns):.1f} % | {cpu} | {100 * answered:.1f} % |')
    return '\n'.join(lines)


def tails(found: Turns) -> str:
    """Return the 99th percentiles of the latency."""
    lines = ['| Hz | subscribers | node | p99 [ms] | lowest to highest |', '|---|---|---|---|---|']
    for (rate, heard, name), turns in found.items():
        each = [t.p99 for t in turns]
        lines.append(f'| {rate:g} | {heard} | {name} | {median(each):.1f} | {min(each):.1f} to '
                     f'{max(each):.1f} |')
    return '\n'.join(lines)


def _ratios(one: Sequence[float], other: Sequence[float]) -> str:
    """Return the median of the ratios of the turns that were side by side, and their spread."""
    middle, low, high = ratios(one, other)
    return f'{middle:.2f} | {low:.2f} to {high:.2f}'


def _idle(shares: Mapping[str, float]) -> str:
    return ', '.join(f'{name} {100 * share:.2f} %' for name, share in shares.items())


def report(names: Sequence[str], runs: int, duration: float) -> str:
    """Measure everything and return it as Markdown."""
    with TemporaryDirectory() as folder, ros():
        bench = Bench(names, Path(folder))
        try:
            time.sleep(SETTLING)
            idle = bench.idle()
            found = measure(bench, names, runs, duration)
        finally:
            bench.close()
        others = '; '.join(', '.join(f'{name} {beside:g}' for name, beside in rates(
            bench.values, rate).items()) for rate in RATES)
    return (f'{INTRODUCTION}\n{runs} runs in turn, {duration:g} s each. Rates [Hz]: {others}.\n\n'
            f'{table(found)}\n\n{tails(found)}\n\nCPU while nothing comes: {_idle(idle)}')


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--runs', type=int, default=5)
    parser.add_argument('--seconds', type=float, default=4.0, metavar='S')
    parser.add_argument('--methods', default='aid', metavar='M,...')
    given = parser.parse_args(arguments)
    os.environ['OPENBLAS_NUM_THREADS'] = '1'
    print(report((PASSING, *given.methods.split(',')), given.runs, given.seconds))


INTRODUCTION = """\
The shipped configuration with `max_wait: 0`: surge from positions, heave from depths, yaw from
attitudes, each of which makes a step and so an output. Depths and currents come at the rates of
the configuration; attitudes at that of the positions where it is higher, for a position waits for
the attitude of the middle of its interval. The messages of one instant come one after the other,
2 ms or a quarter of the interval of the positions apart, the position last. The other node takes
the same messages, decodes them, and publishes an array for each position. A latency goes from the
sending of a position to when the subscriber's middleware has `rov/params`; the CPU is that of the
node's process. Ratios are of turns that were side by side: median, lowest to highest.
"""


if __name__ == '__main__':
    main()
