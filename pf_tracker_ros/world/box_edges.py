"""What the edges of a box measure.

The lower edge is where the target meets the ground, the upper edge its head, and the middle column
its direction. An edge at the border of the image is cut: it is where the image ends, not the
target.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.boxes import Box

# An edge within this distance of the border is cut: pixels, and a share of the box's height, since
# detectors set the edges of cut boxes a little inside.
_CUT_WITHIN, _CUT_WITHIN_SHARE = 2.0, 0.02
# Standard deviation of an edge's row and of the middle column of a detector's box, box heights.
_EDGE_SD = 0.043
# Half the width of a target whose edge is cut, and its standard deviation, box heights: wider than
# most, since it walks or rides across the image.
_HALF_WIDTH, _HALF_WIDTH_SD = 0.25, 0.18
# Smallest standard deviation, pixels: boxes are rounded.
_MIN_SD = 0.5
# From center x, center y, width, height to middle column, lower edge, upper edge.
_FROM_CENTER_AND_SIZE = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.5], [0.0, 1.0, 0.0, -0.5]]
)

# Largest number of a box, and standard deviation, pixels.
_LARGEST = 1e6
# Asymmetry and negative eigenvalues of a covariance that are rounding, over its largest number.
_ROUNDING = 1e-6

_TO_CENTER = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.5]])


@dataclass(frozen=True, eq=False)
class BoxEdges:
    """Edges of a box in pixels, counted from the corner of the image.

    Attributes:
        box: The part inside the image.
        middle: Column of the target's middle.
        lower: Row of the lower edge; `upper` likewise.
        upper: See `lower`.
        covariance: (3, 3) of middle, lower and upper, px^2.
        root: (3, 3) of the covariance, C = root root^T.
        has_lower: Whether the lower edge is the target's.
        has_upper: Whether the upper edge is.
        is_whole: Whether all four edges are.
    """

    box: Box
    middle: float
    lower: float
    upper: float
    covariance: NDArray[np.float64]
    root: NDArray[np.float64]
    has_lower: bool
    has_upper: bool
    is_whole: bool

    @classmethod
    def of(
        cls, box: ArrayLike, covariance: ArrayLike | None, image_size: tuple[int, int]
    ) -> BoxEdges | None:
        """The edges of a box; None where it is outside the image.

        Args:
            box: (x, y, width, height) in pixels.
            covariance: (4, 4) of center x, center y, width and height, or (2, 2) of the center,
                px^2; None means that of a good detector.
            image_size: (width, height) in pixels.

        Raises:
            ValueError: The box is not four finite numbers with a positive size, or the covariance
                has another shape or is not one.
        """
        left, upper, right, lower = _corners(box)
        width, height = image_size
        tolerance = max(_CUT_WITHIN, _CUT_WITHIN_SHARE * (lower - upper))
        cut_left, cut_right = left < tolerance, right > width - tolerance
        has_upper, has_lower = upper >= tolerance, lower <= height - tolerance
        edges = _covariance(covariance, lower - upper)
        left, right = max(left, 0.0), min(right, float(width))
        upper, lower = max(upper, 0.0), min(lower, float(height))
        if left >= right or upper >= lower:
            return None
        middle = (left + right) / 2.0
        if cut_left or cut_right:
            half = max(_HALF_WIDTH * (lower - upper), (right - left) / 2.0)
            if not cut_left:
                middle = left + half
            elif not cut_right:
                middle = right - half
            edges[0, :] = edges[:, 0] = 0.0
            edges[0, 0] = (_HALF_WIDTH_SD * (lower - upper)) ** 2 + (right - left) ** 2 / 12.0
        inside = (left, upper, right - left, lower - upper)
        # Without a covariance it is diagonal.
        root = np.sqrt(edges) if covariance is None else np.asarray(np.linalg.cholesky(edges))
        is_whole = has_lower and has_upper and not (cut_left or cut_right)
        return cls(inside, middle, lower, upper, edges, root, has_lower, has_upper, is_whole)

    def points(self) -> NDArray[np.float64]:
        """(3, 2) pixels of foot, head and center of the box, counted as in `CameraModel`."""
        center = self.box[0] + self.box[2] / 2.0, (self.upper + self.lower) / 2.0
        return np.array([(self.middle, self.lower), (self.middle, self.upper), center]) - 0.5

    def center_covariance(self) -> NDArray[np.float64]:
        """(2, 2) of the center, px^2."""
        return _TO_CENTER @ self.covariance @ _TO_CENTER.T


def _corners(box: ArrayLike) -> tuple[float, float, float, float]:
    """Left, upper, right and lower edge."""
    values = np.asarray(box, dtype=np.float64)
    if values.shape == (4,):
        x, y, width, height = values.tolist()
        # A comparison with NaN is false.
        if (
            abs(x) <= _LARGEST
            and abs(y) <= _LARGEST
            and 0.0 < width <= _LARGEST
            and 0.0 < height <= _LARGEST
        ):
            return x, y, x + width, y + height
    raise ValueError(
        f"box is {box!r}; expected four finite numbers (x, y, width, height) up to "
        f"{_LARGEST:.0f} pixels, with a positive size"
    )


def _covariance(covariance: ArrayLike | None, height: float) -> NDArray[np.float64]:
    """(3, 3) of middle, lower and upper edge, px^2."""
    variance = (_EDGE_SD * height) ** 2
    if covariance is None:
        return _IDENTITY * (variance + _MIN_SD**2)
    given = np.asarray(covariance, dtype=np.float64)
    if given.shape == (2, 2):
        full = np.diag([0.0, 0.0, 2.0 * variance, 2.0 * variance])
        full[:2, :2] = given
    elif given.shape == (4, 4):
        full = given
    else:
        raise ValueError(
            f"box_covariance has shape {given.shape}; expected (4, 4) of center x, center y, width "
            "and height, or (2, 2) of the center"
        )
    largest = float(np.abs(full).max())
    # A comparison with NaN is false.
    if not (
        largest <= _LARGEST**2
        and float(np.abs(full - full.T).max()) <= _ROUNDING * largest
        and float(np.linalg.eigvalsh((full + full.T) / 2.0).min()) >= -_ROUNDING * largest
    ):
        raise ValueError(
            "box_covariance must be finite, symmetric and positive semidefinite, with standard "
            f"deviations up to {_LARGEST:.0f} px"
        )
    edges = _FROM_CENTER_AND_SIZE @ full @ _FROM_CENTER_AND_SIZE.T + _IDENTITY * _MIN_SD**2
    return (edges + edges.T) / 2.0


_IDENTITY = np.eye(3)
