"""
How many messages the node takes.

``python -m benchmarks.speed.load [--rates HZ,...]``

Positions and thruster currents come at the same rate each, attitudes at up to 200 Hz, over
DDS, into the node in a process of its own; a second process publishes them. A node that only
passes positions on (``benchmarks.speed.pass_through``) goes through the same beside it.
"""

from __future__ import annotations

import argparse
from bisect import bisect_right
from dataclasses import dataclass
from multiprocessing import get_context
import os
from pathlib import Path
from tempfile import TemporaryDirectory
import time
from typing import Any

import numpy as np
from rovid_ros.config.parameter_file import load
from rovid_ros.results.outputs import DIAGNOSTIC_TYPE

from benchmarks.speed.load_sensors import publish
from test.support.fault_live import ros
from test.support.live import Peer, rejected_in, write_parameters
from test.support.processes import child_environment, cpu_time, NodeProcess, REPOSITORY
from test.support.sensors import stamp_of
from test.support.trials import CONFIG

RATES = (50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0)
QUIET = 2.0
"""[s] without an output after which no more is expected."""

Sent = dict[str, list[tuple[int, int]]]
"""By input: the stamp of each message, and when it was sent [ns]."""

ARRAY = 'std_msgs/msg/Float64MultiArray'


@dataclass(frozen=True)
class Load:
    """
    What came of one rate.

    Attributes
    ----------
    node : str
        Which one.
    rate, reached : float
        Asked of the publisher, and what it reached [Hz].
    expected, got : int
        Steps.
    refused : dict
        What the node says it refused: ``input.reason`` -> how often.
    cpu : float
        Share of a core while messages came.
    latencies : tuple of two floats
        From a position to the parameters, median and 99 % [ms].
    behind : float
        From the last position to the last parameters [s].

    """

    node: str
    rate: float
    reached: float
    expected: int
    got: int
    refused: dict[str, int]
    cpu: float
    latencies: tuple[float, float]
    behind: float

    def row(self) -> str:
        """Return a line of the table."""
        p50, p99 = self.latencies
        refused = ', '.join(f'{name} {count}' for name, count in self.refused.items())
        return (f'| {self.node} | {self.rate:g} | {self.reached:.0f} | {self.expected} | '
                f'{self.expected - self.got} | {refused} | {100 * self.cpu:.0f} % | '
                f'{p50:.1f} | {p99:.1f} | {self.behind:.1f} |')


def loaded(rate: float, duration: float, passing: bool = False) -> Load:
    """Let a node have positions and currents at a rate [Hz] for a time [s]."""
    values = _values(f'/load{os.getpid()}')
    with TemporaryDirectory() as folder, ros():
        file = write_parameters(Path(folder, 'parameters.yaml'), values)
        peer = Peer()
        names = {name: f'/load{os.getpid()}/rov/{name}' for name in ('params', 'identifier_state')}
        arrivals: dict[str, list[tuple[int, bytes]]] = {name: [] for name in names}
        for name, kind in (('params', ARRAY), ('identifier_state', 'sensor_msgs/msg/JointState')):
            peer.tap(names[name], kind, lambda cdr, to=arrivals[name]: to.append(
                (time.time_ns(), cdr)))
        health = peer.listen('/diagnostics', DIAGNOSTIC_TYPE)
        node = NodeProcess(
            ['--ros-args', '--params-file', file, '-r', f'__ns:=/load{os.getpid()}'],
            child_environment(), Path(folder), REPOSITORY,
            *(('benchmarks.speed.pass_through',) if passing else ()))
        try:
            sent, cpu = _published(peer, node, values, rate, duration, arrivals['params'])
            health.clear()
            if not passing:
                peer.until(lambda: len(_own(health)) > 1)
            refused = {} if passing else rejected_in(_own(health)[-1])
            came = len(arrivals['params'])
            node.stop()  # what it holds comes out
            peer.spin(0.5)
        finally:
            node.kill()
            peer.close()
    return _load('passing on' if passing else 'rovid', rate, sent, cpu, refused, came,
                 [t for t, _ in arrivals['params']],
                 [stamp_of(cdr) for _, cdr in arrivals['identifier_state']])


