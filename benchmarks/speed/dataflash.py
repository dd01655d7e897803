"""
A log of ArduSub against the same data as MCAP.

``python -m benchmarks.speed.dataflash [--runs N] [--seconds S]``

The same simulated dive with a DVL is written as ArduSub writes it, with its IMU, second barometer
and battery beside it, and in messages of ROS, and replayed from both in turn.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
from pathlib import Path
import subprocess
from tempfile import TemporaryDirectory
from typing import Any

from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from

from benchmarks.speed.commands import CLI, environment, measure, ROOT, table
from test.support.dataflash_logs import dive

MESSAGES = {
    'depth.type': 'std_msgs/msg/Float64', 'depth.field': 'data', 'depth.stamp': 'receive',
    'attitude.type': 'sensor_msgs/msg/Imu', 'attitude.field': 'orientation',
    'velocity.type': 'geometry_msgs/msg/TwistStamped', 'velocity.field': 'twist.linear',
    'thrusters.type': 'std_msgs/msg/Float64MultiArray', 'thrusters.field': 'data',
    'thrusters.stamp': 'receive'}
"""What the MCAP file has instead of the records of ArduPilot."""

AT_100_HZ = {'without the IMU': 0, 'one IMU at 100 Hz': 1, 'four IMUs at 100 Hz': 4}
"""Records that nobody asked for, beside those at 10 Hz."""


def parameters() -> dict[str, Any]:
    """Return the shipped configuration with a DVL, and a vehicle to simulate."""
    truth = load(ROOT / 'config' / 'bluerov2_ardusub.yaml')
    return {
        **load(ROOT / 'config' / 'ardusub_bin.yaml'),
        **{key: value for key, value in truth.items() if key.startswith('simulation.')},
        'dofs': ['surge', 'sway', 'heave', 'yaw'], 'velocity.topic': '/VISO',
        **{f'simulation.{name}_rate': 10.0 for name in (
            'thruster', 'attitude', 'depth', 'velocity')}}


def lines(folder: Path, runs: int, seconds: float) -> list[str]:
    """Return the table and what it is of."""
    def written(name: str, values: dict[str, Any]) -> Path:
        file = folder / f'{name}.yaml'  # JSON is YAML
        file.write_text(json.dumps({'/**': {'ros__parameters': values}}))
        return file

    values = parameters()
    ours, messages = written('bin', values), written('mcap', {**values, **MESSAGES})
    mcap = folder / 'dive.mcap'
    subprocess.run([*CLI, 'simulate', '--params-file', messages, '--output', mcap, '--duration',
                    str(seconds)], check=True, cwd=ROOT, env=environment(),
                   stdout=subprocess.DEVNULL)
    logs = {'.mcap': (mcap, messages)}
    for name, busy in AT_100_HZ.items():
        log = folder / f'{busy}.BIN'
        log.write_bytes(dive(settings_from(values), seconds, busy=busy).data)
        logs[f'.BIN, {name}'] = log, ours
    commands: dict[str, Sequence[object]] = {
        f'{name}, {log.stat().st_size / 1e6:.1f} MB': [
            *CLI, 'replay', log, '--params-file', file, '--json', folder / 'out.json']
        for name, (log, file) in logs.items()}
    return [f'`rovid replay` of {seconds:.0f} s, to JSON. Asked for: at most twice the time of '
            'the same data as MCAP.', '', table(measure(commands, runs), next(iter(commands)))]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--runs', type=int, default=3)
    parser.add_argument('--seconds', type=float, default=600.0)
    args = parser.parse_args()
    with TemporaryDirectory() as folder:
        print('\n'.join(lines(Path(folder), args.runs, args.seconds)))


if __name__ == '__main__':
    main()
