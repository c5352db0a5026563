"""Statuses as messages that are written anew in place, and a target's polygon as a box."""

from __future__ import annotations

import math
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PolygonStamped
from std_msgs.msg import Header

from pf_tracker_ros.boxes import Box, bounding_box
from pf_tracker_ros.plurals import counted


def box_of_polygon(message: PolygonStamped) -> Box:
    """The bounding rectangle (x, y, width, height) of a polygon in pixels.

    Raises:
        ValueError: A point is not finite, or the points span no area.
    """
    points = [(point.x, point.y) for point in message.polygon.points]
    count = len(points)
    if count < 2:
        raise ValueError(
            f"its polygon has {counted(count, 'point')}; allowed: at least two, "
            "such as opposite corners of the box in pixels"
        )
    if not all(math.isfinite(value) for point in points for value in point):
        raise ValueError("a point of its polygon is not finite")
    box = bounding_box(points)
    if not all(box[2:]):
        raise ValueError(
            f"its {count} points span {box[2]:g} x {box[3]:g} px; "
            "allowed: points that differ in both x and y"
        )
    return box


def status_message(
    header: Header, name: str, level: bytes, message: str, values: Mapping[str, str | float | int]
) -> DiagnosticArray:
    """One status; numbers are written so that they read back to the same value.

    Args:
        header: Of the frame that it is about.
        name: Fully qualified name of the node.
        level: `DiagnosticStatus.OK`, `WARN` or `ERROR`.
        message: One sentence for people.
        values: What there is to know, key to value.
    """
    status = DiagnosticStatus()
    fill_status(status, name, level, message, values)
    return DiagnosticArray(header=header, status=[status])


def fill_status(
    status: DiagnosticStatus,
    name: str,
    level: bytes,
    message: str,
    values: Mapping[str, str | float | int],
) -> None:
    """Write into a status that was written before, or is new: to make its pairs takes long.

    The other arguments are those of `status_message`.
    """
    status.name, status.level, status.message = name, level, message
    if [pair.key for pair in status.values] != list(values):
        status.values = [KeyValue(key=key) for key in values]
    for pair, value in zip(status.values, values.values(), strict=True):
        pair.value = str(value)
