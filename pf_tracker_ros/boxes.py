"""Boxes: a part of an image, as four numbers."""

from __future__ import annotations

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


def sides_apart(boxes: ArrayLike, place: ArrayLike) -> NDArray[Any]:
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


def are_at(boxes: ArrayLike, place: ArrayLike) -> NDArray[Any]:
    """(...,) whether boxes, (..., 4), are where another one is, (4,), and not beside it."""
    is_there: NDArray[Any] = sides_apart(boxes, place) <= _SAME_PLACE
    return is_there
