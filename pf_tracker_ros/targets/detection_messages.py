"""What a vision_msgs Detection2DArray says, whoever deserialized it."""

from __future__ import annotations

import math
from typing import Any

from pf_tracker_ros.targets.detections import Detections

# Bytes of a message: a thousand detections, each of which becomes objects of Python.
_LARGEST = 500_000


def check_length(octets: bytes) -> None:
    """Refuse a serialized message that would take too long to read.

    Raises:
        ValueError: It is longer than about a thousand detections.
    """
    if len(octets) > _LARGEST:
        raise ValueError(
            f"the message has {len(octets)} bytes; allowed: up to {_LARGEST}, about a "
            "thousand detections; let the detector leave out those with low scores"
        )


def detections_of(message: Any) -> Detections:
    """The detections of a vision_msgs Detection2DArray.

    The label and the score are those of the hypothesis with the best score; without one there is no
    label, and the score is 1. A box that is turned counts as its upright outline.
    """
    boxes, scores, labels = [], [], []
    for detection in message.detections:
        boxes.append(_upright(detection.bbox))
        best = max(
            (one.hypothesis for one in detection.results), key=lambda one: one.score, default=None
        )
        scores.append(1.0 if best is None else best.score)
        labels.append("" if best is None else best.class_id)
    return Detections(boxes, scores, labels)


def _upright(box: Any) -> tuple[float, float, float, float]:
    """(x, y, width, height) of the outline of a BoundingBox2D, pixels."""
    width, height, angle = box.size_x, box.size_y, box.center.theta
    if angle and math.isfinite(angle):
        across, down = abs(math.cos(angle)), abs(math.sin(angle))
        width, height = width * across + height * down, width * down + height * across
    center = box.center.position
    return center.x - width / 2, center.y - height / 2, width, height
