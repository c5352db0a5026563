"""What all families share: the interface, and the rules for the box."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.tracking.image import check_box, check_image, gray_range, to_8_bit

Image = NDArray[np.uint8]
Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

# Bounds of a box's width and height, over those it was started with.
_SIZE_RANGE = (0.3, 4.0)


class FamilyTracker(ABC):
    """Follows one target by the means of one family.

    A family learns the target from the first image and finds it in each later one. A frame in which
    it finds nothing keeps the last box. Whatever it finds, the box's center stays in the image and
    its size between 0.3 and 4 times the first. The same seed and images give the same boxes.

    Args:
        seed: Seed of everything random.
    """

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed

    def start(self, image: NDArray[Any], box: ArrayLike) -> Box:
        """Take a target.

        Args:
            image: (H, W, 3) uint8 BGR, (H, W) uint8 or (H, W) uint16.
            box: (x, y, width, height) in pixels, its center in the image.

        Raises:
            ValueError: The image or the box is not usable.
        """
        check_image(image)
        self._box = np.array(check_box(box, (image.shape[1], image.shape[0])))
        self._shape = image.shape
        self._gray_range = gray_range(image)
        self._first_size = self._box[2:].copy()
        self._learn(self._color(image), self._box.copy())
        return self._answer()

    def update(self, image: NDArray[Any]) -> Box:
        """The target's box in the next image, of the same size and kind as the first.

        Raises:
            ValueError: The image is not usable or of another size or kind.
        """
        check_image(image)
        if image.shape != self._shape:
            raise ValueError(f"image is {image.shape}; allowed: as the first one, {self._shape}")
        color = self._color(image)
        found = self._find(color, self._box.copy())
        if found is not None and np.isfinite(found).all():
            self._box = self._within_reach(found, color)
        return self._answer()

    @abstractmethod
    def _learn(self, image: Image, box: Array) -> None:
        """Learn the target from the first image, (H, W, 3), where it has the box, (4,)."""

    @abstractmethod
    def _find(self, image: Image, box: Array) -> Array | None:
        """The target's box in an image where it was before in `box`; None if it is not found."""

    def _color(self, image: NDArray[Any]) -> Image:
        shown = to_8_bit(image, self._gray_range)
        return cv2.cvtColor(shown, cv2.COLOR_GRAY2BGR) if shown.ndim == 2 else shown

    def _within_reach(self, box: Array, image: Image) -> Array:
        image_size = np.array([image.shape[1], image.shape[0]], float)
        least = np.minimum(np.maximum(_SIZE_RANGE[0] * self._first_size, 4.0), self._first_size)
        most = np.minimum(_SIZE_RANGE[1] * self._first_size, image_size)
        size = np.clip(box[2:], least, most)
        return box_around(np.clip(center_of(box), 0.0, image_size), size)

    def _answer(self) -> Box:
        x, y, width, height = self._box.tolist()
        return x, y, width, height


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
    """What a box shows, as an image of another size.

    Args:
        image: (H, W) or (H, W, channels).
        box: (x, y, width, height), the corner of the first pixel being (0, 0); may jut out of the
            image, whose border then goes on.
        size: (width, height) of the result in pixels.
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

    Args:
        window: (H, W) or (H, W, channels); channels are matched one by one and count alike.
        template: Of the same kind, not larger.
        calm: By how much the correlation must be better at the window's border than in its middle.

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
