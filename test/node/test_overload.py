"""A node that gets more than it can take leaves out whole fixes, counts them, and recovers."""

from collections.abc import Iterator
from threading import Thread
import time
from typing import Any

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rovid_ros.node.node import IdentifierNode
from rovid_ros.node.transport.inputs import LARGEST_DECIMATION, LATE, LoadShedding

from test.support.live_node import changed, Peer, simulated, TYPES, WatchedStream


def taken(load: LoadShedding, topic: str = '/fast', longest_gap: int = 1 << 60) -> int:
    return sum(not load.leaves_out(topic, 1000 * k, longest_gap) for k in range(64))


def test_a_pause_costs_nothing() -> None:
    load, now = LoadShedding(), 0.0
    for pause in (0.0, 0.02, 30.0, 0.02, 5.0, 5.0, 0.02):
        now += pause
        load.start_batch(pause)
        assert taken(load) == 64
        load.end_batch(0.01, now)


def test_a_pause_at_work_costs_nothing_either() -> None:
    load, now = LoadShedding(), 0.0
    load.end_batch(0.01, now)
    for waited, work in ((0.0, 0.01), (0.0, 2.0), (2.0, 0.1), (0.1, 0.01), (0.0, 0.01)):
        now += max(waited, 0.02)
        load.start_batch(waited)
        assert taken(load) == 64
        load.end_batch(work, now)


def test_what_is_too_much_is_thinned_by_its_measure_and_then_less() -> None:
    load, now = LoadShedding(), 0.0
    load.end_batch(0.0, now)
    for every in (1, 4, 16, 64, 64):  # three times what there is time for
        load.start_batch(2.0 * LATE)
        assert taken(load) == 64 // every
        now += 1.0
        load.end_batch(3.0, now)
    assert load.decimation == LARGEST_DECIMATION
    assert taken(load, '/slow', longest_gap=3000) >= 20  # these are needed
    load.start_batch(0.5 * LATE)  # neither late nor early: it just holds
    assert load.decimation == LARGEST_DECIMATION
    for every in (32, 16, 8, 4, 2, 1, 1):
        load.start_batch(0.0)
        assert taken(load) == 64 // every


@pytest.fixture
def node() -> Iterator[IdentifierNode]:
    rclpy.init(args=[])
    node = IdentifierNode(changed({}))
    yield node
    node.destroy_node()
    rclpy.shutdown()


def test_overload_leaves_out_fixes_and_no_commands(
        node: IdentifierNode, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    peer, executor = Peer(), SingleThreadedExecutor()
    executor.add_node(node)
    peer.advertise(TYPES)
    messages = simulated(tmp_path / 'log.mcap', 30.0)
    position = [raw for raw in messages if raw.topic == '/position']
    current = [raw for raw in messages if raw.topic == '/current']
    sound = node.stream.receive

    def slow(event: Any) -> Any:
        if event.samples[0].input == 'position':
            time.sleep(0.1)
        return sound(event)

    def send() -> None:
        for k in range(250):  # in 5 s what takes the node 25
            peer.publish([position[k], *current[2 * k:2 * k + 2]])
            time.sleep(0.02)

    stream = node.stream
    monkeypatch.setattr(node, 'stream', WatchedStream(stream, slow))
    sender = Thread(target=send)
    sender.start()
    while sender.is_alive():
        executor.spin_once(timeout_sec=0.05)
    sender.join()
    refused = dict(node.stream.rejected)
    assert set(refused) == {('position', 'overload')}
    assert 0 < refused['position', 'overload'] < 250

    monkeypatch.setattr(node, 'stream', stream)
    for k in range(250, 300):
        if k == 290:
            refused = dict(node.stream.rejected)
        peer.publish([position[k], *current[2 * k:2 * k + 2]])
        time.sleep(0.01)
        executor.spin_once(timeout_sec=0.05)
    assert node.stream.rejected == refused  # it takes every fix again
    executor.shutdown()
    peer.close()
