"""The measurement of Li et al. 2007 as a loop over particles with OpenCV, as in tutorials."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_RANGES = [0, 256] * 3
_CELLS, _DIRECTIONS = 4, 8


class ParticleLoop:
    """The measurement of Li et al. 2007 for one particle after the other.

    Args:
        image: (H, W, 3) uint8 BGR to take the template from.
        box: (x, y, side, side) of the target in whole pixels.
    """

    def __init__(self, image: NDArray[np.uint8], box: tuple[int, int, int, int]) -> None:
        x, y, side, _ = box
        grid = (np.arange(side) + 0.5) / side - 0.5
        gaussian = np.exp(-0.5 * np.square(grid / 0.5))
        self._gaussian = (gaussian[:, None] * gaussian).astype(np.float32)
        cell = np.arange(side) * _CELLS // side
        self._first_bin = (cell[:, None] * _CELLS + cell) * _DIRECTIONS
        self._side = side
        patch = image[y : y + side, x : x + side]
        self._histogram = self._color(patch)
        self._vector = self._texture(cv2.cvtColor(patch, cv2.COLOR_BGR2GRAY))

    def weights(self, image: NDArray[np.uint8], corners: NDArray[np.intp]) -> NDArray[np.float64]:
        """(N,) normalized weights of boxes with these (N, 2) top-left corners."""
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        log_likelihood = np.empty(len(corners))
        side = self._side
        for index, (x, y) in enumerate(corners):
            patch = image[y : y + side, x : x + side]
            distance = cv2.compareHist(
                self._color(patch), self._histogram, cv2.HISTCMP_BHATTACHARYYA
            )
            offset = self._texture(gray[y : y + side, x : x + side]) - self._vector
            log_likelihood[index] = -0.6 * 30.0 * distance**2 - 0.4 * 10.0 * (offset @ offset)
        weights = np.exp(log_likelihood - log_likelihood.max())
        return weights / weights.sum()

    def _color(self, patch: NDArray[np.uint8]) -> NDArray[np.float32]:
        histogram = cv2.calcHist([patch], [0, 1, 2], None, [16, 16, 16], _RANGES)
        return histogram / patch[..., 0].size

    def _texture(self, patch: NDArray[np.uint8]) -> NDArray[np.float64]:
        right = cv2.Sobel(patch, cv2.CV_32F, 1, 0, ksize=1)
        down = cv2.Sobel(patch, cv2.CV_32F, 0, 1, ksize=1)
        magnitude, angle = cv2.cartToPolar(right, down)
        direction = (angle * (_DIRECTIONS / (2 * np.pi))).astype(np.intp) % _DIRECTIONS
        vector = np.bincount(
            (self._first_bin + direction).ravel(),
            (magnitude * self._gaussian).ravel(),
            _CELLS**2 * _DIRECTIONS,
        )
        return vector / max(float(np.linalg.norm(vector)), 1e-9)
