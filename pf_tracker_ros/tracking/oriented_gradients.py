"""Histograms of oriented gradients of boxes, all boxes of a frame in one go.

1. Each box is resized to a small square and smoothed.
2. In each of 6 x 6 cells, gradient magnitudes are summed per direction, over 180 degrees.
3. Blocks of 2 x 2 cells, which overlap by half, are scaled to unit length, and all of them together
   to a sum of 1. The descriptor has the square roots, so the dot product of two descriptors is
   their Bhattacharyya coefficient.

Source: Dalal and Triggs 2005, "Histograms of oriented gradients for human detection"; the shares of
neighboring directions as in `cues.hog`.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.hog import direction_table, normalized_blocks
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.region import paired_differences, read_window

BINS = 9
"""Direction bins over 180 degrees."""
# Cells along each side of a box, pixels along each side of a cell.
_CELLS, _CELL_PIXELS = 6, 6
_SIDE = _CELLS * _CELL_PIXELS
# Pixels around the box that smoothing and derivatives read.
_MARGIN = 2


def gradient_descriptors(frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.float32]:
    """(K, 900) descriptors of unit length, 0 without any gradient, of (K, 4) boxes, pixels.

    The boxes have their centers in the image.
    """
    count, side = len(boxes), _SIDE + 2 * _MARGIN
    centers, sides = boxes[:, :2] + boxes[:, 2:] / 2, boxes[:, 2:] * (side / _SIDE)
    # All patches in one column, so that each operation processes one image.
    column = np.concatenate(
        [read_window(frame, *one, side, gray=True) for one in zip(centers, sides, strict=True)]
    )
    differences = paired_differences(cv2.GaussianBlur(column, (3, 3), 0.0))
    inside = slice(_MARGIN, -_MARGIN)
    differences = differences.reshape(count, side, side)[:, inside, inside]
    magnitudes = direction_table(BINS).take(differences.astype(np.intp), axis=0)
    rows = magnitudes.reshape(count * _CELLS, _CELL_PIXELS, -1).sum(axis=1, dtype=np.uint16)
    rows = rows.reshape(count, _CELLS, _CELLS, _CELL_PIXELS, BINS)
    cells = rows.sum(axis=3, dtype=np.int32).astype(np.float32)
    blocks = normalized_blocks(np.moveaxis(cells, 0, 2))
    descriptors = np.moveaxis(blocks, 3, 0).reshape(count, -1)
    total = descriptors.sum(axis=1, keepdims=True)
    return np.sqrt(descriptors / np.where(total > 0.0, total, 1.0))
