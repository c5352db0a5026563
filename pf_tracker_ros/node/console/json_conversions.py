"""Conversion of the tracker's messages to JSON for the page, with limits on sizes and lengths."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import UInt32
from visualization_msgs.msg import Marker, MarkerArray

from pf_tracker_ros.boxes import bounding_box
from pf_tracker_ros.messages import PARTICLE_FIELDS
from pf_tracker_ros.targets.detections import upright_box

Json = dict[str, Any]

_LEVELS = {
    DiagnosticStatus.OK: "ok",
    DiagnosticStatus.WARN: "warn",
    DiagnosticStatus.ERROR: "error",
    DiagnosticStatus.STALE: "error",
}
_MAX_TEXT = 2000
_MAX_PARTICLES = 400
_MAX_VALUES = 200
_MAX_CELLS = 128 * 128
_HEATMAP_RANGE = 20.0
_BOX_NAMESPACE = "boxes"
_MAX_TARGETS = 1000
_MAX_LABEL = 200
_MAX_ID = 2**32 - 1
_DIGITS = 10


def diagnostic_status_to_json(status: DiagnosticStatus) -> Json:
    """A DiagnosticStatus as level, message and values; numeric values become numbers."""
    return {
        "level": _LEVELS.get(status.level, "error"),
        "message": status.message[:_MAX_TEXT],
        "values": {
            item.key[:_MAX_TEXT]: _value(item.value) for item in status.values[:_MAX_VALUES]
        },
    }


def status_to_json(message: DiagnosticArray) -> Json:
    """The node's status of a frame, with `targets` and the id of the `selected` one, if any."""
    own, *others = message.status
    status = diagnostic_status_to_json(own)
    status["targets"] = _targets_of(others)
    # Ids are texts, as JavaScript's numbers are too short for them.
    selected = next((item.value for item in own.values if item.key == "selected"), "")
    is_there = any(target["id"] == selected for target in status["targets"])
    return status | {"selected": selected if is_there else ""}


def _targets_of(statuses: Sequence[DiagnosticStatus]) -> list[Json]:
    """Id, label, state and confidence (None if unknown) of each target."""
    targets = []
    for status in statuses[:_MAX_TARGETS]:
        # Texts, as a label may look like a number.
        texts = {item.key: item.value[:_MAX_LABEL] for item in status.values[:_MAX_VALUES]}
        confidence = diagnostic_status_to_json(status)["values"].get("confidence")
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


def boxes_to_json(message: MarkerArray) -> dict[str, Json]:
    """Box [x, y, width, height], pixels, and color of each visible target by its id."""
    boxes = {}
    for marker in message.markers[: 2 * _MAX_TARGETS + 1]:
        if marker.ns != _BOX_NAMESPACE or marker.action != Marker.ADD:
            continue
        corners = np.array([(point.x, point.y) for point in marker.points], np.float64)
        if corners.size and np.isfinite(box := bounding_box(corners)).all():
            color = _color(marker.color)
            boxes[str(marker.id)] = {"box": [round(value, 3) for value in box], "color": color}
    return boxes


def detections_to_json(message: Any) -> list[Json]:
    """Boxes [x, y, width, height], pixels, and labels of a vision_msgs Detection2DArray."""
    detections = []
    for detection in message.detections[:_MAX_TARGETS]:
        box = upright_box(detection.bbox)
        if not all(math.isfinite(value) for value in box):
            continue
        scored = [one.hypothesis for one in detection.results]
        best = max(scored, key=lambda one: one.score, default=None)
        label = best.class_id[:_MAX_LABEL] if best else ""
        detections.append({"box": [round(value, 3) for value in box], "label": label})
    return detections


def id_message(id: str) -> UInt32:
    """The message with the id of a target; 0 means none.

    Raises:
        ValueError: The text is no id.
    """
    if not _is_id(id):
        raise ValueError(f"there is no target {id!r}")
    return UInt32(data=int(id))


def _is_id(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= _DIGITS and int(text) <= _MAX_ID


def _color(color: Any) -> str:
    parts = (color.r, color.g, color.b)
    return "#" + "".join(f"{round(255 * min(1.0, max(0.0, part))):02x}" for part in parts)


def particles_to_json(message: PointCloud2) -> list[list[float]]:
    """The heaviest particles, at most 400, as [x, y, weight]: pixels; relative to the largest."""
    # Further fields may follow, such as the id of the target.
    fields, rest = divmod(message.point_step, 4)
    if rest or fields < len(PARTICLE_FIELDS) or message.is_bigendian:
        return []
    data = np.frombuffer(message.data, np.uint8)
    count = len(data) // message.point_step
    columns = data[: count * message.point_step].view(np.float32).reshape(count, fields)
    columns = columns[:, : len(PARTICLE_FIELDS)]
    columns = columns[np.isfinite(columns).all(axis=1)]
    if not len(columns) or not columns[:, 5].max() > 0.0:
        return []
    chosen = np.argsort(-columns[:, 5], kind="stable")[:_MAX_PARTICLES]
    with np.errstate(over="ignore"):
        shares = np.clip(columns[chosen, 5] / columns[:, 5].max(), 0.0, 1.0)
    table = np.column_stack([columns[chosen, :2], shares]).astype(np.float64)
    return np.round(table, 2).tolist()


def likelihood_to_json(message: Image) -> Json | None:
    """A log-likelihood image as `columns` and `values`; None if it is invalid.

    The values are base64 of a byte per cell, row by row: 255 at the maximum, 0 where the logarithm
    is lower by 20 or more.
    """
    count = message.height * message.width
    if message.encoding != "32FC1" or not 0 < count <= _MAX_CELLS:
        return None
    if message.is_bigendian or len(message.data) != 4 * count:
        return None
    values = np.frombuffer(message.data, "<f4").astype(np.float64)
    values = np.nan_to_num(values, nan=-np.inf, posinf=-np.inf)
    best = values.max()
    if not np.isfinite(best):
        return None
    levels = np.clip(255.0 * (1.0 + (values - best) / _HEATMAP_RANGE), 0.0, 255.0).astype(np.uint8)
    return {"columns": message.width, "values": base64.b64encode(levels.tobytes()).decode()}


def note(about: str | None, text: str, *, ok: bool = True) -> Json:
    """A message about the outcome of a request, for the user."""
    return {"type": "note", "about": about, "ok": ok, "text": text}


def pack_frame(header: Mapping[str, Any], jpeg: bytes) -> bytes:
    """A frame for the web socket: length of the header (4 bytes), header, JPEG."""
    text = json.dumps(header, allow_nan=False).encode()
    return len(text).to_bytes(4, "big") + text + jpeg


def _value(text: str) -> str | float:
    try:
        number = float(text)
    except ValueError:
        return text[:_MAX_TEXT]
    return number if math.isfinite(number) else text[:_MAX_TEXT]
