"""How a frame becomes 8 bits: gain control of more than 8 bits, changes of light of 8 bits."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# (dark, bright): the values that become 0 and 255.
GrayRange = tuple[float, float]
# Of uint16 or float32.
Values = NDArray[Any]

# Percentiles that an image's gray range spans: single hot or dead pixels must not stretch it.
_PERCENTILES = (1.0, 99.0)
_MARGIN = 0.25
# At most so many pixels are looked at.
_SAMPLES = 20_000
# Seconds in which a range comes nearer to that of the images by a factor of e: slow beside the
# templates, quick beside a sensor that warms up.
_TIME = 10.0


def gray_range(image: NDArray[np.generic]) -> GrayRange | None:
    """The (dark, bright) values that the image's 8-bit version spans; None for 8 bit.

    Args:
        image: (H, W) uint16 or float32, where pixels that are not finite are left out, or uint8.
    """
    if image.dtype == np.uint8:
        return None
    values = sample(image)
    return range_of(values) if values.size else (0.0, 1.0)


def sample(image: NDArray[np.generic]) -> Values:
    """(N,) values all over an image of uint16 or float32, those that are not finite left out."""
    stride = math.ceil(math.sqrt(image.size / _SAMPLES))
    height, width = image.shape[:2]
    down = across = stride
    if min(height, width) < stride:
        # A side that is so short is looked at in full, the other one the less.
        longer = math.ceil(image.size / _SAMPLES)
        down, across = (1, longer) if height < width else (longer, 1)
    values = image[::down, ::across].ravel()
    return values if image.dtype == np.uint16 else values[np.isfinite(values)]


def range_of(values: Values, margin: float = _MARGIN) -> GrayRange:
    """The gray range of (N,) values, at least one.

    Args:
        values: As of `sample`.
        margin: On both sides, as a share of what is between their bounds. There is always one if
            they are hardly apart.
    """
    is_whole = values.dtype == np.uint16
    # Of 16 bits, which a stable sort sorts digit by digit, percentiles are found sooner in order.
    exact = np.sort(values, kind="stable") if is_whole else values.astype(np.float64)
    low, high = np.percentile(exact, _PERCENTILES, overwrite_input=True).tolist()
    smallest = 1.0 if is_whole else 1e-6 * max(1.0, abs(low), abs(high))
    if high - low < smallest:
        margin = max(margin, _MARGIN)
    beyond = margin * max(high - low, smallest)
    return low - beyond, high + beyond


def adapt_range(span: GrayRange, own: GrayRange, interval: float) -> GrayRange:
    """The range after a frame: a little nearer to that of the frame.

    Args:
        span: The range before.
        own: What `gray_range` says of the frame.
        interval: Seconds since the frame before.
    """
    share = -math.expm1(-interval / _TIME)
    return span[0] + share * (own[0] - span[0]), span[1] + share * (own[1] - span[1])


def to_8_bit(image: NDArray[np.generic], span: GrayRange | None) -> NDArray[np.uint8]:
    """The image with 8 bits a channel; what is not a number becomes black.

    Args:
        image: As for `gray_range`, or (H, W, 3) uint8.
        span: Of `gray_range`.
    """
    if span is None:
        return image  # type: ignore[return-value]
    low, high = span
    scaled = image.astype(np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        scaled -= low
        scaled *= 255.0 / (high - low)
    if image.dtype != np.uint16:
        # Of a number and what is none, this takes the number.
        np.fmax(scaled, 0.0, out=scaled)
    np.clip(scaled, 0.0, 255.0, out=scaled)
    return scaled.astype(np.uint8)


# Seconds that images unlike those before must last, and be like each other: a shutter, a glitch on
# the wire or a flash leave the range alone.
_PATIENCE = 0.5
# An image suits a range that holds this share of its values, ...
_SHARE_INSIDE = 0.5
# ... and is at most so many times as wide, or as narrow, as the image's own: 32 grays are left to
# the narrower one.
_CONTRAST = 8.0


@dataclass(frozen=True)
class GainControl:
    """The gray range of a stream of images, and what it takes to move it; a value.

    The range follows slowly, so that templates see no jump while a sensor warms up. An image that
    is far outside of the range, fills next to nothing of it or exceeds it by far leaves it as it
    was, and so is shown clipped, or flat. Once such images have lasted, the range moves to where
    they are: at once if they were not to be seen, and slowly if they were. Where an image is seen
    well in the range before that, as after a shutter, it returns at once.

    Attributes:
        span: In use; None before the first image with values, and for images of 8 bit.
        previous_span: The last one that was left at once; None if there is none.
        outlier_span: Of the last image, if that was unlike those before; else None.
        outlier_for: Seconds for which images have been unlike those before, and like each other.
    """

    span: GrayRange | None = None
    previous_span: GrayRange | None = None
    outlier_span: GrayRange | None = None
    outlier_for: float = 0.0

    def update(self, image: NDArray[np.generic], interval: float) -> GainControl:
        """The gain control as it is for this image.

        Args:
            image: (H, W) uint16 or float32, where pixels that are not finite are left out; images
                of 8 bit have no range.
            interval: Seconds since the image before.
        """
        if image.dtype == np.uint8:
            return self
        values = sample(image)
        if values.size == 0:
            return self
        own = range_of(values)
        if self.span is None:
            return GainControl(own)
        if _suits(self.span, values, own):
            return GainControl(adapt_range(self.span, own, interval), self.previous_span)
        if self.previous_span and _suits(self.previous_span, values, own):
            return GainControl(adapt_range(self.previous_span, own, interval), self.span)
        lasts = self.outlier_span is not None and _suits(self.outlier_span, values, own)
        outlier_for = self.outlier_for + interval if lasts else 0.0
        waiting = replace(self, outlier_span=own, outlier_for=outlier_for)
        return (
            waiting if outlier_for < _PATIENCE else waiting._moved(self.span, values, own, interval)
        )

    def _moved(
        self, span: GrayRange, values: Values, own: GrayRange, interval: float
    ) -> GainControl:
        """After an image unlike those before, of which there were others."""
        if not _holds(span, values):
            return GainControl(own, span)
        if _width(own) > _width(span):
            return replace(self, span=adapt_range(span, own, interval))
        # No range shows more of an image of one value.
        return self if values.min() == values.max() else GainControl(own, span)


def _suits(span: GrayRange, values: Values, own: GrayRange) -> bool:
    """Whether values, with a range of their own, are seen well in a range, and fill it."""
    ratio = _width(own) / _width(span)
    return 1.0 / _CONTRAST <= ratio <= _CONTRAST and _holds(span, values)


def _holds(span: GrayRange, values: Values) -> bool:
    with np.errstate(over="ignore"):
        inside = (values >= span[0]) & (values <= span[1])
    return bool(np.count_nonzero(inside) >= _SHARE_INSIDE * values.size)


def _width(span: GrayRange) -> float:
    return span[1] - span[0]


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
_GIVEN_BACK_IN = 10.0
# A factor from one image to the next that is more than a cloud before the sun.
_JUMP = 1.2
# What is multiplied by more, or less than one part of it, has too few levels left to tell colors.
_MOST = 4.0


@dataclass(frozen=True, eq=False)
class Illumination:
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

    def update(self, image: NDArray[np.generic], interval: float) -> Illumination:
        """The light of this image.

        Args:
            image: (H, W, 3) or (H, W), of the size of the last one.
            interval: Seconds since that one.
        """
        if image.dtype != np.uint8:
            return self
        thumbnail = _thumbnail(image)
        change = 1.0 if self.thumbnail is None else _change(self.thumbnail, thumbnail)
        gain = change * self.gain ** math.exp(-interval / _GIVEN_BACK_IN)
        return Illumination(1.0 if abs(math.log(gain)) < _LEAST_CHANGE else gain, thumbnail, change)


UNCHANGED_ILLUMINATION = Illumination()
"""That of a stream's first image."""


def gain_table(gain: float) -> NDArray[np.uint8]:
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
