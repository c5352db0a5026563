"""How boxes lie to each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# A box that ends within so many pixels of the image's border is cut by it.
_CUT_WITHIN = 2.0


def intersections(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, M) px^2 that each of (N, 4) boxes shares with each of (M, 4)."""
    ends, other_ends = one[:, :2] + one[:, 2:], other[:, :2] + other[:, 2:]
    sides = np.minimum(ends[:, None], other_ends) - np.maximum(one[:, None, :2], other[:, :2])
    np.maximum(sides, 0.0, out=sides)
    return sides[..., 0] * sides[..., 1]


def overlaps(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, M) intersection over union, 0 to 1, of (N, 4) and (M, 4) boxes."""
    shared = intersections(one, other)
    areas, other_areas = one[:, 2] * one[:, 3], other[:, 2] * other[:, 3]
    return shared / np.maximum(areas[:, None] + other_areas - shared, 1e-9)


def covered(boxes: NDArray[np.float64], by: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, M) share, 0 to 1, of each of (N, 4) boxes that each of (M, 4) covers."""
    return intersections(boxes, by) / np.maximum(boxes[:, 2] * boxes[:, 3], 1e-9)[:, None]


def is_cut(box: NDArray[np.float64], image_size: tuple[int, int]) -> bool:
    """Whether a (4,) box goes to the border of the image."""
    ends = box[:2] + box[2:]
    return bool((box[:2] < _CUT_WITHIN).any() or (ends > np.array(image_size) - _CUT_WITHIN).any())
