"""Base class of the families: limits of the box, cropping and template matching."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from color_image_tracker import Array, Box, ColorImageTracker, Image
from numpy.typing import ArrayLike, NDArray

# Bounds of a box's width and height, over those it was started with.
_SIZE_RANGE = (0.3, 4.0)


class FamilyTracker(ColorImageTracker):
    """Follows one target by the means of one family.

    Whatever it finds, the box's center stays in the image and its size between 0.3 and 4 times the
    first. The same seed and images give the same boxes.
    """

    def start(self, image: NDArray[Any], box: ArrayLike) -> Box:
        """See `ColorImageTracker.start`."""
        first = super().start(image, box)
        self._first_size = np.array(first[2:])
        return first

    def _limited(self, box: Array, image: Image) -> Array:
        image_size = np.array([image.shape[1], image.shape[0]], float)
        least = np.minimum(np.maximum(_SIZE_RANGE[0] * self._first_size, 4.0), self._first_size)
        most = np.minimum(_SIZE_RANGE[1] * self._first_size, image_size)
        size = np.clip(box[2:], least, most)
        return box_around(np.clip(center_of(box), 0.0, image_size), size)


def center_of(box: Array) -> Array:
    """(x, y) of a box's center."""
    return box[:2] + box[2:] / 2


def box_around(center: ArrayLike, size: ArrayLike) -> Array:
    """The box of a size, (width, height), around a center, (x, y)."""
    sides = np.asarray(size, float)
    return np.concatenate([np.asarray(center, float) - sides / 2, sides])


def to_gray(image: Image) -> Image:
    """(H, W) brightness of a (H, W, 3) image."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def resample(image: NDArray[Any], box: Array, size: tuple[int, int]) -> NDArray[Any]:
    """What a box shows, as an image of (width, height) pixels.

    The corner of the first pixel is (0, 0). Where the box juts out, the image's border goes on.
    """
    scale = box[2:] / np.asarray(size, float)
    # A pixel's index is its center, half a pixel from its corner.
    start = box[:2] + scale / 2 - 0.5
    transform = np.array([[scale[0], 0.0, start[0]], [0.0, scale[1], start[1]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(image, transform, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)


def working_size(box: Array, side: float) -> tuple[int, int]:
    """(width, height) in whole pixels of a box reduced to the area of a square of `side`.

    A smaller box keeps its size; neither side is below 4.
    """
    reduction = max(np.sqrt(box[2] * box[3]) / side, 1.0)
    width, height = np.maximum(np.rint(box[2:] / reduction), 4).astype(int)
    return int(width), int(height)


def nearest_match(window: NDArray[Any], template: NDArray[Any], calm: float) -> tuple[Array, float]:
    """Where a template matches best in a window, among equals the nearest to its middle.

    Channels are matched one by one and count alike. The correlation must be better by `calm` at the
    window's border than in its middle.

    Returns:
        (x, y) of the template's corner in fractions of a pixel, and the normalized correlation
        there, -1 to 1.
    """
    planes = zip(cv2.split(window), cv2.split(template), strict=True)
    responses = [cv2.matchTemplate(*pair, cv2.TM_CCOEFF_NORMED) for pair in planes]
    # Where the window is flat the correlation is not defined.
    response = np.nan_to_num(np.mean(responses, axis=0), posinf=0.0, neginf=0.0)
    rows, columns = (np.linspace(-1.0, 1.0, side) for side in response.shape)
    away = calm * (rows[:, None] ** 2 + columns**2)
    place, score = peak_of(response - away)
    column, row = np.rint(place).astype(int)
    return place, score + float(away[row, column])


def peak_of(response: NDArray[Any]) -> tuple[Array, float]:
    """Where a map is highest, (x, y) in fractions of a pixel, and how high it is there."""
    _, value, _, (column, row) = cv2.minMaxLoc(response)
    shift = np.zeros(2)
    for axis, (line, place) in enumerate(((response[row], column), (response[:, column], row))):
        if 0 < place < len(line) - 1:
            before, after = float(line[place - 1]), float(line[place + 1])
            bend = before + after - 2 * value
            # The parabola through the three highest values.
            shift[axis] = np.clip((before - after) / (2 * bend), -0.5, 0.5) if bend < 0 else 0.0
    return np.array([column, row]) + shift, float(value)
