"""What the node publishes of each frame of several targets besides its status."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from geometry_msgs.msg import Point
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from pf_tracker_ros.boxes import box_corners
from pf_tracker_ros.node.message_building import image_message, several_particles_message
from pf_tracker_ros.node.qos import DEFAULT_QOS, Report, advertise
from pf_tracker_ros.node.tracker.detections import DETECTIONS_TYPE, several_detections_message
from pf_tracker_ros.node.tracker.drawing import DrawingThread
from pf_tracker_ros.overlay import draw_targets, target_color, target_text
from pf_tracker_ros.targets.tracked_target import TrackedTarget

_LINE_WIDTH, _TEXT_HEIGHT = 2.0, 16.0


class SeveralOutputs:
    """The publishers of one configured node; closed, they are gone.

    Args:
        node: The node that publishes.
        report: Called with a sentence if a subscriber cannot be reached.
    """

    def __init__(self, node: Node, report: Report) -> None:
        self._node = node

        def publisher(message_type: Any, topic: str) -> Publisher:
            return advertise(node, message_type, topic, profile=DEFAULT_QOS, report=report)

        self._boxes = publisher(MarkerArray, "~/boxes")
        self._particles = publisher(PointCloud2, "~/particles")
        self._overlay = publisher(Image, "~/overlay")
        self._drawing = DrawingThread(self._overlay, report)
        self._detections: Publisher | None = None
        if DETECTIONS_TYPE:
            self._detections = publisher(DETECTIONS_TYPE, "~/detections")

    def publish(self, header: Header, targets: Sequence[TrackedTarget]) -> None:
        """Publish where the targets are in a frame, each message only where somebody listens."""
        present = [target for target in targets if target.estimate.state != "lost"]
        if self._detections and self._detections.get_subscription_count():
            self._detections.publish(several_detections_message(present, header))
        if self._boxes.get_subscription_count():
            self._boxes.publish(boxes_message(present, header))

    def show(self, image: NDArray[Any], header: Header, targets: Sequence[TrackedTarget]) -> None:
        """Publish what people look at, particles and overlay, only where somebody does."""
        if targets and self._particles.get_subscription_count():
            self._particles.publish(several_particles_message(targets, header))
        if self._overlay.get_subscription_count():
            self._drawing.draw(lambda: image_message(draw_targets(image, targets), header))

    def close(self) -> None:
        """Withdraw the topics."""
        self._drawing.close()
        for publisher in (self._boxes, self._particles, self._overlay, self._detections):
            if publisher:
                self._node.destroy_publisher(publisher)


def boxes_message(targets: Sequence[TrackedTarget], header: Header) -> MarkerArray:
    """The boxes in pixels in the frame of the image, each with its id and label as a text.

    The first marker deletes those of the frame before; then come, for each target, its box as a
    line (namespace `boxes`) and a text (namespace `labels`), both with its id.
    """
    array = MarkerArray(markers=[Marker(header=header, action=Marker.DELETEALL)])
    for target in targets:
        corners = [Point(x=x, y=y) for x, y in box_corners(target.estimate.box)]
        box = _marker(target, header, "boxes", Marker.LINE_STRIP)
        box.points = [*corners, corners[0]]
        box.scale.x = _LINE_WIDTH
        text = _marker(target, header, "labels", Marker.TEXT_VIEW_FACING)
        text.text = target_text(target)
        text.pose.position.x = corners[0].x
        text.pose.position.y = corners[0].y - _TEXT_HEIGHT / 2
        text.scale.z = _TEXT_HEIGHT
        array.markers += [box, text]
    return array


def _marker(target: TrackedTarget, header: Header, namespace: str, kind: int) -> Marker:
    marker = Marker(header=header, ns=namespace, id=target.id, type=kind, action=Marker.ADD)
    marker.pose.orientation.w = 1.0
    blue, green, red = (value / 255.0 for value in target_color(target.id))
    alpha = 1.0 if target.estimate.state == "tracking" else 0.5
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=alpha)
    return marker
