"""How images and boxes are laid out in ROS messages, whoever serializes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, bounding_box, box_corners

PARTICLE_FIELDS = ("x", "y", "z", "width", "height", "weight")


def image_encoding(image: NDArray[Any]) -> str:
    """The encoding of sensor_msgs/Image for an array: `bgr8`, `mono8` or `mono16`.

    Args:
        image: (H, W, 3) uint8 BGR, (H, W) uint8 or (H, W) uint16.
    """
    if image.ndim == 3:
        return "bgr8"
    return "mono16" if image.dtype.itemsize == 2 else "mono8"


def box_as_sent(box: Sequence[float]) -> Box:
    """A box (x, y, width, height) as the corners of a message, in single precision, tell it."""
    # What is too large for single precision is infinite there, and refused where it is used.
    with np.errstate(over="ignore"):
        return bounding_box(np.array(box_corners(box), dtype=np.float32))


def particle_columns(
    boxes: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Particles as the points of a sensor_msgs/PointCloud2, at the centers of their boxes.

    Args:
        boxes: (N, 4) x, y, width, height in pixels.
        weights: (N,) their weights.

    Returns:
        (N, 6) float32, a column for each of `PARTICLE_FIELDS`; z is 0.
    """
    columns = np.zeros((len(boxes), len(PARTICLE_FIELDS)), dtype=np.float32)
    columns[:, :2] = boxes[:, :2] + boxes[:, 2:] / 2
    columns[:, 3:5] = boxes[:, 2:]
    columns[:, 5] = weights
    return columns
