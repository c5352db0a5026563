"""How images and boxes are laid out in ROS messages, whoever serializes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray


def image_encoding(image: NDArray[Any]) -> str:
    """The encoding of sensor_msgs/Image for an array: `bgr8`, `mono8` or `mono16`.

    Args:
        image: (H, W, 3) uint8 BGR, (H, W) uint8 or (H, W) uint16.
    """
    if image.ndim == 3:
        return "bgr8"
    return "mono16" if image.dtype.itemsize == 2 else "mono8"


def box_corners(box: Sequence[float]) -> list[tuple[float, float]]:
    """The four corners of a box (x, y, width, height), clockwise from the top left."""
    x, y, width, height = (float(value) for value in box)
    return [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
