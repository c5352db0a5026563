"""A setting: an image, a target and particles around it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame, Region
from pf_tracker_ros.frames.exposure import gray_range

SIZES = ((320, 240), (768, 576), (1920, 1080))
SIDES = (20, 40, 80, 120, 200)
PARTICLES = (30, 100, 300, 1000, 3000, 10_000)
KINDS = ("color", "gray", "16 bit")
# Standard deviation of the particles' places along each axis, pixels.
SPREAD = 8.0
_WORKING_SIZE = 40


def street(width: int, height: int, seed: int = 1) -> NDArray[np.uint8]:
    """A textured color image, with details of the same sizes in pixels however large it is."""
    generator = np.random.default_rng(seed)
    image = np.zeros((height, width, 3), np.float32)
    for pixels in (128, 32, 8):
        cells = -(-height // pixels), -(-width // pixels), 3
        noise = generator.uniform(0, 255 / 3, cells).astype(np.float32)
        image += cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.clip(image + generator.normal(0, 3, image.shape), 0, 255).astype(np.uint8)


def of_kind(image: NDArray[np.uint8], kind: str) -> NDArray[np.generic]:
    """A color image as one of `KINDS`."""
    if kind == "color":
        return image
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return gray if kind == "gray" else gray.astype(np.uint16) * 16 + 5000


@dataclass(frozen=True)
class Setting:
    """What a stage works on.

    Attributes:
        size: (width, height) of the image, pixels.
        side: Of the target, pixels.
        particles: Their number.
        kind: Of the image, one of `KINDS`.
    """

    size: tuple[int, int] = (768, 576)
    side: int = 40
    particles: int = 200
    kind: str = "color"

    @cached_property
    def image(self) -> NDArray[np.generic]:
        """(H, W, 3) or (H, W)."""
        return of_kind(street(*self.size), self.kind)

    @cached_property
    def box(self) -> NDArray[np.float64]:
        """(4,) of the target, in the middle."""
        corner = (np.array(self.size) - self.side) // 2
        return np.array([*corner, self.side, self.side], np.float64)

    @cached_property
    def boxes(self) -> NDArray[np.float64]:
        """(N, 4) of the particles, all of the target's size."""
        boxes = np.tile(self.box, (self.particles, 1))
        boxes[:, :2] += np.random.default_rng(0).normal(0.0, SPREAD, (self.particles, 2))
        return boxes

    @cached_property
    def span(self) -> tuple[float, float] | None:
        """Gray values that the 8-bit view spans, None for 8 bit."""
        return gray_range(self.image)

    def frame(self) -> Frame:
        """A frame of which nothing is computed yet."""
        return Frame(self.image, span=self.span)

    def region(self, context_margin: float = 0.0) -> Region:
        """The region of a new frame that covers the particles."""
        reduction = -(-self.side // _WORKING_SIZE)
        return Region(self.frame(), self.boxes, reduction, context_margin, center_box=self.box)

    @property
    def text(self) -> str:
        """As in a table."""
        width, height = self.size
        return f"{width}x{height}, {self.side} px, N = {self.particles}, {self.kind}"
