"""How a target comes to the node, and goes: topics `~/target` and `~/click`, service `~/stop`."""

from __future__ import annotations

import math
from collections.abc import Callable

from geometry_msgs.msg import PointStamped, PolygonStamped
from rclpy.node import Node
from std_msgs.msg import Header

from pf_tracker_ros.node.message_building import Box, TargetError, box_of_polygon
from pf_tracker_ros.node.qos import DEFAULT_QOS, Report, subscribe
from pf_tracker_ros.node.session import NANOSECONDS


def nanoseconds(header: Header) -> int:
    """The stamp of a header."""
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)


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
    """The subscriptions to targets while they are open."""

    def __init__(
        self,
        node: Node,
        request: Callable[[Box, int], None],
        click_size: Callable[[], float],
        report: Report,
    ) -> None:
        """Subscribe.

        Args:
            node: The node that subscribes.
            request: Called with the box and the stamp in nanoseconds of the frame that it was
                drawn on; raises TargetError to refuse it.
            click_size: Tells the side of the square around a click, in pixels.
            report: Called with the reason for each target that is refused.
        """
        self._node = node
        self._request = request
        self._click_size = click_size
        self._report = report
        self._subscriptions = [
            subscribe(
                node,
                PolygonStamped,
                "~/target",
                self._on_target,
                profile=DEFAULT_QOS,
                report=report,
            ),
            subscribe(
                node, PointStamped, "~/click", self._on_click, profile=DEFAULT_QOS, report=report
            ),
        ]

    def close(self) -> None:
        """Give the subscriptions up."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def _on_target(self, message: PolygonStamped) -> None:
        self._try(lambda: box_of_polygon(message), message.header)

    def _on_click(self, message: PointStamped) -> None:
        self._try(lambda: box_of_click(message, self._click_size()), message.header)

    def _try(self, box: Callable[[], Box], header: Header) -> None:
        try:
            self._request(box(), nanoseconds(header))
        except TargetError as error:
            self._report(str(error))
