"""The subscription to images: raw or compressed, as reliable as the publishers offer.

A tracker needs the images of a single camera, so it also watches their publishers and frame_ids.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.node.graph_monitor import listed, surplus_publishers
from pf_tracker_ros.node.qos import is_overridden, subscribe

_TYPES = {"raw": Image, "compressed": CompressedImage}

# Best effort keeps the newest frame; `reliable` also keeps a few that wait.
_PROFILES = {
    "best_effort": QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
    "reliable": QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE),
}
# With a depth of 1, Fast DDS drops a complete image for the first fragment of the next one: a busy
# node would hardly receive any.
_NEWEST_RELIABLY = QoSProfile(depth=2, reliability=ReliabilityPolicy.RELIABLE)
# For a callback group that defers images.
_DEFERRED = {
    name: QoSProfile(depth=8, reliability=profile.reliability)
    for name, profile in _PROFILES.items()
}

# An image that follows the last one within this share of its processing time was in the queue.
# After this many in a row the newest image is processed; after a single hold-up each of them is.
_QUEUED_WITHIN, _MAX_QUEUED = 0.25, 3

# The remedy for a publisher that offers less reliability than requested.
RELIABILITY_REMEDY = "set image_reliability to auto, or publish reliably"

# Seconds between checks of the publishers with `auto`; an incompatible one is noticed at once.
_CHECK_INTERVAL = 0.5

# Seconds for which an image shows that its frame_id is in use, and consecutive polls of the graph
# monitor before a report. A single change of the frame_id lasts for fewer.
_FRAME_ID_WINDOW, _FRAME_ID_POLLS = 2.0, 10


class ImageSubscription:
    """Subscribes to the images while it is open; initially closed.

    With the reliability `auto` it requests what all publishers offer, and adapts as they come and
    go; without a publisher it requests reliable delivery. If images arrive faster than `receive`
    processes them, it passes the newest one.

    Attributes:
        topic: Full name of the topic, empty while closed.
        reliability: Of the subscription, `reliable` or `best_effort`.

    Args:
        node: The subscribing node.
        receive: Called with each message, an Image or a CompressedImage.
        report: Called with a sentence if a QoS override is invalid.
        on_lost: Called with the number of images that were lost in transport; None if unused.
        topic: Name of the topic; by default `image` or that of the transport.
        group: Callback group that may defer images until `take_pending`; None for no deferral.
    """

    def __init__(
        self,
        node: Node,
        receive: Callable[[Any], None],
        report: Callable[[str], None],
        topic: str = "",
        *,
        on_lost: Callable[[int], None] | None = None,
        group: CallbackGroup | None = None,
    ) -> None:
        self.reliability = "reliable"
        self._node = node
        self._receive = receive
        self._report = report
        self._on_lost = on_lost
        self._given_topic = topic
        self._group = group
        self._transport = "raw"
        self._subscription: Subscription | None = None
        self._check_timer: Timer | None = None
        # Consecutive images that were waiting, and the time until which the next one counts.
        self._queued, self._queued_until = 0, 0.0
        # frame_id to the time of its last image, for the seconds before the last image.
        self._frame_ids: dict[str, float] = {}

    @property
    def topic(self) -> str:  # noqa: D102
        return self._subscription.topic_name if self._subscription else ""

    def open(self, transport: str, reliability: str) -> None:
        """Subscribe, in place of an earlier subscription.

        Args:
            transport: `raw` or `compressed`.
            reliability: `auto`, `reliable` or `best_effort`.
        """
        self.close()
        self._transport = transport
        name = self._node.resolve_topic_name(self._topic_name(transport))
        if reliability == "auto" and is_overridden(self._node, name, "subscription", "reliability"):
            reliability = "reliable"
        if reliability != "auto":
            self._subscribe(_PROFILES[reliability], self._pass_on)
            return
        self.reliability = self._offered_reliability(name)
        self._subscribe_to_newest()
        self._check_timer = self._node.create_timer(
            _CHECK_INTERVAL, self._adapt, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def close(self) -> None:
        """Unsubscribe."""
        if self._check_timer:
            self._node.destroy_timer(self._check_timer)
            self._check_timer = None
        self._unsubscribe()

    def take_pending(self, limit: int) -> int:
        """Receive at most `limit` deferred images; returns their number."""
        return take_pending(self._subscription, limit) if self._subscription else 0

    def check_frame_id(self, frame_id: str) -> None:
        """Check the frame_id of a target against that of the images; either may be empty.

        Raises:
            ValueError: They differ.
        """
        if self._frame_ids and frame_id and not {frame_id, ""} & self._frame_ids.keys():
            raise ValueError(
                f"its frame_id is {listed([frame_id])}, but that of the images is "
                f"{listed(self._frame_ids)}; send pixels of these images, with their frame_id or "
                "an empty one"
            )

    def conflicts(self) -> Iterator[tuple[str, int]]:
        """Why the images may be of several cameras, as for `GraphMonitor`."""
        if not self._subscription:
            return
        message_type = f"sensor_msgs/msg/{_TYPES[self._transport].__name__}"
        yield from surplus_publishers(self._node, self.topic, message_type)
        now = time.monotonic()
        frame_ids = [name for name, at in self._frame_ids.items() if now - at < _FRAME_ID_WINDOW]
        if len(frame_ids) > 1:
            yield (
                f"the images on {self.topic} have {len(frame_ids)} frame_ids, {listed(frame_ids)}; "
                "let a single camera publish there, with one frame_id",
                _FRAME_ID_POLLS,
            )

    def _offered_reliability(self, topic: str) -> str:
        """The reliability that all publishers offer; the present one without publishers."""
        publishers = self._node.get_publishers_info_by_topic(topic)
        reliabilities = {publisher.qos_profile.reliability for publisher in publishers}
        if not reliabilities:
            return self.reliability
        return "reliable" if reliabilities == {ReliabilityPolicy.RELIABLE} else "best_effort"

    def _adapt(self) -> None:
        offered = self._offered_reliability(self.topic)
        if offered == self.reliability:
            return
        self.reliability = offered
        self._node.get_logger().info(
            f"subscribed to {self.topic} with {offered.replace('_', '-')} delivery, as its "
            "publishers offer"
        )
        self._unsubscribe()
        self._subscribe_to_newest()

    def _subscribe_to_newest(self) -> None:
        reliable = self.reliability == "reliable"
        profile = _NEWEST_RELIABLY if reliable else _PROFILES["best_effort"]
        if self._group:
            profile = _DEFERRED[self.reliability]
        self._subscribe(profile, self._receive_newest, lambda _: self._adapt())

    def _receive_newest(self, message: Any) -> None:
        """Pass an image on, or while overloaded the newest one."""
        start = time.monotonic()
        self._queued = self._queued + 1 if start < self._queued_until else 0
        if self._queued >= _MAX_QUEUED and self._subscription and self._keeps_newest:
            while (newer := take_oldest(self._subscription)) is not None:
                message = newer
        self._pass_on(message)
        end = time.monotonic()
        self._queued_until = end + _QUEUED_WITHIN * (end - start)

    def _pass_on(self, message: Any) -> None:
        now, known = time.monotonic(), self._frame_ids
        self._frame_ids = {name: at for name, at in known.items() if now - at < _FRAME_ID_WINDOW}
        self._frame_ids[message.header.frame_id] = now
        self._receive(message)

    @property
    def _keeps_newest(self) -> bool:
        """Whether the user did not override the depth."""
        return not is_overridden(self._node, self.topic, "subscription", "depth")

    def _subscribe(
        self,
        profile: QoSProfile,
        receive: Callable[[Any], None],
        on_mismatch: Callable[[Any], None] | None = None,
    ) -> None:
        on_lost = self._on_lost
        self._subscription = subscribe(
            self._node,
            _TYPES[self._transport],
            self._topic_name(self._transport),
            receive,
            profile=profile,
            report=self._report,
            on_mismatch=on_mismatch,
            on_lost=on_lost and (lambda event: on_lost(event.total_count_change)),
            group=self._group,
        )
        is_lossy = self._subscription.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
        self.reliability = "best_effort" if is_lossy else "reliable"

    def _unsubscribe(self) -> None:
        if self._subscription:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _topic_name(self, transport: str) -> str:
        """Name of the topic; compressed images follow a remapping of `image`."""
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


def take_pending(subscription: Subscription, limit: int | None = None) -> int:
    """Run a subscription's callback with its pending messages; returns their number.

    The executor takes one message of each subscription in turn, so the second of two messages
    before an image would follow it.

    Args:
        subscription: The subscription.
        limit: Maximum number of messages; None for all.
    """
    taken = 0
    while taken != limit and (message := take_oldest(subscription)) is not None:
        subscription.callback(message)
        taken += 1
    return taken


def take_oldest(subscription: Subscription) -> Any:
    """The oldest pending message of a subscription, None without one."""
    with subscription.handle:
        found = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    return None if found is None else found[0]
