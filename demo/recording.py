"""Records the messages that the tracker publishes."""

from __future__ import annotations

import itertools
import time
from array import array
from collections.abc import Callable
from types import TracebackType
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from pf_tracker_ros.footage.cdr import header_stamp
from pf_tracker_ros.stamps import stamp_of

BOX = "/pf_tracker/box"
BOXES = "/pf_tracker/boxes"
STATUS = "/pf_tracker/status"
PARTICLES = "/pf_tracker/particles"
OVERLAY = "/pf_tracker/overlay"
# The overlay is the last subscription: once the tracker has discovered it, it knows the others.
_TOPICS_OF_ALL = {
    STATUS: (DiagnosticArray, "diagnostic_msgs/msg/DiagnosticArray"),
    PARTICLES: (PointCloud2, "sensor_msgs/msg/PointCloud2"),
    OVERLAY: (Image, "sensor_msgs/msg/Image"),
}
_TOPICS_OF_ONE = {BOX: (PolygonStamped, "geometry_msgs/msg/PolygonStamped"), **_TOPICS_OF_ALL}
_TOPICS_OF_SEVERAL = {
    BOXES: (MarkerArray, "visualization_msgs/msg/MarkerArray"),
    **_TOPICS_OF_ALL,
}
RECORDED_STATUS = "/recorder/status"
_EVERYTHING = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
_PROBE_INTERVAL = 0.5


class Recorder:
    """A node that records the tracker's outputs; a context manager.

    When all messages of a frame are recorded, its status is published again on `RECORDED_STATUS`. A
    replay in lockstep with that topic loses no message.

    Attributes:
        topics: Topic to its message type and the name of the type.
        messages: Topic to stamp (nanoseconds) to serialized message.
    """

    def __init__(self, *, several: bool = False) -> None:
        """Subscribe to the outputs for one or for several targets, in this process' ROS domain."""
        self.topics = _TOPICS_OF_SEVERAL if several else _TOPICS_OF_ONE
        self.messages: dict[str, dict[int, bytes]] = {topic: {} for topic in self.topics}
        self._context = Context()
        self._context.init()
        self._node = Node("recorder", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._probes = self._node.create_publisher(Image, "/image", 1)
        self._recorded = self._node.create_publisher(DiagnosticArray, RECORDED_STATUS, 10)
        for topic, (message_type, _) in self.topics.items():
            self._node.create_subscription(
                message_type, topic, self._keep(topic), _EVERYTHING, raw=True
            )

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def read(self, topic: str) -> dict[int, Any]:
        """The messages of a topic, by stamp in nanoseconds."""
        message_type, _ = self.topics[topic]
        return {
            stamp: deserialize_message(message, message_type)
            for stamp, message in self.messages[topic].items()
        }

    def wait_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Record until a condition is true.

        Args:
            condition: The condition, checked after each message.
            timeout: Maximum time to wait, seconds.

        Returns:
            Whether it became true in time.
        """
        deadline = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.02)
        return True

    def meet_tracker(self, timeout: float, check: Callable[[], None]) -> bool:
        """Wait until all outputs of the tracker arrive here.

        DDS discovers each topic separately, and messages from before the discovery are lost. So
        small probe images are published, while the tracker has no target, until the overlay of one
        arrives. Each probe has its own stamp, before those of the recording, because the tracker
        skips duplicates.

        Args:
            timeout: Maximum time to wait, seconds.
            check: Called before each probe; may raise to stop waiting.

        Returns:
            Whether the outputs arrive.
        """
        deadline = time.monotonic() + timeout
        stamps = itertools.count(1)
        while time.monotonic() < deadline:
            check()
            self._probes.publish(_probe(next(stamps)))
            if self.wait_until(self._probe_has_returned, _PROBE_INTERVAL):
                self._node.destroy_publisher(self._probes)
                return True
        return False

    def _probe_has_returned(self) -> bool:
        return not self.messages[STATUS].keys().isdisjoint(self.messages[OVERLAY])

    def _keep(self, topic: str) -> Callable[[bytes], None]:
        def keep(message: bytes) -> None:
            stamp = self._stamp(topic, message)
            # Only the first message of a stamp counts: a repeated frame is a skipped duplicate.
            self.messages[topic].setdefault(stamp, message)
            if self._is_complete(stamp):
                self._recorded.publish(self.messages[STATUS][stamp])

        return keep

    def _stamp(self, topic: str, message: bytes) -> int:
        """Stamp of a serialized message, nanoseconds; for markers, that of the first one."""
        if topic != BOXES:
            return header_stamp(message)
        return stamp_of(deserialize_message(message, MarkerArray).markers[0].header)

    def _is_complete(self, stamp: int) -> bool:
        if stamp not in self.messages[STATUS]:
            return False
        state = status_values(deserialize_message(self.messages[STATUS][stamp], DiagnosticArray))
        every = {OVERLAY, BOXES} & self.topics.keys()
        expected = {"idle": every, "lost": every | {PARTICLES}}.get(
            state["state"], set(self.topics)
        )
        return all(stamp in self.messages[topic] for topic in expected)


def status_values(message: DiagnosticArray) -> dict[str, str]:
    """Key to value of the node's status, the first one in the message."""
    return {pair.key: pair.value for pair in message.status[0].values}


def target_values(message: DiagnosticArray) -> list[dict[str, str]]:
    """Key to value of the status of each target."""
    return [{pair.key: pair.value for pair in status.values} for status in message.status[1:]]


def _probe(stamp: int) -> Image:
    """A small image with a stamp in nanoseconds, below 10^9."""
    side = 16
    image = Image(height=side, width=side, encoding="mono8", step=side)
    image.header.stamp.nanosec = stamp
    image.data = array("B", bytes(side * side))
    return image
