"""Family 7, Bayesian filter: a color particle filter whose particles search as a swarm.

After the prediction, each particle flies towards its own best place and that of all (particle swarm
optimization), so that few particles find the likelihood's peak. It ends in the best place that it
has seen, and the likelihood there is its weight. The color histograms are those of hue and
saturation, and of brightness where there is no color, of the upper and the lower half.

Sources: Perez, Hue, Vermaak, Gangnet 2002, "Color-based probabilistic tracking"; Kennedy, Eberhart
1995, "Particle swarm optimization".
"""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from color_image_tracker import Array, Image
from numpy.typing import NDArray

from tracker_families.family import FamilyTracker, box_around, center_of

_PARTICLES = 50
_FLIGHTS = 3
_INERTIA, _OWN_PULL, _COMMON_PULL = 0.5, 0.8, 0.8
_SHARPNESS = 20.0
# Standard deviations of the random walk: of the place in box sizes, of the logarithm of the scale.
_WALK = np.array([0.06, 0.06, 0.02])
_VELOCITY_RATE = 0.5
_SCALE_RANGE = np.log([0.4, 2.5])
# Squared Bhattacharyya distance from which on nothing looks like the target.
_FARTHEST = 0.5
_BINS = 10
_LABELS = _BINS * _BINS + _BINS
_LEAST_SATURATION, _LEAST_VALUE = 26, 51


class SwarmFilter(FamilyTracker):
    """Particles (x, y, logarithm of the scale), scored by color."""

    def _learn(self, image: Image, box: Array) -> None:
        self._generator = np.random.default_rng(self._seed)
        self._size = box[2:].copy()
        self._velocity = np.zeros(2)
        start = np.append(center_of(box), 0.0)
        self._particles = np.tile(start, (_PARTICLES, 1))
        self._reference = self._histogram(_labels(image), start)

    def _find(self, image: Image, box: Array) -> Array | None:
        labels = _labels(image)
        step = _WALK * np.append(box[2:], 1.0)
        walk = step * self._generator.standard_normal((_PARTICLES, 3))
        limit = np.array([image.shape[1], image.shape[0]], float)
        places = self._bounded(self._particles + np.append(self._velocity, 0.0) + walk, limit)
        places, scores = self._fly(labels, places, walk, limit)
        weights = np.exp(scores - scores.max())
        weights /= weights.sum()
        estimate = weights @ places
        if scores.max() < -_SHARPNESS * _FARTHEST:
            # Wait for it in a cloud around the last box.
            self._velocity *= 0.5
            self._particles = self._bounded(
                np.append(center_of(box), np.log(box[2] / self._size[0])) + 2.0 * walk, limit
            )
            return None
        moved = estimate[:2] - center_of(box)
        self._velocity += _VELOCITY_RATE * (moved - self._velocity)
        starts = (self._generator.random() + np.arange(_PARTICLES)) / _PARTICLES
        chosen = np.searchsorted(np.cumsum(weights), starts).clip(max=_PARTICLES - 1)
        self._particles = places[chosen]
        return box_around(estimate[:2], np.exp(estimate[2]) * self._size)

    def _fly(
        self, labels: Image, places: Array, velocities: Array, limit: Array
    ) -> tuple[Array, Array]:
        """Where the particles end and their log likelihoods."""
        scores = self._scores(labels, places)
        best, best_scores = places.copy(), scores.copy()
        for _ in range(_FLIGHTS):
            own, common = self._generator.random((2, _PARTICLES, 1))
            velocities = (
                _INERTIA * velocities
                + _OWN_PULL * own * (best - places)
                + _COMMON_PULL * common * (best[best_scores.argmax()] - places)
            )
            places = self._bounded(places + velocities, limit)
            scores = self._scores(labels, places)
            better = scores > best_scores
            best[better], best_scores[better] = places[better], scores[better]
        return best, best_scores

    def _bounded(self, places: Array, limit: Array) -> Array:
        low, high = np.append((0.0, 0.0), _SCALE_RANGE[0]), np.append(limit, _SCALE_RANGE[1])
        return np.clip(places, low, high)

    def _scores(self, labels: Image, places: Array) -> Array:
        """(particles,) log likelihoods: -sharpness times the squared Bhattacharyya distance."""
        histograms = np.array([self._histogram(labels, place) for place in places])
        similarity = np.sqrt(histograms * self._reference).sum(axis=1)
        return -_SHARPNESS * (1.0 - similarity)

    def _histogram(self, labels: Image, place: Array) -> NDArray[np.float32]:
        """(2 labels,) histogram of the upper and the lower half, summing to 1 each."""
        box = box_around(place[:2], np.exp(place[2]) * self._size)
        left, right = max(round(box[0]), 0), max(round(box[0] + box[2]), 0)
        rows = [max(round(box[1] + share * box[3]), 0) for share in (0.0, 0.5, 1.0)]
        halves = []
        for top, bottom in pairwise(rows):
            patch = labels[top:bottom, left:right]
            if patch.size:
                counts = cv2.calcHist([patch], [0], None, [_LABELS], [0, _LABELS]).ravel()
                halves.append(counts / (2.0 * patch.size))
            else:
                halves.append(np.zeros(_LABELS, np.float32))
        return np.concatenate(halves)


def _labels(image: Image) -> Image:
    """(H, W) which color each pixel has: hue and saturation, or brightness where there is none."""
    hue, saturation, value = cv2.split(cv2.cvtColor(image, cv2.COLOR_BGR2HSV))
    colors = (hue.astype(np.uint16) * _BINS // 180) * _BINS + saturation.astype(np.uint16) // 26
    colors = np.minimum(colors, _BINS * _BINS - 1)
    grays = _BINS * _BINS + value.astype(np.uint16) * _BINS // 256
    colorful = (saturation >= _LEAST_SATURATION) & (value >= _LEAST_VALUE)
    return np.where(colorful, colors, grays).astype(np.uint8)
