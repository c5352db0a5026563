"""Sprites: small images with transparency, placed on a canvas at subpixel positions.

Bilinear interpolation keeps a sprite's total coverage and moves its centroid by exactly the shift,
so what is drawn is where the ground truth says, whatever the fraction. OpenCV would round the shift
to 1/32 pixel, hence the weighted sum of four neighbors here.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Color = tuple[float, float, float]
"""Blue, green, red, 0 to 255."""


def from_hsv(hue: float, saturation: float, value: float) -> Color:
    """The color of a hue in degrees, and saturation and value from 0 to 1."""
    pixel = cv2.cvtColor(np.array([[[hue, saturation, value]]], np.float32), cv2.COLOR_HSV2BGR)
    blue, green, red = (255.0 * pixel).ravel().tolist()
    return blue, green, red


def shaded(color: Color, share: float) -> Color:
    """A color of so much of its brightness."""
    blue, green, red = color
    return share * blue, share * green, share * red


Points = list[tuple[float, float]] | NDArray[np.floating]


@dataclass(frozen=True)
class Sprite:
    """A picture with transparency and the point by which it is held."""

    # (H, W, 4) float32: blue, green and red from 0 to 255, multiplied by the coverage, then the
    # coverage from 0 to 1. Its outermost pixels are empty.
    pixels: NDArray[np.float32]
    # (x, y) of the holding point in pixels of the sprite; the center of the top-left pixel is (0,
    # 0)
    anchor: tuple[float, float]

    def textured(self, factors: NDArray[np.float32]) -> Sprite:
        """The same sprite, brighter or darker by factors of at least its size."""
        pixels = self.pixels.copy()
        height, width = pixels.shape[:2]
        brighter = pixels[..., :3] * factors[:height, :width, None]
        pixels[..., :3] = np.minimum(brighter, 255.0 * pixels[..., 3:])
        return Sprite(pixels, self.anchor)

    def held_at_centroid(self) -> Sprite:
        """The same sprite with the centroid of its coverage as the anchor."""
        coverage = self.pixels[..., 3].astype(np.float64)
        rows, columns = np.indices(coverage.shape)
        total = coverage.sum()
        anchor = (float((columns * coverage).sum() / total), float((rows * coverage).sum() / total))
        return Sprite(self.pixels, anchor)

    def placed(self, x: float, y: float) -> Placement:
        """The sprite resampled so that its anchor lies at (x, y), in pixel indices."""
        left, top = x - self.anchor[0], y - self.anchor[1]
        column, row = int(np.floor(left)), int(np.floor(top))
        right_share, lower_share = np.float32(left - column), np.float32(top - row)
        height, width = self.pixels.shape[:2]
        pixels = np.zeros((height + 1, width + 1, 4), np.float32)
        rows = np.zeros((height, width + 1, 4), np.float32)
        rows[:, :-1] = (1 - right_share) * self.pixels
        rows[:, 1:] += right_share * self.pixels
        pixels[:-1] = (1 - lower_share) * rows
        pixels[1:] += lower_share * rows
        return Placement(pixels, column, row)


@dataclass(frozen=True)
class Placement:
    """A sprite's pixels on the grid of a canvas."""

    pixels: NDArray[np.float32]  # (H, W, 4) float32 as in `Sprite`
    column: int  # canvas column of the first pixel; may lie outside the canvas
    row: int  # canvas row of the first pixel; may lie outside the canvas

    def draw(self, canvas: NDArray[np.float32]) -> None:
        """Lay the pixels over a (H, W, 3) float32 canvas, in place; what juts out is cut off."""
        height, width = self.pixels.shape[:2]
        top, bottom = max(self.row, 0), min(self.row + height, canvas.shape[0])
        left, right = max(self.column, 0), min(self.column + width, canvas.shape[1])
        if top >= bottom or left >= right:
            return
        rows, columns = slice(top - self.row, bottom - self.row), slice(left - self.column, None)
        pixels = self.pixels[rows, columns][:, : right - left]
        target = canvas[top:bottom, left:right]
        target *= 1.0 - pixels[..., 3:]
        target += pixels[..., :3]


class Drawing:
    """Smooth-edged shapes, drawn enlarged by a factor and scaled down by area.

    Coordinates are in pixels of the result; (0, 0) is the corner of its top-left pixel.
    """

    def __init__(self, width: int, height: int, enlargement: int = 4):
        self._size = (width, height)
        self._enlargement = enlargement
        shape = (height * enlargement, width * enlargement)
        self._color = np.zeros((*shape, 3), np.uint8)
        self._coverage = np.zeros(shape, np.uint8)

    def polygon(self, points: Points, color: Color) -> None:
        """Fill a polygon."""
        corners = np.round(np.asarray(points, float) * self._enlargement).astype(np.int32)
        cv2.fillPoly(self._color, [corners], color)
        cv2.fillPoly(self._coverage, [corners], 255)

    def ellipse(
        self, center: tuple[float, float], axes: tuple[float, float], color: Color, angle: float = 0
    ) -> None:
        """Fill an ellipse of the given half axes, turned by `angle` degrees."""
        x, y = (round(value * self._enlargement) for value in center)
        half = (
            max(round(axes[0] * self._enlargement), 1),
            max(round(axes[1] * self._enlargement), 1),
        )
        cv2.ellipse(self._color, (x, y), half, angle, 0, 360, color, -1)
        cv2.ellipse(self._coverage, (x, y), half, angle, 0, 360, 255, -1)

    def stroke(self, points: Points, width: float, color: Color) -> None:
        """Draw a line through the points."""
        corners = np.round(np.asarray(points, float) * self._enlargement).astype(np.int32)
        thickness = max(round(width * self._enlargement), 1)
        cv2.polylines(self._color, [corners], False, color, thickness)
        cv2.polylines(self._coverage, [corners], False, 255, thickness)

    def pixels(self) -> NDArray[np.float32]:
        """The drawing as pixels of a `Sprite`."""
        coverage = self._coverage.astype(np.float32) / 255.0
        enlarged = np.dstack([self._color * coverage[..., None], coverage]).astype(np.float32)
        return cv2.resize(enlarged, self._size, interpolation=cv2.INTER_AREA)
