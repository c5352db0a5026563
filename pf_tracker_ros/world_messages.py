"""ROS messages of targets in meters, for the node `localizer` and for bag writers.

`pf_tracker_ros.messages` describes the argument `new`. Positions are in a fixed frame with z up and
the ground at z = 0. Angles of a pose that nobody measures have the variance of a uniform
distribution: a covariance of 0 would be certainty.

Sources: ROS REP 103 and 105.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.messages import (
    DETECTIONS_3D_TYPE,
    MARKERS_TYPE,
    MessageFactory,
    hypothesis_message,
)
from pf_tracker_ros.overlay import target_color
from pf_tracker_ros.world import FilteredPosition

POSE_TYPE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE_TYPE = "geometry_msgs/msg/PoseWithCovarianceStamped"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
BEARING_TYPE = "geometry_msgs/msg/Vector3Stamped"

TARGET_FRAME = "target"
"""Frame of the selected target; that of any target is `target_<id>`."""

UNKNOWN_ANGLE = math.pi**2 / 3
"""Variance of an angle about which nothing is known, rad^2: uniform over a whole turn."""

# Largest normalized squared distance in the 90 % region of two dimensions.
_REGION_90 = -2.0 * math.log(0.1)
# Variance of the ground's height and of a vertical velocity, m^2 and m^2/s^2.
_VERTICAL_VARIANCE = 0.05**2
# Marker sizes, meters.
_FLAT, _LINE, _TEXT = 0.02, 0.06, 0.25
_MARKER = "visualization_msgs/msg/Marker"
_POINT, _VECTOR = "geometry_msgs/msg/Point", "geometry_msgs/msg/Vector3"
# Constants of visualization_msgs/Marker.
_ARROW, _CYLINDER, _TEXT_FACING, _ADD, _DELETE_ALL = 0, 3, 9, 0, 3


@dataclass(frozen=True, eq=False)
class WorldTarget:
    """A target on the ground.

    Attributes:
        id: From 1, never reused.
        label: Possibly empty.
        state: `tracking`, `occluded` or `lost`.
        confidence: 0 to 1.
        filtered: Position and velocity in the fixed frame.
        yaw: Heading about z from the x axis, radians.
        yaw_variance: rad^2.
        size: Width and height, meters.
    """

    id: int
    label: str
    state: str
    confidence: float
    filtered: FilteredPosition
    yaw: float
    yaw_variance: float
    size: tuple[float, float]


def pose_message(new: MessageFactory, header: Any, target: WorldTarget) -> Any:
    """A target as geometry_msgs/PoseStamped on the ground, x forward along its heading."""
    return new(POSE_TYPE, header=header, pose=_pose(new, target))


def pose_with_covariance_message(new: MessageFactory, header: Any, target: WorldTarget) -> Any:
    """A target as geometry_msgs/PoseWithCovarianceStamped."""
    return new(POSE_WITH_COVARIANCE_TYPE, header=header, pose=_pose_with_covariance(new, target))


def odometry_message(new: MessageFactory, header: Any, target: WorldTarget) -> Any:
    """A target as nav_msgs/Odometry; as there, the velocity is in the frame of the target."""
    rotation = _rotation(-target.yaw)
    x, y = rotation @ target.filtered.velocity
    covariance = np.diag([0.0, 0.0, _VERTICAL_VARIANCE, *[UNKNOWN_ANGLE] * 3])
    covariance[:2, :2] = rotation @ target.filtered.covariance[2:, 2:] @ rotation.T
    twist = new("geometry_msgs/msg/Twist", linear=new(_VECTOR, x=float(x), y=float(y)))
    return new(
        ODOMETRY_TYPE,
        header=header,
        child_frame_id=TARGET_FRAME,
        pose=_pose_with_covariance(new, target),
        twist=new(
            "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=covariance.ravel()
        ),
    )


def bearing_message(new: MessageFactory, header: Any, bearing: NDArray[np.float64]) -> Any:
    """A unit vector in the camera's optical frame as geometry_msgs/Vector3Stamped."""
    x, y, z = (float(value) for value in bearing)
    return new(BEARING_TYPE, header=header, vector=new(_VECTOR, x=x, y=y, z=z))


def detections_3d_message(new: MessageFactory, header: Any, targets: Sequence[WorldTarget]) -> Any:
    """Targets as vision_msgs/Detection3DArray; the boxes stand on the ground."""
    detections = []
    for target in targets:
        width, height = target.size
        pose = _pose(new, target, height / 2)
        label, covariance = target.label or TARGET_FRAME, _pose_covariance(target)
        result = hypothesis_message(new, label, target.confidence, pose, covariance)
        box = new(
            "vision_msgs/msg/BoundingBox3D",
            center=pose,
            size=new(_VECTOR, x=width, y=width, z=height),
        )
        fields = {"header": header, "results": [result], "bbox": box, "id": str(target.id)}
        detections.append(new("vision_msgs/msg/Detection3D", **fields))
    return new(DETECTIONS_3D_TYPE, header=header, detections=detections)


