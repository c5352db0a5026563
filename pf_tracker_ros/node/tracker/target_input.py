"""How a target comes to the node, and goes: topics `~/target` and `~/click`, service `~/stop`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PointStamped, PolygonStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.node.message_building import TargetError, box_of_polygon
from pf_tracker_ros.node.qos import DEFAULT_QOS, Report, subscribe, take_waiting
from pf_tracker_ros.stamps import stamp_of

# Bytes of a message: thousands of corners, and a frame's name of any sensible length.
_LARGEST = 65_536


def box_of_click(message: PointStamped, size: float) -> Box:
    """The square (x, y, width, height) of side `size` around a point in pixels.

    Raises:
        TargetError: The point is not finite.
    """
    x, y = message.point.x, message.point.y
    if not (math.isfinite(x) and math.isfinite(y)):
        raise TargetError(f"target refused: the point ({x:g}, {y:g}) is not finite")
    return x - size / 2, y - size / 2, size, size


class TargetInput:
    """The subscriptions to targets while they are open.

    Args:
        node: The node that subscribes.
        request: Called with the box and the stamp in nanoseconds of the frame that it was
            drawn on; raises TargetError to refuse it.
        click_size: Tells the side of the square around a click, in pixels.
        report: Called with the reason for each target that is refused.
    """

    def __init__(
        self,
        node: Node,
        request: Callable[[Box, int], None],
        click_size: Callable[[], float],
        report: Report,
    ) -> None:
        self._node = node
        self._request = request
        self._click_size = click_size
        self._report = report
        # As bytes: a polygon of millions of points would become as many objects of Python.
        self._subscriptions = [
            subscribe(
                node,
                kind,
                topic,
                receive,
                profile=DEFAULT_QOS,
                report=report,
                raw=True,
            )
            for kind, topic, receive in (
                (PolygonStamped, "~/target", self._on_target),
                (PointStamped, "~/click", self._on_click),
            )
        ]

    def take_waiting(self) -> None:
        """Take what came before the image at hand."""
        for subscription in self._subscriptions:
            take_waiting(subscription)

    def close(self) -> None:
        """Give the subscriptions up."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def _on_target(self, octets: bytes) -> None:
        self._try(octets, PolygonStamped, box_of_polygon)

    def _on_click(self, octets: bytes) -> None:
        self._try(octets, PointStamped, lambda click: box_of_click(click, self._click_size()))

    def _try(self, octets: bytes, message_type: Any, box_of: Callable[[Any], Box]) -> None:
        try:
            message = _deserialized(octets, message_type)
            self._request(box_of(message), stamp_of(message.header))
        except TargetError as error:
            self._report(str(error))


def _deserialized(octets: bytes, message_type: Any) -> Any:
    if len(octets) > _LARGEST:
        raise TargetError(
            f"target refused: its message has {len(octets)} bytes; allowed: up to {_LARGEST}"
        )
    try:
        return deserialize_message(octets, message_type)
    except Exception as error:
        # What rclpy raises for bytes that are no such message is not specified.
        raise TargetError(f"target refused: its message cannot be read: {error}") from error
