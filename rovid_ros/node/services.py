"""The services of the node."""

from __future__ import annotations

from typing import Any, Protocol

from rclpy.node import Node
from rclpy.service import Service
from std_srvs.srv import SetBool, Trigger


class Serving(Protocol):
    """What can be asked of the identifier."""

    def reset(self) -> None:
        """Go back to the initial values."""

    def enable(self, adapt: bool) -> None:
        """Adapt the parameters, or freeze them."""

    def save(self) -> str:
        """Save the state; return why not, or ''."""


class Services:
    """
    ``~/reset``, ``~/enable`` and ``~/save``.

    Parameters
    ----------
    node : Node
        Owns the services.
    identifier : Serving
        Does what they ask for.
    path : str
        Of the saved state.

    """

    def __init__(self, node: Node, identifier: Serving, path: str) -> None:
        self._node = node
        self._identifier = identifier
        self._path = path
        self._services: list[Service[Any, Any]] = []
        try:
            for kind, name, answer in (
                    (Trigger, '~/reset', self._on_reset), (SetBool, '~/enable', self._on_enable),
                    (Trigger, '~/save', self._on_save)):
                self._services.append(node.create_service(kind, name, answer))
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Leave the graph."""
        for service in self._services:
            self._node.destroy_service(service)

    def _on_reset(self, request: Trigger.Request,
                  response: Trigger.Response) -> Trigger.Response:
        self._identifier.reset()
        response.success, response.message = True, 'back at the initial values'
        self._node.get_logger().info(f'~/reset: {response.message}')
        return response

    def _on_enable(self, request: SetBool.Request,
                   response: SetBool.Response) -> SetBool.Response:
        self._identifier.enable(request.data)
        response.success = True
        response.message = 'adapting' if request.data else 'frozen'
        self._node.get_logger().info(f'~/enable: {response.message}')
        return response

    def _on_save(self, request: Trigger.Request,
                 response: Trigger.Response) -> Trigger.Response:
        failed = self._identifier.save()
        response.success = not failed
        response.message = failed or f'saved to {self._path}'
        self._node.get_logger().info(f'~/save: {response.message}')
        return response
