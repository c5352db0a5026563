"""Camera motion (ego-motion), estimated from the images.

1. Points on a grid are tracked from an earlier image by pyramidal Lucas-Kanade.
2. RANSAC finds the similarity transform on which most points agree.
3. It is the camera's motion if it moves the image's corners and few points have stayed in place;
   else a large object moves before a still camera.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames.frame import Frame

# Largest number of pixels of the reduced images, and their smallest side.
_MAX_PIXELS = 384 * 288
_MIN_SIDE = 16
# Distance of the tracked points on their grid, pixels.
_GRID = 24
# With fewer tracked points, or a smaller share of inliers, the motion is unknown.
_MIN_POINTS = 12
_MIN_INLIER_SHARE = 0.5
# Pixels of the reduced image: a point that moves less has stayed; a camera that moves all corners
# by less stands still. If at least this share of points has stayed, the scene moves instead.
_STAYS_BELOW, _MOVES_ABOVE, _MAX_STAYING_SHARE = 0.2, 0.3, 0.3
# Comparisons after which a still camera gets a new reference image, and after which only every
# other frame is compared, to save time.
_RENEWED_AFTER, _STILL_AFTER = 10, 10


class EgoMotion:
    """Estimates the camera's motion between frames.

    While the camera stands still, frames are compared with one reference image for some time, so
    that a slow motion adds up until it is measurable. Later, only every other frame is compared.
    """

    def __init__(self) -> None:
        self._reference: NDArray[np.uint8] | None = None
        self._reference_age = 0
        self._still_for = 0

    def update(self, frame: Frame) -> NDArray[np.float64] | None:
        """Process the next frame; all have the same size.

        Returns:
            (3, 3) similarity from (x, y, 1) in the reference image to this frame, pixels, of the
            static scene. None if the camera stands still, its motion is unknown, or it is too small
            yet; a later frame then includes it.
        """
        if self._still_for >= _STILL_AFTER:
            self._still_for = _STILL_AFTER - 1
            return None
        reduction = math.ceil(math.sqrt(math.prod(frame.size) / _MAX_PIXELS))
        gray = _gray(frame, reduction)
        if min(gray.shape) < _MIN_SIDE:
            return None
        if self._reference is None:
            self._reference = gray
            return None
        before, now = _track_points(self._reference, gray)
        motion = _estimate_similarity(before, now)
        has_moved = motion is not None and _is_camera_motion(motion, before, now, gray.shape)
        self._reference_age += 1
        if has_moved or motion is None or self._reference_age >= _RENEWED_AFTER:
            self._reference, self._reference_age = gray, 0
        if motion is None or not has_moved:
            self._still_for = 0 if motion is None else self._still_for + 1
            return None
        self._still_for = 0
        motion[:2, 2] *= reduction
        return motion


def _gray(frame: Frame, reduction: int) -> NDArray[np.uint8]:
    """(h, w) reduced brightness of the frame; of a color image, its green channel."""
    # Not a view of the frame, which would be stored with it.
    size = [math.ceil(side / reduction) for side in frame.size]
    reduced = cv2.resize(frame.pixels, size, interpolation=cv2.INTER_AREA)
    return reduced if reduced.ndim == 2 else cv2.extractChannel(reduced, 1)


def _is_camera_motion(
    motion: NDArray[np.float64],
    before: NDArray[np.float32],
    now: NDArray[np.float32],
    shape: tuple[int, ...],
) -> bool:
    """Whether a (3, 3) similarity of (P, 2) points is the camera's, in images of (h, w)."""
    height, width = shape
    corners = np.array([[0, width, 0, width], [0, 0, height, height], [1, 1, 1, 1]], float)
    if np.abs(motion @ corners - corners).max() < _MOVES_ABOVE:
        return False
    has_stayed = np.hypot(*(now - before).T) < _STAYS_BELOW
    return bool(has_stayed.mean() < _MAX_STAYING_SHARE)


def _track_points(
    before: NDArray[np.uint8], now: NDArray[np.uint8]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Track points on a grid from one image to another, with sides of at least 16.

    Returns:
        (P, 2) tracked points, before and now; points on flat surfaces are missing.
    """
    height, width = before.shape
    x, y = np.meshgrid(np.arange(_GRID // 2, width, _GRID), np.arange(_GRID // 2, height, _GRID))
    points = np.stack([x, y], axis=-1).reshape(-1, 1, 2).astype(np.float32)
    if len(points) < _MIN_POINTS:
        return np.empty((0, 2), np.float32), np.empty((0, 2), np.float32)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        before, now, points, None, winSize=(15, 15), maxLevel=3, minEigThreshold=1e-3
    )
    tracked = status.ravel() == 1
    return points[tracked, 0], moved[tracked, 0]


def _estimate_similarity(
    before: NDArray[np.float32], now: NDArray[np.float32]
) -> NDArray[np.float64] | None:
    """(3, 3) similarity transform of most of (P, 2) points, from (x, y, 1) before to now.

    By RANSAC; moving objects are outliers. None with too few points or inliers.
    """
    if len(before) < _MIN_POINTS:
        return None
    matrix, inliers = cv2.estimateAffinePartial2D(before, now, ransacReprojThreshold=1.0)
    if matrix is None or inliers.mean() < _MIN_INLIER_SHARE:
        return None
    return np.vstack([matrix, [0.0, 0.0, 1.0]])
