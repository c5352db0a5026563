"""The motion of the whole image from one frame to the next, as a moving camera causes it."""

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

    Points on a grid are followed by pyramidal Lucas-Kanade; the similarity that most of them agree
    on is the camera's, and the others belong to what moves in the scene.

    Args:
        gray: (h, w) uint8 first frame, both sides at least 16.
    """

    def __init__(self, gray: NDArray[np.uint8]) -> None:
        self._previous = gray
        height, width = gray.shape
        x, y = np.meshgrid(
            np.arange(_GRID // 2, width, _GRID), np.arange(_GRID // 2, height, _GRID)
        )
        self._points = np.stack([x, y], axis=-1).reshape(-1, 1, 2).astype(np.float32)

    def update(self, gray: NDArray[np.uint8]) -> NDArray[np.float64] | None:
        """Take the next frame.

        Args:
            gray: (h, w) uint8, of the first frame's size.

        Returns:
            (3, 3) matrix that takes (x, y, 1) of the frame before to this one; None where too few
            points could be followed or they do not agree on one motion.
        """
        previous, self._previous = self._previous, gray
        if len(self._points) < _LEAST_POINTS:
            return None
        moved, found, _ = cv2.calcOpticalFlowPyrLK(
            previous, gray, self._points, None, winSize=(15, 15), maxLevel=3, minEigThreshold=1e-3
        )
        known = found.ravel() == 1
        if known.sum() < _LEAST_POINTS:
            return None
        matrix, inliers = cv2.estimateAffinePartial2D(
            self._points[known], moved[known], ransacReprojThreshold=1.0
        )
        if matrix is None or inliers.mean() < _LEAST_AGREEMENT:
            return None
        return np.vstack([matrix, [0.0, 0.0, 1.0]])
