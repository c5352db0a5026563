"""Footage for false tracking: changing illumination, another scene, a target that leaves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

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
        """The longest part of a sequence with the target in every frame.

        Args:
            footage: A sequence with ground truth.
            frames: Frames of the clip: of a longer part the first ones; a shorter one is played
                back and forth.
            at_least: Frames of a part that is long enough; otherwise None is returned.
        """
        start, length = _longest_run(has_target(np.asarray(footage.ground_truth)))
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

    @property
    def motion(self) -> float:
        """Mean pixel difference of successive images, gray levels."""
        pairs = zip(self.images[:-1:5], self.images[1::5], strict=False)
        return float(np.mean([cv2.absdiff(*pair).mean() for pair in pairs]))


def _longest_run(holds: NDArray[np.bool_]) -> tuple[int, int]:
    """Start and length of the first longest run of frames in which a condition, (F,), holds."""
    changes = np.flatnonzero(np.diff(holds.astype(int), prepend=0, append=0))
    starts, ends = changes[::2], changes[1::2]
    if not len(starts):
        return 0, 0
    longest = int(np.argmax(ends - starts))
    return int(starts[longest]), int(ends[longest] - starts[longest])


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


def flicker(depth: float, hertz: float) -> GainOverTime:
    """Gain that oscillates from time 0 on, between `1 - depth` and `1 + depth`."""
    return lambda time: 1.0 + depth * math.sin(2.0 * math.pi * hertz * time) * (time >= 0.0)


def relight(clip: Clip, light: GainOverTime) -> Iterator[Image]:
    """The images of a clip with a gain over time, time 0 in its middle."""
    middle = len(clip.images) // 2
    for index, image in enumerate(clip.images):
        gain = light((index - middle) * clip.interval)
        yield image if gain == 1.0 else cv2.convertScaleAbs(image, alpha=gain)


def cut(clip: Clip, scene: Clip, after: int) -> Iterator[Image]:
    """The frames of a clip, then those of another scene, resized to the same size.

    Args:
        clip: The first part.
        scene: The second part, played back and forth if too short.
        after: Frames of the scene.
    """
    yield from clip.images
    height, width = clip.images[0].shape[:2]
    for index in range(after):
        image = scene.images[_back_and_forth(index, len(scene.images))]
        yield cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)


def departure(
    target: Clip, background: Clip, seconds: tuple[float, float, float], interval: float
) -> Clip:
    """A target's cut-out that moves over a moving background, leaves the image and returns.

    It leaves to the right, and comes back from the left and further down.

    Args:
        target: Clip whose first box is cut out.
        background: Clip behind it, played back and forth.
        seconds: Durations in view, absent, and in view again.
        interval: Seconds between frames.
    """
    sprite, mask = _cut_out(target, background)
    height, width = sprite.shape[:2]
    counts = [round(duration / interval) for duration in seconds]
    images, boxes = [], []
    image_height, image_width = background.images[0].shape[:2]
    for index in range(sum(counts)):
        image = background.images[_back_and_forth(index, len(background.images))]
        is_gone = counts[0] <= index < counts[0] + counts[1]
        # It crosses two thirds of the image before it leaves.
        speed = (image_width / 1.5 + width) / counts[0]
        if index < counts[0]:
            x, y = image_width - (counts[0] - index) * speed, image_height / 4
        else:
            x, y = (index - counts[0] - counts[1] + 1) * speed - width, image_height / 2
        x = min(x, image_width * 0.6) if index >= counts[0] else x
        y += image_height / 10 * math.sin(index * interval * 2.0)
        boxes.append([math.nan] * 4 if is_gone else [x, y, width, height])
        images.append(image if is_gone else _pasted(image, sprite, mask, x, y))
    name = f"{target.name} over {background.name}"
    return Clip(name, tuple(images), np.array(boxes), interval)


def beside_its_like(
    target: Clip, background: Clip, seconds: tuple[float, float, float], interval: float
) -> Clip:
    """A target's cut-out that moves next to a copy of itself, vanishes there and returns.

    The other one stays where it is, half of its width beside it.

    Args:
        target: Clip whose first box is cut out.
        background: Clip behind both, played back and forth.
        seconds: Durations in view, absent, and in view again.
        interval: Seconds between frames.
    """
    sprite, mask = _cut_out(target, background)
    height, width = sprite.shape[:2]
    image_height, image_width = background.images[0].shape[:2]
    end, y = image_width * 0.5, image_height / 2
    speed = min(end, 4.0 * width) / (seconds[0] / interval)
    counts = [round(duration / interval) for duration in seconds]
    images, boxes = [], []
    for index in range(sum(counts)):
        image = background.images[_back_and_forth(index, len(background.images))]
        image = _pasted(image, sprite, mask, end + 1.5 * width, y)
        x = end - max(counts[0] - index, 0) * speed
        is_gone = counts[0] <= index < counts[0] + counts[1]
        boxes.append([math.nan] * 4 if is_gone else [x, y, width, height])
        images.append(image if is_gone else _pasted(image, sprite, mask, x, y))
    name = f"{target.name} beside its like over {background.name}"
    return Clip(name, tuple(images), np.array(boxes), interval)


def _cut_out(target: Clip, background: Clip) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A target scaled to an eighth of a background's height, and its opacity, 0 to 1."""
    x, y, width, height = (round(side) for side in target.boxes[0])
    sprite = target.images[0][max(y, 0) : y + height, max(x, 0) : x + width].astype(np.float32)
    scale = background.images[0].shape[0] / 8.0 / math.sqrt(sprite.shape[0] * sprite.shape[1])
    sprite = cv2.resize(sprite, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    height, width = sprite.shape[:2]
    down, across = np.mgrid[:height, :width]
    distance = np.hypot((across + 0.5) / width * 2 - 1, (down + 0.5) / height * 2 - 1)
    mask = np.clip((1.0 - distance) * min(width, height) / 4, 0.0, 1.0)[..., None]
    return sprite, mask.astype(np.float32)


def _pasted(
    image: Image, sprite: NDArray[np.float32], mask: NDArray[np.float32], x: float, y: float
) -> Image:
    """An image with a sprite at a subpixel position, clipped at the borders."""
    height, width = image.shape[:2]
    shift = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
    alpha = cv2.warpAffine(mask, shift, (width, height))[..., None]
    moved = cv2.warpAffine(sprite, shift, (width, height), borderMode=cv2.BORDER_REPLICATE)
    return np.rint(image * (1.0 - alpha) + moved * alpha).astype(np.uint8)


def _back_and_forth(index: int, count: int) -> int:
    """Index of a frame, of `count`, at an index played back and forth."""
    if count == 1:
        return 0
    place = index % (2 * count - 2)
    return min(place, 2 * count - 2 - place)
