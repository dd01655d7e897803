"""A process that publishes a simulated vehicle's messages to one node or the other, when told."""

from __future__ import annotations

from multiprocessing.connection import Connection
import time
from typing import Any, NamedTuple

from rovid_ros.config.parameters import settings_from

from benchmarks.speed.load_sensors import at_rate
from test.support.fault_live import ros
from test.support.live import Peer
from test.support.sensors import at_rates, encoded, sensed, stamp

INPUTS = ('attitude', 'depth', 'thrusters', 'position')
"""In the order in which those of one instant are sent."""

APART = 0.002
"""[s] Between two messages of one instant, or a quarter of the interval of the positions."""


class Ask(NamedTuple):
    """What to publish: to whom, positions per second, for how long [s]."""

    namespace: str
    rate: float
    duration: float


def serve(pipe: Connection, values: dict[str, Any], namespaces: tuple[str, ...]) -> None:
    """
    Publish what is asked for until None is.

    Parameters
    ----------
    pipe : Connection
        Gets a word when all nodes have been found. Then takes each ``Ask``, says when the messages
        are made, waits for a word, and in the end gives input and time [ns] of all that was sent.
    values : mapping
        Parameters of the nodes; their topics are those under a namespace.
    namespaces : tuple of str
        Of the nodes.

    """
    made: dict[tuple[float, float], list[tuple[int, str, bytearray]]] = {}
    topics = {name: values[f'{name}.topic'] for name in INPUTS}
    with ros():
        peer = Peer()
        peer.advertise({space + topic: values[f'{name}.type']
                        for space in namespaces for name, topic in topics.items()})
        pipe.send('ready')
        while (ask := pipe.recv()) is not None:
            key = ask.rate, ask.duration
            made[key] = made.get(key) or _messages(values, *key)
            pipe.send('made')
            pipe.recv()
            pipe.send(_send(peer, {
                name: ask.namespace + topic for name, topic in topics.items()}, made[key]))
        peer.close()


def rates(values: dict[str, Any], rate: float) -> dict[str, float]:
    """Return the rate of each input beside positions of ``rate`` [Hz]."""
    usual = settings_from(values).simulation
    return {'position': rate, 'attitude': max(rate, usual.attitude_rate),
            'depth': usual.depth_rate, 'thruster': usual.thruster_rate}


def _messages(values: dict[str, Any], rate: float,
              duration: float) -> list[tuple[int, str, bytearray]]:
    """Return due times [ns], inputs and bytes, in the order of the times."""
    settings = at_rates(at_rate(settings_from(values), rate), **rates(values, rate))
    inputs = {values[f'{name}.topic']: name for name in INPUTS}
    apart = round(1e9 * min(APART, 0.25 / rate))
    messages = []
    for message in sensed(settings, duration):
        name = inputs[message.topic]
        early = apart * (len(INPUTS) - 1 - INPUTS.index(name))
        messages.append((message.time - early, name, encoded(message)))
    return sorted(messages, key=lambda message: message[0])


def _send(peer: Peer, topics: dict[str, str],
          messages: list[tuple[int, str, bytearray]]) -> list[tuple[str, int]]:
    sent = []
    shift = time.time_ns() + 10_000_000 - messages[0][0]
    for due, name, cdr in messages:
        while (left := due + shift - time.time_ns()) > 0:
            time.sleep(left * 1e-9)
        stamp(cdr, due + shift)  # also when this process was late
        sent.append((name, time.time_ns()))
        peer.send(topics[name], bytes(cdr))
    return sent
