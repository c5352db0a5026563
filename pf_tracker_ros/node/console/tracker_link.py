"""The console's side of the tracker's topics; every callback comes from the executor."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PolygonStamped
from rcl_interfaces.msg import ParameterEvent
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import UInt32
from visualization_msgs.msg import MarkerArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.messages import box_message
from pf_tracker_ros.node.console.deferred_image_input import DeferredImageInput
from pf_tracker_ros.node.console.json_conversions import (
    boxes_to_json,
    detections_to_json,
    diagnostic_status_to_json,
    id_message,
    likelihood_to_json,
    particles_to_json,
    status_to_json,
)
from pf_tracker_ros.node.console.tracker_services import TrackerError, TrackerServices
from pf_tracker_ros.node.graph_monitor import GraphMonitor
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.qos import DEFAULT_QOS, advertise, subscribe
from pf_tracker_ros.node.tracker.target_subscriptions import DETECTIONS_CLASS
from pf_tracker_ros.stamps import set_stamp, stamp_of

Receive = Callable[[str, int, Any], None]

# A status tells what became of a target: none is to be lost while the executor is busy.
_ALL = QoSProfile(
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# With its history full, Fast DDS asks for the acknowledgment with each message; else every 3 s.
_TARGET_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
_PATIENCE = 2.0


class TrackerLink:
    """What is heard of one tracker, and said to it.

    Attributes:
        name: Fully qualified name of the tracker's node.
        services: Of it.
        image_topic: That it takes its images from, empty while that is not known.

    Args:
        node: The console's node.
        name: Of the tracker's node, in the console's namespace unless it begins with a slash.
        receive: Called in the executor with what came, its stamp in nanoseconds (0 without one),
            and the content: `image`, `boxes`, `particles`, `likelihood`, `status`, `detections`,
            `health`, `parameters` for a change of these, or `fault`.
    """

    def __init__(self, node: Node, name: str, receive: Receive) -> None:
        self._node = node
        self._receive = receive
        self.name = node.resolve_topic_name(name, only_expand=True)
        self._actions: deque[Callable[[], None]] = deque()
        # Works before the node has an executor too.
        self._guard = node.create_guard_condition(self._act)
        self.image_topic = ""
        self._watching = False
        self._answers: list[Subscription] = []
        self._likelihood: Subscription | None = None
        self._images = DeferredImageInput(
            node, self._handing_on("image", lambda message: message), self._report
        )
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_health, DEFAULT_QOS)
        self._targets = self._advertise("target", PolygonStamped)
        self._clicks = self._advertise("click", PointStamped)
        self._ids = {name: self._advertise(name, UInt32) for name in ("select", "stop_target")}
        self.services = TrackerServices(node, self.name, self._do)
        node.create_subscription(ParameterEvent, "/parameter_events", self._on_parameters, 100)
        self._graph = GraphMonitor(node, self._report)

    # What is said to the tracker; called from any thread

    def watch(self, watched: bool) -> None:
        """Subscribe to images and what the tracker says of each, as long as anybody looks."""
        self._do(lambda: self._watch(watched))

    def watch_likelihood(self, watched: bool) -> None:
        """Subscribe to the likelihood around the target, which costs the tracker time."""
        self._do(partial(self._watch_likelihood, watched))

    def available_trackers(self) -> list[str]:
        """Names of the nodes that seem to be trackers, by their topics."""
        topics = {name for name, _ in self._node.get_topic_names_and_types()}
        nodes = (name.removesuffix("/status") for name in topics if name.endswith("/status"))
        return sorted(
            name
            for name in nodes
            if f"{name}/particles" in topics and self._node.count_publishers(f"{name}/status")
        )

    def set_image_topic(self, topic: str) -> None:
        """Take the images from the topic that the tracker takes them from.

        Args:
            topic: As its diagnostics tell; empty while it has none, which changes nothing.
        """
        if topic and topic != self.image_topic:
            self.image_topic = topic
            self._do(self._reopen)

    def send_target(self, box: Box, stamp: int) -> None:
        """Send a box to track.

        Args:
            box: (x, y, width, height), pixels.
            stamp: Of the frame that it was drawn on, nanoseconds.

        Raises:
            TrackerError: Nobody takes targets.
        """
        message = box_message(new_message, PolygonStamped().header, box)
        set_stamp(message.header, stamp)
        self._send(self._targets, message)

    @property
    def has_target_subscribers(self) -> bool:
        """Whether somebody takes targets."""
        return bool(
            self._targets.get_subscription_count() and self._clicks.get_subscription_count()
        )

    def require_target_subscriber(self) -> None:
        """Make sure that somebody takes targets.

        Raises:
            TrackerError: Nobody does.
        """
        self._expect_subscriber(self._targets)

    def wait_for_target_ack(self) -> bool:
        """Wait until the tracker has the target that was sent last; whether it has."""
        return bool(self._targets.wait_for_all_acked(Duration(seconds=_PATIENCE)))

    def send_click(self, x: float, y: float, stamp: int) -> None:
        """Send a point to track, pixels; otherwise as `send_target`."""
        message = PointStamped()
        message.point.x, message.point.y = x, y
        set_stamp(message.header, stamp)
        self._send(self._clicks, message)

    def send_id(self, topic: str, id: str) -> None:
        """Name a target to the tracker.

        Args:
            topic: `select`, for which 0 is none, or `stop_target`.
            id: Of the target.

        Raises:
            ValueError: That is no id of a target.
            TrackerError: Nobody takes it.
        """
        self._send(self._ids[topic], id_message(id))

    # In the executor

    def _do(self, action: Callable[[], None]) -> None:
        self._actions.append(action)
        self._guard.trigger()

    def _act(self) -> None:
        while self._actions:
            self._actions.popleft()()

    def _watch(self, watched: bool) -> None:
        if watched == self._watching:
            return
        self._watching = watched
        self._reopen()
        for subscription in self._answers:
            self._node.destroy_subscription(subscription)
        self._answers = []
        if watched:
            particles = self._handing_on("particles", particles_to_json)
            self._answers = [
                self._subscribe(f"{self.name}/status", DiagnosticArray, self._on_status, _ALL),
                self._subscribe(f"{self.name}/particles", PointCloud2, particles),
                self._subscribe(f"{self.name}/boxes", MarkerArray, self._on_boxes),
            ]
            if DETECTIONS_CLASS:
                topic = f"{self.name.rpartition('/')[0]}/detections"
                detections = self._handing_on("detections", detections_to_json)
                self._answers.append(self._subscribe(topic, DETECTIONS_CLASS, detections))

    def _watch_likelihood(self, watched: bool) -> None:
        if watched and self._likelihood is None:
            likelihood = self._handing_on("likelihood", likelihood_to_json)
            self._likelihood = self._subscribe(f"{self.name}/likelihood", Image, likelihood)
        elif self._likelihood and not watched:
            self._node.destroy_subscription(self._likelihood)
            self._likelihood = None

    def _reopen(self) -> None:
        """Take the images, of the topic that they are on, as long as anybody looks."""
        if not self._watching:
            self._images.close()
        elif self._images.topic != self.image_topic or not self.image_topic:
            self._images.open(self.image_topic)

    def _subscribe(
        self,
        topic: str,
        message_type: Any,
        callback: Callable[[Any], None],
        profile: QoSProfile = DEFAULT_QOS,
    ) -> Subscription:
        return subscribe(
            self._node, message_type, topic, callback, profile=profile, report=self._report
        )

    def _handing_on(self, kind: str, read: Callable[[Any], Any]) -> Callable[[Any], None]:
        """A callback that hands on what `read` makes of a message."""
        return lambda message: self._receive(kind, stamp_of(message.header), read(message))

    def _advertise(self, name: str, message_type: Any) -> Any:
        topic = f"{self.name}/{name}"
        return advertise(self._node, message_type, topic, profile=_TARGET_QOS, report=self._report)

    def _send(self, publisher: Any, message: Any) -> None:
        self._expect_subscriber(publisher)
        publisher.publish(message)

    def _expect_subscriber(self, publisher: Any) -> None:
        if not publisher.get_subscription_count():
            topic = publisher.topic_name
            nobody = f"nobody takes targets on {topic}: is the tracker running and active?"
            faults = (one for one in self.graph_faults if one.startswith(f"{topic} "))
            raise TrackerError(next(faults, nobody))

    @property
    def graph_faults(self) -> tuple[str, ...]:
        """Lasting faults of the ROS graph around the console, a sentence each."""
        return self._graph.lasting

    def _report(self, fault: str) -> None:
        self._node.get_logger().warning(fault)
        self._receive("fault", 0, fault)

    def _on_boxes(self, message: MarkerArray) -> None:
        if message.markers:
            self._receive("boxes", stamp_of(message.markers[0].header), boxes_to_json(message))

    def _on_status(self, message: DiagnosticArray) -> None:
        if message.status:
            self._receive("status", stamp_of(message.header), status_to_json(message))
            self._images.on_status()

    def _on_parameters(self, message: ParameterEvent) -> None:
        if message.node == self.name:
            self._receive("parameters", 0, None)

    def _on_health(self, message: DiagnosticArray) -> None:
        wanted = f"{self.name.lstrip('/')}: tracker"
        for status in message.status:
            if status.name == wanted:
                self._receive("health", 0, diagnostic_status_to_json(status))
