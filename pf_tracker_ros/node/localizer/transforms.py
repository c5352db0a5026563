"""Transforms of tf2, where tf2_ros is installed."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from geometry_msgs.msg import Pose, TransformStamped
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Header

from pf_tracker_ros.localization.rigid_pose import RigidPose
from pf_tracker_ros.localization.sensors import NotYetError

_TOPIC, _STATIC_TOPIC = "/tf", "/tf_static"


class Transforms:
    """Listens to transforms, and broadcasts those of the targets.

    Args:
        node: The node whose executor receives them.

    Raises:
        ImportError: tf2_ros cannot be loaded.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        try:
            tf2 = import_module("tf2_ros")
            self._buffer = tf2.Buffer()
            self._listener = tf2.TransformListener(self._buffer, node)
            self._broadcaster = tf2.TransformBroadcaster(node)
        except Exception as error:
            # A broken installation raises whatever its libraries do.
            raise ImportError(
                f"tf2_ros cannot be loaded: {error}; reinstall ros-jazzy-tf2-ros, or give "
                "camera.height. Until then, transforms are neither used nor broadcast"
            ) from error
        self._tf2, self._have_been_published = tf2, False

    @staticmethod
    def are_installed() -> bool:
        """Whether tf2_ros is installed."""
        return find_spec("tf2_ros") is not None

    @property
    def are_published(self) -> bool:
        """Whether another node publishes transforms, or has done so."""
        if not self._have_been_published:
            # One publisher of the former is this node's.
            others = self._node.count_publishers(_TOPIC) > 1
            self._have_been_published = others or self._node.count_publishers(_STATIC_TOPIC) > 0
        return self._have_been_published

    def lookup(self, parent: str, child: str, stamp: int) -> RigidPose:
        """The pose of a frame in another one.

        Args:
            parent: Name of the frame in which the pose is given.
            child: Name of the other frame.
            stamp: Nanoseconds; 0 for the latest of a transform that does not change.

        Raises:
            NotYetError: The transforms end before the stamp.
            ValueError: There is no such transform at the stamp, or it is invalid.
        """
        if not child:
            raise ValueError(
                "the images have no frame_id, which transforms need; set camera.height"
            )
        names = parent.lstrip("/"), child.lstrip("/")
        try:
            found = self._buffer.lookup_transform(*names, Time(nanoseconds=stamp)).transform
        except self._tf2.ExtrapolationException as error:
            reason = f"no transform from {child} to {parent} at the image's stamp: {error}"
            may_come = self._buffer.get_latest_common_time(*names).nanoseconds < stamp
            raise (NotYetError if may_come else ValueError)(reason) from None
        except self._tf2.TransformException as error:
            raise NotYetError(
                f"no transform from {child} to {parent}: {error}; publish it, or set camera.height"
            ) from None
        try:
            return RigidPose.of_message(found.translation, found.rotation)
        except ValueError as error:
            raise ValueError(
                f"the transform from {child} to {parent} is invalid: {error}"
            ) from None

    def broadcast(self, header: Header, poses: dict[str, Pose]) -> None:
        """Broadcast the poses of frames.

        Args:
            header: With the parent's name and the stamp.
            poses: Name of each frame to its pose.
        """
        transforms = []
        for child, pose in poses.items():
            made: Any = TransformStamped(header=header, child_frame_id=child)
            made.transform.translation.x = pose.position.x
            made.transform.translation.y = pose.position.y
            made.transform.translation.z = pose.position.z
            made.transform.rotation = pose.orientation
            transforms.append(made)
        if transforms:
            self._broadcaster.sendTransform(transforms)

    def clear(self) -> None:
        """Forget all transforms, after a jump of the time."""
        self._buffer.clear()

    def close(self) -> None:
        """Unsubscribe."""
        self._listener.unregister()
