"""Frames for the camera: a textured square that moves left and right over a textured image."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_SIDE, _STEP, _STEPS = 40, 3, 30
# (x, y, width, height) of the square in the first frame.
BOX = (100.0, 100.0, float(_SIDE), float(_SIDE))


def moving_square(width: int, height: int) -> list[NDArray[np.uint8]]:
    """(height, width, 3) frames, forth and back, so that the last suits the first."""
    generator = np.random.default_rng(0)
    ground = generator.integers(60, 120, (height, width, 3), dtype=np.uint8)
    ground = cv2.GaussianBlur(ground, (5, 5), 0.0)
    square = generator.integers(150, 255, (_SIDE, _SIDE, 3), dtype=np.uint8)
    x, y = int(BOX[0]), int(BOX[1])
    images = []
    for step in [*range(_STEPS), *range(_STEPS - 2, 0, -1)]:
        image = ground.copy()
        left = x + _STEP * step
        image[y : y + _SIDE, left : left + _SIDE] = square
        images.append(image)
    return images
