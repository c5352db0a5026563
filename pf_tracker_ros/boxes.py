"""Boxes: a part of an image, as four numbers."""

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

# Sides.
_SAME_PLACE = 0.5
# A box that ends within so many pixels of the image's border is cut by it.
_CUT_WITHIN = 2.0


class BoxesByAxis(NamedTuple):
    """Boxes, pixels, as four arrays of any shapes that NumPy brings together to one."""

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
        """The same, that NumPy brings together to (rows, columns)."""
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
    """The smallest box around a rectangle that is turned.

    Args:
        center: (x, y) in pixels.
        size: (width, height) in pixels.
        angle: Radians; one that is not finite counts as 0.
    """
    (x, y), (width, height) = center, size
    if angle and math.isfinite(angle):
        across, down = abs(math.cos(angle)), abs(math.sin(angle))
        width, height = width * across + height * down, width * down + height * across
    return x - width / 2, y - height / 2, width, height


def intersection_areas(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """(...,) px^2 that (..., 4) boxes share with (..., 4) others."""
    ends, other_ends = one[..., :2] + one[..., 2:], other[..., :2] + other[..., 2:]
    sides = np.minimum(ends, other_ends) - np.maximum(one[..., :2], other[..., :2])
    np.maximum(sides, 0.0, out=sides)
    areas: NDArray[np.float64] = sides[..., 0] * sides[..., 1]
    return areas


def pairwise_iou(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, M) intersection over union, 0 to 1, of (N, 4) and (M, 4) boxes."""
    shared = intersection_areas(one[:, None], other)
    areas, other_areas = one[:, 2] * one[:, 3], other[:, 2] * other[:, 3]
    return shared / np.maximum(areas[:, None] + other_areas - shared, 1e-9)


def pairwise_coverage(boxes: NDArray[np.float64], by: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, M) share, 0 to 1, of each of (N, 4) boxes that each of (M, 4) covers."""
    return (
        intersection_areas(boxes[:, None], by)
        / np.maximum(boxes[:, 2] * boxes[:, 3], 1e-9)[:, None]
    )


def is_truncated(box: NDArray[np.float64], image_size: tuple[int, int]) -> bool:
    """Whether a (4,) box goes to the border of an image of (width, height)."""
    ends = box[:2] + box[2:]
    return bool((box[:2] < _CUT_WITHIN).any() or (ends > np.array(image_size) - _CUT_WITHIN).any())


def relative_center_distances(boxes: ArrayLike, place: ArrayLike) -> NDArray[Any]:
    """How far boxes are from another one.

    Args:
        boxes: (..., 4) in pixels.
        place: (4,) in pixels.

    Returns:
        (...,) distances of the centers along that axis on which they are further apart, in the
        place's sides: boxes of its size are clear of it from 1 on.
    """
    boxes, place = np.asarray(boxes), np.asarray(place)
    offsets = boxes[..., :2] + boxes[..., 2:] / 2 - place[:2] - place[2:] / 2
    apart: NDArray[Any] = (np.abs(offsets) / place[2:]).max(axis=-1)
    return apart


def are_same_place(boxes: ArrayLike, place: ArrayLike) -> NDArray[Any]:
    """(...,) whether boxes, (..., 4), are where another one is, (4,), and not beside it."""
    is_there: NDArray[Any] = relative_center_distances(boxes, place) <= _SAME_PLACE
    return is_there
