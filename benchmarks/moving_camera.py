"""Footage of a moving camera: a moving part of each image of a still camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# Share of the image that is seen, along each axis.
_SEEN = 0.75
# Of what that leaves, the way to each side and its seconds: across and down.
_PAN, _PERIODS = (0.92, 0.4), (6.0, 4.1)
# Steps of who carries it: shares of the image and times a second, and pixels at random.
_STEPS, _RATES, _JITTER = (0.008, 0.02), (0.9, 1.8), 1.0


@dataclass(frozen=True, eq=False)
class MovingCamera:
    """A camera that looks at a part of another one's images.

    Attributes:
        corners: (frames, 2) upper left corner of the part in each image, pixels.
        size: (width, height) of the part, pixels.
    """

    corners: NDArray[np.float64]
    size: tuple[int, int]

    @classmethod
    def carried(cls, count: int, interval: float, size: tuple[int, int]) -> MovingCamera:
        """One that looks left and right as it is carried along.

        Args:
            count: Frames.
            interval: Seconds from one to the next.
            size: (width, height) of the other camera's images, pixels.
        """
        whole, time = np.array(size, float), np.arange(count)[:, None] * interval
        room = whole * (1.0 - _SEEN)
        corners = room / 2 * (1.0 + np.array(_PAN) * np.sin(2 * np.pi * time / np.array(_PERIODS)))
        corners += whole * np.array(_STEPS) * np.sin(2 * np.pi * time * np.array(_RATES))
        corners += np.random.default_rng(5).normal(0.0, _JITTER, corners.shape)
        width, height = (whole * _SEEN).astype(int).tolist()
        return cls(np.clip(corners, 0.0, room), (width, height))

    def see(self, number: int, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """What it sees of one of the images."""
        shift = np.column_stack([np.eye(2), -self.corners[number]])
        return cv2.warpAffine(image, shift, self.size, borderMode=cv2.BORDER_REPLICATE)

    def place(self, number: int, rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], Any]:
        """Where boxes are in what it sees.

        Args:
            number: Of the image.
            rows: (M, 4 or more), x and y of boxes first, then their sides.

        Returns:
            (M, 4 or more) the same in its own pixels, and (M,) which have their center in view.
        """
        moved = rows.copy()
        moved[:, :2] -= self.corners[number]
        centers = moved[:, :2] + moved[:, 2:4] / 2
        return moved, ((centers >= 0.0) & (centers < self.size)).all(axis=1)
