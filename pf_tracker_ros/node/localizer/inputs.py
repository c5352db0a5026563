"""The subscriptions of the localizer beside that of the tracker's status."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, Image, Imu

from pf_tracker_ros.localization.problems import Problems
from pf_tracker_ros.localization.sensors import (
    BasePoses,
    CameraCalibration,
    DepthImages,
    Gravity,
    Probabilities,
    Store,
)
from pf_tracker_ros.node.qos import subscribe
from pf_tracker_ros.node.tracker.image_subscription import ImageSubscription
from pf_tracker_ros.stamps import stamp_of

# Matches reliable and best-effort publishers.
_SENSOR_QOS = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
# Seconds since the last message after which none is waited for.
_SILENT_AFTER = 0.5

StoreType = TypeVar("StoreType", bound=Store)


class Arrivals:
    """Counts the messages of an input.

    Attributes:
        count: Number of messages.
        last_at: Time of the last one, by `time.monotonic`; -inf before the first.
    """

    def __init__(self) -> None:
        self.count = 0
        self.last_at = float("-inf")
        self._rated = 0, time.monotonic()

    def add(self) -> None:
        """Count a message."""
        self.count += 1
        self.last_at = time.monotonic()

    @property
    def silent_for(self) -> float:
        """Seconds since the last message; infinite before the first."""
        return time.monotonic() - self.last_at

    def rate(self) -> float:
        """Messages a second since the last call, or since the start, Hz."""
        now = time.monotonic()
        (count, then), self._rated = self._rated, (self.count, now)
        return (self.count - count) / max(now - then, 1e-3)


class Input(Generic[StoreType]):
    """A subscription that fills the store of a sensor.

    Attributes:
        arrivals: The messages since it was opened.
        store: What they say.

    Args:
        node: The subscribing node.
        problems: Where it tells its problems, under its name.
        arrived: Called after each message.
        store: Class of the store.
        message_type: Class of the messages.
    """

    def __init__(
        self,
        node: Node,
        problems: Problems,
        arrived: Callable[[], None],
        store: type[StoreType],
        message_type: Any,
    ) -> None:
        self.arrivals = Arrivals()
        self.name = store.name
        self._node = node
        self._problems = problems
        self._arrived = arrived
        self._message_type = message_type
        self._subscription: Subscription | None = None
        self.store = store(self)

    @property
    def topic(self) -> str:
        """Full name of the topic."""
        return str(self._node.resolve_topic_name(self.name))

    @property
    def is_used(self) -> bool:
        """Whether somebody publishes it, or has done so."""
        return bool(self.arrivals.count or self._node.count_publishers(self.topic))

    @property
    def is_silent(self) -> bool:
        """Whether no message is waited for."""
        return self.arrivals.silent_for > _SILENT_AFTER

    def open(self) -> None:
        """Subscribe, unless it is subscribed."""
        if self._subscription:
            return
        self.arrivals = Arrivals()
        self.store.forget()
        self._subscription = subscribe(
            self._node,
            self._message_type,
            self.name,
            self._receive,
            profile=_SENSOR_QOS,
            report=self._tell,
        )

    def close(self) -> None:
        """Unsubscribe."""
        if self._subscription:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _receive(self, message: Any) -> None:
        self.arrivals.add()
        stamp = stamp_of(message.header)
        if self.store.is_needless(stamp):
            return
        try:
            self.store.take(stamp, message.header.frame_id, message)
        except ValueError as error:
            self._problems.set(self.name, f"{self.name} refused: {error}")
        else:
            self._problems.set(self.name, "")
        self._arrived()

    def _tell(self, sentence: str) -> None:
        self._problems.tell(self.name, sentence)


class DepthInput(Input[DepthImages]):
    """The depth images, in one of their transports."""

    _transport = "raw"
    _images: ImageSubscription | None = None

    @property
    def topic(self) -> str:
        """Full name of the topic."""
        suffix = "" if self._transport == "raw" else f"/{self._transport}"
        return f"{self._node.resolve_topic_name(self.name)}{suffix}"

    def open_transport(self, transport: str) -> None:
        """Subscribe, in place of an earlier subscription.

        Args:
            transport: `raw`, `compressed` or `compressedDepth`.
        """
        self.close()
        self.arrivals = Arrivals()
        self.store.forget()
        self._transport = transport
        self._images = ImageSubscription(self._node, self._receive, self._tell, self.topic)
        self._images.open("raw" if transport == "raw" else "compressed", "auto")

    def close(self) -> None:
        """Unsubscribe."""
        if self._images:
            self._images.close()
            self._images = None


class Inputs:
    """All inputs beside the tracker's status.

    Args:
        node: The subscribing node.
        problems: Where they tell their problems.
        arrived: Called after each message.
    """

    def __init__(self, node: Node, problems: Problems, arrived: Callable[[], None]) -> None:
        common = node, problems, arrived
        self.camera_info = Input(*common, CameraCalibration, CameraInfo)
        self.depth = DepthInput(*common, DepthImages, Image)
        self.odometry = Input(*common, BasePoses, Odometry)
        self.gravity = Input(*common, Gravity, Imu)
        self.probability = Input(*common, Probabilities, Image)

    @property
    def sensors(self) -> tuple[Input[Any], ...]:
        """Those that a sensor publishes."""
        return self.camera_info, self.depth, self.odometry, self.gravity

    @property
    def silent_for(self) -> float:
        """Seconds since the last message that frames wait for: of depth and odometry."""
        return min(self.depth.arrivals.silent_for, self.odometry.arrivals.silent_for)

    def open(self, depth_transport: str) -> None:
        """Subscribe to the sensors."""
        self.camera_info.open()
        self.depth.open_transport(depth_transport)
        self.odometry.open()
        self.gravity.open()

    def close(self) -> None:
        """Unsubscribe from all."""
        for one in (*self.sensors, self.probability):
            one.close()
