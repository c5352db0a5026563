"""Estimates as ROS messages, and a target's polygon as a box."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Point32, PolygonStamped
from numpy.typing import NDArray
from sensor_msgs.msg import Image, PointCloud2, PointField
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from pf_tracker_ros.boxes import Box, bounding_box, box_corners
from pf_tracker_ros.messages import PARTICLE_FIELDS, image_encoding, particle_columns
from pf_tracker_ros.overlay import target_color, target_text
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap

_FLOAT_SIZE = 4
# Pixels, of markers.
_LINE_WIDTH, _TEXT_HEIGHT = 2.0, 16.0


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


def box_message(box: Box, header: Header) -> PolygonStamped:
    """The four corners of a box in pixels, clockwise from the top left."""
    message = PolygonStamped(header=header)
    message.polygon.points = [Point32(x=x, y=y) for x, y in box_corners(box)]
    return message


def boxes_message(targets: Sequence[TrackedTarget], header: Header) -> MarkerArray:
    """The boxes in pixels in the frame of the image, each with its id and label as a text.

    The first marker deletes those of the frame before; then come, for each target, its box as a
    line (namespace `boxes`) and a text (namespace `labels`), both with its id.
    """
    array = MarkerArray(markers=[Marker(header=header, action=Marker.DELETEALL)])
    for target in targets:
        corners = [Point(x=x, y=y) for x, y in box_corners(target.estimate.box)]
        box = _marker(target, header, "boxes", Marker.LINE_STRIP)
        box.points = [*corners, corners[0]]
        box.scale.x = _LINE_WIDTH
        text = _marker(target, header, "labels", Marker.TEXT_VIEW_FACING)
        text.text = target_text(target)
        text.pose.position.x = corners[0].x
        text.pose.position.y = corners[0].y - _TEXT_HEIGHT / 2
        text.scale.z = _TEXT_HEIGHT
        array.markers += [box, text]
    return array


def _marker(target: TrackedTarget, header: Header, namespace: str, kind: int) -> Marker:
    marker = Marker(header=header, ns=namespace, id=target.id, type=kind, action=Marker.ADD)
    marker.pose.orientation.w = 1.0
    blue, green, red = (value / 255.0 for value in target_color(target.id))
    alpha = 1.0 if target.estimate.state == "tracking" else 0.5
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=alpha)
    return marker


def particles_message(targets: Sequence[TrackedTarget], header: Header) -> PointCloud2:
    """The particles of targets, at least one, as points at the centers of their boxes.

    In pixels, with size and weight, and the id of the target as the last field.
    """
    columns = []
    for target in targets:
        own = particle_columns(target.estimate.particle_boxes, target.estimate.weights)
        columns.append(np.hstack([own, np.full((len(own), 1), target.id, np.float32)]))
    return _points_message(np.vstack(columns), (*PARTICLE_FIELDS, "id"), header)


def _points_message(
    columns: NDArray[np.float32], names: Sequence[str], header: Header
) -> PointCloud2:
    point_step = _FLOAT_SIZE * len(names)
    message = PointCloud2(
        header=header,
        height=1,
        width=len(columns),
        fields=list(_point_fields(tuple(names))),
        is_bigendian=sys.byteorder == "big",
        point_step=point_step,
        row_step=point_step * len(columns),
        is_dense=True,
    )
    _fill(message, columns)
    return message


@cache
def _point_fields(names: tuple[str, ...]) -> tuple[PointField, ...]:
    """What the floats of a point are; the same messages each time, as they take long to make."""
    return tuple(
        PointField(name=name, offset=index * _FLOAT_SIZE, datatype=PointField.FLOAT32, count=1)
        for index, name in enumerate(names)
    )


def image_message(image: NDArray[np.generic], header: Header) -> Image:
    """An array as an image.

    Args:
        image: (H, W, 3) uint8 BGR, (H, W) uint8 or (H, W) uint16.
        header: Of the message.

    Returns:
        The message, encoded bgr8, mono8 or little-endian mono16.
    """
    pixels = np.ascontiguousarray(image, dtype=image.dtype.newbyteorder("<"))
    return _image_message(pixels, image_encoding(image), header)


def likelihood_message(likelihood: LikelihoodMap, header: Header) -> Image:
    """The fused log likelihood around a target as an image, encoded 32FC1, a pixel a place."""
    pixels = np.ascontiguousarray(likelihood.log_likelihood, dtype="<f4")
    return _image_message(pixels, "32FC1", header)


def likelihood_values(likelihood: LikelihoodMap) -> dict[str, str | float | int]:
    """Where the likelihood image lies, and what each cue says, under the keys of the status."""
    x, y, side, _ = likelihood.square
    values: dict[str, str | float | int] = {
        "likelihood_x": x,
        "likelihood_y": y,
        "likelihood_side": side,
    }
    for name, cue in likelihood.cues.items():
        values[f"at_target_{name}"] = cue.at_target
        values[f"at_rival_{name}"] = cue.at_rival
    return values


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


def _image_message(pixels: NDArray[np.generic], encoding: str, header: Header) -> Image:
    """An array of little-endian samples as an image."""
    message = Image(
        header=header,
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=pixels.strides[0],
    )
    _fill(message, pixels)
    return message


def _fill(message: Image | PointCloud2, values: NDArray[np.generic]) -> None:
    """Put the octets of an array into a message that has none.

    In place: what a message is made with or assigned it copies once more, and an ndarray element by
    element.
    """
    message.data.frombytes(np.ascontiguousarray(values).reshape(-1).view(np.uint8).data)
