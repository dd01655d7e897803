"""The live node, killed at random moments while sensors come over DDS."""

from __future__ import annotations

import os
from pathlib import Path
import random
import subprocess
import sys
import time

from rovid_core.pipeline.stream import Stream
from rovid_ros.commands.simulate import simulate_log
from rovid_ros.config.parameter_file import load
from rovid_ros.config.parameters import settings_from
from rovid_ros.files.state_file import load as load_checkpoint
from rovid_ros.logs.log import Log

from test.support.kill_tally import configured, environment, Tally
from test.support.processes import REPOSITORY

SPEED = 2.0
"""Times real time at which the messages are sent, so that more of them are on the way."""

LONGEST = 5.0
"""[s] from when the node has its files to the kill."""

PATIENCE = 60.0
"""[s] in which it has to have them, also on a busy machine."""

MOST_LEFT = 2
"""Temporary files of one save: what is written, and the second name of the one before."""


class Vehicle:
    """The sensors of a simulated vehicle, over DDS."""

    def __init__(self, log: Path, topics: list[str]) -> None:
        import rclpy
        from rclpy.qos import qos_profile_sensor_data
        from rovid_ros.node.transport.message_types import import_type
        rclpy.init(args=[])
        self.node = rclpy.create_node('vehicle')
        with Log([log]) as opened:
            self._messages = [(m.time, m.channel.topic, m.data) for m in opened.raw(topics)]
            types = {name: opened.topics[name].type for name in topics}
        self._publishers = {
            name: self.node.create_publisher(import_type(kind), name, qos_profile_sensor_data)
            for name, kind in types.items()}
        self._next = 0

    def drive(self, until: float) -> None:
        """Send what is due, up to a time of the steady clock."""
        first, began = self._messages[self._next][0], time.monotonic()
        while (now := time.monotonic()) < until:
            due = first + (now - began) * SPEED * 1e9
            while self._messages[self._next][0] <= due:
                _, topic, data = self._messages[self._next]
                self._publishers[topic].publish(data)
                self._next += 1
            time.sleep(0.005)

    def close(self) -> None:
        """Leave the graph."""
        import rclpy
        self.node.destroy_node()
        rclpy.shutdown()


class Nodes:
    """One node after the other, each with the checkpoint of the one before."""

    def __init__(self, folder: Path, count: int) -> None:
        self.tally = Tally()
        self._folder = folder / 'files'
        self._state = self._folder / 'state.json'
        self._stderr = folder / 'stderr'
        self._config = configured(folder / 'vehicle.yaml', **{
            "    record:\n      path: ''": f'    record:\n      path: {self._folder}/record.mcap',
            "    checkpoint:\n      path: ''": f'    checkpoint:\n      path: {self._state}'})
        self.settings = settings_from(load(self._config))
        log = folder / 'log.mcap'
        simulate_log(self.settings, log, (count + 1) * LONGEST * SPEED, seed=1)
        used = self.settings.used_inputs()
        topics = {self.settings.input(name).topic for name in used if name != 'thrusters'}
        self.vehicle = Vehicle(log, sorted({*topics, *self.settings.thrusters.topics}))
        self._records: set[Path] = set()

    def kill(self, delay: float) -> None:
        """Start a node, kill it so many seconds after, and look at what is there."""
        before = self._state.exists()
        with self._stderr.open('wb') as stderr:
            process = subprocess.Popen(
                [sys.executable, '-m', 'rovid_ros.node', '--ros-args', '--params-file',
                 str(self._config)], env=environment(), cwd=REPOSITORY, stdout=stderr,
                stderr=stderr)
        latest = time.monotonic() + PATIENCE
        while 'recording to' not in self._stderr.read_text() and time.monotonic() < latest:
            time.sleep(0.02)
        self.vehicle.drive(time.monotonic() + delay)
        self.tally.kills += 1
        self.tally.check(process.poll() is None, 'it was gone already')
        process.kill()
        process.wait()
        self._look(before, time.time())

    def _look(self, had_state: bool, now: float) -> None:
        tally, said = self.tally, self._stderr.read_text()
        tally.check('not restored' not in said and 'Traceback' not in said, said)
        if had_state:
            tally.check('going on from' in said, 'it did not go on from the checkpoint')
        if self._state.exists():
            try:
                Stream(self.settings).restore(load_checkpoint(self._state, self.settings))
                tally.states += 1
            except ValueError as error:
                tally.check(False, f'{self._state.name}: {error}')
        files = set(self._folder.glob('*')) if self._folder.exists() else set()
        records = {path for path in files if path.suffix == '.mcap'}
        for path in records - self._records:
            times = tally.opened(path, 0)
            if times:
                tally.lost = max(tally.lost, now - max(times) * 1e-9)
        for path in self._records:
            tally.check(path in records, f'{path.name} is gone')
        self._records = records
        ours = {self._state, self._state.with_name(f'{self._state.name}.1'),
                self._state.with_name(f'.{self._state.name}.lock')}
        others = sorted(path.name for path in files - records - ours)
        tally.leftovers = max(tally.leftovers, len(others))
        tally.check(len(others) <= MOST_LEFT, f'the folder holds {", ".join(others)}')


def live_kills(folder: Path, count: int, seed: int) -> Tally:
    """
    Kill live nodes at random moments.

    Parameters
    ----------
    folder : Path
        An empty one to work in.
    count : int
        How many kills.
    seed : int
        Of the moments.

    """
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', '59')
    chance, nodes = random.Random(seed), Nodes(folder, count)
    try:
        for _ in range(count):
            nodes.kill(chance.uniform(0.0, LONGEST))
    finally:
        nodes.vehicle.close()
    return nodes.tally