def world_markers_message(
    new: MessageFactory, header: Any, targets: Sequence[WorldTarget], selected: int
) -> Any:
    """Targets as visualization_msgs/MarkerArray, which replaces all earlier markers.

    The first marker deletes them. Each target has its 90 % region on the ground (namespace
    `regions`), an arrow to where it is in a second (`velocities`) and a text (`labels`), with its
    id.

    Args:
        new: See the module.
        header: Header of each marker.
        targets: The targets.
        selected: Id of the selected one, 0 without.
    """
    upright = new("geometry_msgs/msg/Quaternion", w=1.0)
    still = new("geometry_msgs/msg/Pose", orientation=upright)
    markers = [new(_MARKER, header=header, action=_DELETE_ALL, pose=still)]
    for target in targets:
        x, y = (float(value) for value in target.filtered.position)
        velocity_x, velocity_y = (float(value) for value in target.filtered.velocity)
        first, second, angle = region_90(target.filtered.covariance[:2, :2])
        color = _color(new, target, 0.8 if target.id == selected else 0.4)
        shared = {"header": header, "id": target.id, "action": _ADD, "color": color}
        region = {
            "ns": "regions",
            "type": _CYLINDER,
            "pose": _flat_pose(new, x, y, 0.0, angle),
            "scale": new(_VECTOR, x=2 * first, y=2 * second, z=_FLAT),
        }
        velocity = {
            "ns": "velocities",
            "type": _ARROW,
            "pose": still,
            "points": [
                new(_POINT, x=x, y=y, z=_LINE),
                new(_POINT, x=x + velocity_x, y=y + velocity_y, z=_LINE),
            ],
            "scale": new(_VECTOR, x=_LINE, y=2 * _LINE, z=2 * _LINE),
        }
        text = {
            "ns": "labels",
            "type": _TEXT_FACING,
            "pose": _flat_pose(new, x, y, target.size[1] + _TEXT, 0.0),
            "scale": new(_VECTOR, z=_TEXT),
            "text": f"{target.id} {target.label}".rstrip(),
        }
        markers += [new(_MARKER, **shared, **one) for one in (region, velocity, text)]
    return new(MARKERS_TYPE, markers=markers)


def region_90(covariance: NDArray[np.float64]) -> tuple[float, float, float]:
    """Half axes in meters, the longer first, and its angle in radians, of a 90 % region.

    Args:
        covariance: (2, 2), m^2.
    """
    variances, axes = np.linalg.eigh(covariance)
    second, first = np.sqrt(_REGION_90 * np.maximum(variances, 0.0))
    return float(first), float(second), math.atan2(axes[1, 1], axes[0, 1])


def _pose_with_covariance(new: MessageFactory, target: WorldTarget) -> Any:
    return new(
        "geometry_msgs/msg/PoseWithCovariance",
        pose=_pose(new, target),
        covariance=_pose_covariance(target).ravel(),
    )


def _pose(new: MessageFactory, target: WorldTarget, z: float = 0.0) -> Any:
    x, y = (float(value) for value in target.filtered.position)
    return _flat_pose(new, x, y, z, target.yaw)


def _flat_pose(new: MessageFactory, x: float, y: float, z: float, yaw: float) -> Any:
    turned = new("geometry_msgs/msg/Quaternion", z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    return new("geometry_msgs/msg/Pose", position=new(_POINT, x=x, y=y, z=z), orientation=turned)


def _pose_covariance(target: WorldTarget) -> NDArray[np.float64]:
    """(6, 6) covariance of x, y, z and the angles about them."""
    covariance = np.diag(
        [0.0, 0.0, _VERTICAL_VARIANCE, UNKNOWN_ANGLE, UNKNOWN_ANGLE, target.yaw_variance]
    )
    covariance[:2, :2] = target.filtered.covariance[:2, :2]
    return covariance


def _color(new: MessageFactory, target: WorldTarget, opacity: float) -> Any:
    blue, green, red = (value / 255.0 for value in target_color(target.id))
    return new("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=opacity)


def _rotation(angle: float) -> NDArray[np.float64]:
    sine, cosine = math.sin(angle), math.cos(angle)
    return np.array([[cosine, -sine], [sine, cosine]])
