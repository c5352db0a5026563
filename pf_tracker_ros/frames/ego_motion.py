"""How the camera itself moves, as its images tell."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames.frame import Frame

# Pixels of the reduced images that are compared, and the least side that they may have.
_MOST_PIXELS = 384 * 288
_LEAST_SIDE = 16
# Points are followed on a grid, this many pixels apart, so that they cover the image evenly.
_GRID = 24
# Flat surfaces cannot be followed; with fewer points or less agreement there is no one motion.
_LEAST_POINTS = 12
_LEAST_AGREEMENT = 0.5
# A point that moves by less has stayed, and a camera that moves every corner by less has: pixels of
# the reduced image. With so many points that have stayed, it is the scene that moves.
_STAYS_BELOW, _MOVES_ABOVE, _STAYING = 0.2, 0.3, 0.3
# Comparisons after which a camera that stands still is compared with a new image, and after which
# only every other frame is compared: following the points takes as long as a third of a target.
_RENEWED_AFTER, _TRUSTED_AFTER = 10, 10


class EgoMotion:
    """Tells the motion of the camera from that of the scene.

    While the camera stands still, images are compared with the same one for some frames, so that a
    slow motion adds up until it is seen; after a while in every other frame only. Where something
    large moves before a still camera, most of the image may move: the camera has moved only if
    hardly anything has stayed.
    """

    def __init__(self) -> None:
        self._known: NDArray[np.uint8] | None = None
        self._age = 0
        self._still_for = 0

    def update(self, frame: Frame) -> NDArray[np.float64] | None:
        """Take the next frame, of the size of those before.

        Returns:
            (3, 3) similarity that takes (x, y, 1), pixels, from where the still part of the scene
            was seen before to where it is seen now; None where the camera stands still, moves by
            too little so far, which a later frame then tells as well, or nobody knows.
        """
        if self._still_for >= _TRUSTED_AFTER:
            self._still_for = _TRUSTED_AFTER - 1
            return None
        reduction = math.ceil(math.sqrt(math.prod(frame.size) / _MOST_PIXELS))
        gray = _gray(frame, reduction)
        if min(gray.shape) < _LEAST_SIDE:
            return None
        if self._known is None:
            self._known = gray
            return None
        before, now = _follow_points(self._known, gray)
        motion = _agreed_motion(before, now)
        has_moved = motion is not None and _is_of_camera(motion, before, now, gray.shape)
        self._age += 1
        if has_moved or motion is None or self._age >= _RENEWED_AFTER:
            self._known, self._age = gray, 0
        if motion is None or not has_moved:
            self._still_for = 0 if motion is None else self._still_for + 1
            return None
        self._still_for = 0
        motion[:2, 2] *= reduction
        return motion


def _gray(frame: Frame, reduction: int) -> NDArray[np.uint8]:
    """(h, w) the frame, reduced; green is brightness enough to follow points."""
    # Not a view of the frame, which would keep it for as long as the frame is kept.
    size = [math.ceil(side / reduction) for side in frame.size]
    reduced = cv2.resize(frame.pixels, size, interpolation=cv2.INTER_AREA)
    return reduced if reduced.ndim == 2 else cv2.extractChannel(reduced, 1)


def _is_of_camera(
    motion: NDArray[np.float64],
    before: NDArray[np.float32],
    now: NDArray[np.float32],
    shape: tuple[int, ...],
) -> bool:
    """Whether a motion on which points agree is the camera's.

    Args:
        motion: (3, 3) matrix.
        before: (P, 2) the points' places.
        now: (P, 2) where they are.
        shape: (h, w) of the image.
    """
    height, width = shape
    corners = np.array([[0, width, 0, width], [0, 0, height, height], [1, 1, 1, 1]], float)
    if np.abs(motion @ corners - corners).max() < _MOVES_ABOVE:
        return False
    has_stayed = np.hypot(*(now - before).T) < _STAYS_BELOW
    return bool(has_stayed.mean() < _STAYING)


def _follow_points(
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


def _agreed_motion(
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
