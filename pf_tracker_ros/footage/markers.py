"""Boxes with texts as the markers that RViz draws, whoever serializes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from pf_tracker_ros.boxes import Box, box_corners

LINE_WIDTH, TEXT_HEIGHT = 2.0, 16.0
"""Pixels."""
# visualization_msgs/Marker has them so.
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


def outline_markers(
    types: Mapping[str, Any], header: Any, outlines: Sequence[Outline]
) -> list[Any]:
    """Markers that replace all before them: a line (`boxes`) and a text (`labels`) for each box.

    Args:
        types: Name of a message type to its class, whose constructor takes every field.
        header: Of each of them.
        outlines: What to draw.
    """
    point = types["geometry_msgs/msg/Point"]
    markers = [_marker(types, header, action=_DELETE_ALL)]
    for outline in outlines:
        corners = [point(x=x, y=y, z=0.0) for x, y in box_corners(outline.box)]
        left, top = corners[0].x, corners[0].y
        shared: dict[str, Any] = {"id": outline.id, "color": outline.color}
        points = [*corners, corners[0]]
        markers += [
            _marker(
                types, header, ns="boxes", type=_LINE_STRIP, across=LINE_WIDTH, points=points,
                **shared,
            ),
            _marker(
                types, header, ns="labels", type=_TEXT, up=TEXT_HEIGHT, text=outline.text,
                place=(left, top - TEXT_HEIGHT / 2), **shared,
            ),
        ]  # fmt: skip
    return markers


def _marker(
    types: Mapping[str, Any],
    header: Any,
    *,
    color: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    place: tuple[float, float] = (0.0, 0.0),
    across: float = 0.0,
    up: float = 0.0,
    **fields: Any,
) -> Any:
    """A marker with what is left out as ROS has it in a new message."""
    vector, point = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Point"]
    quaternion = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    nothing = np.zeros(0, np.uint8)
    stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    empty_header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    usual = {
        "ns": "",
        "id": 0,
        "type": 0,
        "action": _ADD,
        "points": [],
        "text": "",
    }
    red, green, blue, opacity = color
    return types["visualization_msgs/msg/Marker"](
        header=header,
        **{**usual, **fields},
        pose=types["geometry_msgs/msg/Pose"](
            position=point(x=place[0], y=place[1], z=0.0), orientation=quaternion
        ),
        scale=vector(x=across, y=0.0, z=up),
        color=types["std_msgs/msg/ColorRGBA"](r=red, g=green, b=blue, a=opacity),
        lifetime=types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0),
        frame_locked=False,
        colors=[],
        texture_resource="",
        texture=types["sensor_msgs/msg/CompressedImage"](
            header=empty_header, format="", data=nothing
        ),
        uv_coordinates=[],
        mesh_resource="",
        mesh_file=types["visualization_msgs/msg/MeshFile"](filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )
