"""What the node says while no step is made: which DOFs have become stale."""

from __future__ import annotations

import time

from rclpy.node import Node
from rovid_core.identify.estimate import Estimate
from rovid_core.pipeline.stream import Stream
from rovid_ros.node.transport.inputs import is_simulated

PERIOD = 0.25  # [s] A node that made no step for so long looks whether it has to say so
REPEAT = 1.0  # [s] from one message about it to the next, while nothing else changes


class StaleEstimates:
    """
    Tells when steps stay away, which no message can tell.

    Event time goes on from the last step as time does here: with /clock, in which case a paused
    simulation makes nothing stale, or with a clock that is never set. What comes of it depends
    on when this program ran, so it is never in a replay.
    """

    def __init__(self, node: Node, stream: Stream) -> None:
        self._node = node
        self._stream = stream
        self._since = self._repeated = self._now()
        self._told: list[str] = []

    def note_estimate(self) -> None:
        """Count from now on: an estimate was published."""
        self._since = self._now()
        self._told = []

    def due(self) -> Estimate | None:
        """Return what has to be published, if there is anything."""
        now = self._now()
        last, elapsed = self._stream.estimate, now - self._since
        if last is None or elapsed < PERIOD:
            return None
        estimate = self._stream.silent_estimate(last.now + round(elapsed * 1e9))
        stale = [dof.dof for dof in estimate.dofs if dof.stale_for] if estimate else []
        if not stale or (stale == self._told and now - self._repeated < REPEAT):
            return None
        self._told, self._repeated = stale, now
        return estimate

    def _now(self) -> float:
        if is_simulated(self._node):
            return self._node.get_clock().now().nanoseconds * 1e-9
        return time.monotonic()
