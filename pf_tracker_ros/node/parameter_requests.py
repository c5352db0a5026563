"""Requests that set several parameters at once, such as `ros2 param load` sends them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from pf_tracker_ros.node.parameter_binding import ParameterBinding


def serve_atomic_requests(node: Node, binding: ParameterBinding) -> None:
    """Let the service `set_parameters` take a request as a whole, where that is allowed.

    rclpy sets the parameters of a request one by one in their order, so values that are right
    together could be refused on the way there, and one with which others begin anew would undo
    those that stand before it. What cannot be is refused alone. Where the rest cannot be taken as a
    whole, rclpy's way remains, with those that renew others before them.

    A read-only parameter that is given the value that it has is no reason to refuse: what
    `ros2 param dump` wrote can be loaded again.

    Args:
        node: Offers the service.
        binding: Of the node's parameters.
    """
    service = next(one for one in node.services if one.srv_name.endswith("/set_parameters"))
    one_by_one: Any = service.callback

    def on_request(request: Any, response: Any) -> Any:
        given = list(request.parameters)
        results = [SetParametersResult(successful=True) for _ in given]
        changes = [index for index, one in enumerate(given) if not _is_settled(node, one)]
        faults = binding.faults([Parameter.from_parameter_msg(given[index]) for index in changes])
        for index in changes:
            if reason := faults.get(given[index].name):
                results[index] = SetParametersResult(successful=False, reason=reason)
        changes = [index for index in changes if given[index].name not in faults]
        if len(changes) < 2 or not _set_as_a_whole(node, [given[index] for index in changes]):
            order = sorted(changes, key=lambda index: not binding.resets_others(given[index].name))
            request.parameters = [given[index] for index in order]
            for index, result in zip(order, one_by_one(request, response).results, strict=True):
                results[index] = result
        response.results = results
        return response

    service.callback = on_request


def _is_settled(node: Node, given: ParameterMessage) -> bool:
    """Whether a parameter cannot change, and is not asked to."""
    if not node.has_parameter(given.name) or not node.describe_parameter(given.name).read_only:
        return False
    return bool(node.get_parameter(given.name).get_parameter_value() == given.value)


def _set_as_a_whole(node: Node, given: Sequence[ParameterMessage]) -> bool:
    parameters = [Parameter.from_parameter_msg(message) for message in given]
    try:
        return bool(node.set_parameters_atomically(parameters).successful)
    except ParameterNotDeclaredException:
        return False
