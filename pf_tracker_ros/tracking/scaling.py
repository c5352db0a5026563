"""Images that change their size at the same aspect ratio, and the boxes in them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box

# Tolerance of the aspect ratio: a camera rounds the sides of scaled images, often to multiples.
_SAME_ASPECT = 0.01


def size_of(image: NDArray[np.generic]) -> tuple[int, int]:
    """(width, height), pixels."""
    return image.shape[1], image.shape[0]


def same_aspect_ratio(size: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two sizes have the same aspect ratio, up to rounding."""
    products = size[0] * other[1], size[1] * other[0]
    return abs(products[0] - products[1]) <= _SAME_ASPECT * max(products)


def scaled_box(box: Box, size: tuple[int, int], other: tuple[int, int]) -> Box:
    """A box after its image was scaled from one size to another."""
    across, down = other[0] / size[0], other[1] / size[1]
    return box[0] * across, box[1] * down, box[2] * across, box[3] * down


def scaled_to(image: NDArray[np.generic], like: NDArray[np.generic]) -> NDArray[np.generic] | None:
    """An image scaled to the size of another; None if format or aspect ratio differ."""
    same_format = (image.shape[2:], image.dtype) == (like.shape[2:], like.dtype)
    if not same_format or not same_aspect_ratio(size_of(image), size_of(like)):
        return None
    smooth = cv2.INTER_AREA if like.size < image.size else cv2.INTER_LINEAR
    return cv2.resize(image, size_of(like), interpolation=smooth)


def clamp_box(box: Box, image: NDArray[np.generic]) -> Box:
    """A box clamped to the limits of `check_box`, which an estimate may exceed."""
    (x, y, width, height), (rows, columns) = box, image.shape[:2]
    center_x = min(max(x + width / 2, 0.0), float(columns))
    center_y = min(max(y + height / 2, 0.0), float(rows))
    width, height = min(max(width, 1.0), float(columns)), min(max(height, 1.0), float(rows))
    return center_x - width / 2, center_y - height / 2, width, height
