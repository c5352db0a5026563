"""Situations made from a sequence's own pixels: the target is gone, covered, or not alone.

Each is a function of a clip whose target is in every frame. It changes the frames from `first` to
before `end`, and leaves the others as they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

import cv2
import numpy as np
from honesty_footage import Clip, Image
from numpy.typing import NDArray

Situation = Callable[[Clip, int, int], Clip]
# Part of the box that is erased; size that it is reduced to for this, pixels.
_ERASED, _ERASED_SIZE = 1.2, 40.0
# Frames in which the view pans or a stranger comes.
_TRANSITION = 20
_NOISE_SEED = 43


def covered(seconds: float) -> Situation:
    """A covered lens: dark noise, for so many seconds in which the footage stands still."""

    def situation(clip: Clip, first: int, end: int) -> Clip:
        generator = np.random.default_rng(_NOISE_SEED)
        # A few images in turns: noise costs more than tracking.
        levels = np.rint(generator.normal(12.0, 4.0, (5, *clip.images[0].shape)))
        noise = np.clip(levels, 0, 255).astype(np.uint8)
        count = max(round(seconds / clip.interval), 1)
        images = [noise[index % 5] for index in range(count)]
        boxes = np.insert(clip.boxes, [first] * count, np.nan, axis=0)
        shown = (*clip.images[:first], *images, *clip.images[first:])
        return Clip(clip.name, shown, boxes, clip.interval)

    return situation


def frozen(clip: Clip, first: int, end: int) -> Clip:
    """One image again and again, while the target moves on."""
    return _changed(clip, first, end, lambda index, image, box: clip.images[first - 1])


def panned(clip: Clip, first: int, end: int) -> Clip:
    """The view pans to the mirrored scene without the target."""

    def change(index: int, image: Image, box: NDArray[np.float64]) -> Image:
        width = image.shape[1]
        other = cv2.flip(erased(image, box), 1)
        shift = round(width * min((index + 1) / _TRANSITION, 1.0))
        box[0] -= shift
        if box[0] + box[2] / 2 < 0.0:
            box[:] = np.nan
        return np.hstack([image[:, shift:], other[:, :shift]])

    return _changed(clip, first, end, change)


def inpainted(clip: Clip, first: int, end: int) -> Clip:
    """The target is erased: its surroundings are continued over it."""
    return _changed(clip, first, end, lambda index, image, box: erased(image, box), gone_after=0)


def covered_by_stranger(clip: Clip, first: int, end: int) -> Clip:
    """A patch of the same image slides over the target and stays there; the target is gone."""
    patch = _stranger(clip.images[first], clip.boxes[first])

    def change(index: int, image: Image, box: NDArray[np.float64]) -> Image:
        base = image if index < _TRANSITION else erased(image, box)
        place = clip.boxes[first + min(index, _TRANSITION)].copy()
        place[0] -= place[2] * 2.0 * max(1.0 - index / _TRANSITION, 0.0)
        return _pasted(base, patch, place)

    return _changed(clip, first, end, change, gone_after=_TRANSITION)


def crossed_by_copy(clip: Clip, first: int, end: int, *, is_alike: bool = True) -> Clip:
    """A copy of the first look passes over the target, which stays visible but for the copy.

    A copy that is not alike is mirrored and 15 % darker.
    """
    patch = _crop(clip.images[0], clip.boxes[0])
    if not is_alike:
        patch = cv2.convertScaleAbs(cv2.flip(patch, 1), alpha=0.85)

    def change(index: int, image: Image, box: NDArray[np.float64]) -> Image:
        progress = (index + 0.5) / (end - first)
        place = box.copy()
        place[0] += box[2] * 6.0 * (progress - 0.5)
        return _pasted(image, patch, place)

    return _changed(clip, first, end, change)


def noisy(clip: Clip, first: int, end: int) -> Clip:
    """Noise with a standard deviation that rises to 40 gray levels."""
    generator = np.random.default_rng(_NOISE_SEED)
    noise = generator.normal(0.0, 40.0, clip.images[0].shape).astype(np.float32)

    def change(index: int, image: Image, box: NDArray[np.float64]) -> Image:
        rolled = np.roll(noise, 7919 * (index + 1))
        return np.clip(image + _rise(index, end - first) * rolled, 0, 255).astype(np.uint8)

    return _changed(clip, first, end, change)


def turned(clip: Clip, first: int, end: int) -> Clip:
    """The image turns around the target by 180 degrees."""
    return _warped(clip, first, end, lambda rise, box: (180.0 * rise, 1.0))


def shrunk(clip: Clip, first: int, end: int) -> Clip:
    """The image shrinks around the target until this is 8 px large."""
    return _warped(clip, first, end, lambda rise, box: (0.0, (min(8.0 / _size(box), 1.0)) ** rise))


SITUATIONS: Mapping[str, Situation] = MappingProxyType(
    {
        "view pans away": panned,
        "erased by inpainting": inpainted,
        "a stranger covers it and stays": covered_by_stranger,
        "a copy of its first look passes": crossed_by_copy,
        "the same, mirrored and 15 % darker": partial(crossed_by_copy, is_alike=False),
        "one frozen image": frozen,
        "noise": noisy,
        "turning": turned,
        "shrinking to 8 px": shrunk,
        **{f"covered for {seconds:g} s": covered(seconds) for seconds in (0.2, 1, 5, 30)},
    }
)
"""Name of a situation to what makes it."""


def erased(image: Image, box: NDArray[np.float64]) -> Image:
    """The image without a (4,) box: its surroundings are continued over it."""
    size = box[2:] * _ERASED
    center = box[:2] + box[2:] / 2
    low = np.maximum(np.floor(center - size), 0).astype(int)
    high = np.minimum(np.ceil(center + size), image.shape[1::-1]).astype(int)
    if (high - low < 2).any():
        return image
    window = image[low[1] : high[1], low[0] : high[0]]
    mask = np.zeros(window.shape[:2], np.uint8)
    start = np.maximum(np.floor(center - size / 2) - low, 0).astype(int)
    stop = np.maximum(np.ceil(center + size / 2) - low, 0).astype(int)
    mask[start[1] : stop[1], start[0] : stop[0]] = 255
    scale = min(_ERASED_SIZE / _size(box), 1.0)
    reduced = [max(round(side * scale), 1) for side in window.shape[1::-1]]
    small = cv2.resize(window, reduced, interpolation=cv2.INTER_AREA)
    small_mask = cv2.resize(mask, reduced, interpolation=cv2.INTER_NEAREST)
    filled = cv2.inpaint(small, small_mask, 3, cv2.INPAINT_TELEA)
    filled = cv2.resize(filled, window.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    result = image.copy()
    result[low[1] : high[1], low[0] : high[0]] = np.where(mask[..., None] > 0, filled, window)
    return result


def _changed(
    clip: Clip,
    first: int,
    end: int,
    change: Callable[[int, Image, NDArray[np.float64]], Image],
    *,
    gone_after: int | None = None,
) -> Clip:
    """The clip with changed images from `first` to before `end`.

    The change gets the number of frames since `first`, the image and the true box, and may move
    that. The target is not to be seen after some frames, or always is (None).
    """
    images, boxes = list(clip.images), clip.boxes.copy()
    for index in range(first, end):
        images[index] = change(index - first, images[index], boxes[index])
    if gone_after is not None:
        boxes[first + gone_after : end] = np.nan
    return Clip(clip.name, tuple(images), boxes, clip.interval)


def _warped(
    clip: Clip,
    first: int,
    end: int,
    transform: Callable[[float, NDArray[np.float64]], tuple[float, float]],
) -> Clip:
    """The clip turned and scaled around the target, by degrees and factor of each frame."""

    def change(index: int, image: Image, box: NDArray[np.float64]) -> Image:
        degrees, scale = transform(_rise(index, end - first), box)
        center = box[:2] + box[2:] / 2
        box[2:] *= scale
        box[:2] = center - box[2:] / 2
        matrix = cv2.getRotationMatrix2D(center.tolist(), degrees, scale)
        size = image.shape[1::-1]
        return cv2.warpAffine(
            image, matrix, size, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REFLECT
        )

    return _changed(clip, first, end, change)


def _stranger(image: Image, box: NDArray[np.float64]) -> Image:
    """The patch of the box's size with the most structure that is apart from it."""
    width, height = (max(round(side), 1) for side in box[2:])
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    best, most = image[:height, :width], -1.0
    for y in range(0, image.shape[0] - height + 1, max(height // 2, 1)):
        for x in range(0, image.shape[1] - width + 1, max(width // 2, 1)):
            is_apart = abs(x - box[0]) > 1.5 * width or abs(y - box[1]) > 1.5 * height
            structure = float(gray[y : y + height, x : x + width].std())
            if is_apart and structure > most:
                best, most = image[y : y + height, x : x + width], structure
    return best.copy()


def _crop(image: Image, box: NDArray[np.float64]) -> Image:
    """The part of the image in a (4,) box."""
    left, top, right, bottom = np.rint([*box[:2], *(box[:2] + box[2:])]).astype(int)
    return image[max(top, 0) : max(bottom, top + 1), max(left, 0) : max(right, left + 1)].copy()


def _pasted(image: Image, patch: Image, box: NDArray[np.float64]) -> Image:
    """The image with a patch scaled into a (4,) box, and clipped at the borders."""
    width, height = (max(round(side), 1) for side in box[2:])
    patch = cv2.resize(patch, (width, height), interpolation=cv2.INTER_AREA)
    x, y = round(box[0]), round(box[1])
    left, top = max(x, 0), max(y, 0)
    right, bottom = min(x + width, image.shape[1]), min(y + height, image.shape[0])
    result = image.copy()
    if right > left and bottom > top:
        result[top:bottom, left:right] = patch[top - y : bottom - y, left - x : right - x]
    return result


def _size(box: NDArray[np.float64]) -> float:
    return max(math.sqrt(box[2] * box[3]), 1.0)


def _rise(index: int, count: int) -> float:
    """From 0 to 1 in the first half of a situation, and 1 from there on."""
    return min(2.0 * (index + 1) / count, 1.0)
