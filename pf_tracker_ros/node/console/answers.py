"""What the tracker says, as the page takes it: numbers and texts, never more than can be shown."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PolygonStamped
from sensor_msgs.msg import Image, PointCloud2

from pf_tracker_ros.boxes import bounding_box
from pf_tracker_ros.messages import PARTICLE_FIELDS

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


def status_of(status: DiagnosticStatus) -> Json:
    """A status of the tracker: level, message, and its values, numbers as numbers."""
    return {
        "level": _LEVELS.get(status.level, "error"),
        "message": status.message[:_LONGEST_TEXT],
        "values": {
            item.key[:_LONGEST_TEXT]: _value(item.value) for item in status.values[:_MOST_VALUES]
        },
    }


def box_of(message: PolygonStamped) -> list[float] | None:
    """The box [x, y, width, height] of a polygon, pixels; None where it has no finite corners."""
    return box_around(message.polygon.points)


def box_around(points: Sequence[Any]) -> list[float] | None:
    """The box [x, y, width, height] around points, pixels; None where it is not finite."""
    corners = np.array([(point.x, point.y) for point in points], np.float64)
    if not corners.size or not np.isfinite(corners).all():
        return None
    box = [round(value, 3) for value in bounding_box(corners)]
    return box if np.isfinite(box).all() else None


def particles_of(message: PointCloud2) -> list[list[float]]:
    """The heaviest particles, [x, y, weight as a share of the largest]; pixels, at most 400."""
    # Those of several targets have one field more, at the end.
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


def heat_of(message: Image) -> Json | None:
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
    heat = np.clip(255.0 * (1.0 + (values - best) / _HEAT_RANGE), 0.0, 255.0).astype(np.uint8)
    return {"columns": message.width, "heat": base64.b64encode(heat.tobytes()).decode()}


def note(about: str | None, text: str, *, ok: bool = True) -> Json:
    """What came of a request, for the page to tell."""
    return {"type": "note", "about": about, "ok": ok, "text": text}


def packed(header: Mapping[str, Any], picture: bytes) -> bytes:
    """One message of the socket: the length of the header, the header, the picture."""
    text = json.dumps(header, allow_nan=False).encode()
    return len(text).to_bytes(4, "big") + text + picture


def _value(text: str) -> str | float:
    try:
        number = float(text)
    except ValueError:
        return text[:_LONGEST_TEXT]
    return number if math.isfinite(number) else text[:_LONGEST_TEXT]
