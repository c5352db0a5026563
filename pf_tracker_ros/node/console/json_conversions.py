"""What the tracker says, as the page takes it: numbers and texts, never more than can be shown."""

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
_LONGEST_TEXT = 2000
_MOST_PARTICLES = 400
_MOST_VALUES = 200
_MOST_PLACES = 128 * 128
_HEAT_RANGE = 20.0
_BOXES = "boxes"
_MOST_TARGETS = 1000
_LONGEST_LABEL = 200
_LARGEST_ID = 2**32 - 1
_DIGITS = 10


def diagnostic_status_to_json(status: DiagnosticStatus) -> Json:
    """A status of the tracker: level, message, and its values, numbers as numbers."""
    return {
        "level": _LEVELS.get(status.level, "error"),
        "message": status.message[:_LONGEST_TEXT],
        "values": {
            item.key[:_LONGEST_TEXT]: _value(item.value) for item in status.values[:_MOST_VALUES]
        },
    }


def status_to_json(message: DiagnosticArray) -> Json:
    """The status of the node, with `targets` and the id of the `selected` one, empty without."""
    own, *others = message.status
    status = diagnostic_status_to_json(own)
    status["targets"] = _targets_of(others)
    # As a text: the node's may be larger than a number of JavaScript holds.
    selected = next((item.value for item in own.values if item.key == "selected"), "")
    is_there = any(target["id"] == selected for target in status["targets"])
    return status | {"selected": selected if is_there else ""}


def _targets_of(statuses: Sequence[DiagnosticStatus]) -> list[Json]:
    """The targets by the statuses of each: id as a text, label, state and confidence, if known."""
    targets = []
    for status in statuses[:_MOST_TARGETS]:
        # As texts: a label may be a number, too.
        texts = {item.key: item.value[:_LONGEST_LABEL] for item in status.values[:_MOST_VALUES]}
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
    """Of each target that is seen, by its id, box [x, y, width, height] in pixels and color."""
    boxes = {}
    for marker in message.markers[: 2 * _MOST_TARGETS + 1]:
        if marker.ns != _BOXES or marker.action != Marker.ADD:
            continue
        corners = np.array([(point.x, point.y) for point in marker.points], np.float64)
        if corners.size and np.isfinite(box := bounding_box(corners)).all():
            color = _color(marker.color)
            boxes[str(marker.id)] = {"box": [round(value, 3) for value in box], "color": color}
    return boxes


def detections_to_json(message: Any) -> list[Json]:
    """The boxes of a vision_msgs Detection2DArray, [x, y, width, height] in pixels, with labels."""
    detections = []
    for detection in message.detections[:_MOST_TARGETS]:
        box = upright_box(detection.bbox)
        if not all(math.isfinite(value) for value in box):
            continue
        scored = [one.hypothesis for one in detection.results]
        best = max(scored, key=lambda one: one.score, default=None)
        label = best.class_id[:_LONGEST_LABEL] if best else ""
        detections.append({"box": [round(value, 3) for value in box], "label": label})
    return detections


def id_message(id: str) -> UInt32:
    """The message that names a target, or with 0 none.

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


def particles_to_json(message: PointCloud2) -> list[list[float]]:
    """The heaviest particles, [x, y, weight as a share of the largest]; pixels, at most 400."""
    # There may be more fields at the end, such as the id of the target.
    fields, rest = divmod(message.point_step, 4)
    if rest or fields < len(PARTICLE_FIELDS) or message.is_bigendian:
        return []
    octets = np.frombuffer(message.data, np.uint8)
    count = len(octets) // message.point_step
    columns = octets[: count * message.point_step].view(np.float32).reshape(count, fields)
    columns = columns[:, : len(PARTICLE_FIELDS)]
    columns = columns[np.isfinite(columns).all(axis=1)]
    if not len(columns) or not columns[:, 5].max() > 0.0:
        return []
    chosen = np.argsort(-columns[:, 5], kind="stable")[:_MOST_PARTICLES]
    with np.errstate(over="ignore"):
        shares = np.clip(columns[chosen, 5] / columns[:, 5].max(), 0.0, 1.0)
    table = np.column_stack([columns[chosen, :2], shares]).astype(np.float64)
    return np.round(table, 2).tolist()


def likelihood_to_json(message: Image) -> Json | None:
    """A likelihood image as `columns` and `heat`, None where it is none.

    The heat is base64 of a byte a place, row by row: 255 at the likeliest, 0 where the logarithm is
    less by 20 or more.
    """
    count = message.height * message.width
    if message.encoding != "32FC1" or not 0 < count <= _MOST_PLACES:
        return None
    if message.is_bigendian or len(message.data) != 4 * count:
        return None
    values = np.frombuffer(message.data, "<f4").astype(np.float64)
    values = np.nan_to_num(values, nan=-np.inf, posinf=-np.inf)
    best = values.max()
    if not np.isfinite(best):
        return None
    levels = np.clip(255.0 * (1.0 + (values - best) / _HEAT_RANGE), 0.0, 255.0).astype(np.uint8)
    return {"columns": message.width, "values": base64.b64encode(levels.tobytes()).decode()}


def note(about: str | None, text: str, *, ok: bool = True) -> Json:
    """What came of a request, for the page to tell."""
    return {"type": "note", "about": about, "ok": ok, "text": text}


def pack_frame(header: Mapping[str, Any], picture: bytes) -> bytes:
    """One message of the socket: the length of the header, the header, the picture."""
    text = json.dumps(header, allow_nan=False).encode()
    return len(text).to_bytes(4, "big") + text + picture


def _value(text: str) -> str | float:
    try:
        number = float(text)
    except ValueError:
        return text[:_LONGEST_TEXT]
    return number if math.isfinite(number) else text[:_LONGEST_TEXT]
