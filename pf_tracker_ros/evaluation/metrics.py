"""How well boxes fit: the measures of one-pass evaluation.

The success plot and the precision plot are those of Wu, Lim and Yang 2013, "Online Object Tracking:
A Benchmark" (OTB). Boxes are rows of x, y, width, height in pixels, (x, y) the top-left corner,
covering [x, x + width) and [y, y + height).

The true box of a frame counts as missing where one of its numbers is not finite or its width or
height is not above 0, which is how sequences mark a target that is out of view. Such a frame has
neither overlap nor center error (both NaN) and takes no part in any share of frames.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.boxes import intersection_areas

Measure = Callable[[ArrayLike, ArrayLike], NDArray[np.float64]]
"""How well boxes fit true boxes: a number for each pair."""

# k / 20 is the double nearest to each threshold; a box that overlaps by exactly .15 is then not
# above the threshold .15, which it would be with k * 0.05.
SUCCESS_THRESHOLDS: NDArray[np.float64] = np.arange(21) / 20
PRECISION_RADIUS = 20.0


def overlap(boxes: ArrayLike, true_boxes: ArrayLike) -> NDArray[np.float64]:
    """Intersection over union of each box with the true box of the same frame.

    Args:
        boxes: (..., 4) x, y, width, height in pixels, finite; a box without area overlaps by 0.
        true_boxes: (..., 4), broadcast against `boxes`.

    Returns:
        (...) 0 (apart) to 1 (exactly 1.0 for equal boxes); NaN where the true box is missing.

    Raises:
        ValueError: The last axis does not have 4 columns, or a number in `boxes` is not finite.
    """
    first, second, known = _comparable(boxes, true_boxes)
    shared = intersection_areas(first, second)
    # An area from width and height is rounded otherwise than one from corners, and equal boxes
    # could come out a little above or below 1.
    union = intersection_areas(first, first) + intersection_areas(second, second) - shared
    ratio = np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)
    return np.where(known, ratio, np.nan)


def center_errors(boxes: ArrayLike, true_boxes: ArrayLike) -> NDArray[np.float64]:
    """Distance between each box's center and that of the true box of the same frame.

    Args:
        boxes: (..., 4) x, y, width, height in pixels, finite.
        true_boxes: (..., 4), broadcast against `boxes`.

    Returns:
        (...) pixels; NaN where the true box is missing.

    Raises:
        ValueError: The last axis does not have 4 columns, or a number in `boxes` is not finite.
    """
    first, second, known = _comparable(boxes, true_boxes)
    offset = (first[..., :2] + first[..., 2:] / 2) - (second[..., :2] + second[..., 2:] / 2)
    return np.where(known, np.hypot(offset[..., 0], offset[..., 1]), np.nan)


def has_target(true_boxes: ArrayLike) -> NDArray[np.bool_]:
    """Which frames have a true box: (..., 4) boxes to (...) booleans; see the module's text."""
    boxes = _as_boxes(true_boxes)
    return np.asarray(np.isfinite(boxes).all(axis=-1) & (boxes[..., 2:] > 0).all(axis=-1))


def success_curve(ious: ArrayLike) -> NDArray[np.float64]:
    """Share of frames whose overlap is above each of the 21 thresholds 0, .05, .. 1.

    Above means strictly above: the value at threshold 1 is 0 even for a perfect tracker.

    Args:
        ious: (frames,) overlaps; NaN frames are left out.

    Returns:
        (21,) shares, not increasing.

    Raises:
        ValueError: No frame has an overlap.
    """
    known = _known(ious, "overlap")
    curve: NDArray[np.float64] = (known[:, None] > SUCCESS_THRESHOLDS).mean(axis=0)
    return curve


def success_auc(ious: ArrayLike) -> float:
    """Area under the success curve: its mean over the 21 thresholds.

    Frame 1 counts with the box that the tracker was given, so with an overlap of 1. As no overlap
    is above the threshold 1, a perfect tracker reaches 20/21 = .952.

    Args:
        ious: (frames,) overlaps; NaN frames are left out.

    Returns:
        0 to 20/21.

    Raises:
        ValueError: No frame has an overlap.
    """
    return float(success_curve(ious).mean())


def precision(errors: ArrayLike, radius: float = PRECISION_RADIUS) -> float:
    """Share of frames whose center error is at most `radius` pixels.

    Args:
        errors: (frames,) center errors in pixels; NaN frames are left out.
        radius: Pixels.

    Returns:
        0 to 1.

    Raises:
        ValueError: No frame has a center error.
    """
    return float((_known(errors, "center error") <= radius).mean())


def precision_curve(errors: ArrayLike) -> NDArray[np.float64]:
    """Share of frames whose center error is at most 0, 1, .. 50 pixels.

    Args:
        errors: (frames,) center errors in pixels; NaN frames are left out.

    Returns:
        (51,) shares, not decreasing.

    Raises:
        ValueError: No frame has a center error.
    """
    known = _known(errors, "center error")
    curve: NDArray[np.float64] = (known[:, None] <= np.arange(51)).mean(axis=0)
    return curve


def _as_boxes(boxes: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(boxes, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != 4:
        raise ValueError(
            f"boxes of shape {array.shape}; allowed: x, y, width, height along the last axis"
        )
    return array


def _comparable(
    boxes: ArrayLike, true_boxes: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    estimated, true = _as_boxes(boxes), _as_boxes(true_boxes)
    if not np.isfinite(estimated).all():
        raise ValueError("boxes hold NaN or infinity; allowed: finite numbers of pixels")
    known = has_target(true)
    return estimated, np.where(known[..., None], true, 0.0), known


def _known(values: ArrayLike, what: str) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64).ravel()
    known: NDArray[np.float64] = array[~np.isnan(array)]
    if known.size == 0:
        raise ValueError(f"no {what} is known: every frame lacks its true box")
    return known
