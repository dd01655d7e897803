"""A process that publishes what the sensors of a simulated vehicle measure, at a high rate."""

from __future__ import annotations

from dataclasses import replace
from multiprocessing.connection import Connection
import time
from typing import Any

from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rovid_core.settings.run import Settings
from rovid_ros.config.parameters import settings_from

from test.support.fault_live import ros
from test.support.live import Peer
from test.support.sensors import at_rates, encoded, sensed, stamp

INPUTS = ('position', 'attitude', 'thrusters')
ATTITUDE = 200.0
"""[Hz] Highest rate of the attitude."""


def at_rate(settings: Settings, rate: float) -> Settings:
    """Return settings with sensors of a rate [Hz], whose fixes are as much better."""
    faster = at_rates(settings, position=rate, thruster=rate, attitude=min(rate, ATTITUDE))
    usual = settings.simulation
    return replace(faster, simulation=replace(
        faster.simulation, position_noise=usual.position_noise * usual.position_rate / rate))


def publish(pipe: Connection, values: dict[str, Any], rate: float, duration: float) -> None:
    """
    Make all messages, say so, wait for the word, publish each when it is due.

    Parameters
    ----------
    pipe : Connection
        Gets a word when all is ready, and in the end, by input, the stamp of each message and
        when it was sent [ns].
    values : mapping
        Parameters of the node that is to hear them.
    rate : float
        Of positions and currents [Hz].
    duration : float
        [s]

    """
    settings = at_rate(settings_from(values), rate)
    inputs = {values[f'{name}.topic']: name for name in INPUTS}
    messages = [(m.time, m.topic, encoded(m)) for m in sensed(settings, duration)]
    sent: dict[str, list[tuple[int, int]]] = {name: [] for name in INPUTS}
    with ros():
        peer = Peer()
        peer.advertise({topic: values[f'{name}.type'] for topic, name in inputs.items()},
                       QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1000,
                                  reliability=ReliabilityPolicy.RELIABLE))
        pipe.send('ready')
        pipe.recv()
        shift = time.time_ns() + 10_000_000 - messages[0][0]
        for due, topic, cdr in messages:
            left = due + shift - time.time_ns()
            if left > 0:
                time.sleep(left * 1e-9)
            stamp(cdr, due + shift)  # also when this process was late
            sent[inputs[topic]].append((due + shift, time.time_ns()))
            peer.send(topic, bytes(cdr))
        peer.spin(1.0)
        pipe.send(sent)
        peer.close()
