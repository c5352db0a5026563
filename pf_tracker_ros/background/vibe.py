"""ViBe: a background model of N sample values for each pixel, updated at random.

1. Initialize: the samples of a pixel are drawn from its 3 x 3 neighborhood in the first image.
2. Classify: a pixel is background if at least U_min samples lie within the radius R of its value.
3. Update: a background pixel replaces, with probability 1 / 16, a random one of its own samples,
   so old samples decay exponentially.
4. Propagate: with the same probability it replaces a random sample of a random neighbor, so
   background grows into wrong foreground.

Sources: Zhang Bo, section 2 (equations (1) to (3)); Barnich, Van Droogenbroeck 2011, "ViBe: a
universal background subtraction algorithm for video sequences".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.background.ghosts import find_ghosts
from pf_tracker_ros.boxes import Box

# With a larger share of foreground, the camera has moved or the light has changed.
_LARGEST_FOREGROUND = 0.5
# Largest model in pixels; a larger one takes seconds to initialize.
_MAX_PIXELS = 960 * 540
# Frames from one search for ghosts to the next; samples averaged for the model's brightness.
_GHOSTS_EVERY, _SAMPLES_OF_MEAN = 4, 4
UPDATE_EVERY = 16
"""Average frames between updates of a pixel; a new model learns for as many frames."""
_ALL_CHANGED = "most of the image has changed, as when the camera moves"
# Steps to the eight neighbors.
_RIGHT, _DOWN = np.array(
    [(x, y) for y in (-1, 0, 1) for x in (-1, 0, 1) if (x, y) != (0, 0)], dtype=np.intp
).T.copy()


@dataclass(frozen=True)
class BackgroundState:
    """Whether the foreground of a frame is usable.

    Attributes:
        name: "learning" in the first `update_every` frames, then "ready"; "off" if the foreground
            is unusable.
        reason: Why it is off, empty otherwise.
    """

    name: Literal["learning", "ready", "off"]
    reason: str = ""

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}" if self.reason else self.name


class BackgroundModel:
    """ViBe with one update per frame, in place.

    If most of the image stays foreground for `update_every` frames, the model is initialized again.
    It could not recover otherwise, because only background is learned.

    Args:
        image: (H, W, 3) uint8 BGR or (H, W) uint8 first frame, which initializes the model.
        generator: Source of all randomness.
        foreground_boxes: Boxes of known foreground, such as targets. The model there is inpainted
            from the surroundings, so that no ghosts remain when they leave.
        reduction: Image pixels averaged along each axis for one model pixel, a whole number; raised
            if the model would have more than 960 x 540 pixels.
        removes_ghosts: Learn ghosts as background at once, see `find_ghosts`; not in the papers.

    Attributes:
        sample_count: Sample values of a pixel (N).
        radius: A sample matches a pixel when no channel differs by more gray levels than this (R).
        matches: Matching samples that make a pixel background (U_min).
        update_every: Average number of frames between updates of a background pixel.
        reduction: Image pixels per mask pixel along each axis.
        state: State of the model at the last image.
    """

    sample_count: ClassVar = 20
    radius: ClassVar = 20
    matches: ClassVar = 2
    update_every: ClassVar = UPDATE_EVERY

    def __init__(
        self,
        image: NDArray[np.uint8],
        generator: np.random.Generator,
        foreground_boxes: Sequence[Box] = (),
        *,
        reduction: int = 2,
        removes_ghosts: bool = False,
    ) -> None:
        least = math.ceil(math.sqrt(image.shape[0] * image.shape[1] / _MAX_PIXELS))
        self.reduction = max(reduction, least)
        self._removes_ghosts = removes_ghosts
        self._generator = generator
        self._initialize(self._planes(image), foreground_boxes)
        self.state = BackgroundState("learning")

    @property
    def samples(self) -> NDArray[np.uint8]:
        """(N, channels, h, w) copy of the model."""
        return self._model.copy()

    def update(
        self, image: NDArray[np.uint8], foreground_boxes: Sequence[Box] = ()
    ) -> NDArray[np.uint8]:
        """Classify the pixels of an image of the first one's shape, then learn its background.

        The boxes serve as for the first image, if the model is initialized again.

        Returns:
            (h, w) uint8, 255 for foreground, 0 for background; h and w are those of the image
            divided by `reduction`, rounded up.
        """
        planes = self._planes(image)
        foreground = self._foreground(planes)
        self._age += 1
        if self._removes_ghosts and self._age % _GHOSTS_EVERY == 0:
            self._remove_ghosts(planes, foreground)
        self._learn(planes, foreground)
        if cv2.countNonZero(foreground) <= _LARGEST_FOREGROUND * foreground.size:
            self._changed_for = 0
            young = self._age < self.update_every
            self.state = BackgroundState("learning" if young else "ready")
            return foreground
        self.state = BackgroundState("off", _ALL_CHANGED)
        self._changed_for += 1
        if self._changed_for >= self.update_every:
            self._initialize(planes, foreground_boxes)
        return foreground

    def _initialize(self, planes: NDArray[np.uint8], foreground_boxes: Sequence[Box]) -> None:
        if foreground_boxes:
            planes = self._inpainted(planes, foreground_boxes)
        samples = self._neighborhood_samples(planes, np.arange(planes[0].size))
        self._model = samples.reshape(-1, *planes.shape)
        self._age = 0
        self._changed_for = 0

    def _planes(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(channels, h, w) the reduced image."""
        reduction = self.reduction
        if reduction > 1:
            size = (-(-image.shape[1] // reduction), -(-image.shape[0] // reduction))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        if image.ndim == 2:
            return image[None]
        planes = np.empty((3, *image.shape[:2]), np.uint8)
        cv2.split(image, list(planes))
        return planes

    def _foreground(self, planes: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(h, w) foreground mask; the distance is the largest difference of any channel.

        Source: Zhang Bo, equations (2) and (3).
        """
        channels, height, width = planes.shape
        stacked = planes.reshape(-1, width)
        difference = np.empty_like(stacked)
        matches = np.zeros((height, width), np.uint8)
        for samples in self._model:
            cv2.absdiff(stacked, samples.reshape(-1, width), dst=difference)
            largest = difference[:height]
            for channel in range(1, channels):
                start = channel * height
                cv2.max(largest, difference[start : start + height], dst=largest)
            # A match is 255, which is -1 modulo 256: the count grows by 1.
            cv2.threshold(largest, self.radius, 255, cv2.THRESH_BINARY_INV, dst=largest)
            matches -= largest
        return cv2.threshold(matches, self.matches - 1, 255, cv2.THRESH_BINARY_INV)[1]

    def _remove_ghosts(self, planes: NDArray[np.uint8], foreground: NDArray[np.uint8]) -> None:
        """Initialize the model again at ghosts, and clear them from the foreground in place."""
        samples = np.array([_gray(sample) for sample in self._model[:_SAMPLES_OF_MEAN]])
        background = samples.mean(axis=0, dtype=np.float32).astype(np.uint8)
        ghosts = find_ghosts(foreground, _gray(planes), background)
        pixels = np.flatnonzero(ghosts)
        model = self._model.reshape(*self._model.shape[:2], -1)
        model[:, :, pixels] = self._neighborhood_samples(planes, pixels)
        foreground[ghosts] = 0

    def _learn(self, planes: NDArray[np.uint8], foreground: NDArray[np.uint8]) -> None:
        """Update and propagate; only background pixels give their value (conservative update).

        Source: Zhang Bo, step 3; Barnich, Van Droogenbroeck 2011, section III-C.
        """
        height, width = foreground.shape
        pixels = height * width
        values = planes.reshape(len(planes), pixels)
        model = self._model.reshape(-1)
        background = foreground.ravel() == 0
        for propagate in (False, True):
            sources = self._random_pixels(pixels)
            sources = sources[background[sources]]
            targets = sources
            if propagate:
                to = self._generator.integers(0, len(_RIGHT), len(sources), dtype=np.uint8)
                y, x = np.divmod(sources, width)
                x = np.clip(x + _RIGHT[to], 0, width - 1)
                targets = np.clip(y + _DOWN[to], 0, height - 1) * width + x
            replaced = self._generator.integers(0, len(self._model), len(sources), dtype=np.uint8)
            # One flat index per sample is much faster than one for each axis.
            indices = targets + replaced * np.intp(values.size)
            for channel in values:
                model[indices] = channel[sources]
                indices += pixels

    def _random_pixels(self, pixels: int) -> NDArray[np.intp]:
        """Indices below `pixels`, each drawn with probability 1 / `update_every`.

        The gaps between them are geometric, computed as rounded exponential numbers: this needs
        much fewer random numbers than one per pixel.
        """
        if self.update_every == 1:
            return np.arange(pixels)
        probability = 1.0 / self.update_every
        expected = pixels * probability
        gaps = self._generator.standard_exponential(
            int(expected + 6 * np.sqrt(expected) + 10), dtype=np.float32
        )
        gaps *= -1.0 / math.log1p(-probability)
        indices = np.cumsum(gaps.astype(np.intp) + 1) - 1
        return indices[: np.searchsorted(indices, pixels)]

    def _inpainted(
        self, planes: NDArray[np.uint8], foreground_boxes: Sequence[Box]
    ) -> NDArray[np.uint8]:
        """The planes with the boxes inpainted from their surroundings."""
        mask = np.zeros(planes.shape[1:], np.uint8)
        for box in foreground_boxes:
            x, y, width, height = (side / self.reduction for side in box)
            left, top = max(math.floor(x), 0), max(math.floor(y), 0)
            right, bottom = max(math.ceil(x + width), 0), max(math.ceil(y + height), 0)
            mask[top:bottom, left:right] = 255
        return np.stack([cv2.inpaint(plane, mask, 3, cv2.INPAINT_TELEA) for plane in planes])

    def _neighborhood_samples(
        self, planes: NDArray[np.uint8], pixels: NDArray[np.intp]
    ) -> NDArray[np.uint8]:
        """(N, channels, P) values drawn from the 3 x 3 neighborhoods of P pixels.

        Source: Zhang Bo, equation (1) and step 1; Barnich, Van Droogenbroeck 2011, section III-B.
        """
        padded = np.stack([cv2.copyMakeBorder(p, 1, 1, 1, 1, cv2.BORDER_REPLICATE) for p in planes])
        rows, columns = np.divmod(pixels, planes.shape[2])
        corners = rows * padded.shape[2] + columns
        drawn = np.empty((self.sample_count, len(planes), len(pixels)), np.uint8)
        for samples in drawn:
            step = self._generator.integers(0, 9, len(pixels))
            indices = corners + step // 3 * padded.shape[2] + step % 3
            samples[:] = padded.reshape(len(planes), -1)[:, indices]
        return drawn


def _gray(planes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, w) brightness, approximated by the middle channel, green."""
    return planes[len(planes) // 2]
