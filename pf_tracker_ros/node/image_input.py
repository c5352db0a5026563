"""The node's images: one subscription, raw or compressed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.node.qos import IMAGE_QOS, subscribe

_TYPES = {"raw": Image, "compressed": CompressedImage}


class ImageInput:
    """Subscribes to the images while it is open, and again when it is told how.

    Attributes:
        topic: Name of the topic, empty while closed.
    """

    def __init__(
        self,
        node: Node,
        receive: Callable[[Any], None],
        report: Callable[[str], None],
    ) -> None:
        """Begin closed.

        Args:
            node: The node that subscribes.
            receive: Called with each message, an Image or a CompressedImage.
            report: Called with a sentence if a publisher and the subscription cannot match.
        """
        self._node = node
        self._receive = receive
        self._report = report
        self._subscription: Subscription | None = None

    @property
    def topic(self) -> str:  # noqa: D102
        return self._subscription.topic_name if self._subscription else ""

    def open(self, transport: str, reliability: str) -> None:
        """Subscribe; what was subscribed before is given up."""
        self.close()
        self._subscription = subscribe(
            self._node,
            _TYPES[transport],
            self._topic_of(transport),
            self._receive,
            profile=IMAGE_QOS[reliability],
            report=self._report,
        )

    def close(self) -> None:
        """Give the subscription up."""
        if self._subscription:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _topic_of(self, transport: str) -> str:
        """Compressed images come beside the raw ones, wherever `image` is remapped to."""
        if transport == "raw":
            return "image"
        name = f"image/{transport}"
        if self._node.resolve_topic_name(name) != self._node.resolve_topic_name(
            name, only_expand=True
        ):
            return name
        return f"{self._node.resolve_topic_name('image')}/{transport}"
