"""What the cues read of one frame, each map computed once and only around the particles.

N particles overlap heavily, so pixels are turned into what a cue needs once a frame, and each
particle then only reads. A map is computed when a cue first asks for it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

Map = TypeVar("Map")

# Derivatives look one pixel further than the boxes do.
_MARGIN = 2


class FrameMaps:
    """The region of a frame that a set of boxes covers, and the maps computed from it.

    Pixels outside the image belong to the region too where a box reaches there: maps say what they
    hold for them.

    Args:
        image: (H, W, 3) uint8 BGR or (H, W) uint8.
        boxes: (N, 4) boxes (x, y, width, height) in pixels, all of which the region covers; each
            overlaps the image.
        reduction: Whole number of image pixels that one region pixel averages along each axis;
            above 1 for targets so large that full resolution would only cost time.

    Attributes:
        pixels: The region inside the image, (h, w, 3) or (h, w) uint8, reduced.
        padding: (top, bottom, left, right) region pixels outside the image.
    """

    def __init__(
        self, image: NDArray[np.uint8], boxes: NDArray[np.float64], reduction: int = 1
    ) -> None:
        height, width = image.shape[:2]
        low = np.floor(boxes[:, :2].min(axis=0) / reduction).astype(int) - _MARGIN
        high = np.ceil((boxes[:, :2] + boxes[:, 2:]).max(axis=0) / reduction).astype(int) + _MARGIN
        inside_low = np.clip(low, 0, None)
        inside_high = np.minimum(high, np.array([-(-width // reduction), -(-height // reduction)]))
        left, top = inside_low * reduction
        right, bottom = inside_high * reduction
        crop = image[top:bottom, left:right]
        if reduction > 1:
            # Blocks are counted from the image's corner, so a pixel's value does not depend on
            # which region it was read for; the last block repeats the image's edge.
            missing = -np.array(crop.shape[:2]) % reduction
            crop = cv2.copyMakeBorder(crop, 0, missing[0], 0, missing[1], cv2.BORDER_REPLICATE)
            size = (crop.shape[1] // reduction, crop.shape[0] // reduction)
            crop = cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
        self.pixels: NDArray[np.uint8] = crop
        self.padding = (
            int(inside_low[1] - low[1]),
            int(high[1] - inside_high[1]),
            int(inside_low[0] - low[0]),
            int(high[0] - inside_high[0]),
        )
        self._origin = low
        self._reduction = reduction
        self._shared: dict[object, object] = {}

    def region_boxes(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 4) boxes in image pixels as (x, y, width, height) in region pixels."""
        scaled = boxes / self._reduction
        scaled[:, :2] -= self._origin
        return scaled

    def shared(self, key: object, compute: Callable[[], Map]) -> Map:
        """The map stored under `key`, computed at the first call and shared by all who ask."""
        if key not in self._shared:
            self._shared[key] = compute()
        return self._shared[key]  # type: ignore[return-value]

    @property
    def gray(self) -> NDArray[np.uint8]:
        """(h, w) uint8 brightness of `pixels`."""
        if self.pixels.ndim == 2:
            return self.pixels
        return self.shared("gray", lambda: cv2.cvtColor(self.pixels, cv2.COLOR_BGR2GRAY))

    def color_bins(self, levels: int) -> NDArray[np.uint16]:
        """Histogram bin of every region pixel, each of R, G and B in `levels` equal steps.

        A gray image counts as R = G = B.

        Returns:
            (h, w) of the padded region: red * levels^2 + green * levels + blue, and levels^3 for a
            pixel outside the image.
        """

        def compute() -> NDArray[np.uint16]:
            step = np.minimum(np.arange(256) * levels // 256, levels - 1)
            if self.pixels.ndim == 2:
                bins = (step * (levels**2 + levels + 1)).astype(np.uint16)[self.pixels]
            else:
                blue, green, red = (
                    cv2.LUT(channel, (step * weight).astype(np.uint16))
                    for channel, weight in zip(
                        cv2.split(self.pixels), (1, levels, levels**2), strict=True
                    )
                )
                bins = blue + green + red
            padded: NDArray[np.uint16] = cv2.copyMakeBorder(
                bins, *self.padding, cv2.BORDER_CONSTANT, value=levels**3
            )
            return padded

        return self.shared(("color bins", levels), compute)

    def gradient_integral(self, directions: int) -> NDArray[np.float64]:
        """Integral image of the gradient magnitude in each direction.

        A pixel's gradient magnitude counts for the direction, of `directions` equal ones over 360
        degrees starting at 0, that its gradient falls into. Outside the image there is none.

        Returns:
            (h + 1, w + 1, directions) of the padded region: the sum over all pixels above and left.
        """

        def compute() -> NDArray[np.float64]:
            gray = self.gray
            # Differences of the two neighbors: the gradient of the smallest possible window.
            right = cv2.Sobel(gray, cv2.CV_32F, 1, 0, ksize=1)
            down = cv2.Sobel(gray, cv2.CV_32F, 0, 1, ksize=1)
            place = ((down + 255) * 511 + (right + 255)).astype(np.intp)
            direction = _direction_table(directions).take(place)
            height, width = gray.shape
            top, bottom, left, right_ = self.padding
            channels = np.zeros(
                (top + height + bottom, left + width + right_, directions), dtype=np.float32
            )
            rows, columns = np.arange(top, top + height), np.arange(left, left + width)
            channels[rows[:, None], columns, direction] = cv2.magnitude(right, down)
            return cv2.integral(channels, sdepth=cv2.CV_64F)

        return self.shared(("gradient integral", directions), compute)


@cache
def _direction_table(directions: int) -> NDArray[np.uint8]:
    """(511 * 511,) direction of all differences of 8-bit values: row down + 255, column right + 255.

    Exact where an approximate angle would be off, on the borders between two directions, where many
    gradients of whole numbers lie.
    """
    differences = np.arange(-255, 256)
    angle = np.arctan2(differences[:, None], differences[None]) % (2 * np.pi)
    direction = np.floor(angle * (directions / (2 * np.pi)) + 1e-9).astype(np.intp) % directions
    return direction.astype(np.uint8).ravel()
