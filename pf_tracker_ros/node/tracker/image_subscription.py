"""The node's images: one subscription, raw or compressed, as reliable as the publishers allow."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.node.qos import is_overridden, subscribe, take_oldest, take_pending

_TYPES = {"raw": Image, "compressed": CompressedImage}

# The newest frame wins; where every frame is asked for, a few may wait.
_PROFILES = {
    "best_effort": QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
    "reliable": QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE),
}
# Of an image that comes in many parts, Fast DDS drops what it has for the first of them: with a
# depth of 1 a busy node would hardly get any.
_NEWEST_RELIABLY = QoSProfile(depth=2, reliability=ReliabilityPolicy.RELIABLE)
# Those that are kept waiting.
_WAITING = {
    name: QoSProfile(depth=8, reliability=profile.reliability)
    for name, profile in _PROFILES.items()
}

# Where so many images in a row came this soon after the one before was done with, as a share of the
# time that took, they come faster than they are looked at. After a hold-up each is looked at.
_SOON, _MOST_SOON = 0.25, 3

# What to do where a publisher offers less reliability than is asked for.
RELIABILITY_CURE = "; set image_reliability to auto, or let the publisher be reliable"

# How often `auto` looks who publishes. A publisher that offers less than what is asked for is
# noticed at once.
_LOOK_INTERVAL = 0.5


class ImageSubscription:
    """Subscribes to the images while it is open, and again when it is told how.

    With the reliability `auto` it asks for what all publishers offer, and follows them as they come
    and go. Before any is there it expects reliable ones. Where images come faster than `receive` is
    done with them, it gets the newest that is there, so that none is old.

    It begins closed.

    Attributes:
        topic: Name of the topic, empty while closed.
        reliability: In force, `reliable` or `best_effort`.

    Args:
        node: The node that subscribes.
        receive: Called with each message, an Image or a CompressedImage.
        report: Called with a sentence if an override of the quality of service is wrong.
        topic: Its name, in place of `image` and of what the transport makes of that.
        group: That keeps images waiting at times, for `take_pending`; None where they never do.
    """

    def __init__(
        self,
        node: Node,
        receive: Callable[[Any], None],
        report: Callable[[str], None],
        topic: str = "",
        group: CallbackGroup | None = None,
    ) -> None:
        self.reliability = "reliable"
        self._node = node
        self._receive = receive
        self._report = report
        self._given_topic = topic
        self._group = group
        self._transport = "raw"
        self._subscription: Subscription | None = None
        self._look: Timer | None = None
        # Images in a row that came soon, and the time, in seconds, by which the next one does.
        self._soon, self._soon_until = 0, 0.0

    @property
    def topic(self) -> str:  # noqa: D102
        return self._subscription.topic_name if self._subscription else ""

    def open(self, transport: str, reliability: str) -> None:
        """Subscribe; what was subscribed before is given up.

        Args:
            transport: `raw` or `compressed`.
            reliability: `auto`, `reliable` or `best_effort`.
        """
        self.close()
        self._transport = transport
        name = self._node.resolve_topic_name(self._topic_of(transport))
        if reliability == "auto" and is_overridden(self._node, name, "subscription", "reliability"):
            reliability = "reliable"
        if reliability != "auto":
            self._subscribe(_PROFILES[reliability], self._receive)
            return
        self.reliability = self._offered(name)
        self._subscribe_to_newest()
        self._look = self._node.create_timer(
            _LOOK_INTERVAL, self._follow, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def close(self) -> None:
        """Give the subscription up."""
        if self._look:
            self._node.destroy_timer(self._look)
            self._look = None
        self._unsubscribe()

    def take_pending(self, most: int) -> int:
        """Receive images that wait, at most so many; how many there were."""
        return take_pending(self._subscription, most) if self._subscription else 0

    def _offered(self, topic: str) -> str:
        """What all publishers offer; what is in force while there are none."""
        publishers = self._node.get_publishers_info_by_topic(topic)
        reliabilities = {publisher.qos_profile.reliability for publisher in publishers}
        if not reliabilities:
            return self.reliability
        return "reliable" if reliabilities == {ReliabilityPolicy.RELIABLE} else "best_effort"

    def _follow(self) -> None:
        offered = self._offered(self.topic)
        if offered == self.reliability:
            return
        self.reliability = offered
        self._node.get_logger().info(
            f"images on {self.topic} are subscribed to with {offered.replace('_', ' ')} delivery, "
            "as their publishers offer"
        )
        self._unsubscribe()
        self._subscribe_to_newest()

    def _subscribe_to_newest(self) -> None:
        reliable = self.reliability == "reliable"
        profile = _NEWEST_RELIABLY if reliable else _PROFILES["best_effort"]
        if self._group:
            profile = _WAITING[self.reliability]
        self._subscribe(profile, self._receive_newest, lambda _: self._follow())

    def _receive_newest(self, message: Any) -> None:
        """Hand an image on; where they come too fast, the newest that is there instead."""
        began = time.monotonic()
        self._soon = self._soon + 1 if began < self._soon_until else 0
        if self._soon >= _MOST_SOON and self._subscription and self._keeps_newest:
            while (newer := take_oldest(self._subscription)) is not None:
                message = newer
        self._receive(message)
        ended = time.monotonic()
        self._soon_until = ended + _SOON * (ended - began)

    @property
    def _keeps_newest(self) -> bool:
        """Whether nobody has asked for more images to wait."""
        return not is_overridden(self._node, self.topic, "subscription", "depth")

    def _subscribe(
        self,
        profile: QoSProfile,
        receive: Callable[[Any], None],
        on_mismatch: Callable[[Any], None] | None = None,
    ) -> None:
        self._subscription = subscribe(
            self._node,
            _TYPES[self._transport],
            self._topic_of(self._transport),
            receive,
            profile=profile,
            report=self._report,
            on_mismatch=on_mismatch,
            group=self._group,
        )
        is_lossy = self._subscription.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
        self.reliability = "best_effort" if is_lossy else "reliable"

    def _unsubscribe(self) -> None:
        if self._subscription:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _topic_of(self, transport: str) -> str:
        """Compressed images come beside the raw ones, wherever `image` is remapped to."""
        if self._given_topic:
            return self._given_topic
        if transport == "raw":
            return "image"
        name = f"image/{transport}"
        if self._node.resolve_topic_name(name) != self._node.resolve_topic_name(
            name, only_expand=True
        ):
            return name
        return f"{self._node.resolve_topic_name('image')}/{transport}"
