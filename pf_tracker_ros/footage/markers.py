"""Boxes with texts as the markers that RViz draws, whoever serializes them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from pf_tracker_ros.boxes import Box, box_corners

LINE_WIDTH, TEXT_HEIGHT = 2.0, 16.0
"""Pixels."""
# visualization_msgs/Marker has them so.
_MARKER, _POINT = "visualization_msgs/msg/Marker", "geometry_msgs/msg/Point"
_LINE_STRIP, _TEXT, _ADD, _DELETE_ALL = 4, 9, 0, 3


class Outline(NamedTuple):
    """A box with a text.

    Attributes:
        id: Its own.
        box: (x, y, width, height) in pixels.
        text: At its upper left corner.
        color: Red, green, blue and opacity, 0 to 1.
    """

    id: int
    box: Box
    text: str
    color: tuple[float, float, float, float]


def outline_markers(new: Callable[..., Any], header: Any, outlines: Sequence[Outline]) -> list[Any]:
    """Markers that replace all before them: a line (`boxes`) and a text (`labels`) for each box.

    Args:
        new: Makes a message out of the name of its type and of fields; the others are 0 or empty.
        header: Of each of them.
        outlines: What to draw.
    """

    def pose(x: float, y: float) -> Any:
        upright = new("geometry_msgs/msg/Quaternion", w=1.0)
        return new("geometry_msgs/msg/Pose", position=new(_POINT, x=x, y=y), orientation=upright)

    markers = [new(_MARKER, header=header, action=_DELETE_ALL, pose=pose(0.0, 0.0))]
    for outline in outlines:
        corners = [new(_POINT, x=x, y=y) for x, y in box_corners(outline.box)]
        color = new("std_msgs/msg/ColorRGBA", **dict(zip("rgba", outline.color, strict=True)))
        shared = {"header": header, "id": outline.id, "action": _ADD, "color": color}
        line = {
            "ns": "boxes",
            "type": _LINE_STRIP,
            "pose": pose(0.0, 0.0),
            "scale": new("geometry_msgs/msg/Vector3", x=LINE_WIDTH),
            "points": [*corners, corners[0]],
        }
        text = {
            "ns": "labels",
            "type": _TEXT,
            "pose": pose(corners[0].x, corners[0].y - TEXT_HEIGHT / 2),
            "scale": new("geometry_msgs/msg/Vector3", z=TEXT_HEIGHT),
            "text": outline.text,
        }
        markers += [new(_MARKER, **shared, **line), new(_MARKER, **shared, **text)]
    return markers
