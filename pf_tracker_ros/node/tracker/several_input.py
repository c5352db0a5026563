"""What is said of several targets: a detector's answers, and which target to stop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import UInt32

from pf_tracker_ros.node.qos import DEFAULT_QOS, Report, subscribe, take_waiting
from pf_tracker_ros.node.tracker.detections import DETECTIONS_TYPE
from pf_tracker_ros.node.tracker.reporter import Throttle
from pf_tracker_ros.stamps import stamp_of
from pf_tracker_ros.targets.detection_messages import check_length, detections_of
from pf_tracker_ros.targets.detections import Detections

DETECTIONS_TOPIC = "detections"
NOT_INSTALLED = (
    "vision_msgs is not installed, so no detector is heard on the topic 'detections': install "
    "ros-jazzy-vision-msgs (with a ROS from apt: PyPI has none), give targets on ~/target, or set "
    "'built_in_detector'"
)


class SeveralInput:
    """The subscriptions to detections and to ids that are to be stopped, while they are open.

    Args:
        node: The node that subscribes.
        detect: Called with detections and the stamp in nanoseconds of the frame that the detector
            saw; raises ValueError to refuse them.
        stop: Called with the id of a target; raises ValueError if there is none.
        report: Called with the reason for what is refused; of detections, where it has not just
            been told of the same kind.
    """

    def __init__(
        self,
        node: Node,
        detect: Callable[[Detections, int], None],
        stop: Callable[[int], None],
        report: Report,
    ) -> None:
        self._node = node
        self._detect = detect
        self._stop = stop
        self._report = report
        self._throttle = Throttle()
        self._subscriptions = [
            subscribe(
                node, UInt32, "~/stop_target", self._on_stop, profile=DEFAULT_QOS, report=report
            )
        ]
        if DETECTIONS_TYPE:
            self._subscriptions.append(
                subscribe(
                    node,
                    DETECTIONS_TYPE,
                    DETECTIONS_TOPIC,
                    self._on_detections,
                    profile=DEFAULT_QOS,
                    report=report,
                    raw=True,
                )
            )

    def take_waiting(self) -> None:
        """Take what came before the image at hand."""
        for subscription in self._subscriptions:
            take_waiting(subscription)

    def close(self) -> None:
        """Give the subscriptions up."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def _on_stop(self, message: UInt32) -> None:
        try:
            self._stop(message.data)
        except ValueError as error:
            self._report(f"not stopped: {error}")

    def _on_detections(self, octets: bytes) -> None:
        try:
            message = _deserialized(octets)
            self._detect(detections_of(message), stamp_of(message.header))
        except ValueError as error:
            for sentence in self._throttle.pick([f"detections refused: {error}"]):
                self._report(sentence)


def _deserialized(octets: bytes) -> Any:
    check_length(octets)
    try:
        return deserialize_message(octets, DETECTIONS_TYPE)
    except Exception as error:
        # What rclpy raises for bytes that are no such message is not specified.
        raise ValueError(f"the message cannot be read: {error}") from error
