"""The static transforms of tf2, looked up once."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from rclpy.node import Node
from rovid_core.settings.run import Settings, SettingsError
from rovid_ros.messages.static_frames import StaticFrames, TOPIC, TYPE, wanted_frames
from rovid_ros.node.transport.message_types import import_type, MessageTypeError
from rovid_ros.node.transport.publishers import latched

PATIENCE = 10.0  # [s] discovery can take some, and what publishes may be started at the same time
PERIOD = 0.02  # [s]
DEPTH = 100  # messages: every publisher has one of its own


def look_up(node: Node, settings: Settings) -> dict[str, Any]:
    """
    Return the values of ``wanted_frames`` by key; waits for them, at most ``PATIENCE``.

    Nothing else of the node runs meanwhile. Raises SettingsError if they do not come.
    """
    wanted = wanted_frames(settings)
    if not wanted:
        return {}
    try:
        cls = import_type(TYPE)
    except MessageTypeError as error:
        raise SettingsError(f'{next(iter(wanted)).partition(".")[0]}.sensor_frame',
                            str(error)) from None
    frames = StaticFrames()
    take_latched(node, cls, TOPIC, frames.add,
                 lambda: frames.knows(wanted.values(), settings.base_frame), PATIENCE)
    return frames.values(wanted, settings.base_frame, f'within {PATIENCE:g} s')


def take_latched(node: Node, cls: type[Any], topic: str, take: Callable[[Any], object],
                 is_enough: Callable[[], bool], timeout: float) -> None:
    """Take what was published on a topic and is kept for those who come late, until it does."""
    subscription = node.create_subscription(cls, topic, lambda message: None, latched(DEPTH))
    end = time.monotonic() + timeout
    try:
        while not is_enough() and time.monotonic() < end and node.context.ok():
            with subscription.handle:
                taken = subscription.handle.take_message(cls, False)
            if taken is None:
                time.sleep(PERIOD)
            else:
                take(taken[0])
    finally:
        node.destroy_subscription(subscription)
