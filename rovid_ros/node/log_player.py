"""``rovid replay --ros``: a log through the real node, publishing as it would live."""

from __future__ import annotations

from collections.abc import Mapping
import time
from typing import Any

import rclpy
from rclpy.clock import ROSClock
from rclpy.clock_type import ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage
from rovid_core.identify.estimate import Estimate
from rovid_core.settings.run import Settings
from rovid_core.trials.score import ScoreLog
from rovid_ros.logs.log import LogMessage, Maker
from rovid_ros.logs.player import restore_recorded
from rovid_ros.messages.types import Decoder, WireType
from rovid_ros.node.node import IdentifierNode

CLOCK_PERIOD = 10_000_000  # [ns] of log time between two messages on /clock
SPIN_PERIOD = 0.01  # [s] of real time after which services and timers are served


class NodePlayer:
    """
    Plays a log through the node, which gets its messages from here, not by subscriptions.

    It plays at ``rate`` times real time, or as fast as it goes. Raises ValueError if the node
    refuses a value.
    """

    def __init__(self, values: Mapping[str, Any], settings: Settings, rate: float | None) -> None:
        # Ctrl-C is handled by the replay; rclpy's handler would end the context under the node
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.scores = ScoreLog(settings)
        try:
            self.node = IdentifierNode(
                {**values, 'use_sim_time': True}, live=False, scorer=self.scores)
        except BaseException:
            rclpy.try_shutdown()
            raise
        self.stream = self.node.stream
        self.converter = self.node.converter
        self._clock = self.node.create_publisher(ClockMessage, '/clock', 10)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._rate = rate
        self._first: int | None = None  # [ns] log time at which the replay began
        self._clock_time = 0  # [ns] log time last published
        self._began = self._last_spin = time.monotonic()

    def maker(self, topic: str, wire: WireType, decode: Decoder) -> Maker:
        """Return the decoder: the node converts by itself."""
        return lambda data, time: decode(data)

    def restore(self, state: Mapping[str, Any]) -> str:
        return restore_recorded(self.stream, state)

    def add_message(self, message: LogMessage) -> list[Estimate]:
        """Add the next message when it is due; return the estimates that it released."""
        self._wait(message.time)
        return self.node.add_message(message.topic, message.data, message.time)

    def repeat_control(self, name: str, value: str) -> list[Estimate]:
        return self.node.repeat_control(name, value)

    def finish(self) -> list[Estimate]:
        return self.node.finish()

    def close(self) -> None:
        """Leave the graph."""
        self._executor.remove_node(self.node)
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def _wait(self, now: int) -> None:
        """Spin until ``now`` [ns] of the log is due, and publish it as the time."""
        if self._first is None:
            self._first = now
            self._began = time.monotonic()
        if self._rate is not None:
            due = self._began + (now - self._first) * 1e-9 / self._rate
            while (left := due - time.monotonic()) > 0.0:
                self._spin(min(left, SPIN_PERIOD))
        if abs(now - self._clock_time) >= CLOCK_PERIOD:  # it may go back
            self._set_time(now)
        if time.monotonic() - self._last_spin > SPIN_PERIOD:
            self._spin(0.0)

    def _spin(self, timeout: float) -> None:
        """Serve services and timers."""
        self._executor.spin_once(timeout_sec=timeout)
        self._last_spin = time.monotonic()

    def _set_time(self, now: int) -> None:
        """Publish the time [ns], and set the node's clock at once, as if it had received it."""
        self._clock_time = now
        clock = self.node.get_clock()
        assert isinstance(clock, ROSClock)
        clock.set_ros_time_override(Time(nanoseconds=now, clock_type=ClockType.ROS_TIME))
        message = ClockMessage()
        message.clock.sec, message.clock.nanosec = divmod(now, 1_000_000_000)
        self._clock.publish(message)
