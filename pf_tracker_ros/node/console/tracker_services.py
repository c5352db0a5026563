"""Calls of the tracker's services."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any

from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.client import Client
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from pf_tracker_ros.node.console.json_conversions import Json
from pf_tracker_ros.node.console.tuning import parameters_to_json, tunable_names

# Seconds per attempt; a response is lost if the service has not discovered the client yet.
_TIMEOUT = 2.0
_ATTEMPTS = 2
_TICK = 0.1
# Participants announce themselves every 3 s, so discovery takes longer if a packet is lost.
_DISCOVERY_TICKS = 50


class TrackerError(Exception):
    """A request to the tracker failed; the message says what to do."""


class TrackerServices:
    """The services of one tracker, awaited in an event loop.

    Args:
        node: The console's node.
        name: Fully qualified name of the tracker's node.
        run_in_executor: Runs a function in the node's executor.
    """

    def __init__(
        self, node: Node, name: str, run_in_executor: Callable[[Callable[[], None]], None]
    ) -> None:
        self._run_in_executor = run_in_executor
        self._stop = node.create_client(Trigger, f"{name}/stop")
        self._enable = node.create_client(SetBool, f"{name}/enable")
        self._parameters = {
            kind: node.create_client(kind, f"{name}/{service}")
            for kind, service in (
                (ListParameters, "list_parameters"),
                (DescribeParameters, "describe_parameters"),
                (GetParameters, "get_parameters"),
                (SetParameters, "set_parameters"),
            )
        }

    async def stop(self) -> str:
        """Stop all targets.

        Returns:
            The tracker's message.

        Raises:
            TrackerError: There is no response.
        """
        return str((await self._call(self._stop, Trigger.Request())).message)

    async def enable(self, enabled: bool) -> str:
        """Resume or pause the tracker.

        Returns:
            The tracker's message.

        Raises:
            TrackerError: There is no response.
        """
        return str((await self._call(self._enable, SetBool.Request(data=enabled))).message)

    async def parameters(self) -> list[Json]:
        """All parameters, as from `tuning.parameters_to_json`.

        Raises:
            TrackerError: There is no response.
        """
        listed = await self._call_parameters(ListParameters, ListParameters.Request())
        names = tunable_names(listed.result.names)
        described = await self._call_parameters(
            DescribeParameters, DescribeParameters.Request(names=names)
        )
        values = await self._call_parameters(GetParameters, GetParameters.Request(names=names))
        if not len(described.descriptors) == len(values.values) == len(names):
            raise TrackerError("the parameters changed while they were read")
        return parameters_to_json(described.descriptors, values.values)

    async def set_parameter(self, parameter: Parameter) -> str:
        """Set a parameter.

        Returns:
            The reason of a refusal, or empty.

        Raises:
            TrackerError: There is no response.
        """
        request = SetParameters.Request(parameters=[parameter])
        (result,) = (await self._call_parameters(SetParameters, request)).results
        return "" if result.successful else str(result.reason or "the node gives no reason")

    async def _call_parameters(self, kind: Any, request: Any) -> Any:
        return await self._call(self._parameters[kind], request)

    async def _call(self, client: Client, request: Any) -> Any:
        """The response of a service.

        Raises:
            TrackerError: There is no such service, or no response.
        """
        # The services of a tracker may be discovered later than the node.
        for _ in range(_DISCOVERY_TICKS):
            if client.service_is_ready():
                break
            await asyncio.sleep(_TICK)
        else:
            raise TrackerError(
                f"there is no service {client.srv_name}: is the tracker running and active?"
            )
        for _ in range(_ATTEMPTS):
            call = _Call(client)
            self._run_in_executor(partial(call.send, request))
            try:
                return await asyncio.wait_for(call.response, _TIMEOUT)
            except asyncio.TimeoutError:
                # The client keeps pending requests forever otherwise.
                self._run_in_executor(call.cancel)
        raise TrackerError(f"{client.srv_name} does not respond")


class _Call:
    """A call of a service: sent in the executor, awaited in the event loop."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._loop = asyncio.get_running_loop()
        self.response: asyncio.Future[Any] = self._loop.create_future()
        self._pending: Any = None

    def send(self, request: Any) -> None:
        self._pending = self._client.call_async(request)
        self._pending.add_done_callback(
            lambda done: self._loop.call_soon_threadsafe(self._finish, done)
        )

    def cancel(self) -> None:
        if self._pending:
            self._client.remove_pending_request(self._pending)

    def _finish(self, done: Any) -> None:
        if self.response.done():
            return
        if error := done.exception():
            self.response.set_exception(TrackerError(str(error)))
        else:
            self.response.set_result(done.result())
