"""Ghosts: foreground without an object.

An object in the first image is learned as background. When it leaves, the true background differs
from the model and counts as foreground, until ViBe has spread into it from the sides.

A ghost has its outline in the model and not in the image; a real object has it the other way round.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

# The outline's contrast in the model must exceed this factor times that in the image, plus levels.
_MIN_FACTOR, _MIN_LEVELS = 1.5, 5.0
# Neighborhood of the contrast: a mask's outline is not exact.
_AROUND = np.ones((5, 5), np.uint8)
_NEIGHBORS = np.ones((3, 3), np.uint8)


def find_ghosts(
    foreground: NDArray[np.uint8], image: NDArray[np.uint8], background: NDArray[np.uint8]
) -> NDArray[np.bool_]:
    """(h, w) mask of the ghosts in an (h, w) foreground mask, 0 for background.

    Image and background model are given by their (h, w) brightness.
    """
    count, labels = cv2.connectedComponents(foreground, connectivity=4)
    outline = foreground > cv2.erode(foreground, _NEIGHBORS)
    part = labels[outline]
    in_model, in_image = (
        np.bincount(part, _contrast(brightness)[outline], count)
        for brightness in (background, image)
    )
    is_ghost = in_model > _MIN_FACTOR * in_image + _MIN_LEVELS * np.bincount(part, minlength=count)
    is_ghost[0] = False
    return is_ghost[labels]


def _contrast(brightness: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, w) largest difference of smoothed brightness around each pixel."""
    return cv2.morphologyEx(cv2.blur(brightness, (3, 3)), cv2.MORPH_GRADIENT, _AROUND)
