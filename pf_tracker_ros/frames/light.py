"""Light that changes: how much brighter a camera's images are than those before."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Thumbnail = NDArray[np.float32]

# (width, height) of the thumbnails; and how many pixels along each axis each of theirs averages.
_SIZE = (24, 18)
_PIXELS_AVERAGED = 4
# Levels within which the ratio of two means tells the light: neither noise nor cut off.
_DARKEST, _BRIGHTEST = 12.0, 200.0
# Share of a thumbnail that must be within them.
_SHARE_TELLING = 0.1
# Changes below this leave colors as they are, as far as they are counted in steps.
_LEAST_CHANGE = 0.04
# Share of the change from one image to the next that may remain once the light is taken out; else
# it was something else that changed: the target, the camera's view, the scene.
_MOST_UNEXPLAINED = 0.5
# Seconds in which what was taken out of the light is given back, by a factor of e: slow beside the
# templates, which follow.
_TIME = 10.0
# A factor from one image to the next that is more than a cloud before the sun.
_JUMP = 1.2
# What is multiplied by more, or less than one part of it, has too few levels left to tell colors.
_MOST = 4.0


@dataclass(frozen=True, eq=False)
class Light:
    """The brightness of a stream of 8-bit images, against what it was before it last changed.

    An exposure that is set anew, a lamp or a cloud changes all of an image by one factor. Templates
    would not know the colors again; divided by that factor, they do.

    Attributes:
        gain: The brightness, 1 is as before; above 0, without a bound, so that light that comes
            back is as it was.
        thumbnail: Of the last image; None before the first, and for images of more than 8 bits,
            which have a gain control.
        change: The brightness against that of the image before.
    """

    gain: float = 1.0
    thumbnail: Thumbnail | None = None
    change: float = 1.0

    @property
    def has_jumped(self) -> bool:
        """Whether all became so much brighter or darker with this image that levels are lost."""
        return abs(math.log(self.change)) > math.log(_JUMP)

    def follow(self, image: NDArray[np.generic], interval: float) -> Light:
        """The light of this image.

        Args:
            image: (H, W, 3) or (H, W), of the size of the last one.
            interval: Seconds since that one.
        """
        if image.dtype != np.uint8:
            return self
        thumbnail = _thumbnail(image)
        change = 1.0 if self.thumbnail is None else _change(self.thumbnail, thumbnail)
        gain = change * self.gain ** math.exp(-interval / _TIME)
        return Light(1.0 if abs(math.log(gain)) < _LEAST_CHANGE else gain, thumbnail, change)


UNCHANGED = Light()
"""That of a stream's first image."""


def relit_levels(gain: float) -> NDArray[np.uint8]:
    """(256,) what each level becomes if light is taken back by a factor, up to the most."""
    gain = min(max(gain, 1.0 / _MOST), _MOST)
    return np.rint(np.minimum(np.arange(256) / gain, 255.0)).astype(np.uint8)


def _thumbnail(image: NDArray[np.generic]) -> Thumbnail:
    """(18, 24) mean brightness of a few pixels each."""
    width, height = _SIZE
    few = (width * _PIXELS_AVERAGED, height * _PIXELS_AVERAGED)
    sampled = cv2.resize(image, few, interpolation=cv2.INTER_NEAREST)
    small = cv2.resize(sampled, _SIZE, interpolation=cv2.INTER_AREA)
    means: Thumbnail = np.asarray(small, dtype=np.float32)
    return means if means.ndim == 2 else means.mean(axis=2)


def _change(before: Thumbnail, now: Thumbnail) -> float:
    """The factor by which all has become brighter; 1 if that is not what has changed."""
    darkest, brightest = np.minimum(before, now), np.maximum(before, now)
    tells = (darkest > _DARKEST) & (brightest < _BRIGHTEST)
    if np.count_nonzero(tells) < _SHARE_TELLING * tells.size:
        return 1.0
    ratio = np.log(now[tells] / before[tells])
    change = float(np.median(ratio))
    if abs(change) < _LEAST_CHANGE:
        return 1.0
    unexplained = np.median(np.abs(ratio - change))
    if unexplained > _MOST_UNEXPLAINED * np.median(np.abs(ratio)):
        return 1.0
    return math.exp(change)
