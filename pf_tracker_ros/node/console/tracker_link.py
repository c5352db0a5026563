"""The console's publishers and subscriptions; all callbacks run in the executor."""

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

# A status has the response to a target, so none may be lost while the executor is busy.
_STATUS_QOS = QoSProfile(
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# With a full history Fast DDS requests an acknowledgment for each message, else only every 3 s.
_TARGET_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
_ACK_TIMEOUT = 2.0


class TrackerLink:
    """Topics and services of one tracker.

    Attributes:
        name: Fully qualified name of the tracker's node.
        services: Its services.
        image_topic: Its image topic, empty while unknown.

    Args:
        node: The console's node.
        name: Of the tracker's node, relative to the console's namespace unless it is absolute.
        receive: Called in the executor with the kind, the stamp in nanoseconds (0 without one) and
            the content of each message. Kinds: `image`, `boxes`, `particles`, `likelihood`,
            `status`, `detections`, `health`, `parameters` (on a change) and `fault`.
    """

    def __init__(self, node: Node, name: str, receive: Receive) -> None:
        self._node = node
        self._receive = receive
        self.name = node.resolve_topic_name(name, only_expand=True)
        self._actions: deque[Callable[[], None]] = deque()
        # A guard condition also works before the node has an executor.
        self._guard = node.create_guard_condition(self._run_actions)
        self.image_topic = ""
        self._is_watched = False
        self._result_subscriptions: list[Subscription] = []
        self._likelihood: Subscription | None = None
        self._images = DeferredImageInput(
            node, self._forward("image", lambda message: message), self._report
        )
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_health, DEFAULT_QOS)
        self._targets = self._advertise("target", PolygonStamped)
        self._clicks = self._advertise("click", PointStamped)
        self._ids = {name: self._advertise(name, UInt32) for name in ("select", "stop_target")}
        self.services = TrackerServices(node, self.name, self._run_in_executor)
        node.create_subscription(ParameterEvent, "/parameter_events", self._on_parameters, 100)
        self._graph = GraphMonitor(node, self._report)

    # Called from any thread

    def watch(self, watched: bool) -> None:
        """Subscribe to images and results, or unsubscribe."""
        self._run_in_executor(lambda: self._subscribe_results(watched))

    def watch_likelihood(self, watched: bool) -> None:
        """Subscribe to the likelihood, which costs the tracker time, or unsubscribe."""
        self._run_in_executor(partial(self._subscribe_likelihood, watched))

    def available_trackers(self) -> list[str]:
        """Names of nodes with the topics of a tracker."""
        topics = {name for name, _ in self._node.get_topic_names_and_types()}
        nodes = (name.removesuffix("/status") for name in topics if name.endswith("/status"))
        return sorted(
            name
            for name in nodes
            if f"{name}/particles" in topics and self._node.count_publishers(f"{name}/status")
        )

    def set_image_topic(self, topic: str) -> None:
        """Subscribe to the tracker's image topic.

        Args:
            topic: As in its diagnostics; an empty one changes nothing.
        """
        if topic and topic != self.image_topic:
            self.image_topic = topic
            self._run_in_executor(self._update_images)

    def send_target(self, box: Box, stamp: int) -> None:
        """Send a box to track.

        Args:
            box: (x, y, width, height), pixels.
            stamp: Of the frame that it was drawn on, nanoseconds.

        Raises:
            TrackerError: No node subscribes to targets.
        """
        message = box_message(new_message, PolygonStamped().header, box)
        set_stamp(message.header, stamp)
        self._send(self._targets, message)

    @property
    def has_target_subscribers(self) -> bool:
        """Whether a node subscribes to targets and clicks."""
        return bool(
            self._targets.get_subscription_count() and self._clicks.get_subscription_count()
        )

    def require_target_subscriber(self) -> None:
        """Check that a node subscribes to targets.

        Raises:
            TrackerError: None does.
        """
        self._require_subscriber(self._targets)

    def wait_for_target_ack(self) -> bool:
        """Wait until the last target is acknowledged; False after 2 s."""
        return bool(self._targets.wait_for_all_acked(Duration(seconds=_ACK_TIMEOUT)))

    def send_click(self, x: float, y: float, stamp: int) -> None:
        """Send a point to track, pixels; otherwise as `send_target`."""
        message = PointStamped()
        message.point.x, message.point.y = x, y
        set_stamp(message.header, stamp)
        self._send(self._clicks, message)

    def send_id(self, topic: str, id: str) -> None:
        """Send the id of a target.

        Args:
            topic: `select`, where 0 means none, or `stop_target`.
            id: Of the target.

        Raises:
            ValueError: The text is no id.
            TrackerError: No node subscribes to the topic.
        """
        self._send(self._ids[topic], id_message(id))

    # In the executor

    def _run_in_executor(self, action: Callable[[], None]) -> None:
        self._actions.append(action)
        self._guard.trigger()

    def _run_actions(self) -> None:
        while self._actions:
            self._actions.popleft()()

    def _subscribe_results(self, watched: bool) -> None:
        if watched == self._is_watched:
            return
        self._is_watched = watched
        self._update_images()
        for subscription in self._result_subscriptions:
            self._node.destroy_subscription(subscription)
        self._result_subscriptions = []
        if watched:
            particles = self._forward("particles", particles_to_json)
            self._result_subscriptions = [
                self._subscribe(
                    f"{self.name}/status", DiagnosticArray, self._on_status, _STATUS_QOS
                ),
                self._subscribe(f"{self.name}/particles", PointCloud2, particles),
                self._subscribe(f"{self.name}/boxes", MarkerArray, self._on_boxes),
            ]
            if DETECTIONS_CLASS:
                topic = f"{self.name.rpartition('/')[0]}/detections"
                detections = self._forward("detections", detections_to_json)
                self._result_subscriptions.append(
                    self._subscribe(topic, DETECTIONS_CLASS, detections)
                )

    def _subscribe_likelihood(self, watched: bool) -> None:
        if watched and self._likelihood is None:
            likelihood = self._forward("likelihood", likelihood_to_json)
            self._likelihood = self._subscribe(f"{self.name}/likelihood", Image, likelihood)
        elif self._likelihood and not watched:
            self._node.destroy_subscription(self._likelihood)
            self._likelihood = None

    def _update_images(self) -> None:
        """Open or close the image subscription as needed."""
        if not self._is_watched:
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

    def _forward(self, kind: str, convert: Callable[[Any], Any]) -> Callable[[Any], None]:
        """A callback that passes a message to `receive`, converted by `convert`."""
        return lambda message: self._receive(kind, stamp_of(message.header), convert(message))

    def _advertise(self, name: str, message_type: Any) -> Any:
        topic = f"{self.name}/{name}"
        return advertise(self._node, message_type, topic, profile=_TARGET_QOS, report=self._report)

    def _send(self, publisher: Any, message: Any) -> None:
        self._require_subscriber(publisher)
        publisher.publish(message)

    def _require_subscriber(self, publisher: Any) -> None:
        if not publisher.get_subscription_count():
            topic = publisher.topic_name
            missing = f"no subscriber on {topic}: is the tracker running and active?"
            faults = (one for one in self.graph_faults if one.startswith(f"{topic} "))
            raise TrackerError(next(faults, missing))

    @property
    def graph_faults(self) -> tuple[str, ...]:
        """Persistent faults of the ROS graph around the console, a sentence each."""
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
        name = f"{self.name.lstrip('/')}: tracker"
        for status in message.status:
            if status.name == name:
                self._receive("health", 0, diagnostic_status_to_json(status))
