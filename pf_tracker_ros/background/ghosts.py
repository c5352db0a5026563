"""Ghosts: foreground where nothing is, since the background model has learned what has left.

Whoever is in the first image is learned as background, and what was behind them then differs from
it for as long as ViBe takes to spread into it from the sides.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

# By so much the outline has to be clearer in the model than in the image: as a factor, and beyond
# that in gray levels.
_CLEARER, _BY_LEVELS = 1.5, 5.0
# Outlines are looked for in so many pixels around each: masks end beside them.
_AROUND = np.ones((5, 5), np.uint8)
_NEIGHBORS = np.ones((3, 3), np.uint8)


def find_ghosts(
    foreground: NDArray[np.uint8], now: NDArray[np.uint8], known: NDArray[np.uint8]
) -> NDArray[np.bool_]:
    """(h, w) the parts of the foreground whose outline is in the model, and not in the image.

    Args:
        foreground: (h, w) 0 for background.
        now: (h, w) brightness of the image.
        known: (h, w) that of the background, as the model has it.
    """
    count, labels = cv2.connectedComponents(foreground, connectivity=4)
    outline = foreground > cv2.erode(foreground, _NEIGHBORS)
    part = labels[outline]
    in_model, in_image = (
        np.bincount(part, _steps(brightness)[outline], count) for brightness in (known, now)
    )
    is_ghost = in_model > _CLEARER * in_image + _BY_LEVELS * np.bincount(part, minlength=count)
    is_ghost[0] = False
    found: NDArray[np.bool_] = is_ghost[labels]
    return found


def _steps(brightness: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, w) the largest difference of brightness around each pixel, noise averaged away."""
    return cv2.morphologyEx(cv2.blur(brightness, (3, 3)), cv2.MORPH_GRADIENT, _AROUND)
