"""ROS messages of images, boxes, particles and statuses, for the node and for bag writers.

The argument `new` creates a message from the name of its type and from fields, the others being 0
or empty: `new("geometry_msgs/msg/Point", x=1.0)`. The node's creates messages of rclpy, a bag
writer's those of its own library.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, bounding_box, box_corners
from pf_tracker_ros.plurals import counted

MessageFactory = Callable[..., Any]
"""Creates a message from a type name and fields."""

IMAGE_TYPE = "sensor_msgs/msg/Image"
POLYGON_TYPE = "geometry_msgs/msg/PolygonStamped"
POINTS_TYPE = "sensor_msgs/msg/PointCloud2"
MARKERS_TYPE = "visualization_msgs/msg/MarkerArray"
DETECTIONS_TYPE = "vision_msgs/msg/Detection2DArray"
DETECTIONS_3D_TYPE = "vision_msgs/msg/Detection3DArray"
STATUS_TYPE = "diagnostic_msgs/msg/DiagnosticArray"

OK, WARN, ERROR = 0, 1, 2
"""Levels of diagnostic_msgs/DiagnosticStatus."""

PARTICLE_FIELDS = ("x", "y", "z", "width", "height", "weight")
# Bytes of a sample to encoding.
_GRAY = {1: "mono8", 2: "mono16", 4: "32FC1"}
_STATUS = "diagnostic_msgs/msg/DiagnosticStatus"
# Height of the text of markers, pixels.
_TEXT_HEIGHT = 16.0
_MARKER, _POINT = "visualization_msgs/msg/Marker", "geometry_msgs/msg/Point"
# Constants of visualization_msgs/Marker and sensor_msgs/PointField.
_LINE_STRIP, _TEXT, _ADD, _DELETE_ALL = 4, 9, 0, 3
_FIELD, _FLOAT32 = "sensor_msgs/msg/PointField", 7


class BoxMarker(NamedTuple):
    """A box with a text.

    Attributes:
        id: Id of the target.
        box: (x, y, width, height) in pixels.
        text: Text at its upper left corner.
        color: Red, green, blue and opacity, 0 to 1.
        width: Line width, pixels.
    """

    id: int
    box: Box
    text: str
    color: tuple[float, float, float, float]
    width: float


class Status(NamedTuple):
    """A diagnostic_msgs/DiagnosticStatus.

    Attributes:
        name: Name of the node or of its part.
        level: `OK`, `WARN` or `ERROR`.
        text: The message, one sentence.
        values: Values by key.
    """

    name: str
    level: int
    text: str
    values: Mapping[str, str | float | int]


def image_message(new: MessageFactory, header: Any, image: NDArray[Any]) -> Any:
    """An array as sensor_msgs/Image, of little-endian samples.

    Args:
        new: See the module.
        header: Header of the message.
        image: (H, W, 3) uint8 BGR, or (H, W) uint8, uint16 or float32.
    """
    pixels = np.ascontiguousarray(image, dtype=image.dtype.newbyteorder("<"))
    encoding = "bgr8" if image.ndim == 3 else _GRAY[image.dtype.itemsize]
    return new(
        IMAGE_TYPE,
        header=header,
        height=image.shape[0],
        width=image.shape[1],
        encoding=encoding,
        step=pixels.strides[0],
        data=pixels.reshape(-1).view(np.uint8),
    )


def box_message(new: MessageFactory, header: Any, box: Sequence[float]) -> Any:
    """A box as geometry_msgs/PolygonStamped of its corners, clockwise from the top left.

    Args:
        new: See the module.
        header: Header of the message.
        box: (x, y, width, height) in pixels.
    """
    points = [new("geometry_msgs/msg/Point32", x=x, y=y) for x, y in box_corners(box)]
    return new(POLYGON_TYPE, header=header, polygon=new("geometry_msgs/msg/Polygon", points=points))


def box_in_single_precision(box: Sequence[float]) -> Box:
    """A box (x, y, width, height) rounded as the single-precision corners of a message."""
    # Too large values become infinite, and are refused where the box is used.
    with np.errstate(over="ignore"):
        return bounding_box(np.array(box_corners(box), dtype=np.float32))


def box_of_polygon(message: Any) -> Box:
    """The bounding rectangle (x, y, width, height) of a geometry_msgs/PolygonStamped in pixels.

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