def _values(namespace: str) -> dict[str, Any]:
    """Return the shipped configuration without its depth, on topics of this run."""
    values = {key: value for key, value in load(CONFIG / 'jhurov.yaml').items()
              if not key.startswith('depth.')}
    return {key: namespace + value if key.endswith('.topic') and value else value
            for key, value in values.items()}


def _published(peer: Peer, node: NodeProcess, values: dict[str, Any], rate: float,
               duration: float, params: list[Any]) -> tuple[Sent, float]:
    """Have another process publish; return what was sent and the share of a core."""
    context = get_context('spawn')
    ours, theirs = context.Pipe()
    process = context.Process(target=publish, args=(theirs, values, rate, duration))
    process.start()
    peer.until(lambda: ours.poll(), 120.0)  # it is ready
    ours.recv()
    peer.spin(0.5)
    before, began = cpu_time(node.process.pid), time.monotonic()
    ours.send('go')
    peer.until(lambda: ours.poll(), duration * 20.0)
    sent: Sent = ours.recv()
    cpu = (cpu_time(node.process.pid) - before) / (time.monotonic() - began)
    process.join()
    count, since = -1, time.monotonic()
    while time.monotonic() - since < QUIET:
        if len(params) != count:
            count, since = len(params), time.monotonic()
        peer.executor.spin_once(timeout_sec=0.05)
    return sent, cpu


def _load(name: str, rate: float, sent: Sent, cpu: float,
          refused: dict[str, int], came: int,
          params: list[int], middles: list[int]) -> Load:
    stamps, times = zip(*sent['position'])
    reached = (len(times) - 1) / ((times[-1] - times[0]) * 1e-9)
    if name == 'rovid':
        # two measurements make the first velocity, which the filters start from
        expected = sum(len(sent[name]) - 2 for name in ('position', 'attitude'))
        # an estimate stands at the middle between two fixes; it comes of the later one
        pairs = [(arrival, bisect_right(stamps, middle)) for arrival, middle in zip(
            params, middles)]
        delays = [arrival - times[k] for arrival, k in pairs if k < len(times)]
    else:
        expected = len(times)
        delays = [arrival - time for arrival, time in zip(params, times)]
    p50, p99 = np.percentile(delays, [50, 99]) / 1e6 if delays else (np.nan, np.nan)
    behind = (params[came - 1] - times[-1]) * 1e-9 if came else np.nan
    return Load(name, rate, reached, expected, len(params), refused, cpu,
                (float(p50), float(p99)), behind)


def _own(health: list[Any]) -> list[Any]:
    return [m for m in health if any(f'/load{os.getpid()}/' in s.name for s in m.status)]


def main() -> None:
    """Print or write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rates', default=','.join(f'{r:g}' for r in RATES), metavar='HZ,...')
    parser.add_argument('--duration', type=float, default=10.0, metavar='S')
    given = parser.parse_args()
    os.environ['OPENBLAS_NUM_THREADS'] = '1'
    print(INTRODUCTION.format(seconds=given.duration), end='', flush=True)
    for rate in map(float, given.rates.split(',')):
        for passing in (True, False):
            print(loaded(rate, given.duration, passing).row(), flush=True)


INTRODUCTION = """\
Positions and currents come at the rate each, attitudes at the rate or 200 Hz, for {seconds:g} s,
over DDS, with the shipped configuration and method (no depth). Times depend on the machine; the
node that only passes positions on, in the same run, is the yardstick.

* Hz, reached: what the publisher was to do, and did; fixes are as much better as they are more
* lost: steps that did not come; a step needs two positions, or two attitudes
* latency, 99 %: the median and the 99th percentile of the time from a position to `rov/params`;
  this waits for the attitude that belongs to it
* behind: from the last position to the last parameters

| node | Hz | reached | steps | lost | refused | CPU | latency [ms] | 99 % [ms] | behind [s] |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
"""


if __name__ == '__main__':
    main()
