"""ViBe: a background model of sample values a pixel, kept up to date at random.

A pixel is background when enough of its samples lie near its value. A background pixel then, by
chance, replaces one of its samples, and by chance one of a neighbor's: memory fades exponentially,
and background spreads into what wrongly counts as foreground.

Sources: Zhang Bo, section 2 (equations (1) to (3)); Barnich, Van Droogenbroeck 2011, "ViBe: a
universal background subtraction algorithm for video sequences".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.background.ghosts import find_ghosts
from pf_tracker_ros.boxes import Box

# No scene has more foreground than this share: then the camera has moved, or the light changed.
_LARGEST_FOREGROUND = 0.5
# Pixels of the model; one of more takes seconds to begin.
_MOST_PIXELS = 960 * 540
# Every how many frames ghosts are looked for, and samples that the model's brightness is a mean of.
_GHOSTS_EVERY, _SAMPLES_OF_MEAN = 4, 4
UPDATE_EVERY = 16
"""Frames that a model learns for, before its foreground counts."""
_ALL_CHANGED = "most of the image has changed, as when the camera moves"
# Steps to the eight neighbors.
_RIGHT, _DOWN = np.array(
    [(x, y) for y in (-1, 0, 1) for x in (-1, 0, 1) if (x, y) != (0, 0)], dtype=np.intp
).T.copy()


@dataclass(frozen=True)
class BackgroundState:
    """What the foreground of a frame is worth.

    Attributes:
        name: "learning" while the model has not seen as many frames as it takes a pixel, on
            average, to renew a sample; "ready" after that; "off" where the foreground says nothing.
        reason: Why it is off, empty otherwise.
    """

    name: Literal["learning", "ready", "off"]
    reason: str = ""

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}" if self.reason else self.name


class BackgroundModel:
    """ViBe, one update a frame.

    Where most of the image stays foreground for `update_every` frames, the model begins anew: only
    background is ever learned, so it would never recover.

    Unlike a cue it has a memory of its own, which every update changes in place.

    Args:
        image: (H, W, 3) uint8 BGR or (H, W) uint8 first frame, which initializes the model.
        generator: Source of all randomness.
        foreground_boxes: Boxes of what is known not to be background, such as targets; the model there begins
            with a continuation of what is around them, so that they leave no ghosts behind.
        samples: Values that the model keeps of a pixel (N).
        radius: A sample matches a pixel when no channel differs by more gray levels than this (R).
        matches: Samples that must match for a pixel to count as background (U_min).
        update_every: A background pixel updates its samples, and a neighbor's, once in so many
            frames on average.
        reduction: Whole number of image pixels that one pixel of the model averages along each
            axis; more where the model would have more pixels than for half of 1920 x 1080.
        color: Whether the model keeps colors; without, it keeps brightness at a third of the cost.
        removes_ghosts: Whether what was background only in the first image is learned anew as soon as
            it is told, see `find_ghosts`; the papers have nothing of it.

    Attributes:
        reduction: Image pixels that one pixel of the mask stands for along each axis.
        state: What the foreground of the last image is worth.
    """

    def __init__(
        self,
        image: NDArray[np.uint8],
        generator: np.random.Generator,
        foreground_boxes: Sequence[Box] = (),
        *,
        samples: int = 20,
        radius: int = 20,
        matches: int = 2,
        update_every: int = UPDATE_EVERY,
        reduction: int = 2,
        color: bool = True,
        removes_ghosts: bool = False,
    ) -> None:
        self.reduction = max(reduction, _least_reduction(image))
        self._samples = samples
        self._radius = radius
        self._matches = matches
        self._update_every = update_every
        self._color = color
        self._lays_ghosts = removes_ghosts
        self._generator = generator
        self._begin(self._planes(image), foreground_boxes)
        self.state = BackgroundState("learning")

    @property
    def samples(self) -> NDArray[np.uint8]:
        """(N, channels, h, w) copy of the model."""
        return self._model.copy()

    def update(
        self, image: NDArray[np.uint8], foreground_boxes: Sequence[Box] = ()
    ) -> NDArray[np.uint8]:
        """Tell foreground from background, then learn the background.

        Args:
            image: As the first, of the same size.
            foreground_boxes: As for the first image, should the model begin anew with this one.

        Returns:
            (h, w) uint8, 255 for foreground, 0 for background; h and w are those of the image
            divided by `reduction`, rounded up.
        """
        planes = self._planes(image)
        foreground = self._foreground(planes)
        self._age += 1
        if self._lays_ghosts and self._age % _GHOSTS_EVERY == 0:
            self._lay_ghosts(planes, foreground)
        self._learn(planes, foreground)
        if cv2.countNonZero(foreground) <= _LARGEST_FOREGROUND * foreground.size:
            self._changed_for = 0
            young = self._age < self._update_every
            self.state = BackgroundState("learning" if young else "ready")
            return foreground
        self.state = BackgroundState("off", _ALL_CHANGED)
        self._changed_for += 1
        if self._changed_for >= self._update_every:
            self._begin(planes, foreground_boxes)
        return foreground

    def _begin(self, planes: NDArray[np.uint8], foreground_boxes: Sequence[Box]) -> None:
        self._model = self._fresh(
            self._filled(planes, foreground_boxes) if foreground_boxes else planes
        )
        self._age = 0
        self._changed_for = 0

    def _planes(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(channels, h, w) the image as the model sees it."""
        if image.ndim == 3 and not self._color:
            image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
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
        """Source: Zhang Bo, equations (2) and (3), the sphere that of the largest difference."""
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
            # 255 where it matches, which is -1 for bytes that wrap: the count goes up by 1.
            cv2.threshold(largest, self._radius, 255, cv2.THRESH_BINARY_INV, dst=largest)
            matches -= largest
        fewest = self._matches
        return cv2.threshold(matches, fewest - 1, 255, cv2.THRESH_BINARY_INV)[1]

    def _lay_ghosts(self, planes: NDArray[np.uint8], foreground: NDArray[np.uint8]) -> None:
        """Begin anew where the foreground is a ghost, which it then is no more."""
        some = np.array([_gray(sample) for sample in self._model[:_SAMPLES_OF_MEAN]])
        known = some.mean(axis=0, dtype=np.float32).astype(np.uint8)
        ghosts = find_ghosts(foreground, _gray(planes), known)
        pixels = np.flatnonzero(ghosts)
        model = self._model.reshape(*self._model.shape[:2], -1)
        model[:, :, pixels] = self._neighborhood_samples(planes, pixels)
        foreground[ghosts] = 0

    def _learn(self, planes: NDArray[np.uint8], foreground: NDArray[np.uint8]) -> None:
        """Conservative update and spatial propagation: only background pixels give their value.

        Source: Zhang Bo, step 3; Barnich, Van Droogenbroeck 2011, section III-C.
        """
        height, width = foreground.shape
        pixels = height * width
        values = planes.reshape(len(planes), pixels)
        model = self._model.reshape(-1)
        background = foreground.ravel() == 0
        for propagate in (False, True):
            givers = self._chosen(pixels)
            givers = givers[background[givers]]
            takers = givers
            if propagate:
                to = self._generator.integers(0, len(_RIGHT), len(givers), dtype=np.uint8)
                y, x = np.divmod(givers, width)
                x = np.clip(x + _RIGHT[to], 0, width - 1)
                takers = np.clip(y + _DOWN[to], 0, height - 1) * width + x
            replaced = self._generator.integers(0, len(self._model), len(givers), dtype=np.uint8)
            # One flat index a sample: far faster than one for each axis.
            places = takers + replaced * np.intp(values.size)
            for channel in values:
                model[places] = channel[givers]
                places += pixels

    def _chosen(self, pixels: int) -> NDArray[np.intp]:
        """Pixels out of a number of them, each with a chance of 1 in `update_every`.

        Gaps between successes are geometric, exponential ones in whole pixels: far fewer random
        numbers than one a pixel.
        """
        if self._update_every == 1:
            return np.arange(pixels)
        chance = 1.0 / self._update_every
        expected = pixels * chance
        gaps = self._generator.standard_exponential(
            int(expected + 6 * np.sqrt(expected) + 10), dtype=np.float32
        )
        gaps *= -1.0 / math.log1p(-chance)
        places = np.cumsum(gaps.astype(np.intp) + 1) - 1
        return places[: np.searchsorted(places, pixels)]

    def _filled(
        self, planes: NDArray[np.uint8], foreground_boxes: Sequence[Box]
    ) -> NDArray[np.uint8]:
        """The planes with the holes painted over from their surroundings."""
        mask = np.zeros(planes.shape[1:], np.uint8)
        for hole in foreground_boxes:
            x, y, width, height = (side / self.reduction for side in hole)
            left, top = max(math.floor(x), 0), max(math.floor(y), 0)
            right, bottom = max(math.ceil(x + width), 0), max(math.ceil(y + height), 0)
            mask[top:bottom, left:right] = 255
        return np.stack([cv2.inpaint(plane, mask, 3, cv2.INPAINT_TELEA) for plane in planes])

    def _fresh(self, planes: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(N, channels, h, w) a model of this frame alone.

        Source: Zhang Bo, equation (1) and step 1; Barnich, Van Droogenbroeck 2011, section III-B.
        """
        samples = self._neighborhood_samples(planes, np.arange(planes[0].size))
        return samples.reshape(-1, *planes.shape)

    def _neighborhood_samples(
        self, planes: NDArray[np.uint8], pixels: NDArray[np.intp]
    ) -> NDArray[np.uint8]:
        """(N, channels, P) values drawn from the 3 x 3 neighborhoods of P pixels."""
        padded = np.stack([cv2.copyMakeBorder(p, 1, 1, 1, 1, cv2.BORDER_REPLICATE) for p in planes])
        rows, columns = np.divmod(pixels, planes.shape[2])
        corners = rows * padded.shape[2] + columns
        drawn = np.empty((self._samples, len(planes), len(pixels)), np.uint8)
        for samples in drawn:
            step = self._generator.integers(0, 9, len(pixels))
            places = corners + step // 3 * padded.shape[2] + step % 3
            samples[:] = padded.reshape(len(planes), -1)[:, places]
        return drawn


def _gray(planes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The brightest part of the eye's answer, green, is brightness enough to compare."""
    return planes[len(planes) // 2]


def _least_reduction(image: NDArray[np.uint8]) -> int:
    return math.ceil(math.sqrt(image.shape[0] * image.shape[1] / _MOST_PIXELS))
