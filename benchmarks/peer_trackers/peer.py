"""What all peers share: the interface of the evaluation, and one kind of image for all."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.tracking.image import check_box, check_image, gray_range, to_8_bit

Image = NDArray[np.uint8]
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class PeerAnswer:
    """What a peer says of a frame; `lost` where it gives no box.

    Attributes:
        box: (x, y, width, height) in pixels; the last one while lost.
        state: "tracking" or "lost".
    """

    box: Box
    state: str


class PeerTracker(ABC):
    """Another tracker as one that can be evaluated.

    Whatever the footage, the peer sees (H, W, 3) uint8 BGR. Its answers are taken as they are.

    Args:
        seed: Seed of everything random.
    """

    name: ClassVar[str]
    """As it stands in the tables."""

    is_random: ClassVar[bool] = False
    """Whether the seed makes a difference."""

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed

    @classmethod
    def missing(cls) -> str:
        """What has to be installed for this tracker to run; empty if nothing."""
        return ""

    def start(self, image: NDArray[Any], box: ArrayLike) -> None:
        """Take a target.

        Args:
            image: (H, W, 3) uint8 BGR, (H, W) uint8 or (H, W) uint16.
            box: (x, y, width, height) in pixels.

        Raises:
            ValueError: The image or the box is not usable, or the peer refuses them.
        """
        check_image(image)
        self._box = check_box(box, (image.shape[1], image.shape[0]))
        self._gray_range = gray_range(image)
        self._start(self._color(image), self._box)

    def update(self, image: NDArray[Any], _dt: float | None = None) -> PeerAnswer:
        """Track into the next image; no peer knows of time.

        Raises:
            ValueError: The image is not usable.
        """
        check_image(image)
        box = self._update(self._color(image))
        if box is None or not np.isfinite(box).all():
            return PeerAnswer(self._box, "lost")
        self._box = box
        return PeerAnswer(box, "tracking")

    @abstractmethod
    def _start(self, image: Image, box: Box) -> None:
        """Learn the target from the first image, (H, W, 3)."""

    @abstractmethod
    def _update(self, image: Image) -> Box | None:
        """The target's box in the next image; None if the peer gives none."""

    def _color(self, image: NDArray[Any]) -> Image:
        shown = to_8_bit(image, self._gray_range)
        return cv2.cvtColor(shown, cv2.COLOR_GRAY2BGR) if shown.ndim == 2 else shown
