"""The motion of the whole image from one frame to another, as a moving camera causes it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

# Points are followed on a grid, this many pixels apart, so that they cover the image evenly.
_GRID = 24
# Flat surfaces cannot be followed; with fewer points or less agreement there is no one motion.
_LEAST_POINTS = 12
_LEAST_AGREEMENT = 0.5


class CameraMotion:
    """Estimates shift, rotation and zoom between consecutive frames.

    See `follow_points` and `agreed_motion`.

    Args:
        gray: (h, w) uint8 first frame, both sides at least 16.
    """

    def __init__(self, gray: NDArray[np.uint8]) -> None:
        self._previous = gray

    def update(self, gray: NDArray[np.uint8]) -> NDArray[np.float64] | None:
        """Take the next frame.

        Args:
            gray: (h, w) uint8, of the first frame's size.

        Returns:
            (3, 3) matrix that takes (x, y, 1) of the frame before to this one; None where too few
            points could be followed or they do not agree on one motion.
        """
        previous, self._previous = self._previous, gray
        return agreed_motion(*follow_points(previous, gray))


def follow_points(
    before: NDArray[np.uint8], now: NDArray[np.uint8]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Where points on a grid have gone, by pyramidal Lucas-Kanade.

    Args:
        before: (h, w) image, both sides at least 16.
        now: Another one of the same size.

    Returns:
        (P, 2) places of those that could be followed, before and now; flat surfaces cannot.
    """
    height, width = before.shape
    x, y = np.meshgrid(np.arange(_GRID // 2, width, _GRID), np.arange(_GRID // 2, height, _GRID))
    points = np.stack([x, y], axis=-1).reshape(-1, 1, 2).astype(np.float32)
    if len(points) < _LEAST_POINTS:
        return np.empty((0, 2), np.float32), np.empty((0, 2), np.float32)
    moved, found, _ = cv2.calcOpticalFlowPyrLK(
        before, now, points, None, winSize=(15, 15), maxLevel=3, minEigThreshold=1e-3
    )
    known = found.ravel() == 1
    return points[known, 0], moved[known, 0]


def agreed_motion(
    before: NDArray[np.float32], now: NDArray[np.float32]
) -> NDArray[np.float64] | None:
    """The similarity that most points agree on; the others belong to what moves in the scene.

    Args:
        before: (P, 2) places.
        now: (P, 2) places of the same points later.

    Returns:
        (3, 3) matrix that takes (x, y, 1) of before to now; None where the points are too few or do
        not agree.
    """
    if len(before) < _LEAST_POINTS:
        return None
    matrix, inliers = cv2.estimateAffinePartial2D(before, now, ransacReprojThreshold=1.0)
    if matrix is None or inliers.mean() < _LEAST_AGREEMENT:
        return None
    return np.vstack([matrix, [0.0, 0.0, 1.0]])
