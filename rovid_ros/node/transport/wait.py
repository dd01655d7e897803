"""
Wait for messages in a fraction of the time that rclpy's executors take for it.

These collect, enter and look through all that a node has for every message, and then once more.
Here one wait set is kept, and what comes on the inputs goes straight to the node. All else, which
is seldom, is left to an executor.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal, Protocol

from rclpy.executors import Executor, TimeoutException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription

FOR_EVER = -1

Kind = Literal['subscription', 'guard_condition', 'timer', 'client', 'service']
"""What there is to wait for, in the order in which a wait set takes their numbers."""


class Listening(Protocol):
    """A node with inputs of its own: an rclpy node with this besides."""

    @property
    def heard(self) -> Iterable[Subscription[Any]]:
        """Return the subscriptions of the inputs, none while it is not active."""

    def take(self) -> None:
        """Take what waits on the inputs."""


class Wait:
    """
    The turns of a node: each waits until something is there, and does what is due.

    What the middleware tells of quality of service is not waited for: the executor looks at it
    whenever it has its turn, as it has with each of the node's timers.

    Parameters
    ----------
    node : Node and Listening
        Whose turns they are.
    executor : Executor
        Has the node, and does all but take what waits on the inputs.

    """

    def __init__(self, node: Any, executor: Executor) -> None:
        self._node = node
        self._executor = executor
        self._collect()

    def turn(self) -> None:
        """Wait, and do what is due."""
        wait_set = self._wait_set
        wait_set.clear_entities()
        for add, handle in self._entities:
            add(handle)
        wait_set.wait(FOR_EVER)
        arrived = set(wait_set.get_ready_entities('subscription'))
        if arrived & self._inputs:
            self._node.take()
        if arrived - self._inputs or any(map(wait_set.get_ready_entities, self._others)):
            self._do_all_else()
            self._collect()  # only there can something have been made or destroyed

    def _do_all_else(self) -> None:
        """Let the executor look once at everything, and do what is due."""
        try:
            while True:
                task, _, _ = self._executor.wait_for_ready_callbacks(0.0)
                task()
                task.result()  # raises what was raised
        except TimeoutException:  # this is how it ends
            return

    def _collect(self) -> None:
        node = self._node
        kinds: dict[Kind, list[Any]] = {
            'subscription': [one.handle for one in node.subscriptions],
            'guard_condition': [one.handle for one in node.guards],
            'timer': [one.handle for one in node.timers],
            'client': [one.handle for one in node.clients],
            'service': [one.handle for one in node.services]}
        self._wait_set = wait_set = rclpy_implementation.WaitSet(  # type: ignore[call-arg]
            *map(len, kinds.values()), 0, node.context.handle)  # type: ignore[arg-type]
        self._entities = [(getattr(wait_set, f'add_{kind}'), handle)
                          for kind, handles in kinds.items() for handle in handles]
        self._others = [kind for kind, handles in kinds.items()
                        if handles and kind != 'subscription']
        self._inputs = {one.handle.pointer for one in node.heard}
