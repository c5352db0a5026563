"""Estimates as ROS messages, and a target's polygon as a box."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point32, PolygonStamped
from numpy.typing import NDArray
from sensor_msgs.msg import Image, PointCloud2, PointField
from std_msgs.msg import Header

from pf_tracker_ros.boxes import Box, bounding_box, box_corners
from pf_tracker_ros.messages import PARTICLE_FIELDS, image_encoding, particle_columns
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap

if TYPE_CHECKING:
    from pf_tracker_ros.targets.tracked_target import TrackedTarget

_FLOAT_SIZE = 4


class TargetError(ValueError):
    """A target's polygon that does not describe a box."""


def box_of_polygon(message: PolygonStamped) -> Box:
    """The bounding rectangle (x, y, width, height) of a polygon in pixels.

    Raises:
        TargetError: A point is not finite, or the points span no area.
    """
    points = [(point.x, point.y) for point in message.polygon.points]
    count = len(points)
    if count < 2:
        raise TargetError(
            f"target refused: its polygon has {counted(count, 'point')}; allowed: at least two, "
            "such as opposite corners of the box in pixels"
        )
    if not all(math.isfinite(value) for point in points for value in point):
        raise TargetError("target refused: a point of its polygon is not finite")
    box = bounding_box(points)
    if not all(box[2:]):
        raise TargetError(
            f"target refused: its {count} points span {box[2]:g} x {box[3]:g} px; "
            "allowed: points that differ in both x and y"
        )
    return box


def box_message(box: Box, header: Header) -> PolygonStamped:
    """The four corners of a box in pixels, clockwise from the top left."""
    message = blank_box_message()
    fill_box_message(message, box, header)
    return message


def blank_box_message() -> PolygonStamped:
    """A message to be filled with a box."""
    message = PolygonStamped()
    message.polygon.points = [Point32() for _ in range(4)]
    return message


def fill_box_message(message: PolygonStamped, box: Box, header: Header) -> None:
    """Put a box into a message that had one before, or is blank: to make one takes long."""
    message.header = header
    for point, (x, y) in zip(message.polygon.points, box_corners(box), strict=True):
        point.x, point.y = x, y


def particles_message(estimate: Estimate, header: Header) -> PointCloud2:
    """The particles as points at the centers of their boxes, in pixels, with size and weight."""
    columns = particle_columns(estimate.particle_boxes, estimate.weights)
    return _points_message(columns, PARTICLE_FIELDS, header)


def several_particles_message(targets: Sequence[TrackedTarget], header: Header) -> PointCloud2:
    """The particles of several targets, at least one, with the ids of these as one more field."""
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
