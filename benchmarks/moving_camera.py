"""Footage of a moving camera: a moving part of each image of a still camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# Share of the image in view, along each axis.
_SEEN = 0.75
# Amplitude as a share of the remaining margin, and period in seconds, along each axis.
_PAN, _PERIODS = (0.92, 0.4), (6.0, 4.1)
# Steps of the carrier: amplitude as a share of the image, and rate in Hz; random jitter in pixels.
_STEPS, _RATES, _JITTER = (0.008, 0.02), (0.9, 1.8), 1.0


@dataclass(frozen=True, eq=False)
class MovingCamera:
    """A camera that sees a part of another one's images."""

    corners: NDArray[np.float64]  # (frames, 2) upper left corner of the part in each image, pixels
    size: tuple[int, int]  # (width, height) of the part, pixels

    @classmethod
    def carried(cls, count: int, interval: float, size: tuple[int, int]) -> MovingCamera:
        """A camera that pans left and right while carried, in images of (width, height) pixels."""
        whole, time = np.array(size, float), np.arange(count)[:, None] * interval
        room = whole * (1.0 - _SEEN)
        corners = room / 2 * (1.0 + np.array(_PAN) * np.sin(2 * np.pi * time / np.array(_PERIODS)))
        corners += whole * np.array(_STEPS) * np.sin(2 * np.pi * time * np.array(_RATES))
        corners += np.random.default_rng(5).normal(0.0, _JITTER, corners.shape)
        width, height = (whole * _SEEN).astype(int).tolist()
        return cls(np.clip(corners, 0.0, room), (width, height))

    def see(self, number: int, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The part of an image in view."""
        shift = np.column_stack([np.eye(2), -self.corners[number]])
        return cv2.warpAffine(image, shift, self.size, borderMode=cv2.BORDER_REPLICATE)

    def place(self, number: int, rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], Any]:
        """(M, 4 or more) boxes in pixels of the part in view, and which have their center in it."""
        moved = rows.copy()
        moved[:, :2] -= self.corners[number]
        centers = moved[:, :2] + moved[:, 2:4] / 2
        return moved, ((centers >= 0.0) & (centers < self.size)).all(axis=1)
