"""Family 2, region matching: a template of brightness and edges is searched near the last box.

Both are matched by normalized cross-correlation at three sizes. The template changes slowly, where
it matches well.
"""

from __future__ import annotations

import cv2
import numpy as np
from color_image_tracker import Array, Image
from numpy.typing import NDArray

from tracker_families.family import (
    FamilyTracker,
    box_around,
    center_of,
    nearest_match,
    resample,
    to_gray,
    working_size,
)

_SIDE = 40.0
_SCALES = (1.0, 0.96, 1.04)
# A change of size must match better than none by this factor.
_CHANGE_OF_SCALE = 0.97
_REACH = 0.6
_LEAST_REACH = 16.0
_CALM = 0.3
_FOUND = 0.4
_TRUSTED = 0.65
_RATE = 0.02
_FLAT = 2.0

Channels = NDArray[np.float32]


class TemplateMatching(FamilyTracker):
    """Searches where brightness and edges correlate best with the target's."""

    def _learn(self, image: Image, box: Array) -> None:
        self._size = working_size(box, _SIDE)
        self._template = _channels(resample(to_gray(image), box, self._size))

    def _find(self, image: Image, box: Array) -> Array | None:
        gray = to_gray(image)
        best, highest = None, _FOUND
        for scale in _SCALES:
            found, score = self._match(gray, box_around(center_of(box), scale * box[2:]))
            score *= 1.0 if scale == 1.0 else _CHANGE_OF_SCALE
            if score > highest:
                best, highest = found, score
        if best is not None and highest > _TRUSTED:
            seen = _channels(resample(gray, best, self._size))
            self._template += _RATE * (seen - self._template)
        return best

    def _match(self, gray: Image, box: Array) -> tuple[Array, float]:
        """The best place for a box of this size, and the correlation there, -1 to 1."""
        pixel = box[2:] / self._size
        reach = np.ceil(max(_REACH * np.sqrt(box[2] * box[3]), _LEAST_REACH) / pixel)
        width, height = (self._size + 2 * reach).astype(int).tolist()
        region = box_around(center_of(box), (width, height) * pixel)
        window = resample(gray, region, (width, height))
        if window.std() < _FLAT:
            return box, -1.0
        place, score = nearest_match(_channels(window), self._template, _CALM)
        return np.concatenate([region[:2] + place * pixel, box[2:]]), score


def _channels(gray: Image) -> Channels:
    """(H, W, 2): brightness and strength of edges."""
    right = cv2.Sobel(gray, cv2.CV_32F, 1, 0)
    down = cv2.Sobel(gray, cv2.CV_32F, 0, 1)
    # Not by cv2.magnitude, whose last bit hangs on where in memory the arrays lie.
    return np.dstack([gray.astype(np.float32), np.sqrt(right**2 + down**2)])
