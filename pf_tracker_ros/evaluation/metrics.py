"""Metrics of one-pass evaluation.

1. Overlap: intersection over union with the true box. Center error: distance of the centers.
2. Success curve: share of frames with an overlap above each threshold. Success AUC is its mean.
3. Precision: share of frames with a center error of at most 20 px.

Frames whose target is absent have no overlap and no center error (both NaN) and do not count.
Sequences mark them by a true box with a number that is not finite, or a width or height of 0.

Boxes are rows of x, y, width, height in pixels, (x, y) the top-left corner, covering
[x, x + width) and [y, y + height).

Source: Wu, Lim and Yang 2013, "Online Object Tracking: A Benchmark" (OTB).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.boxes import iou

Measure = Callable[[ArrayLike, ArrayLike], NDArray[np.float64]]
"""Compares boxes with true boxes: a number for each pair."""

# k / 20 is the nearest double to each threshold. With k * 0.05, an overlap of exactly .15 would be
# above the threshold .15.
SUCCESS_THRESHOLDS: NDArray[np.float64] = np.arange(21) / 20
PRECISION_RADIUS = 20.0


def overlap(boxes: ArrayLike, true_boxes: ArrayLike) -> NDArray[np.float64]:
    """Intersection over union of each box with the true box of the same frame.

    Args:
        boxes: (..., 4) x, y, width, height in pixels, finite; an empty box has overlap 0.
        true_boxes: (..., 4), broadcast against `boxes`.

    Returns:
        (...) 0 to 1 (exactly 1.0 for equal boxes); NaN where the target is absent.

    Raises:
        ValueError: The last axis does not have 4 columns, or a number in `boxes` is not finite.
    """
    first, second, is_present = _comparable(boxes, true_boxes)
    return np.where(is_present, iou(first, second), np.nan)


def center_errors(boxes: ArrayLike, true_boxes: ArrayLike) -> NDArray[np.float64]:
    """Distance between each box's center and that of the true box of the same frame.

    Args:
        boxes: (..., 4) x, y, width, height in pixels, finite.
        true_boxes: (..., 4), broadcast against `boxes`.

    Returns:
        (...) pixels; NaN where the target is absent.

    Raises:
        ValueError: The last axis does not have 4 columns, or a number in `boxes` is not finite.
    """
    first, second, is_present = _comparable(boxes, true_boxes)
    offset = (first[..., :2] + first[..., 2:] / 2) - (second[..., :2] + second[..., 2:] / 2)
    return np.where(is_present, np.hypot(offset[..., 0], offset[..., 1]), np.nan)


def has_target(true_boxes: ArrayLike) -> NDArray[np.bool_]:
    """Which frames have a target: (..., 4) true boxes to (...) booleans."""
    boxes = _as_boxes(true_boxes)
    return np.asarray(np.isfinite(boxes).all(axis=-1) & (boxes[..., 2:] > 0).all(axis=-1))


def success_curve(ious: ArrayLike) -> NDArray[np.float64]:
    """Share of frames whose overlap is strictly above each of the 21 thresholds 0, .05, .. 1.

    Args:
        ious: (frames,) overlaps; NaN frames do not count.

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

    The first frame counts with its given box, an overlap of 1. As no overlap is above the
    threshold 1, a perfect tracker reaches 20/21 = .952.

    Args:
        ious: (frames,) overlaps; NaN frames do not count.

    Returns:
        0 to 20/21.

    Raises:
        ValueError: No frame has an overlap.
    """
    return float(success_curve(ious).mean())


def precision(errors: ArrayLike, radius: float = PRECISION_RADIUS) -> float:
    """Share of frames whose center error is at most `radius` pixels.

    Args:
        errors: (frames,) center errors in pixels; NaN frames do not count.
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
        errors: (frames,) center errors in pixels; NaN frames do not count.

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
        raise ValueError("boxes contain NaN or infinity; allowed: finite numbers of pixels")
    is_present = has_target(true)
    return estimated, np.where(is_present[..., None], true, 0.0), is_present


def _known(values: ArrayLike, what: str) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64).ravel()
    known: NDArray[np.float64] = array[~np.isnan(array)]
    if known.size == 0:
        raise ValueError(f"there is no {what}: every frame lacks its true box")
    return known
