"""Targets as vision_msgs detections, on machines that have vision_msgs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from std_msgs.msg import Header

from pf_tracker_ros.targets.tracked_target import TrackedTarget

# Not a dependency: a robot without it loses this topic alone.
try:
    from vision_msgs import msg as vision
except ImportError:
    vision = None

DETECTIONS_TYPE: Any = vision.Detection2DArray if vision else None

# The class of a target that nobody has called anything.
_UNLABELED = "target"


def detections_message(
    targets: Sequence[TrackedTarget], header: Header, messages: Any = vision
) -> Any:
    """The targets as detections, each with its id.

    Args:
        targets: What is known of them.
        header: Of the image.
        messages: The module with the message types.

    Returns:
        A Detection2DArray in pixels; the class is the label, or "target". The score is the
        confidence; the covariance of the center stands in the first two rows and columns of the
        pose's.
    """
    array = messages.Detection2DArray(header=header)
    array.detections = [_detection(target, header, messages) for target in targets]
    return array


def _detection(target: TrackedTarget, header: Header, messages: Any) -> Any:
    estimate = target.estimate
    x, y, width, height = estimate.box
    detection = messages.Detection2D(header=header, id=str(target.id))
    detection.bbox.center.position.x = x + width / 2
    detection.bbox.center.position.y = y + height / 2
    detection.bbox.size_x = width
    detection.bbox.size_y = height
    result = messages.ObjectHypothesisWithPose()
    result.hypothesis.class_id = target.label or _UNLABELED
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
