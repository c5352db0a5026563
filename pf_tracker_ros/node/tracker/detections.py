"""Estimates as vision_msgs detections, on machines that have vision_msgs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from std_msgs.msg import Header

from pf_tracker_ros.tracking.estimate import Estimate

if TYPE_CHECKING:
    from pf_tracker_ros.targets.tracked_target import TrackedTarget

# Not a dependency: a robot without it loses this topic alone.
try:
    from vision_msgs import msg as vision
except ImportError:
    vision = None

DETECTIONS_TYPE: Any = vision.Detection2DArray if vision else None

_TARGET = "target"


def detections_message(estimate: Estimate | None, header: Header, messages: Any = vision) -> Any:
    """The target as the only detection, or no detection.

    Args:
        estimate: What is known of the target, None without one.
        header: Of the image.
        messages: The module with the message types.

    Returns:
        A Detection2DArray in pixels. The score is the confidence; the covariance of the center
        stands in the first two rows and columns of the pose's.
    """
    array = messages.Detection2DArray(header=header)
    if estimate is not None:
        array.detections.append(_detection(estimate, header, _TARGET, _TARGET, messages))
    return array


def several_detections_message(
    targets: Sequence[TrackedTarget], header: Header, messages: Any = vision
) -> Any:
    """Several targets as detections, each with its id.

    Args:
        targets: What is known of them.
        header: Of the image.
        messages: The module with the message types.

    Returns:
        A Detection2DArray as by `detections_message`; the class is the label, or "target".
    """
    array = messages.Detection2DArray(header=header)
    array.detections = [
        _detection(target.estimate, header, str(target.id), target.label or _TARGET, messages)
        for target in targets
    ]
    return array


def _detection(estimate: Estimate, header: Header, id: str, label: str, messages: Any) -> Any:
    x, y, width, height = estimate.box
    detection = messages.Detection2D(header=header, id=id)
    detection.bbox.center.position.x = x + width / 2
    detection.bbox.center.position.y = y + height / 2
    detection.bbox.size_x = width
    detection.bbox.size_y = height
    result = messages.ObjectHypothesisWithPose()
    result.hypothesis.class_id = label
    result.hypothesis.score = float(estimate.confidence)
    result.pose.pose.position.x = detection.bbox.center.position.x
    result.pose.pose.position.y = detection.bbox.center.position.y
    covariance = [0.0] * 36
    for row in range(2):
        for column in range(2):
            covariance[6 * row + column] = float(estimate.covariance[row, column])
    result.pose.covariance = covariance
    detection.results.append(result)
    return detection
