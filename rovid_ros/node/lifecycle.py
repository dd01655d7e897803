"""A managed node: a transition succeeds, or logs in one line why not and changes nothing."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
import re
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

DONE = {'configure': 'configured', 'activate': 'activated', 'deactivate': 'deactivated',
        'cleanup': 'cleaned up', 'shutdown': 'shut down'}
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


def one_line(error: Exception) -> str:
    """Return the text of an error without line breaks and rcl's own source lines."""
    text = ' '.join(str(error).split())
    if text.startswith("['"):
        text = f'unknown ROS arguments {text}'
    text = re.sub(r'^failed to initialize rcl: |^Failed to parse ROS arguments: ', '', text)
    return re.sub(r', at /\S+:\d+', '', text)


class ManagedNode(LifecycleNode):
    """
    A node with the life cycle of ROS 2.

    Derived classes define what the transitions do. A transition that raises has failed: one
    line is logged, and the node returns to the state that it came from. ``overrides`` are values
    of the parameters that rclpy itself declares. ``resources`` closes what ``configure`` makes.
    """

    def __init__(self, name: str, overrides: list[Parameter[Any]]) -> None:
        super().__init__(name, parameter_overrides=overrides)
        self.active = False
        self.resources = ExitStack()
        self._failure: Exception | None = None
        self._starting = False
        self._guard_requests()

    @property
    def label(self) -> str:
        """Return the name of the state of a configured node."""
        return 'active' if self.active else 'inactive'

    def configure(self) -> None:
        """Make all that the node needs; if it raises, its ``resources`` are closed."""
        raise NotImplementedError

    def activate(self) -> None:
        """Start to use the inputs; a failure must leave nothing behind."""
        raise NotImplementedError

    def deactivate(self) -> None:
        """Stop to use the inputs; the estimate stays."""
        raise NotImplementedError

    def finish(self) -> object:
        """Publish and write what is held, in any state, before the resources are closed."""
        raise NotImplementedError

    def start(self) -> None:
        """Configure and activate; raises the error that a transition failed with."""
        self._starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != SUCCESS:
                assert self._failure is not None
                raise self._failure
        self._starting = False

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._transition('configure', self.configure, self.resources.close)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._transition('activate', self._activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._transition('deactivate', self._deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._transition('cleanup', self._end)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Shut down, from any state."""
        return self._transition('shutdown', self._end)

    def _activate(self) -> None:
        self.activate()
        self.active = True

    def _deactivate(self) -> None:
        self.deactivate()
        self.active = False

    def _end(self) -> None:
        if self.active:
            self._deactivate()
        self.finish()
        self.resources.close()

    def _transition(self, name: str, action: Callable[[], None],
                    undo: Callable[[], None] = lambda: None) -> TransitionCallbackReturn:
        self._failure = None
        try:
            action()
        except Exception as error:  # rclpy would drop it silently
            self._failure = error
            undo()
            if not self._starting:
                self.get_logger().error(f'{name}: {one_line(error)}')
            return FAILURE
        self.get_logger().info(DONE[name])
        return SUCCESS

    def _guard_requests(self) -> None:
        """Refuse a request that does not fit the state; some versions of rclpy die of it."""
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = _guarded(service.callback)


def _guarded(callback: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    def answer(request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except RuntimeError:  # rcl has logged the reason
            response.success = False
            return response

    return answer
