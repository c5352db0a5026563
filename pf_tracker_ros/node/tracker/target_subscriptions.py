"""The subscriptions to target requests, to detections and to a localizer."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PolygonStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from std_msgs.msg import Header, UInt32

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.localization.located_frame import hint_of_values
from pf_tracker_ros.messages import DETECTIONS_TYPE, box_of_polygon
from pf_tracker_ros.node.messages import message_class
from pf_tracker_ros.node.qos import DEFAULT_QOS, ErrorCallback, subscribe
from pf_tracker_ros.node.tracker.image_subscription import take_pending
from pf_tracker_ros.node.tracker.reporter import Throttle
from pf_tracker_ros.stamps import stamp_of
from pf_tracker_ros.targets.detections import check_message_size, detections_from_message
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.hints import Hint

# vision_msgs is optional: without it only this topic is missing.
DETECTIONS_CLASS: Any = None
with contextlib.suppress(ModuleNotFoundError):
    DETECTIONS_CLASS = message_class(DETECTIONS_TYPE)

DETECTIONS_TOPIC = "detections"
VISION_MSGS_MISSING = (
    "the topic 'detections' needs vision_msgs: apt install ros-jazzy-vision-msgs, or with ROS from "
    "PyPI run tools/make_vision_msgs.py; without it, draw targets or set 'built_in_detector'"
)

# Bytes of a message other than detections; enough for thousands of corners.
_MAX_BYTES = 65_536
# The same of a localizer's status; enough for hundreds of targets.
_MAX_STATUS_BYTES = 1_000_000
_LOCALIZER_STATUS = "localizer/status"


def box_of_click(message: PointStamped, size: float) -> Box:
    """The square (x, y, width, height) of side `size` around a point in pixels.

    Raises:
        ValueError: The point is not finite.
    """
    x, y = message.point.x, message.point.y
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"the point ({x:g}, {y:g}) is not finite")
    return x - size / 2, y - size / 2, size, size


class _Topic(NamedTuple):
    """A subscribed topic.

    Attributes:
        name: Its name.
        type: Message class.
        apply: Applies a message; raises ValueError to refuse it.
        refused: Start of the error for a refused message.
        max_bytes: Of a message other than detections.
    """

    name: str
    type: Any
    apply: Callable[[Any], None]
    refused: str
    max_bytes: int = _MAX_BYTES


class TargetSubscriptions:
    """The open subscriptions to target requests, to detections and to a localizer.

    Args:
        node: The subscribing node.
        session: Returns the session; raises ValueError without one.
        click_size: Returns the side of the square around a click, pixels.
        check_frame_id: Raises ValueError if the frame_id of a request is not that of the images.
        report: Called with a sentence for each refused message; for detections and statuses,
            repetitions are left out.
    """

    def __init__(
        self,
        node: Node,
        session: Callable[[], Session],
        click_size: Callable[[], float],
        check_frame_id: Callable[[str], None],
        report: ErrorCallback,
    ) -> None:
        self._node = node
        self._session = session
        self._click_size = click_size
        self._check_frame_id = check_frame_id
        self._report = report
        self._throttle = Throttle()
        # Pending messages are taken in this order: stopping makes room for a new target.
        topics = [
            _Topic("~/stop_target", UInt32, self._on_stop, "not stopped"),
            _Topic("~/target", PolygonStamped, self._on_target, "target refused"),
            _Topic("~/click", PointStamped, self._on_click, "target refused"),
            _Topic("~/select", UInt32, self._on_select, "not selected"),
        ]
        if DETECTIONS_CLASS:
            topics.append(
                _Topic(
                    DETECTIONS_TOPIC, DETECTIONS_CLASS, self._on_detections, "detections refused"
                )
            )
        self._subscriptions = [self._subscribe(topic) for topic in topics]
        self._has_localizer = False

    def find_localizer(self) -> None:
        """Subscribe to a localizer once there is one; call it from time to time."""
        name = self._node.resolve_topic_name(_LOCALIZER_STATUS)
        if self._has_localizer or not self._node.count_publishers(name):
            return
        self._has_localizer = True
        topic = _Topic(
            _LOCALIZER_STATUS,
            DiagnosticArray,
            self._on_localizer_status,
            "the localizer's status refused",
            _MAX_STATUS_BYTES,
        )
        self._subscriptions.append(self._subscribe(topic))

    def take_pending(self) -> None:
        """Apply the messages that arrived before the present image."""
        for subscription in self._subscriptions:
            take_pending(subscription)

    def close(self) -> None:
        """Unsubscribe."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def _subscribe(self, topic: _Topic) -> Subscription:
        # Raw bytes: the size is checked before millions of points become Python objects.
        def receive(octets: bytes) -> None:
            try:
                topic.apply(_deserialize(octets, topic))
            except ValueError as error:
                refusal = f"{topic.refused}: {error}"
                is_stream = topic.type in (DETECTIONS_CLASS, DiagnosticArray)
                if not is_stream or self._throttle.unrepeated([refusal]):
                    self._report(refusal)

        return subscribe(
            self._node,
            topic.type,
            topic.name,
            receive,
            profile=DEFAULT_QOS,
            report=self._report,
            raw=True,
        )

    def _on_target(self, message: PolygonStamped) -> None:
        self._request(box_of_polygon(message), message.header)

    def _on_click(self, message: PointStamped) -> None:
        self._request(box_of_click(message, self._click_size()), message.header)

    def _request(self, box: Box, header: Header) -> None:
        self._check_frame_id(header.frame_id)
        self._session().request(box, stamp_of(header))

    def _on_select(self, message: UInt32) -> None:
        self._session().select(message.data)

    def _on_stop(self, message: UInt32) -> None:
        self._session().stop_target(message.data)

    def _on_detections(self, message: Any) -> None:
        self._session().add_detections(detections_from_message(message), stamp_of(message.header))

    def _on_localizer_status(self, message: DiagnosticArray) -> None:
        hints = localizer_hints(message, str(self._node.resolve_topic_name("~/status")))
        if hints:
            self._session().set_hints(hints, stamp_of(message.header))


def localizer_hints(message: DiagnosticArray, tracker_status: str) -> dict[int, Hint]:
    """Id of a target to what a localizer knows of it.

    Args:
        message: Status of a localizer.
        tracker_status: Full name of the topic of the tracker's status; targets of other trackers
            are left out.

    Raises:
        ValueError: A value or an id is no number.
    """
    if not message.status:
        return {}
    own, *targets = [{one.key: one.value for one in status.values} for status in message.status]
    if own.get("tracker_status") != tracker_status:
        return {}
    hints = {}
    for values in targets:
        try:
            hints[int(values.get("id", ""))] = hint_of_values(values)
        except ValueError as error:
            raise ValueError(f"a target of the localizer cannot be read: {error}") from error
    return hints


def _deserialize(octets: bytes, topic: _Topic) -> Any:
    if topic.type is DETECTIONS_CLASS:
        check_message_size(octets)
    elif len(octets) > topic.max_bytes:
        raise ValueError(f"its message has {len(octets)} bytes; allowed: up to {topic.max_bytes}")
    try:
        return deserialize_message(octets, topic.type)
    except Exception as error:
        # rclpy does not specify what it raises for invalid bytes.
        raise ValueError(f"its message cannot be read: {error}") from error
