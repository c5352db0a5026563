"""The real nodes in one process, in lockstep: each image waits for its answer.

Detections go straight to the tracker, because vision_msgs is not installed everywhere.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped, Vector3Stamped
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from sensor_msgs.msg import CameraInfo, Image, Imu
from std_msgs.msg import Header, UInt32

from follow_parts.chain import Report, camera_parameters, stamp_at
from follow_parts.messages import (
    camera_info_message,
    imu_message,
    odometry_message,
    pose_message,
)
from follow_parts.rendering import CAMERA
from follow_parts.scenarios import Scenario
from follow_parts.world import ACCELERATION_NOISE, Motion
from pf_tracker_ros import Detections
from pf_tracker_ros.boxes import Box
from pf_tracker_ros.messages import box_message, image_message
from pf_tracker_ros.node.localizer.localizer_node import LocalizerNode
from pf_tracker_ros.node.localizer.tracker_status import read_status
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.tracker.tracker_node import TrackerNode
from pf_tracker_ros.ros_domains import unused_domain
from pf_tracker_ros.stamps import NANOSECONDS, stamp_of

# Seconds after which a missing answer is an error, and for which an executor waits at most.
_DEADLINE, _POLL = 30.0, 0.05
_CALLBACKS = 30  # of three nodes, that may be due at once
_ANSWERS = {
    "pf_tracker/status": DiagnosticArray,
    "localizer/odometry": Odometry,
    "localizer/bearing": Vector3Stamped,
    "localizer/status": DiagnosticArray,
}


class NodeChain:
    """The nodes `pf_tracker` and `localizer`, and the robot's topics; used as `LibraryChain`.

    Raises:
        TimeoutError: The nodes do not find each other.
    """

    def __init__(self, scenario: Scenario, seed: int, *, has_imu: bool) -> None:
        self._stack = ExitStack()
        context = Context()
        rclpy.init(context=context, domain_id=self._stack.enter_context(unused_domain()))
        self._stack.callback(context.try_shutdown)
        self._executor = SingleThreadedExecutor(context=context)
        camera = camera_parameters(has_imu=has_imu)
        values = {"seed": seed, "max_targets": scenario.max_targets}
        tracked = _overrides(image_reliability="reliable", **values)
        self._tracker = TrackerNode(context=context, parameter_overrides=tracked)
        values = {f"camera.{name}": one for name, one in vars(camera).items()}
        # By default messages of sensors may be lost, and on a busy machine some are.
        for topic in ("camera_info", "odom", "imu"):
            values[f"qos_overrides./{topic}.subscription.reliability"] = "reliable"
        self._localizer = LocalizerNode(context=context, parameter_overrides=_overrides(**values))
        robot = rclpy.create_node("robot", context=context)
        self._nodes = (self._tracker, self._localizer, robot)
        for node in self._nodes:
            self._executor.add_node(node)
            self._stack.callback(node.destroy_node)
        self._last: dict[str, Any] = {}  # the newest message of each topic
        for topic, kind in _ANSWERS.items():
            robot.create_subscription(kind, topic, partial(self._last.__setitem__, topic), 50)
        topics = {
            "image": Image,
            "camera_info": CameraInfo,
            "odom": Odometry,
            "pf_tracker/target": PolygonStamped,
            "pf_tracker/select": UInt32,
            **({"depth": Image} if scenario.has_depth else {}),
            **({"imu": Imu} if has_imu else {}),
        }
        self._topics = {
            topic: robot.create_publisher(kind, topic, 50) for topic, kind in topics.items()
        }
        self._wait(self._is_connected, "the nodes have not found each other")

    @property
    def session(self) -> NodeChain:
        """Takes detections, boxes drawn by hand and the selection, as that of the library."""
        return self

    def add_detections(self, detections: Detections, stamp: int) -> None:
        """Give the detections of an image to the tracker."""
        if session := self._tracker._manager.session:
            session.add_detections(detections, stamp)

    def request(self, box: Box, stamp: int) -> None:
        """Publish a box on an image."""
        header = _header(stamp, "camera")
        self._publish("pf_tracker/target", box_message(new_message, header, box))

    def select(self, id: int) -> None:
        """Publish the selected target."""
        self._publish("pf_tracker/select", UInt32(data=id))

    def take_motion(self, motion: Motion) -> None:
        """Publish on the topics odom and imu."""
        stamp, pose = stamp_at(motion.time), motion.odometry
        base = pose_message(new_message, pose.x, pose.y, pose.yaw)
        odometry = odometry_message(new_message, _header(stamp, "odom"), base)
        self._publish("odom", odometry)
        if "imu" in self._topics:
            header = _header(stamp, "camera")
            imu = imu_message(new_message, header, motion.acceleration, ACCELERATION_NOISE)
            self._publish("imu", imu)

    def process(
        self, image: NDArray[np.uint8], depth: NDArray[np.uint16] | None, time: float
    ) -> Report:
        """Publish an image with what belongs to it, and wait for the answers of both nodes."""
        stamp = stamp_at(time)
        header = _header(stamp, "camera")
        self._publish("camera_info", camera_info_message(new_message, header, CAMERA))
        if depth is not None:
            self._publish("depth", image_message(new_message, header, depth))
        self._publish("image", image_message(new_message, header, image))
        self._wait(partial(self._answer, "localizer/status", stamp), f"no answer at {time} s")
        # The status may overtake what was published before.
        for publisher in self._localizer.publishers:
            _wait_until_there(publisher)
        for _ in range(_CALLBACKS):
            self._executor.spin_once(timeout_sec=0.0)
        values: dict[str, Any] = {}
        if odometry := self._answer("localizer/odometry", stamp):
            values = _odometry_values(odometry)
        if bearing := self._answer("localizer/bearing", stamp):
            values["bearing"] = math.atan2(-bearing.vector.x, bearing.vector.z)
        frame, _ = read_status(self._last["pf_tracker/status"])
        boxes = {one.id: one.box for one in frame.targets if one.state != "lost" and one.box}
        selected = next((one for one in frame.targets if one.id == frame.selected), None)
        confidence = selected.confidence if selected else math.nan
        return Report(frame.state, confidence, boxes.get(frame.selected), boxes, **values)

    def close(self) -> None:
        """End the nodes."""
        self._stack.close()

    def _publish(self, topic: str, message: Any) -> None:
        """Publish a message, and wait until it is there: messages of other topics may overtake."""
        self._topics[topic].publish(message)
        _wait_until_there(self._topics[topic])

    def _answer(self, topic: str, stamp: int) -> Any:
        """The newest message of a topic, if it has that stamp; else None."""
        message = self._last.get(topic)
        return message if message and stamp_of(message.header) == stamp else None

    def _is_connected(self) -> bool:
        """Whether every publisher knows all who listen: before, it says nothing to them."""
        publishers = [one for node in self._nodes for one in node.publishers]
        heard = Counter(one.topic_name for node in self._nodes for one in node.subscriptions)
        return (
            heard["/localizer/status"] == 2
            and all(heard[one.topic_name] for one in self._topics.values())
            and all(one.get_subscription_count() >= heard[one.topic_name] for one in publishers)
        )

    def _wait(self, is_done: Callable[[], Any], problem: str) -> None:
        end = time.monotonic() + _DEADLINE
        while not is_done():
            if time.monotonic() > end:
                raise TimeoutError(f"{problem} within {_DEADLINE:.0f} s")
            self._executor.spin_once(timeout_sec=_POLL)


def _wait_until_there(publisher: Publisher) -> None:
    if not publisher.wait_for_all_acked(Duration(seconds=_DEADLINE)):
        raise TimeoutError(f"{publisher.topic_name} did not arrive within {_DEADLINE:.0f} s")


def _overrides(**values: Any) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]


def _header(stamp: int, frame_id: str) -> Header:
    header = Header(frame_id=frame_id)
    header.stamp.sec, header.stamp.nanosec = divmod(stamp, NANOSECONDS)
    return header


def _odometry_values(message: Odometry) -> dict[str, Any]:
    """Position, covariance and velocity; the twist is in the frame of the target."""
    pose, twist = message.pose.pose, message.twist.twist
    yaw = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    return {
        "position": np.array([pose.position.x, pose.position.y]),
        "covariance": np.reshape(message.pose.covariance, (6, 6))[:2, :2],
        "velocity": turn @ [twist.linear.x, twist.linear.y],
    }
