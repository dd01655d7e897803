"""
A long log for the benchmarks.

``python -m benchmarks.speed.long_log HOURS OUT.mcap PARAMS.yaml``

Ten fixes, twenty depths, fifty attitudes and twenty thruster messages a second, zstd chunks. As
on a vehicle, every message is logged a few milliseconds after its stamp, some later than others,
so that the order of the log is not that of the stamps; the headers have frames.
"""

from __future__ import annotations

from collections.abc import Iterator
import heapq
from itertools import groupby
from pathlib import Path
import sys
from typing import Any

import numpy as np
from rovid_core.settings.run import Settings
from rovid_core.simulation.sensors import simulate
from rovid_ros.commands.simulate import EPOCH
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.logs.writer import LogWriter
from rovid_ros.messages.simulated_messages import SensorMessage, SensorMessages

CONFIG = Path(__file__).parents[2] / 'config' / 'jhurov.yaml'
RATES = {'position_rate': 10.0, 'depth_rate': 20.0, 'attitude_rate': 50.0, 'thruster_rate': 20.0}
FRAMES = {'/sharps/position': 'sharps', '/depth/pressure': 'pressure_link',
          '/imu/data': 'imu_link', '/thrusters/current': ''}
DELAYS = {'/sharps/position': (30.0, 15.0), '/depth/pressure': (4.0, 2.0),
          '/imu/data': (2.0, 1.0), '/thrusters/current': (3.0, 3.0)}
"""[ms] From stamp to log: the shortest, and the mean of what comes on top."""

LATEST = 60_000_000
"""[ns] Later than this nothing comes: max_wait is 100 ms, and nothing is to be refused."""


def settings() -> Settings:
    """Return the shipped configuration with the rates of the benchmark and ``aid``."""
    values = load(CONFIG)
    values['identifier.method'] = 'aid'
    values.update({f'simulation.{name}': rate for name, rate in RATES.items()})
    return settings_from(values)


def parameters() -> str:
    """Return the text of the shipped configuration with ``aid``."""
    return CONFIG.read_text(encoding='utf-8').replace('method: ekf ', 'method: aid ', 1)


def write(hours: float, path: Path) -> int:
    """Write the log; return the number of messages."""
    partial = path.with_suffix('.part')
    count = 0
    with LogWriter(partial) as writer:
        for time, _, message in _in_order(settings(), 3600.0 * hours):
            writer.write(message.topic, message.type, message.fields, time)
            count += 1
    partial.rename(path)
    return count


def _in_order(run: Settings, duration: float) -> Iterator[tuple[int, int, SensorMessage]]:
    """Yield log time [ns], number and message in the order of the log."""
    random = np.random.default_rng(1)
    sensors = SensorMessages(run)
    waiting: list[tuple[int, int, SensorMessage]] = []
    count = 0
    newest: dict[str, int] = {}
    for time, group in groupby(simulate(run, duration, 1), key=lambda sample: sample[0]):
        now = EPOCH + time
        while waiting and waiting[0][0] <= now:
            yield heapq.heappop(waiting)
        for message in sensors.messages(now, {name: value for _, name, value in group}):
            least, mean = DELAYS[message.topic]
            delay = round(1e6 * (least + mean * random.exponential()))
            # a topic's own messages do not overtake each other
            due = max(now + min(delay, LATEST), newest.get(message.topic, 0) + 1)
            newest[message.topic] = due
            _frame(message.fields, FRAMES[message.topic])
            heapq.heappush(waiting, (due, count, message))
            count += 1
    while waiting:
        yield heapq.heappop(waiting)


def _frame(fields: dict[str, Any], name: str) -> None:
    fields['header']['frame_id'] = name


if __name__ == '__main__':
    Path(sys.argv[3]).write_text(parameters(), encoding='utf-8')
    print(f'{sys.argv[2]}: {write(float(sys.argv[1]), Path(sys.argv[2])):,} messages')
