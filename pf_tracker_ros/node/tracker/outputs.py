"""What the node publishes of each frame besides its status: box, detections, particles, overlay."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import PolygonStamped
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

from pf_tracker_ros.node.message_building import (
    blank_box_message,
    fill_box_message,
    image_message,
    likelihood_message,
    particles_message,
)
from pf_tracker_ros.node.qos import DEFAULT_QOS, Report, advertise
from pf_tracker_ros.node.tracker.detections import DETECTIONS_TYPE, detections_message
from pf_tracker_ros.node.tracker.drawing import DrawingThread
from pf_tracker_ros.overlay import draw_overlay
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap


class Outputs:
    """The publishers of one configured node; closed, they are gone.

    Args:
        node: The node that publishes.
        report: Called with a sentence if a subscriber cannot be reached.
    """

    def __init__(self, node: Node, report: Report) -> None:
        self._node = node
        self._box = advertise(node, PolygonStamped, "~/box", profile=DEFAULT_QOS, report=report)
        self._box_message = blank_box_message()
        self._particles = advertise(
            node, PointCloud2, "~/particles", profile=DEFAULT_QOS, report=report
        )
        self._overlay = advertise(node, Image, "~/overlay", profile=DEFAULT_QOS, report=report)
        self._drawing = DrawingThread(self._overlay, report)
        self._likelihood = advertise(
            node, Image, "~/likelihood", profile=DEFAULT_QOS, report=report
        )
        self._detections: Publisher | None = None
        if DETECTIONS_TYPE:
            self._detections = advertise(
                node, DETECTIONS_TYPE, "~/detections", profile=DEFAULT_QOS, report=report
            )

    def publish(self, header: Header, estimate: Estimate | None) -> None:
        """Publish where the target is in a frame, each message only where somebody listens."""
        present = estimate is not None and estimate.state != "lost"
        if estimate and present and self._box.get_subscription_count():
            fill_box_message(self._box_message, estimate.box, header)
            self._box.publish(self._box_message)
        if self._detections and self._detections.get_subscription_count():
            self._detections.publish(detections_message(estimate if present else None, header))

    def show(self, image: NDArray[Any], header: Header, estimate: Estimate | None) -> None:
        """Publish what people look at, particles and overlay, only where somebody does."""
        if estimate and self._particles.get_subscription_count():
            self._particles.publish(particles_message(estimate, header))
        if self._overlay.get_subscription_count():
            text = f"{estimate.state} {estimate.confidence:.2f}" if estimate else "no target"
            self._drawing.draw(lambda: image_message(draw_overlay(image, estimate, text), header))

    @property
    def wants_likelihood(self) -> bool:
        """Whether somebody listens to the likelihood around the target."""
        return bool(self._likelihood.get_subscription_count())

    def publish_likelihood(self, likelihood: LikelihoodMap, header: Header) -> None:
        """Publish the likelihood around the target."""
        self._likelihood.publish(likelihood_message(likelihood, header))

    def close(self) -> None:
        """Withdraw the topics."""
        self._drawing.close()
        taken = (self._box, self._particles, self._overlay, self._likelihood, self._detections)
        for publisher in taken:
            if publisher:
                self._node.destroy_publisher(publisher)
