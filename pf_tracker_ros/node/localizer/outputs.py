"""The topics of the localizer beside its status, each built only for subscribers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Header

from pf_tracker_ros.messages import DETECTIONS_3D_TYPE, MARKERS_TYPE
from pf_tracker_ros.node.localizer.transforms import Transforms
from pf_tracker_ros.node.messages import message_class, new_message
from pf_tracker_ros.node.qos import DEFAULT_QOS, ErrorCallback, advertise
from pf_tracker_ros.world import Bearing
from pf_tracker_ros.world_messages import (
    BEARING_TYPE,
    ODOMETRY_TYPE,
    POSE_TYPE,
    POSE_WITH_COVARIANCE_TYPE,
    TARGET_FRAME,
    WorldTarget,
    bearing_message,
    detections_3d_message,
    odometry_message,
    pose_message,
    pose_with_covariance_message,
    world_markers_message,
)

_TOPICS = {
    "pose": POSE_TYPE,
    "pose_with_covariance": POSE_WITH_COVARIANCE_TYPE,
    "odometry": ODOMETRY_TYPE,
    "bearing": BEARING_TYPE,
    "detections_3d": DETECTIONS_3D_TYPE,
    "markers": MARKERS_TYPE,
}


class Outputs:
    """The publishers; without vision_msgs, only `~/detections_3d` is missing.

    Args:
        node: The publishing node.
        transforms: Broadcasts the targets' frames; None where tf2_ros is not installed.
        report: Called with a sentence if a QoS override is invalid.
    """

    def __init__(self, node: Node, transforms: Transforms | None, report: ErrorCallback) -> None:
        self._node = node
        self._transforms = transforms
        self._publishers: dict[str, Publisher] = {}
        for name, type_name in _TOPICS.items():
            try:
                message_type = message_class(type_name)
            except ModuleNotFoundError:
                continue
            self._publishers[name] = advertise(
                node, message_type, f"~/{name}", profile=DEFAULT_QOS, report=report
            )

    def publish_selected(self, header: Header, target: WorldTarget) -> None:
        """Publish the position of the selected target.

        Args:
            header: With the fixed frame and the image's stamp.
            target: The target.
        """
        self._publish("pose", lambda: pose_message(new_message, header, target))
        self._publish(
            "pose_with_covariance",
            lambda: pose_with_covariance_message(new_message, header, target),
        )
        self._publish(
            "odometry", lambda: odometry_message(new_message, header, target, TARGET_FRAME)
        )
        self._broadcast(header, {TARGET_FRAME: target})

    def publish_bearing(self, header: Header, bearing: Bearing) -> None:
        """Publish the direction of the selected target.

        Args:
            header: Of the image.
            bearing: The direction.
        """
        self._publish("bearing", lambda: bearing_message(new_message, header, bearing.direction))

    def publish_all(self, header: Header, targets: Sequence[WorldTarget], selected: int) -> None:
        """Publish all targets.

        Args:
            header: With the fixed frame and the image's stamp.
            targets: Those with a position.
            selected: Id of the selected one, 0 without.
        """
        self._publish("detections_3d", lambda: detections_3d_message(new_message, header, targets))
        self._publish(
            "markers", lambda: world_markers_message(new_message, header, targets, selected)
        )
        self._broadcast(header, {f"{TARGET_FRAME}_{target.id}": target for target in targets})

    def close(self) -> None:
        """Remove the publishers."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        self._publishers.clear()

    def _publish(self, name: str, build: Callable[[], Any]) -> None:
        publisher = self._publishers.get(name)
        if publisher and publisher.get_subscription_count():
            publisher.publish(build())

    def _broadcast(self, header: Header, targets: dict[str, WorldTarget]) -> None:
        if self._transforms:
            poses = {
                name: pose_message(new_message, header, target).pose
                for name, target in targets.items()
            }
            self._transforms.broadcast(header, poses)
