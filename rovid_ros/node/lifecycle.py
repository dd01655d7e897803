"""A managed node: its transitions succeed, or say in one line why not and change nothing."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
import re
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

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

    What derives from it says what the transitions do. One that raises has failed: one line is
    logged, and the node is back where it was.

    Parameters
    ----------
    name : str
        Of the node.
    overrides : list of Parameter
        Of ROS' own parameters.

    Attributes
    ----------
    active : bool
        Whether it is in the state ``active``.
    made : ExitStack
        How to let go of what ``configure`` makes.

    """

    def __init__(self, name: str, overrides: list[Parameter[Any]]) -> None:
        super().__init__(name, parameter_overrides=overrides)
        self.active = False
        self.made = ExitStack()
        self._failure: Exception | None = None
        self._starting = False
        self._answer_all_requests()

    @property
    def label(self) -> str:
        """Return the name of its state, as far as it is configured."""
        return 'active' if self.active else 'inactive'

    def configure(self) -> None:
        """Make all that the node needs; ``made`` undoes it, even if it comes halfway only."""
        raise NotImplementedError

    def activate(self) -> None:
        """Begin, or leave nothing behind."""
        raise NotImplementedError

    def deactivate(self) -> None:
        """Stop, and keep what was found."""
        raise NotImplementedError

    def finish(self) -> object:
        """Send and write what is held, before all is let go of; whatever the state is."""
        raise NotImplementedError

    def start(self) -> None:
        """Configure and activate; raises what a transition failed by."""
        self._starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != SUCCESS:
                assert self._failure is not None
                raise self._failure
        self._starting = False

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure."""
        return self._done('configure', self.configure, self.made.close)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate."""
        return self._done('activate', self._begin)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate."""
        return self._done('deactivate', self._stop)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up."""
        return self._done('cleanup', self._end)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Shut down, from any state."""
        return self._done('shutdown', self._end)

    def _begin(self) -> None:
        self.activate()
        self.active = True

    def _stop(self) -> None:
        self.deactivate()
        self.active = False

    def _end(self) -> None:
        if self.active:
            self._stop()
        self.finish()
        self.made.close()

    def _done(self, name: str, action: Callable[[], None],
              undo: Callable[[], None] = lambda: None) -> TransitionCallbackReturn:
        self._failure = None
        try:
            action()
        except Exception as error:  # rclpy would drop it without a word
            self._failure = error
            undo()
            if not self._starting:
                self.get_logger().error(f'{name}: {one_line(error)}')
            return FAILURE
        return SUCCESS

    def _answer_all_requests(self) -> None:
        """Answer a request that does not fit the state with no; some rclpy die of it."""
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = _guarded(service.callback)


def _guarded(callback: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    def answer(request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except RuntimeError:  # rcl has said why
            response.success = False
            return response

    return answer
