"""What is asked of the tracker by its services."""

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

# A service may not know a client yet that it is ready for; its answer is lost then.
_PATIENCE = 2.0
_ATTEMPTS = 2
_TICK = 0.1
# Participants announce themselves every 3 seconds: where a packet is lost they meet that late.
_MEETING_TICKS = 50


class TrackerError(Exception):
    """The tracker cannot be asked, or has not answered; the message says what to do."""


class TrackerServices:
    """The services of one tracker; to be awaited in an event loop.

    Args:
        node: The console's node.
        name: Fully qualified name of the tracker's node.
        do: Lets the executor of the node do something.
    """

    def __init__(self, node: Node, name: str, do: Callable[[Callable[[], None]], None]) -> None:
        self._do = do
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
        """Let the tracker forget its target; what it says.

        Raises:
            TrackerError: It does not answer.
        """
        return str((await self._ask(self._stop, Trigger.Request())).message)

    async def enable(self, enabled: bool) -> str:
        """Let the tracker go on or pause; what it says.

        Raises:
            TrackerError: It does not answer.
        """
        return str((await self._ask(self._enable, SetBool.Request(data=enabled))).message)

    async def parameters(self) -> list[Json]:
        """All parameters, as `tuning.parameters_to_json` gives them.

        Raises:
            TrackerError: It does not answer.
        """
        listed = await self._ask_parameters(ListParameters, ListParameters.Request())
        names = tunable_names(listed.result.names)
        described = await self._ask_parameters(
            DescribeParameters, DescribeParameters.Request(names=names)
        )
        values = await self._ask_parameters(GetParameters, GetParameters.Request(names=names))
        if not len(described.descriptors) == len(values.values) == len(names):
            raise TrackerError("the parameters changed while they were asked for")
        return parameters_to_json(described.descriptors, values.values)

    async def set_parameter(self, parameter: Parameter) -> str:
        """Set a parameter; why it is refused, or empty.

        Raises:
            TrackerError: It does not answer.
        """
        request = SetParameters.Request(parameters=[parameter])
        (result,) = (await self._ask_parameters(SetParameters, request)).results
        return "" if result.successful else str(result.reason or "the node gives no reason")

    async def _ask_parameters(self, kind: Any, request: Any) -> Any:
        return await self._ask(self._parameters[kind], request)

    async def _ask(self, client: Client, request: Any) -> Any:
        """The response of a service.

        Raises:
            TrackerError: There is no such service, or it does not answer.
        """
        # Those of a tracker that has just been found may not be known yet.
        for _ in range(_MEETING_TICKS):
            if client.service_is_ready():
                break
            await asyncio.sleep(_TICK)
        else:
            raise TrackerError(
                f"{client.srv_name} is not there: is the tracker running and active?"
            )
        for _ in range(_ATTEMPTS):
            answer = _Answer(client)
            self._do(partial(answer.ask, request))
            try:
                return await asyncio.wait_for(answer.awaited, _PATIENCE)
            except asyncio.TimeoutError:
                # The client would wait for it as long as it lives.
                self._do(answer.give_up)
        raise TrackerError(f"{client.srv_name} does not answer")


class _Answer:
    """The answer of a service, awaited in the event loop and asked for in the executor."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._loop = asyncio.get_running_loop()
        self.awaited: asyncio.Future[Any] = self._loop.create_future()
        self._asked: Any = None

    def ask(self, request: Any) -> None:
        self._asked = self._client.call_async(request)
        self._asked.add_done_callback(
            lambda done: self._loop.call_soon_threadsafe(self._settle, done)
        )

    def give_up(self) -> None:
        if self._asked:
            self._client.remove_pending_request(self._asked)

    def _settle(self, done: Any) -> None:
        if self.awaited.done():
            return
        if error := done.exception():
            self.awaited.set_exception(TrackerError(str(error)))
        else:
            self.awaited.set_result(done.result())
