"""The publishers of the node `replay`, and checks of their subscribers."""

from __future__ import annotations

from geometry_msgs.msg import PolygonStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CompressedImage

from pf_tracker_ros.boxes import as_box
from pf_tracker_ros.messages import box_message
from pf_tracker_ros.node.image_topics import image_subscriber_hint
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.replay.playback import Playback
from pf_tracker_ros.node.replay.replay_parameters import ReplayParameters
from pf_tracker_ros.node.replay.replay_source import ReplayItem, ReplaySource, make_header

# Covers subscribers that are busy for a third of a second, with little memory.
DEPTH = 10
# With a full history, Fast DDS requests an acknowledgment with each message, else every 3 s.
_TARGET_DEPTH = 1
_ACKNOWLEDGE_TIMEOUT = 5.0
# Running nodes are discovered within it.
_DISCOVERY_TIMEOUT = 2.0
_UNKNOWN_NODE = ("_NODE_NAME_UNKNOWN_", "_NODE_NAMESPACE_UNKNOWN_")


class ReplayOutputs:
    """The publishers of one source.

    Attributes:
        image_topic: Full name of the image topic.
        sends_target: Whether a target is published.

    Args:
        node: The publishing node.
        source: The source.
        parameters: Parameters of the topics.
        playback: The schedule; stopping it ends the waits here.
        spectator: A node that only displays the images. Playback needs it and another subscriber.

    Raises:
        NameValidationException: A topic name is invalid.
    """

    def __init__(
        self,
        node: Node,
        source: ReplaySource,
        parameters: ReplayParameters,
        playback: Playback,
        spectator: Node | None = None,
    ) -> None:
        self._node = node
        self._spectator = spectator
        self._parameters = parameters
        self._playback = playback
        self._is_compressed = source.image_type is CompressedImage
        reliability = ReliabilityPolicy[parameters.image_reliability.upper()]
        self._images = node.create_publisher(
            source.image_type,
            "image/compressed" if self._is_compressed else "image",
            QoSProfile(depth=DEPTH, reliability=reliability),
        )
        self.image_topic = str(self._images.topic_name)
        self._ground_truth = self._targets = self._clock = None
        if source.has_ground_truth:
            self._ground_truth = node.create_publisher(PolygonStamped, "~/ground_truth", DEPTH)
        self.sends_target = bool(parameters.target_box) or parameters.target_from_ground_truth
        if self.sends_target:
            topic = parameters.target_topic
            self._targets = node.create_publisher(PolygonStamped, topic, _TARGET_DEPTH)
        if parameters.publish_clock:
            self._clock = node.create_publisher(Clock, "/clock", DEPTH)

    def publish(self, item: ReplayItem) -> None:
        """Publish time, true box and image, in this order."""
        if self._clock is not None:
            self._clock.publish(Clock(clock=Time(nanoseconds=item.time).to_msg()))
        if self._ground_truth is not None and item.ground_truth is not None:
            self._ground_truth.publish(item.ground_truth)
        self._images.publish(item.image)

    def publish_target(self, item: ReplayItem) -> bool:
        """Publish the target if it is in this image; returns whether it is.

        Waits for the acknowledgment, as the tracker needs the target before the image.
        """
        target: PolygonStamped | bytes | None = item.ground_truth
        if box := self._parameters.target_box:
            # The images of a bag have a frame_id of their own.
            header = make_header(item.stamp, "")
            target = box_message(new_message, header, as_box(box))
        if target is None or self._targets is None:
            return False
        self._targets.publish(target)
        self._wait_for_acknowledgment(self._targets)
        return True

    def wait_for_subscriber(self) -> None:
        """Wait briefly for a subscriber of the images."""
        self._playback.wait_for(lambda: self._has_subscriber(self._images), _DISCOVERY_TIMEOUT)

    def wait_for_delivery(self) -> None:
        """Wait until the last messages are acknowledged."""
        self._wait_for_acknowledgment(self._images)
        if self._ground_truth is not None:
            self._wait_for_acknowledgment(self._ground_truth)

    def missing_peers(self) -> list[str]:
        """Missing subscribers: a target, and images in lockstep, need one."""
        needed = [self._targets] if self._targets is not None else []
        if self._parameters.lockstep or needed:
            needed.append(self._images)
        missing = []
        for publisher in needed:
            if not self._has_subscriber(publisher):
                compressed = publisher.msg_type is CompressedImage
                hint = " (tracker: image_transport:=compressed)" if compressed else ""
                missing.append(f"a subscriber of {publisher.topic_name}{hint}")
        return missing

    def other_topic_hint(self) -> str:
        """Hint to image subscribers on other topics, if there is none on this one."""
        if self._has_subscriber(self._images):
            return ""
        return image_subscriber_hint(
            self._node, self._images.topic_name, compressed=self._is_compressed
        )

    def best_effort_subscribers(self) -> list[str]:
        """Names of the nodes that subscribe with best effort, and so may lose images."""
        subscribers = self._node.get_subscriptions_info_by_topic(self._images.topic_name)
        return [
            subscriber.node_name
            for subscriber in subscribers
            if subscriber.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
        ]

    def _has_subscriber(self, publisher: Publisher) -> bool:
        """Whether there is a subscriber, for images one in addition to the spectator, if any."""
        if self._spectator is None or publisher is not self._images:
            return bool(publisher.get_subscription_count())
        spectator = (self._spectator.get_name(), self._spectator.get_namespace())
        subscribers = {
            (subscriber.node_name, subscriber.node_namespace)
            for subscriber in self._node.get_subscriptions_info_by_topic(publisher.topic_name)
        }
        # An endpoint whose node is unknown yet may be the spectator's.
        return spectator in subscribers and bool(subscribers - {spectator, _UNKNOWN_NODE})

    def _wait_for_acknowledgment(self, publisher: Publisher) -> None:
        acknowledged = self._playback.wait_for(
            lambda: publisher.wait_for_all_acked(Duration(seconds=0)), _ACKNOWLEDGE_TIMEOUT
        )
        if not acknowledged:
            self._node.get_logger().warning(
                f"a subscriber of {publisher.topic_name} has not acknowledged all messages"
            )
