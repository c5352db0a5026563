"""A grid of pixels in a box and in a ring around it, in an image of any resolution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box

# Most samples along each axis, and width of the ring relative to the box.
_COLUMNS, _ROWS, _RING = 36, 48, 0.25


@dataclass(frozen=True, eq=False)
class BoxSamples:
    """Sampled rows and columns, those of the box in the middle.

    Attributes:
        columns: (K,) indices of the columns of box and ring; likewise `rows`.
        rows: (L,) see `columns`.
        inside: Slices of the (L, K) samples that select the (R, C) samples in the box.
        across: (C,) positions of the columns in the box, 0 to 1 from left to right.
        down: (R,) likewise of the rows from top to bottom.
    """

    columns: NDArray[np.intp]
    rows: NDArray[np.intp]
    inside: tuple[slice, slice]
    across: NDArray[np.float64]
    down: NDArray[np.float64]

    @classmethod
    @lru_cache(maxsize=1)
    def of(cls, box: Box, image_size: tuple[int, int], shape: tuple[int, int]) -> BoxSamples:
        """Samples of a box and its ring, at most one a pixel.

        The last are kept: those of depth and image are mostly the same.

        Args:
            box: In pixels of the camera's image, not outside of it.
            image_size: (width, height) of that.
            shape: (rows, columns) of the array to sample.
        """
        x, y, width, height = box
        columns, of_box, across = _axis(x, width, image_size[0], shape[1], _COLUMNS)
        rows, of_box_down, down = _axis(y, height, image_size[1], shape[0], _ROWS)
        return cls(columns, rows, (of_box_down, of_box), across, down)

    def take(self, array: NDArray[Any]) -> NDArray[Any]:
        """(L, K, ...) samples of an array."""
        return array[self.rows[:, None], self.columns]

    def resample(self, over_box: NDArray[np.generic]) -> NDArray[np.float64]:
        """(R, C) nearest values of a (rows, columns) map over the box.

        Raises:
            ValueError: The map has other dimensions, or values outside 0 to 1.
        """
        if over_box.ndim != 2 or over_box.size == 0 or over_box.dtype.kind not in "fiu":
            raise ValueError(
                f"target_probability is {over_box.shape} {over_box.dtype}; expected numbers in "
                "rows and columns over the box"
            )
        rows = (self.down * over_box.shape[0]).astype(np.intp)
        columns = (self.across * over_box.shape[1]).astype(np.intp)
        np.minimum(rows, over_box.shape[0] - 1, out=rows)
        np.minimum(columns, over_box.shape[1] - 1, out=columns)
        values = over_box[rows[:, None], columns].astype(np.float64)
        if not (values.min() >= 0.0 and values.max() <= 1.0):
            raise ValueError("target_probability must be between 0 and 1")
        return values


def _axis(
    start: float, length: float, size: int, cells: int, most: int
) -> tuple[NDArray[np.intp], slice, NDArray[np.float64]]:
    """Cells along one axis, the slice of those in the box, and the positions of these in it."""
    scale = cells / size
    first = max(math.floor((start - _RING * length) * scale), 0)
    end = min(max(math.ceil((start + (1.0 + _RING) * length) * scale), first + 1), cells)
    first = min(first, end - 1)
    count = min(most, end - first)
    indices = (first + (np.arange(count) + 0.5) * ((end - first) / count)).astype(np.intp)
    positions = ((indices + 0.5) / scale - start) / length
    begin, stop = np.searchsorted(positions, (0.0, 1.0)).tolist()
    if begin == stop:
        # A box between two cells.
        begin, stop = max(begin - 1, 0), max(begin, 1)
    of_box = slice(begin, stop)
    return indices, of_box, np.clip(positions[of_box], 0.0, 1.0)
