"""What a vision_msgs Detection2DArray says, whoever deserialized it."""

from __future__ import annotations

from typing import Any

from pf_tracker_ros.boxes import Box, box_around_turned
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
        boxes.append(outline_of(detection.bbox))
        best = max(
            (one.hypothesis for one in detection.results), key=lambda one: one.score, default=None
        )
        scores.append(1.0 if best is None else best.score)
        labels.append("" if best is None else best.class_id)
    return Detections(boxes, scores, labels)


def outline_of(box: Any) -> Box:
    """The box around a vision_msgs BoundingBox2D, which may be turned."""
    center = box.center
    return box_around_turned(
        (center.position.x, center.position.y), (box.size_x, box.size_y), center.theta
    )
