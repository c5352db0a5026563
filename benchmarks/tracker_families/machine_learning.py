"""Family 6, machine learning: an online classifier of target and background.

OpenCV's `TrackerMIL`: boosted Haar features, trained on bags of patches. It has no scale.

Source: Babenko, Yang, Belongie 2009, "Visual tracking with online multiple instance learning".
"""

from __future__ import annotations

import ctypes

import cv2
import numpy as np
from color_image_tracker import Array, Image

from tracker_families.family import FamilyTracker, box_around, center_of

_C_LIBRARY = ctypes.CDLL(None)
# In a box of a few pixels OpenCV looks for features that fit in without end.
_LEAST_SIDE = 8


class MultipleInstanceLearning(FamilyTracker):
    """OpenCV's tracker, on the part of the box that lies in the image, of 8 px a side at least."""

    def _learn(self, image: Image, box: Array) -> None:
        self._count = 0
        limit = np.array([image.shape[1], image.shape[0]])
        near = np.clip(np.rint(box[:2]), 0, limit - 2).astype(int)
        far = np.clip(np.rint(box[:2] + box[2:]), near + 2, limit).astype(int)
        size = np.minimum(np.maximum(far - near, _LEAST_SIDE), limit)
        near = np.clip(near - (size - (far - near)) // 2, 0, limit - size)
        far = near + size
        self._shift = center_of(box) - (near + far) / 2
        self._reseed()
        self._tracker = cv2.TrackerMIL_create()
        width, height = size
        self._tracker.init(image, (int(near[0]), int(near[1]), int(width), int(height)))

    def _find(self, image: Image, box: Array) -> Array | None:
        self._reseed()
        found, (x, y, width, height) = self._tracker.update(image)
        if not found:
            return None
        return box_around((x + width / 2, y + height / 2) + self._shift, box[2:])

    def _reseed(self) -> None:
        """Seed anew what OpenCV draws from, which trackers that run side by side share.

        Samples come from OpenCV's own generator, features from the C library's.
        """
        seed = self._seed * 65536 + self._count
        cv2.setRNGSeed(seed % 2**31)
        _C_LIBRARY.srand(seed % 2**31)
        self._count += 1
