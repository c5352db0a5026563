"""Atomic requests for several parameters, such as those of `ros2 param load`."""

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
    """Make the service `set_parameters` apply a request as a whole, where possible.

    rclpy sets the parameters one by one in their order. Values that are valid together could be
    refused, and a parameter that resets others would undo earlier ones. Here:

    1. A read-only parameter with its present value is accepted, so that the file of
       `ros2 param dump` can be loaded.
    2. Invalid and unknown parameters are refused individually.
    3. The rest is set as a whole; if that is refused, one by one, parameters that reset others
       first.

    Args:
        node: The node of the service.
        binding: Binding of its parameters.
    """
    service = next(one for one in node.services if one.srv_name.endswith("/set_parameters"))
    set_one_by_one: Any = service.callback

    def on_request(request: Any, response: Any) -> Any:
        given = list(request.parameters)
        results = [SetParametersResult(successful=True) for _ in given]
        changes = [
            index for index, one in enumerate(given) if not _is_unchanged_read_only(node, one)
        ]
        faults = binding.faults([Parameter.from_parameter_msg(given[index]) for index in changes])
        for index in changes:
            if reason := faults.get(given[index].name):
                results[index] = SetParametersResult(successful=False, reason=reason)
        changes = [index for index in changes if given[index].name not in faults]
        if len(changes) < 2 or not _set_as_a_whole(node, [given[index] for index in changes]):
            order = sorted(changes, key=lambda index: not binding.resets_others(given[index].name))
            request.parameters = [given[index] for index in order]
            for index, result in zip(order, set_one_by_one(request, response).results, strict=True):
                results[index] = result
        response.results = results
        return response

    service.callback = on_request


def _is_unchanged_read_only(node: Node, given: ParameterMessage) -> bool:
    """Whether a parameter is read-only and requested with its present value."""
    if not node.has_parameter(given.name) or not node.describe_parameter(given.name).read_only:
        return False
    return bool(node.get_parameter(given.name).get_parameter_value() == given.value)


def _set_as_a_whole(node: Node, given: Sequence[ParameterMessage]) -> bool:
    parameters = [Parameter.from_parameter_msg(message) for message in given]
    try:
        return bool(node.set_parameters_atomically(parameters).successful)
    except ParameterNotDeclaredException:
        return False
