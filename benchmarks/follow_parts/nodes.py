"""The real nodes in one process, in lockstep: each image waits for its answer.

Detections go straight to the tracker, because vision_msgs is not installed everywhere.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped, Vector3Stamped
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image, Imu, RegionOfInterest
from std_msgs.msg import Header, UInt32

from follow_parts.chain import Report, camera_info, camera_parameters, odometry_values, stamp_at
from follow_parts.scenarios import Scenario
from follow_parts.world import Motion
from pf_tracker_ros import Detections
from pf_tracker_ros.boxes import Box
from pf_tracker_ros.localization.tracker_frame import TrackerFrame
from pf_tracker_ros.messages import box_message, image_message
from pf_tracker_ros.node.localizer.localizer_node import LocalizerNode
from pf_tracker_ros.node.localizer.tracker_status import read_status
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.tracker.tracker_node import TrackerNode
from pf_tracker_ros.ros_domains import unused_domain
from pf_tracker_ros.stamps import NANOSECONDS, stamp_of

# Seconds after which a missing answer is an error, and for which an executor waits at most.
_DEADLINE, _POLL = 30.0, 0.05


class NodeChain:
    """The nodes `pf_tracker` and `localizer`, and the robot's topics.

    Args:
        scenario: What there is to be fed.
        seed: Of the tracker.
        has_imu: Whether there is an accelerometer.

    Raises:
        TimeoutError: The nodes do not find each other.
    """

    def __init__(self, scenario: Scenario, seed: int, *, has_imu: bool) -> None:
        self._stack = ExitStack()
        domain = self._stack.enter_context(unused_domain())
        context = Context()
        rclpy.init(context=context, domain_id=domain)
        self._stack.callback(context.try_shutdown)
        self._executor = SingleThreadedExecutor(context=context)
        parameters = {"seed": seed, "max_targets": scenario.max_targets}
        self._tracker = TrackerNode(
            context=context,
            parameter_overrides=_overrides(image_reliability="reliable", **parameters),
        )
        camera = {f"camera.{name}": one for name, one in camera_parameters(has_imu=has_imu).items()}
        self._localizer = LocalizerNode(context=context, parameter_overrides=_overrides(**camera))
        robot = rclpy.create_node("robot", context=context)
        for node in (self._tracker, self._localizer, robot):
            self._executor.add_node(node)
            self._stack.callback(node.destroy_node)
        # Messages by topic: the newest one.
        self._last: dict[str, Any] = {}
        for topic, kind in (
            ("pf_tracker/status", DiagnosticArray),
            ("localizer/status", DiagnosticArray),
            ("localizer/odometry", Odometry),
            ("localizer/bearing", Vector3Stamped),
        ):
            robot.create_subscription(kind, topic, self._keeper(topic), 50)
        self._topics = {
            topic: robot.create_publisher(kind, topic, 50)
            for topic, kind in (
                ("image", Image),
                ("camera_info", CameraInfo),
                ("odom", Odometry),
                ("pf_tracker/target", PolygonStamped),
                ("pf_tracker/select", UInt32),
                *([("depth", Image)] if scenario.has_depth else []),
                *([("imu", Imu)] if has_imu else []),
            )
        }
        self._wait(self._is_connected, "the nodes have not found each other")

    def take_motion(self, motion: Motion) -> None:
        """Publish on the topics odom and imu."""
        time, pose = motion.time, motion.odometry
        message = Odometry(header=_header(time, "odom"))
        message.pose.pose.position.x, message.pose.pose.position.y = pose.x, pose.y
        turn = message.pose.pose.orientation
        turn.z, turn.w = math.sin(pose.yaw / 2.0), math.cos(pose.yaw / 2.0)
        self._topics["odom"].publish(message)
        if "imu" in self._topics:
            imu, acceleration = Imu(header=_header(time, "camera")), motion.acceleration.tolist()
            one = imu.linear_acceleration
            one.x, one.y, one.z = acceleration
            self._topics["imu"].publish(imu)

    def take_detections(self, detections: Detections, time: float) -> None:
        """Give the detections of the image of a time to the tracker."""
        if session := self._tracker._manager.session:
            session.add_detections(detections, stamp_at(time))

    def request(self, box: Box, time: float) -> None:
        """Publish a box on the image of a time."""
        self._topics["pf_tracker/target"].publish(
            box_message(new_message, _header(time, "camera"), box)
        )

    def select(self, id: int) -> None:
        """Publish the selected target."""
        self._topics["pf_tracker/select"].publish(UInt32(data=id))

    def process(
        self, image: NDArray[np.uint8], depth: NDArray[np.uint16] | None, time: float
    ) -> Report:
        """Publish an image with what belongs to it, and wait for the answers of both nodes."""
        header, stamp = _header(time, "camera"), stamp_at(time)
        self._topics["camera_info"].publish(_camera_info(header))
        if depth is not None:
            self._topics["depth"].publish(image_message(new_message, header, depth))
        self._topics["image"].publish(image_message(new_message, header, image))
        statuses = "pf_tracker/status", "localizer/status"
        self._wait(lambda: all(map(self._has(stamp), statuses)), f"no answer at {time} s")
        # What both published before is there, too.
        for _ in self._topics:
            self._executor.spin_once(timeout_sec=0.0)
        frame, _ = read_status(self._last["pf_tracker/status"])
        has = self._has(stamp)
        values = (
            odometry_values(self._last["localizer/odometry"]) if has("localizer/odometry") else {}
        )
        if has("localizer/bearing"):
            direction = self._last["localizer/bearing"].vector
            values["bearing"] = math.atan2(-direction.x, direction.z)
        return _report(frame, values)

    def close(self) -> None:
        """End the nodes."""
        self._stack.close()

    def _keeper(self, topic: str) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            self._last[topic] = message

        return keep

    def _has(self, stamp: int) -> Callable[[str], bool]:
        """Whether the newest message of a topic has a stamp."""
        return lambda topic: topic in self._last and stamp_of(self._last[topic].header) == stamp

    def _is_connected(self) -> bool:
        status = "/localizer/status" in [one.topic_name for one in self._tracker.subscriptions]
        return status and all(one.get_subscription_count() for one in self._topics.values())

    def _wait(self, is_done: Callable[[], bool], problem: str) -> None:
        end = time.monotonic() + _DEADLINE
        while not is_done():
            if time.monotonic() > end:
                raise TimeoutError(f"{problem} within {_DEADLINE:.0f} s")
            self._executor.spin_once(timeout_sec=_POLL)


def _overrides(**values: Any) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]


def _header(time: float, frame_id: str) -> Header:
    header = Header(frame_id=frame_id)
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_at(time), NANOSECONDS)
    return header


def _camera_info(header: Header) -> CameraInfo:
    fields = vars(camera_info())
    fields["roi"] = RegionOfInterest(**vars(fields["roi"]))
    fields["p"] = [*fields["p"], 0.0, 0.0][:12]
    return CameraInfo(header=header, r=[1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0], **fields)


def _report(frame: TrackerFrame, values: dict[str, Any]) -> Report:
    boxes = {one.id: one.box for one in frame.targets if one.state != "lost" and one.box}
    selected = next((one for one in frame.targets if one.id == frame.selected), None)
    return Report(
        state=frame.state,
        confidence=selected.confidence if selected else math.nan,
        box=boxes.get(frame.selected),
        targets=boxes,
        **values,
    )
