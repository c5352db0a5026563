"""What the node publishes of each frame besides its status."""

from __future__ import annotations

from collections.abc import Collection
from functools import partial

from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Header

from pf_tracker_ros.node.messages import message_class, new_message
from pf_tracker_ros.node.qos import DEFAULT_QOS, ErrorCallback, advertise
from pf_tracker_ros.node.tracker.overlay_publisher import OverlayPublisher
from pf_tracker_ros.topics import OUTPUT_TOPICS, FrameResult, OutputTopic

PRIMARY_TOPICS = tuple(output.name for output in OUTPUT_TOPICS if not output.is_visualization)
# Made in a thread of its own: it takes as long as tracking does.
_DRAWN = "overlay"


class FramePublishers:
    """The publishers of `OUTPUT_TOPICS` of one configured node; closed, they are gone.

    A message is made only where somebody listens. Without vision_msgs, a robot loses the topic
    `~/detections` alone.

    Args:
        node: The node that publishes.
        report: Called with a sentence if a subscriber cannot be reached.
    """

    def __init__(self, node: Node, report: ErrorCallback) -> None:
        self._node = node
        self._publishers: dict[OutputTopic, Publisher] = {}
        for output in OUTPUT_TOPICS:
            try:
                message_type = message_class(output.message_type)
            except ModuleNotFoundError:
                continue
            self._publishers[output] = advertise(
                node, message_type, f"~/{output.name}", profile=DEFAULT_QOS, report=report
            )
        (drawn,) = (one for output, one in self._publishers.items() if output.name == _DRAWN)
        self._drawing = OverlayPublisher(drawn, report)

    def has_subscribers(self, name: str) -> bool:
        """Whether somebody listens to a topic."""
        return any(output.name == name for output, _ in self._wanted())

    def publish(
        self, header: Header, result: FrameResult, names: Collection[str] = PRIMARY_TOPICS
    ) -> None:
        """Publish some topics, by default what others act on.

        Args:
            header: Of the image.
            result: What is known after its frame.
            names: Of the topics.
        """
        for output, publisher in self._wanted():
            if output.name in names:
                _publish(publisher, output, header, result)

    def publish_visualizations(self, header: Header, result: FrameResult) -> None:
        """Publish what people look at; arguments as of `publish`."""
        for output, publisher in self._wanted():
            if output.name == _DRAWN:
                self._drawing.draw(partial(output.build, new_message, header, result))
            elif output.is_visualization:
                _publish(publisher, output, header, result)

    def close(self) -> None:
        """Withdraw the topics."""
        self._drawing.close()
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)

    def _wanted(self) -> list[tuple[OutputTopic, Publisher]]:
        return [one for one in self._publishers.items() if one[1].get_subscription_count()]


def _publish(
    publisher: Publisher, output: OutputTopic, header: Header, result: FrameResult
) -> None:
    message = output.build(new_message, header, result)
    if message is not None:
        publisher.publish(message)
