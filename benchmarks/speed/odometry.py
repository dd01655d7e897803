"""
How much faster than real time a vehicle with everything is replayed.

``python -m benchmarks.speed.odometry [--runs N] [--seconds S]``

Six degrees of freedom, eight thrusters at 50 Hz and an odometry with velocities at 200 Hz:
``rovid replay`` to JSON, against AnyReader with decoding of the same log.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
from pathlib import Path
from statistics import median
import subprocess
from tempfile import TemporaryDirectory
from typing import Any

from rovid_ros.config.parameter_file import load

from benchmarks.speed.commands import CLI, environment, measure, ROOT, table
from benchmarks.speed.replay import BASE, decoding

RATE = 200.0
"""[Hz] of the odometry."""

ANGULAR = {'roll': (2.0, 0.09), 'pitch': (2.0, 0.07)}
"""DOF that no shipped file has: amplitude [N m] and frequency [Hz] of its thrust."""


def parameters(method: str) -> dict[str, Any]:
    """Return the shipped configuration of an odometry with the thrusters of a BlueROV2 Heavy."""
    heavy = load(ROOT / 'config' / 'ardusub_bin.yaml')
    values = {key: value for key, value in load(ROOT / 'config' / 'odometry_wrench.yaml').items()
              if not key.startswith('thrusters.')}
    values.update({
        'dofs': ['surge', 'sway', 'heave', 'roll', 'pitch', 'yaw'],
        'identifier.method': method,
        'velocity.topic': '/odometry', 'angular_velocity.topic': '/odometry',
        'thrusters.topic': '/thrusters', 'thrusters.type': 'std_msgs/msg/Float64MultiArray',
        'thrusters.field': 'data', 'thrusters.stamp': 'receive', 'thrusters.timeout': 1.0,
        'thrusters.gain': heavy['thrusters.gain'],
        'thrusters.allocation': heavy['thrusters.allocation'],
        'simulation.position_rate': RATE, 'simulation.attitude_rate': RATE,
        'simulation.velocity_rate': RATE, 'simulation.angular_velocity_rate': RATE,
        'simulation.thruster_rate': 50.0})
    for dof, (force, frequency) in ANGULAR.items():
        values.update({
            f'{dof}.initial.mass': 4.0, f'{dof}.initial.quadratic_drag': 4.0,
            f'{dof}.initial.linear_drag': 1.0, f'{dof}.typical.force': 3.0,
            f'{dof}.typical.velocity': 0.5, f'simulation.{dof}.mass': 7.0,
            f'simulation.{dof}.quadratic_drag': 6.0, f'simulation.{dof}.linear_drag': 1.5,
            f'simulation.{dof}.forces': [force], f'simulation.{dof}.frequencies': [frequency]})
    return values


def lines(folder: Path, runs: int, seconds: float) -> list[str]:
    """Return the table and what it is of."""
    commands: dict[str, Sequence[object]] = {}
    log = folder / 'log.mcap'
    for method in ('aid', 'ekf'):
        file = folder / f'{method}.yaml'  # JSON is YAML
        file.write_text(json.dumps({'/**': {'ros__parameters': parameters(method)}}))
        commands[f'rovid replay, {method}'] = [
            *CLI, 'replay', log, '--params-file', file, '--json', folder / f'{method}.json']
    subprocess.run([*CLI, 'simulate', '--params-file', file, '--output', log, '--duration',
                    str(seconds)], check=True, cwd=ROOT, env=environment(),
                   stdout=subprocess.DEVNULL)
    commands[BASE] = decoding(log)
    found = measure(commands, runs)
    steps = sum(dof['steps'] for dof in json.loads(
        (folder / 'ekf.json').read_text())['dofs'].values())
    speeds = ', '.join(f'{name.split()[-1]} {seconds / median(one.times):.1f} times'
                       for name, one in found.items() if name != BASE)
    return [f'{seconds:g} s, 6 DOFs, 8 thrusters, odometry at {RATE:g} Hz, {steps:,} steps; '
            f'whole commands, {runs} runs in turn. Real time: {speeds}.', '', table(found, BASE)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--runs', type=int, default=3)
    parser.add_argument('--seconds', type=float, default=120.0)
    given = parser.parse_args(arguments)
    with TemporaryDirectory() as folder:
        print('\n'.join(lines(Path(folder), given.runs, given.seconds)))


if __name__ == '__main__':
    main()
