"""Family 3, feature points: corners in the box are tracked by pyramidal Lucas-Kanade (KLT).

Points that do not come back to where they were when tracked backward are dropped, and those that do
not go along with the others, as points of the background in the box. The median motion moves the
box, the median change of the points' distances scales it; lost points are replaced.

Sources: Shi, Tomasi 1994, "Good features to track"; Kalal, Mikolajczyk, Matas 2010,
"Forward-backward error: automatic detection of tracking failures" (median flow).
"""

from __future__ import annotations

import cv2
import numpy as np
from color_image_tracker import Array, Image
from numpy.typing import NDArray

from tracker_families.family import FamilyTracker, box_around, center_of, to_gray

_POINTS = 60
_GRID = 7
_INNER = 0.7
_LEAST_POINTS = 5
# Median forward-backward error in pixels above which the target is taken for hidden.
_WORST_ERROR = 10.0
_GOOD_ERROR = 0.5
# How far a point may move otherwise than the median in one frame, over the box's smaller side.
_STRAYING = 0.03
_SCALE_PER_FRAME = 1.08


class FeaturePoints(FamilyTracker):
    """Moves the box with the points in it."""

    def _learn(self, image: Image, box: Array) -> None:
        self._before = to_gray(image)
        self._points = _points_in(self._before, box)

    def _find(self, image: Image, box: Array) -> Array | None:
        before, now = self._before, to_gray(image)
        self._before = now
        points = self._points
        if len(points) < _LEAST_POINTS:
            self._points = _points_in(now, box)
            return None
        window = int(np.clip(box[2:].min() / 2, 9, 21)) | 1
        options = {"winSize": (window, window), "maxLevel": 3}
        moved, there, _ = cv2.calcOpticalFlowPyrLK(before, now, points, None, **options)
        returned, back, _ = cv2.calcOpticalFlowPyrLK(now, before, moved, None, **options)
        known = (there == 1).ravel() & (back == 1).ravel()
        error = np.linalg.norm(returned - points, axis=-1).ravel()
        if known.sum() < _LEAST_POINTS or np.median(error[known]) > _WORST_ERROR:
            # Hidden: the points are sought anew where they were.
            self._points = _points_in(now, box)
            return None
        known &= error <= max(float(np.median(error[known])), _GOOD_ERROR)
        start, end = points[known, 0].astype(float), moved[known, 0].astype(float)
        middle = np.median(end - start, axis=0)
        found = box_around(center_of(box) + middle, _change_of_scale(start, end) * box[2:])
        self._points = self._kept(now, found, end, np.abs(end - start - middle).max(axis=1))
        return found

    def _kept(self, gray: Image, box: Array, points: Array, strayed: Array) -> NDArray[np.float32]:
        """The points that stay with the target, and others for those that do not."""
        tolerance = max(_STRAYING * float(box[2:].min()), float(np.median(strayed)))
        inside = (np.abs(points - center_of(box)) < box[2:] / 2).all(axis=1)
        kept = points[inside & (strayed <= tolerance)].astype(np.float32)[:, None]
        if len(kept) >= _POINTS // 2:
            return kept
        return np.concatenate([kept, _points_in(gray, box)])


def _points_in(gray: Image, box: Array) -> NDArray[np.float32]:
    """(points, 1, 2) corners in the inner part of a box, or a grid where there are few."""
    inner = box_around(center_of(box), _INNER * box[2:])
    limit = np.array([gray.shape[1], gray.shape[0]])
    near = np.clip(np.rint(inner[:2]), 0, limit).astype(int)
    far = np.clip(np.rint(inner[:2] + inner[2:]), 0, limit).astype(int)
    if (far - near < 3).any():
        return np.empty((0, 1, 2), np.float32)
    patch = np.ascontiguousarray(gray[near[1] : far[1], near[0] : far[0]])
    spacing = max(np.sqrt(patch.size / _POINTS) / 2, 2.0)
    corners = cv2.goodFeaturesToTrack(patch, _POINTS, 0.01, spacing)
    if corners is not None and len(corners) >= 2 * _LEAST_POINTS:
        return (corners + near).astype(np.float32)
    columns, rows = (np.linspace(near[axis], far[axis] - 1, _GRID) for axis in (0, 1))
    grid = np.stack(np.meshgrid(columns, rows), axis=-1)
    return grid.reshape(-1, 1, 2).astype(np.float32)


def _change_of_scale(start: Array, end: Array) -> float:
    """Median, over pairs of points, of their distance in the end over that at the start."""
    first, second = np.triu_indices(len(start), 1)
    distances = np.linalg.norm(start[first] - start[second], axis=1)
    apart = distances > 1.0
    if not apart.any():
        return 1.0
    stretched = np.linalg.norm(end[first] - end[second], axis=1)[apart] / distances[apart]
    return float(np.clip(np.median(stretched), 1 / _SCALE_PER_FRAME, _SCALE_PER_FRAME))
