"""Footage for false tracking: changing illumination, and another scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from tracking_runs import spans

from pf_tracker_ros.evaluation import has_target
from pf_tracker_ros.footage import Footage

Image = NDArray[np.uint8]
# Minimum pixel correlation of two images of the same place.
_SAME_ABOVE = 0.9
GainOverTime = Callable[[float], float]


@dataclass(frozen=True, eq=False)
class Clip:
    """A few seconds of footage in memory."""

    name: str  # its name
    # (height, width, 3), 8 bit, blue first; gray ones have three equal channels
    images: tuple[Image, ...]
    # (frames, 4) true boxes, pixels; NaN where the target is not in the image
    boxes: NDArray[np.float64]
    interval: float  # seconds between frames

    @classmethod
    def of(cls, footage: Footage, frames: int | None = None) -> Clip:
        """The first frames of a sequence with ground truth, or all of it."""
        images = []
        for frame in footage.frames():
            image = frame.image
            images.append(image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
            if len(images) == frames:
                break
        boxes = np.asarray(footage.ground_truth)[: len(images)].copy()
        boxes[~has_target(boxes)] = np.nan
        return cls(footage.name, tuple(images), boxes, footage.nominal_interval)

    @classmethod
    def with_target(cls, footage: Footage, frames: int, at_least: int) -> Clip | None:
        """The longest part of a sequence with the target in every frame, of so many frames.

        Of a longer part it has the first ones; a shorter one is played back and forth, and one of
        less than `at_least` frames is None.
        """
        parts = spans(has_target(np.asarray(footage.ground_truth)))
        start, end = max(parts, key=lambda part: part[1] - part[0], default=(0, 0))
        length = end - start
        if length < at_least:
            return None
        part = cls.of(footage, start + min(length, frames))
        order = [start + _back_and_forth(index, min(length, frames)) for index in range(frames)]
        images = tuple(part.images[index] for index in order)
        return cls(part.name, images, part.boxes[order], part.interval)

    @property
    def is_colored(self) -> bool:
        """Whether the first image has colors."""
        return float(np.ptp(self.images[0], axis=2).mean()) >= 2.0


def same_place(one: Clip, other: Clip) -> bool:
    """Whether two clips show the same place, by their first images."""
    first, second = (
        cv2.resize(clip.images[0], (32, 24), interpolation=cv2.INTER_AREA).ravel()
        for clip in (one, other)
    )
    return float(np.corrcoef(first, second)[0, 1]) > _SAME_ABOVE


def step(gain: float) -> GainOverTime:
    """Gain that jumps at time 0."""
    return lambda time: 1.0 if time < 0.0 else gain


def ramp(gain: float, seconds: float) -> GainOverTime:
    """Gain that changes linearly from time 0 on."""
    return lambda time: 1.0 + (gain - 1.0) * min(max(time / seconds, 0.0), 1.0)


def relight(clip: Clip, light: GainOverTime) -> Iterator[Image]:
    """The images of a clip with a gain over time, time 0 in its middle."""
    middle = len(clip.images) // 2
    for index, image in enumerate(clip.images):
        gain = light((index - middle) * clip.interval)
        yield image if gain == 1.0 else cv2.convertScaleAbs(image, alpha=gain)


def cut(clip: Clip, scene: Clip, after: int) -> Iterator[Image]:
    """The frames of a clip, then so many of a scene, back and forth, resized to the same size."""
    yield from clip.images
    height, width = clip.images[0].shape[:2]
    for index in range(after):
        image = scene.images[_back_and_forth(index, len(scene.images))]
        yield cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)


def _back_and_forth(index: int, count: int) -> int:
    """Index of a frame, of `count`, at an index played back and forth."""
    if count == 1:
        return 0
    place = index % (2 * count - 2)
    return min(place, 2 * count - 2 - place)
