"""The color particle filter of tutorials: a loop over particles with a histogram for each."""

from __future__ import annotations

import cv2
import numpy as np
from color_image_tracker import Array, Box, Image
from numpy.typing import NDArray

from peer_trackers.peer import PeerTracker

_PARTICLES = 100
# Standard deviation of a step: of the center in sides of the box, of the scale in parts of it.
_POSITION_NOISE, _SCALE_NOISE = 0.1, 0.02
_SCALE_RANGE = (0.3, 4.0)
# exp(-20 d^2), as Perez et al. have it.
_SHARPNESS = 20.0
_BINS = (8, 8, 8)
_RANGES = (0, 180, 0, 256, 0, 256)


class ColorParticleFilter(PeerTracker):
    """100 particles in a random walk of center and scale, each with an HSV histogram.

    Histograms by `calcHist`, Bhattacharyya distance to that of the first frame by `compareHist`,
    the weighted mean as the estimate, multinomial resampling in each frame.

    Source: Perez et al. 2002, "Color-based probabilistic tracking".
    """

    name = "color particle filter"
    is_random = True

    def _learn(self, image: Image, box: Array) -> None:
        self._generator = np.random.default_rng(self._seed)
        x, y, width, height = box
        self._size = np.array([width, height])
        first = np.array([x + width / 2, y + height / 2, 1.0])
        self._states = np.tile(first, (_PARTICLES, 1))
        self._reference = self._histogram(cv2.cvtColor(image, cv2.COLOR_BGR2HSV), first)

    def _find(self, image: Image, box: Array) -> Box:
        hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
        self._predict(image.shape[1], image.shape[0])
        weights = np.empty(_PARTICLES)
        for index, state in enumerate(self._states):
            histogram = self._histogram(hsv, state)
            distance = cv2.compareHist(self._reference, histogram, cv2.HISTCMP_BHATTACHARYYA)
            weights[index] = np.exp(-_SHARPNESS * distance**2)
        weights /= weights.sum()
        x, y, scale = weights @ self._states
        drawn = self._generator.choice(_PARTICLES, _PARTICLES, p=weights)
        self._states = self._states[drawn]
        width, height = scale * self._size
        return float(x - width / 2), float(y - height / 2), float(width), float(height)

    def _predict(self, image_width: int, image_height: int) -> None:
        noise = np.array([*(_POSITION_NOISE * self._size), _SCALE_NOISE])
        self._states = self._states + noise * self._generator.standard_normal((_PARTICLES, 3))
        lowest = (0.0, 0.0, _SCALE_RANGE[0])
        highest = (image_width - 1.0, image_height - 1.0, _SCALE_RANGE[1])
        self._states = np.clip(self._states, lowest, highest)

    def _histogram(self, hsv: Image, state: NDArray[np.float64]) -> NDArray[np.float32]:
        """Of the pixels of a state's box; the box reaches at least one pixel of the image."""
        center, sides = state[:2], state[2] * self._size
        left, top = np.maximum(center - sides / 2, 0.0).astype(int)
        right, bottom = np.ceil(center + sides / 2).astype(int)
        patch = hsv[top:bottom, left:right]
        histogram = cv2.calcHist([patch], [0, 1, 2], None, _BINS, _RANGES)
        return cv2.normalize(histogram, None, 1.0, 0.0, cv2.NORM_L1)
