"""What the node is told of targets: which to start, select and stop, and what a detector found."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from typing import Any, NamedTuple

from geometry_msgs.msg import PointStamped, PolygonStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from std_msgs.msg import UInt32

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.messages import DETECTIONS_TYPE, box_of_polygon
from pf_tracker_ros.node.messages import message_class
from pf_tracker_ros.node.qos import DEFAULT_QOS, ErrorCallback, subscribe, take_pending
from pf_tracker_ros.node.tracker.reporter import Throttle
from pf_tracker_ros.stamps import stamp_of
from pf_tracker_ros.targets.detections import check_message_size, detections_from_message
from pf_tracker_ros.targets.session import Session

# Not a dependency: a robot without it loses this topic alone.
DETECTIONS_CLASS: Any = None
with contextlib.suppress(ModuleNotFoundError):
    DETECTIONS_CLASS = message_class(DETECTIONS_TYPE)

DETECTIONS_TOPIC = "detections"
VISION_MSGS_MISSING = (
    "vision_msgs is not installed, so no detector is heard on the topic 'detections': install "
    "ros-jazzy-vision-msgs (with a ROS from apt: PyPI has none), give targets on ~/target, or set "
    "'built_in_detector'"
)

# Bytes of a message but for detections: thousands of corners, and a frame's name of any sensible
# length.
_LARGEST = 65_536


def box_of_click(message: PointStamped, size: float) -> Box:
    """The square (x, y, width, height) of side `size` around a point in pixels.

    Raises:
        ValueError: The point is not finite.
    """
    x, y = message.point.x, message.point.y
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"the point ({x:g}, {y:g}) is not finite")
    return x - size / 2, y - size / 2, size, size


class _Input(NamedTuple):
    """One topic.

    Attributes:
        topic: Its name.
        type: Of its messages.
        take: Takes a message; raises ValueError to refuse it.
        refused: What is said before the reason where one is refused.
    """

    topic: str
    type: Any
    take: Callable[[Any], None]
    refused: str


class TargetSubscriptions:
    """The subscriptions to what is said of targets, while they are open.

    Args:
        node: The node that subscribes.
        session: Gives the session; raises ValueError where there is none.
        click_size: Tells the side of the square around a click, in pixels.
        report: Called with the reason for what is refused; of detections, where it has not just
            been told of the same kind.
    """

    def __init__(
        self,
        node: Node,
        session: Callable[[], Session],
        click_size: Callable[[], float],
        report: ErrorCallback,
    ) -> None:
        self._node = node
        self._session = session
        self._click_size = click_size
        self._report = report
        self._throttle = Throttle()
        # What waits is taken in this order: room is made before a target comes.
        inputs = [
            _Input("~/stop_target", UInt32, self._on_stop, "not stopped"),
            _Input("~/target", PolygonStamped, self._on_target, "target refused"),
            _Input("~/click", PointStamped, self._on_click, "target refused"),
            _Input("~/select", UInt32, self._on_select, "not selected"),
        ]
        if DETECTIONS_CLASS:
            inputs.append(
                _Input(
                    DETECTIONS_TOPIC, DETECTIONS_CLASS, self._on_detections, "detections refused"
                )
            )
        self._subscriptions = [self._subscribe(one) for one in inputs]

    def take_pending(self) -> None:
        """Take what came before the image at hand."""
        for subscription in self._subscriptions:
            take_pending(subscription)

    def close(self) -> None:
        """Give the subscriptions up."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def _subscribe(self, one: _Input) -> Subscription:
        # As bytes: a polygon of millions of points would become as many objects of Python.
        def receive(octets: bytes) -> None:
            try:
                one.take(_deserialized(octets, one.type))
            except ValueError as error:
                sentence = f"{one.refused}: {error}"
                is_often = one.type is DETECTIONS_CLASS
                for each in self._throttle.unrepeated([sentence]) if is_often else (sentence,):
                    self._report(each)

        return subscribe(
            self._node,
            one.type,
            one.topic,
            receive,
            profile=DEFAULT_QOS,
            report=self._report,
            raw=True,
        )

    def _on_target(self, message: PolygonStamped) -> None:
        self._session().request(box_of_polygon(message), stamp_of(message.header))

    def _on_click(self, message: PointStamped) -> None:
        box = box_of_click(message, self._click_size())
        self._session().request(box, stamp_of(message.header))

    def _on_select(self, message: UInt32) -> None:
        self._session().select(message.data)

    def _on_stop(self, message: UInt32) -> None:
        self._session().stop_target(message.data)

    def _on_detections(self, message: Any) -> None:
        self._session().add_detections(detections_from_message(message), stamp_of(message.header))


def _deserialized(octets: bytes, message_type: Any) -> Any:
    if message_type is DETECTIONS_CLASS:
        check_message_size(octets)
    elif len(octets) > _LARGEST:
        raise ValueError(f"its message has {len(octets)} bytes; allowed: up to {_LARGEST}")
    try:
        return deserialize_message(octets, message_type)
    except Exception as error:
        # What rclpy raises for bytes that are no such message is not specified.
        raise ValueError(f"its message cannot be read: {error}") from error