def particles_message(
    new: MessageFactory,
    header: Any,
    boxes: NDArray[np.float64],
    weights: NDArray[np.float64],
    ids: NDArray[np.integer[Any]],
) -> Any:
    """Particles as sensor_msgs/PointCloud2 of `PARTICLE_FIELDS` and `id`, each at its box's center.

    Args:
        new: See the module.
        header: Header of the message.
        boxes: (N, 4) x, y, width, height in pixels.
        weights: (N,) their weights.
        ids: (N,) ids of their targets.
    """
    names = (*PARTICLE_FIELDS, "id")
    centers, depths = boxes[:, :2] + boxes[:, 2:] / 2, np.zeros(len(boxes))
    columns = np.column_stack([centers, depths, boxes[:, 2:], weights, ids]).astype(np.float32)
    size, step = columns.itemsize, columns.itemsize * len(names)
    return new(
        POINTS_TYPE,
        header=header,
        height=1,
        width=len(columns),
        fields=[
            new(_FIELD, name=name, offset=index * size, datatype=_FLOAT32, count=1)
            for index, name in enumerate(names)
        ],
        is_bigendian=sys.byteorder == "big",
        point_step=step,
        row_step=step * len(columns),
        data=columns.reshape(-1).view(np.uint8),
        is_dense=True,
    )


def markers_message(new: MessageFactory, header: Any, boxes: Sequence[BoxMarker]) -> Any:
    """Boxes as visualization_msgs/MarkerArray, which replaces all earlier markers.

    The first marker deletes them. Each box has a line (namespace `boxes`) and a text (`labels`),
    with its id.
    """

    def pose(x: float, y: float) -> Any:
        upright = new("geometry_msgs/msg/Quaternion", w=1.0)
        return new("geometry_msgs/msg/Pose", position=new(_POINT, x=x, y=y), orientation=upright)

    markers = [new(_MARKER, header=header, action=_DELETE_ALL, pose=pose(0.0, 0.0))]
    for box in boxes:
        corners = [new(_POINT, x=x, y=y) for x, y in box_corners(box.box)]
        color = new("std_msgs/msg/ColorRGBA", **dict(zip("rgba", box.color, strict=True)))
        shared = {"header": header, "id": box.id, "action": _ADD, "color": color}
        line = {
            "ns": "boxes",
            "type": _LINE_STRIP,
            "pose": pose(0.0, 0.0),
            "scale": new("geometry_msgs/msg/Vector3", x=box.width),
            "points": [*corners, corners[0]],
        }
        text = {
            "ns": "labels",
            "type": _TEXT,
            "pose": pose(corners[0].x, corners[0].y - _TEXT_HEIGHT / 2),
            "scale": new("geometry_msgs/msg/Vector3", z=_TEXT_HEIGHT),
            "text": box.text,
        }
        markers += [new(_MARKER, **shared, **line), new(_MARKER, **shared, **text)]
    return new(MARKERS_TYPE, markers=markers)


def hypothesis_message(
    new: MessageFactory, label: str, score: float, pose: Any, covariance: NDArray[np.float64]
) -> Any:
    """A class and a pose as vision_msgs/ObjectHypothesisWithPose.

    Args:
        new: See the module.
        label: Class of the object.
        score: 0 to 1.
        pose: Its geometry_msgs/Pose.
        covariance: (6, 6) covariance of the pose.
    """
    return new(
        "vision_msgs/msg/ObjectHypothesisWithPose",
        hypothesis=new("vision_msgs/msg/ObjectHypothesis", class_id=label, score=score),
        pose=new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance.ravel()),
    )


def status_message(new: MessageFactory, header: Any, statuses: Sequence[Status]) -> Any:
    """Statuses as diagnostic_msgs/DiagnosticArray; numbers read back to the same value."""
    messages = []
    for name, level, text, values in statuses:
        pairs = [
            new("diagnostic_msgs/msg/KeyValue", key=key, value=str(value))
            for key, value in values.items()
        ]
        messages.append(new(_STATUS, level=level, name=name, message=text, values=pairs))
    return new(STATUS_TYPE, header=header, status=messages)
