"""What a tracker of several targets says, as the page takes it, and how one of them is stopped."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import UInt32
from visualization_msgs.msg import Marker, MarkerArray

from pf_tracker_ros.node.console.answers import Json, box_around, status_of
from pf_tracker_ros.targets.detection_messages import outline_of

_BOXES = "boxes"
_MOST = 1000
_LONGEST_TEXT = 200
_LARGEST_ID = 2**32 - 1
_DIGITS = 10


def targets_of(statuses: Sequence[DiagnosticStatus]) -> list[Json]:
    """The targets by the statuses of each: id as a text, label, state and confidence, if known."""
    targets = []
    for status in statuses[:_MOST]:
        # As texts: a label may be a number, too.
        texts = {item.key: item.value[:_LONGEST_TEXT] for item in status.values[:_MOST]}
        confidence = status_of(status)["values"].get("confidence")
        if _is_id(texts.get("id", "")):
            targets.append(
                {
                    "id": texts["id"],
                    "label": texts.get("label", ""),
                    "state": texts.get("state", ""),
                    "confidence": confidence if isinstance(confidence, float) else None,
                }
            )
    return targets


def boxes_of(message: MarkerArray) -> dict[str, Json]:
    """Of each target that is seen, by its id, box [x, y, width, height] in pixels and color."""
    boxes = {}
    for marker in message.markers[: 2 * _MOST + 1]:
        if marker.ns != _BOXES or marker.action != Marker.ADD:
            continue
        box = box_around(marker.points)
        if box is not None:
            boxes[str(marker.id)] = {"box": box, "color": _color(marker.color)}
    return boxes


def detections_of(message: Any) -> list[Json]:
    """The boxes of a vision_msgs Detection2DArray, [x, y, width, height] in pixels, with labels."""
    detections = []
    for detection in message.detections[:_MOST]:
        box = outline_of(detection.bbox)
        if not all(math.isfinite(value) for value in box):
            continue
        scored = [one.hypothesis for one in detection.results]
        best = max(scored, key=lambda one: one.score, default=None)
        label = best.class_id[:_LONGEST_TEXT] if best else ""
        detections.append({"box": [round(value, 3) for value in box], "label": label})
    return detections


def stop_message(id: str) -> UInt32:
    """The message that stops a target.

    Raises:
        ValueError: That is no id of a target.
    """
    if not _is_id(id):
        raise ValueError(f"there is no target {id!r}")
    return UInt32(data=int(id))


def _is_id(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= _DIGITS and int(text) <= _LARGEST_ID


def _color(color: Any) -> str:
    parts = (color.r, color.g, color.b)
    return "#" + "".join(f"{round(255 * min(1.0, max(0.0, part))):02x}" for part in parts)
