"""Family 1, contrast with the background: detection by a mixture of Gaussians per pixel.

OpenCV's MOG2 tells foreground from background, the difference of images takes out of it what does
not move: ghosts left where something stood in the first image. The foreground near where a Kalman
filter expects the target is the target. Nothing is known of what the target looks like, so people
who meet are confused; with a moving camera all is foreground, and the box only coasts.

Source of the model: Zivkovic 2004, "Improved adaptive Gaussian mixture model for background
subtraction".
"""

from __future__ import annotations

import cv2
import numpy as np
from color_image_tracker import Array, Image
from numpy.typing import NDArray

from tracker_families.family import FamilyTracker, box_around, center_of, to_gray

_HISTORY = 300
# Squared distance from a Gaussian, in variances, from which on a pixel is foreground.
_VARIANCES = 16.0
# Share of a pixel's time that its background's Gaussians take up.
_BACKGROUND_SHARE = 0.7
# Brightness over the background's below which a pixel is a dark coat and no shadow.
_DARKEST_SHADOW = 0.7
_LEARNING_RATE = 0.004
_FOREGROUND = 255
# More foreground than this share of the image is the camera's motion or a change of the light.
_MOST_FOREGROUND = 0.5
_LEAST_FILLED = 0.08
# Sizes of a detection over the target's within which it is the target alone and whole.
_WHOLE = (0.5, 1.5)
_SIZE_RATE = 0.1
# Gray levels between two images that are motion, and the frames for which it is remembered.
_MOVED = 7
_FRAMES_REMEMBERED = 3
_VELOCITY_KEPT = 0.95


class GaussianMixture(FamilyTracker):
    """Detects the moving foreground and follows the part that is the target's."""

    def _learn(self, image: Image, box: Array) -> None:
        self._model = cv2.createBackgroundSubtractorMOG2(_HISTORY, _VARIANCES, True)
        self._model.setBackgroundRatio(_BACKGROUND_SHARE)
        self._model.setShadowThreshold(_DARKEST_SHADOW)
        # The target would be taken for background, and leave a ghost when it goes.
        self._model.apply(_without(image, box))
        self._before = cv2.GaussianBlur(to_gray(image), (5, 5), 0)
        self._moved = np.zeros(image.shape[:2], np.uint8)
        self._motion = _kalman_filter(center_of(box), float(box[2:].mean()))

    def _find(self, image: Image, box: Array) -> Array:
        labels = self._model.apply(image, learningRate=_LEARNING_RATE)
        mask = np.where(labels == _FOREGROUND, 255, 0).astype(np.uint8)
        mask = cv2.medianBlur(mask, 3)
        gap = max(int(0.1 * box[2:].min()), 1) | 1
        moving = self._moving(image, 2 * gap)
        expected = box_around(self._motion.predict()[:2, 0], box[2:])
        if np.count_nonzero(mask) > _MOST_FOREGROUND * mask.size:
            return expected
        closing = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (gap, gap))
        mask = cv2.morphologyEx(mask & moving, cv2.MORPH_CLOSE, closing)
        found = _whole_detection(mask, expected)
        if found is None:
            found = _densest_place(mask, expected)
        if found is None:
            return expected
        self._motion.correct(center_of(found).astype(np.float32)[:, None])
        size = box[2:] + _SIZE_RATE * (found[2:] - box[2:])
        return box_around(self._motion.statePost[:2, 0], size)

    def _moving(self, image: Image, reach: int) -> Image:
        """255 within `reach` pixels of where something moved of late, 0 elsewhere."""
        gray = cv2.GaussianBlur(to_gray(image), (5, 5), 0)
        _, moved = cv2.threshold(cv2.absdiff(gray, self._before), _MOVED, 255, cv2.THRESH_BINARY)
        self._before = gray
        self._moved = cv2.max(moved, cv2.subtract(self._moved, 255 // _FRAMES_REMEMBERED))
        wide = cv2.dilate(self._moved, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
        return cv2.threshold(wide, 0, 255, cv2.THRESH_BINARY)[1]


def _whole_detection(mask: Image, expected: Array) -> Array | None:
    """The box of the foreground's parts at the expected box, if it is about as large."""
    _, _, stats, centers = cv2.connectedComponentsWithStats(mask)
    near = (np.abs(centers - center_of(expected)) < 0.65 * expected[2:]).all(axis=1)
    large = stats[:, cv2.CC_STAT_AREA] > 0.03 * expected[2] * expected[3]
    # The first component is the background.
    parts = stats[1:][(near & large)[1:]].astype(float)
    if not len(parts):
        return None
    start = parts[:, :2].min(axis=0)
    size = (parts[:, :2] + parts[:, 2:4]).max(axis=0) - start
    ratio = size / expected[2:]
    if (ratio < _WHOLE[0]).any() or (ratio > _WHOLE[1]).any():
        return None
    return np.concatenate([start, size])


def _densest_place(mask: Image, expected: Array) -> Array | None:
    """The expected box moved uphill to where it holds most foreground."""
    height, width = mask.shape
    corner, size = np.rint(expected[:2]).astype(int), np.rint(expected[2:]).astype(int)
    corner = np.clip(corner, 0, np.maximum(np.array([width, height]) - size, 0))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 1.0)
    window = (int(corner[0]), int(corner[1]), int(size[0]), int(size[1]))
    _, (x, y, wide, tall) = cv2.meanShift(mask, window, criteria)
    filled = np.count_nonzero(mask[y : y + tall, x : x + wide]) / max(wide * tall, 1)
    if filled < _LEAST_FILLED:
        return None
    return box_around((x + wide / 2, y + tall / 2), expected[2:])


def _without(image: Image, box: Array) -> Image:
    """The image with what surrounds the box continued into it."""
    mask = np.zeros(image.shape[:2], np.uint8)
    corner = np.floor(box[:2]).astype(int)
    far = np.ceil(box[:2] + box[2:]).astype(int)
    mask[max(corner[1], 0) : max(far[1], 0), max(corner[0], 0) : max(far[0], 0)] = 255
    return cv2.inpaint(image, mask, 3, cv2.INPAINT_TELEA) if not mask.all() else image


def _kalman_filter(center: Array, size: float) -> cv2.KalmanFilter:
    """Position and velocity of the target; the velocity fades, so that a coasting box stops."""
    motion = cv2.KalmanFilter(4, 2)
    transition = np.eye(4)
    transition[[0, 1], [2, 3]] = 1.0
    transition[[2, 3], [2, 3]] = _VELOCITY_KEPT
    motion.transitionMatrix = _single(transition)
    motion.measurementMatrix = _single(np.eye(2, 4))
    motion.processNoiseCov = _single(np.diag([0.02, 0.02, 0.01, 0.01]) ** 2 * size**2)
    motion.measurementNoiseCov = _single(np.eye(2) * (0.05 * size) ** 2)
    motion.errorCovPost = _single(np.diag([0.02, 0.02, 0.1, 0.1]) ** 2 * size**2)
    motion.statePost = _single(np.array([[center[0]], [center[1]], [0.0], [0.0]]))
    return motion


def _single(array: Array) -> NDArray[np.float32]:
    return array.astype(np.float32)
