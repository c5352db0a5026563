"""The services of a configured node."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger


class Services:
    """`~/stop` forgets the target, `~/enable` pauses and goes on.

    Args:
        node: The node that offers them.
        stop: Forgets the target and tells in a sentence what came of it.
        enable: Goes on (true) or pauses, and tells the same.
    """

    def __init__(self, node: Node, stop: Callable[[], str], enable: Callable[[bool], str]) -> None:
        self._node = node

        def on_stop(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success, response.message = True, stop()
            return response

        def on_enable(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            response.success, response.message = True, enable(request.data)
            return response

        self._services = [
            node.create_service(Trigger, "~/stop", on_stop),
            node.create_service(SetBool, "~/enable", on_enable),
        ]

    def close(self) -> None:
        """Withdraw the services."""
        for service in self._services:
            self._node.destroy_service(service)
        self._services = []
