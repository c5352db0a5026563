"""Gradients of 8-bit gray levels by tables: the differences of a pixel's neighbors as one number.

Reading a gradient's magnitude and direction is faster than working them out, and exact on the
borders between two directions, where many gradients of whole numbers lie.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_LARGEST = 255
_VALUES = 2 * _LARGEST + 1
NO_GRADIENT = _LARGEST * _VALUES + _LARGEST
"""The number of two differences of 0."""
# The gradient of the smallest possible window. All such numbers are exact in single precision.
_KERNEL = np.array([[0, -_VALUES, 0], [-1, 0, 1], [0, _VALUES, 0]], dtype=np.float32)


def paired_differences(gray: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(H, W) whole numbers for (H, W) gray levels, the rows of tables over `all_gradients`.

    That of a pixel is (down + 255) * 511 + right + 255, with the differences of its neighbors below
    and above, and of those to the right and to the left, both from -255 to 255.
    """
    return cv2.filter2D(gray, cv2.CV_32F, _KERNEL, delta=NO_GRADIENT)


def all_gradients() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(511 * 511,) magnitudes, gray levels, and angles, -pi to pi, of any two differences."""
    values = np.arange(-_LARGEST, _LARGEST + 1)
    magnitudes = np.hypot(values[:, None], values[None])
    angles = np.arctan2(values[:, None], values[None])
    return magnitudes.ravel(), angles.ravel()
