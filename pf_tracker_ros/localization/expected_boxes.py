"""Boxes in the image of targets that are known in meters: where the tracker should look."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.localization.camera_pose import CameraPose
from pf_tracker_ros.tracking.hints import Standing
from pf_tracker_ros.world import CameraModel, FilteredPosition

# Distances, meters, between which heights of boxes are on a line over their lower edges.
_NEAR, _FAR = 3.0, 9.0
# Least distance of a target along the optical axis, meters.
_LEAST_DEPTH = 0.3


def expected_box(
    camera: CameraModel,
    camera_pose: CameraPose,
    filtered: FilteredPosition,
    height: float,
    aspect: float,
) -> tuple[Box, float] | None:
    """The box of a target that stands at a predicted position.

    Args:
        camera: Its calibration.
        camera_pose: Where it is.
        filtered: The prediction, in the fixed frame.
        height: Of the target, meters.
        aspect: Width of its boxes over their height.

    Returns:
        The box in pixels and the standard deviation of its center across the image, pixels; None
        where the target is not before the camera.
    """
    inverse = camera_pose.pose.inverse()
    ends = np.array([[*filtered.position, level] for level in (0.0, height)])
    foot, head = ends @ inverse.rotation.T + inverse.translation
    if min(foot[2], head[2]) < _LEAST_DEPTH:
        return None
    box = _box_between(camera, foot, head, aspect)
    if box is None:
        return None
    along = camera_pose.pose.rotation[:2, 0]
    variance = float(along @ filtered.covariance[:2, :2] @ along)
    return box, math.sqrt(max(variance, 0.0)) * camera.fx / float(foot[2])


def standing(camera: CameraModel, camera_pose: CameraPose, height: float) -> Standing | None:
    """Heights of boxes of standing targets; None where the height of the camera is unknown.

    Args:
        camera: Its calibration.
        camera_pose: Where it is.
        height: Of targets, meters.
    """
    plane = camera_pose.plane
    if plane.height is None:
        return None
    forward = np.array([0.0, 0.0, 1.0]) - plane.down[2] * plane.down
    length = float(np.linalg.norm(forward))
    if length < _LEAST_DEPTH:
        return None
    boxes = []
    for distance in (_NEAR, _FAR):
        foot = distance / length * forward + plane.height * plane.down
        boxes.append(_box_between(camera, foot, foot - height * plane.down, 0.4))
    near, far = boxes
    if near is None or far is None:
        return None
    near_edge, far_edge = near[1] + near[3], far[1] + far[3]
    if near_edge - far_edge < 1.0:
        return None
    slope = (near[3] - far[3]) / (near_edge - far_edge)
    return Standing(near_edge - near[3] / slope, slope) if slope > 0.0 else None


def _box_between(
    camera: CameraModel, foot: NDArray[np.float64], head: NDArray[np.float64], aspect: float
) -> Box | None:
    """The box of an upright target, from its ends in camera coordinates; None without."""
    (x_foot, lower), (x_head, upper) = camera.project([foot, head]).tolist()
    height = lower - upper
    # A comparison with NaN is false.
    if not height >= 1.0:
        return None
    width = aspect * height
    return (x_foot + x_head - width) / 2.0, upper, width, height
