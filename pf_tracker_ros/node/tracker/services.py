"""The services of a configured node."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger


class Services:
    """`~/stop` stops all targets, `~/enable` pauses and resumes.

    Args:
        node: The serving node.
        stop: Stops all targets; returns the result as a sentence.
        enable: Resumes (true) or pauses; returns the result as a sentence.
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
        """Remove the services."""
        for service in self._services:
            self._node.destroy_service(service)
        self._services = []
