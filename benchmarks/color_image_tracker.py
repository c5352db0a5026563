"""Base class of the trackers that are compared with: those of the families and of libraries."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.frames import check_image
from pf_tracker_ros.frames.exposure import gray_range, to_8_bit
from pf_tracker_ros.tracking.input_checks import check_box

Image = NDArray[np.uint8]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlainEstimate:
    """A tracker's output for a frame."""

    box: Box  # (x, y, width, height) in pixels; the last one while lost
    state: str  # "tracking", or "lost" without a box from the tracker


class ColorImageTracker(ABC):
    """Tracks one target in color images of 8 bits, converted from any footage.

    It learns the target from the first image and locates it in each later one. If this fails, the
    last box is kept.
    """

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed

    def start(self, image: NDArray[Any], box: ArrayLike) -> Box:
        """Start on a target, its center in an image of 8 bit color or 8 or 16 bit gray.

        Raises:
            ValueError: The image or the box is not usable, or the tracker refuses them.
        """
        check_image(image)
        self._box = np.array(check_box(box, (image.shape[1], image.shape[0])))
        self._kind = image.shape, image.dtype
        self._gray_range = gray_range(image)
        self._learn(self._color(image), self._box.copy())
        return as_box(self._box)

    def update(self, image: NDArray[Any], _dt: float | None = None) -> PlainEstimate:
        """Track in the next image, of the first one's size and type; the interval is ignored.

        Raises:
            ValueError: The image is not usable or of another size or kind.
        """
        check_image(image)
        if (image.shape, image.dtype) != self._kind:
            shape, depth = self._kind
            raise ValueError(
                f"image is {image.shape} {image.dtype}; allowed: as the first one, {shape} {depth}"
            )
        color = self._color(image)
        found = self._find(color, self._box.copy())
        if found is None or not np.isfinite(found).all():
            return PlainEstimate(as_box(self._box), "lost")
        self._box = self._limited(np.asarray(found, np.float64), color)
        return PlainEstimate(as_box(self._box), "tracking")

    @abstractmethod
    def _learn(self, image: Image, box: Array) -> None:
        """Learn the target in a (4,) box of the first image, (H, W, 3)."""

    @abstractmethod
    def _find(self, image: Image, box: Array) -> ArrayLike | None:
        """The target's box, given the last box; None if it is not found."""

    def _limited(self, box: Array, image: Image) -> Array:
        """Limit a box that was found; by default unchanged."""
        return box

    def _color(self, image: NDArray[Any]) -> Image:
        image = to_8_bit(image, self._gray_range)
        return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
