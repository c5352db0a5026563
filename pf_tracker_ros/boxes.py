"""Axis-aligned boxes in pixels: corners, overlaps and distances."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

# (x, y, width, height) in pixels, (x, y) the top-left corner counted from 0; it covers
# [x, x + width) and [y, y + height).
Box = tuple[float, float, float, float]

SAME_OBJECT_ABOVE = 0.5
"""Intersection over union above which two boxes are on one object."""
# Relative center distance.
_SAME_PLACE = 0.5
# Distance in pixels to the image border within which a box counts as truncated.
_TRUNCATED_WITHIN = 2.0


class BoxesByAxis(NamedTuple):
    """Boxes in pixels as four arrays that broadcast to one shape."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    width: NDArray[np.float64]
    height: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BoxGrid:
    """Boxes of one size in rows and columns.

    Attributes:
        left: (columns,) left edge of each column's boxes, pixels.
        top: (rows,) upper edge of each row's boxes, pixels.
        size: (2,) width and height, pixels.
    """

    left: NDArray[np.float64]
    top: NDArray[np.float64]
    size: NDArray[np.float64]

    @cached_property
    def boxes(self) -> NDArray[np.float64]:
        """(rows * columns, 4) boxes, row by row."""
        boxes = np.empty((len(self.top), len(self.left), 4))
        for number, values in enumerate(self.by_axis):
            boxes[..., number] = values
        return boxes.reshape(-1, 4)

    @property
    def by_axis(self) -> BoxesByAxis:
        """The boxes as arrays that broadcast to (rows, columns)."""
        return BoxesByAxis(self.left, self.top[:, None], self.size[0], self.size[1])


def as_box(values: Iterable[float]) -> Box:
    """Four numbers as a box."""
    x, y, width, height = map(float, values)
    return x, y, width, height


def box_corners(box: Iterable[float]) -> list[tuple[float, float]]:
    """The four corners of a box, clockwise from the top left."""
    x, y, width, height = as_box(box)
    return [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]


def bounding_box(points: ArrayLike) -> Box:
    """The smallest box around (N, 2) points, at least one."""
    points = np.asarray(points, dtype=np.float64)
    (left, top), (right, bottom) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return left, top, right - left, bottom - top


def bounding_box_of_rotated(
    center: tuple[float, float], size: tuple[float, float], angle: float
) -> Box:
    """The smallest box around a rotated rectangle.

    Args:
        center: (x, y) in pixels.
        size: (width, height) in pixels.
        angle: Radians; NaN and infinity count as 0.
    """
    (x, y), (width, height) = center, size
    if angle and math.isfinite(angle):
        cosine, sine = abs(math.cos(angle)), abs(math.sin(angle))
        width, height = width * cosine + height * sine, width * sine + height * cosine
    return x - width / 2, y - height / 2, width, height


def intersection_areas(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...,) intersections in px^2 of (..., 4) boxes with (..., 4) others."""
    (begins, ends), (other_begins, other_ends) = _corners(one), _corners(other)
    return _areas(np.maximum(begins, other_begins), np.minimum(ends, other_ends))


def iou(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...,) intersection over union of (..., 4) boxes with (..., 4) others.

    Returns:
        0 to 1: exactly 1.0 for equal boxes, 0 where a box is empty.
    """
    shared = intersection_areas(one, other)
    # Areas from width x height round differently; equal boxes must give 1.
    union = _areas(*_corners(one)) + _areas(*_corners(other)) - shared
    return np.divide(shared, union, out=np.zeros_like(shared), where=union > 0.0)


def _corners(boxes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(..., 2) top left and bottom right corners."""
    return boxes[..., :2], boxes[..., :2] + boxes[..., 2:]


def _areas(begins: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...,) areas in px^2 between (..., 2) corners; 0 where one ends before it begins."""
    sides = np.maximum(ends - begins, 0.0)
    areas: NDArray[np.float64] = sides[..., 0] * sides[..., 1]
    return areas


def pairwise_iou(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, M) intersection over union, 0 to 1, of (N, 4) and (M, 4) boxes."""
    return iou(one[:, None], other)


def pairwise_coverage(boxes: NDArray[np.float64], by: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, M) share, 0 to 1, of the area of each of (N, 4) boxes inside each of (M, 4) others."""
    return (
        intersection_areas(boxes[:, None], by)
        / np.maximum(boxes[:, 2] * boxes[:, 3], 1e-9)[:, None]
    )


def grown(boxes: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """(N, 4) boxes of the same centers, with sides that are a factor as long, above 0; pixels."""
    sizes = factor * boxes[:, 2:]
    return np.hstack([boxes[:, :2] + (boxes[:, 2:] - sizes) / 2, sizes])


def is_on_any(box: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    """Whether a (4,) box is on the object of one of (K, 4) others."""
    return bool(pairwise_iou(box[None], others).max(initial=0.0) > SAME_OBJECT_ABOVE)


def is_truncated(box: NDArray[np.float64], image_size: tuple[int, int]) -> bool:
    """Whether a (4,) box reaches the border of an image of (width, height)."""
    ends, limits = box[:2] + box[2:], np.array(image_size) - _TRUNCATED_WITHIN
    return bool((box[:2] < _TRUNCATED_WITHIN).any() or (ends > limits).any())


def relative_center_distances(boxes: ArrayLike, reference: ArrayLike) -> NDArray[Any]:
    """Center distances of boxes to a reference box, in units of its sides.

    Args:
        boxes: (..., 4) in pixels.
        reference: (4,) in pixels.

    Returns:
        (...,) distances, the larger of both axes. Boxes of the reference's size do not overlap it
        from 1 on.
    """
    boxes, reference = np.asarray(boxes), np.asarray(reference)
    offsets = boxes[..., :2] + boxes[..., 2:] / 2 - reference[:2] - reference[2:] / 2
    distances: NDArray[Any] = (np.abs(offsets) / reference[2:]).max(axis=-1)
    return distances


def are_same_place(boxes: ArrayLike, reference: ArrayLike) -> NDArray[Any]:
    """(...,) whether the center of each (..., 4) box is within half a side of a (4,) reference."""
    are_close: NDArray[Any] = relative_center_distances(boxes, reference) <= _SAME_PLACE
    return are_close
