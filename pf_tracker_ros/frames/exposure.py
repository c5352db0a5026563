"""Conversion to 8 bits that keeps the target's appearance when sensor or light change.

- Images of more than 8 bits (`GainControl`): a gray range, from percentiles of the images, becomes
  0 to 255. It adapts slowly, so templates see no jump.
- Images of 8 bits (`Illumination`): a brightness change of the whole image is estimated from small
  thumbnails, as the median of the log ratios, and divided out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# (dark, bright): the values that become 0 and 255.
GrayRange = tuple[float, float]
# uint16 or float32.
Values = NDArray[Any]

# Percentiles of an image's gray range; they exclude hot and dead pixels.
_PERCENTILES = (1.0, 99.0)
_MARGIN = 0.25
# Largest number of sampled pixels.
_SAMPLES = 20_000
# Time constant in seconds of the range: slower than the templates, faster than a warming sensor.
_TIME_CONSTANT = 10.0


def gray_range(image: NDArray[np.generic]) -> GrayRange | None:
    """The (dark, bright) values of an image that become 0 and 255; None for 8 bits.

    Pixels that are not finite are ignored.
    """
    if image.dtype == np.uint8:
        return None
    values = sample(image)
    return range_of(values) if values.size else (0.0, 1.0)


def sample(image: NDArray[np.generic]) -> Values:
    """(N,) finite values, sampled evenly from a uint16 or float32 image."""
    stride = math.ceil(math.sqrt(image.size / _SAMPLES))
    height, width = image.shape[:2]
    down = across = stride
    if min(height, width) < stride:
        # A very short side is read completely.
        longer = math.ceil(image.size / _SAMPLES)
        down, across = (1, longer) if height < width else (longer, 1)
    values = image[::down, ::across].ravel()
    return values if image.dtype == np.uint16 else values[np.isfinite(values)]


def range_of(values: Values, margin: float = _MARGIN) -> GrayRange:
    """The gray range of (N,) values from `sample`, N >= 1.

    The margin on both sides is a share of the range; at least the default if the values are almost
    equal.
    """
    is_whole = values.dtype == np.uint16
    # For 16 bits a stable sort is a radix sort, which makes the percentiles faster.
    exact = np.sort(values, kind="stable") if is_whole else values.astype(np.float64)
    low, high = np.percentile(exact, _PERCENTILES, overwrite_input=True).tolist()
    smallest = 1.0 if is_whole else 1e-6 * max(1.0, abs(low), abs(high))
    if high - low < smallest:
        margin = max(margin, _MARGIN)
    beyond = margin * max(high - low, smallest)
    return low - beyond, high + beyond


def adapt_range(span: GrayRange, own: GrayRange, interval: float) -> GrayRange:
    """The range after a frame, moved towards the frame's own by exponential smoothing."""
    share = -math.expm1(-interval / _TIME_CONSTANT)
    return span[0] + share * (own[0] - span[0]), span[1] + share * (own[1] - span[1])


def to_8_bit(image: NDArray[np.generic], span: GrayRange | None) -> NDArray[np.uint8]:
    """The image with 8 bits per channel, by its range from `gray_range`; NaN becomes black."""
    if span is None:
        return image  # type: ignore[return-value]
    low, high = span
    scaled = image.astype(np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        scaled -= low
        scaled *= 255.0 / (high - low)
    if image.dtype != np.uint16:
        # fmax replaces NaN.
        np.fmax(scaled, 0.0, out=scaled)
    np.clip(scaled, 0.0, 255.0, out=scaled)
    return scaled.astype(np.uint8)


# Seconds that outlier images must last, and agree with each other, to move the range. A shutter, a
# transmission error or a flash is shorter.
_OUTLIERS_ACCEPTED_AFTER = 0.5
# An image suits a range that contains this share of its values, ...
_SHARE_INSIDE = 0.5
# ... and whose width differs from the image's own range by at most this factor: 32 grays remain.
_MAX_WIDTH_RATIO = 8.0


@dataclass(frozen=True)
class GainControl:
    """The gray range of a stream of images (automatic gain control); immutable.

    1. An image that suits the range moves it slowly, so templates see no jump.
    2. An outlier, far outside the range or of very different contrast, leaves it unchanged.
    3. When outliers last and agree, the range jumps to theirs, or moves slowly if they are visible
       in it but exceed it.
    4. When an image suits the range before such a jump, as after a shutter, that range returns.

    Attributes:
        span: Present range; None before the first image with values, and for 8 bits.
        previous_span: Range before the last jump; None without a jump.
        outlier_span: Range of the last image if it was an outlier; else None.
        outlier_for: Seconds of consecutive outliers that agree with each other.
    """

    span: GrayRange | None = None
    previous_span: GrayRange | None = None
    outlier_span: GrayRange | None = None
    outlier_for: float = 0.0

    def update(self, image: NDArray[np.generic], interval: float) -> GainControl:
        """The gain control for this image; images of 8 bits have no range.

        Pixels that are not finite are ignored.
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
        agrees = self.outlier_span is not None and _suits(self.outlier_span, values, own)
        outlier_for = self.outlier_for + interval if agrees else 0.0
        updated = replace(self, outlier_span=own, outlier_for=outlier_for)
        is_accepted = outlier_for >= _OUTLIERS_ACCEPTED_AFTER
        return updated._moved(self.span, values, own, interval) if is_accepted else updated

    def _moved(
        self, span: GrayRange, values: Values, own: GrayRange, interval: float
    ) -> GainControl:
        """The gain control after outliers that lasted."""
        if not _contains(span, values):
            return GainControl(own, span)
        if _width(own) > _width(span):
            return replace(self, span=adapt_range(span, own, interval))
        # An image of one value has no better range.
        return self if values.min() == values.max() else GainControl(own, span)


def _suits(span: GrayRange, values: Values, own: GrayRange) -> bool:
    """Whether a range shows values well; `own` is the range of these values."""
    ratio = _width(own) / _width(span)
    return 1.0 / _MAX_WIDTH_RATIO <= ratio <= _MAX_WIDTH_RATIO and _contains(span, values)


def _contains(span: GrayRange, values: Values) -> bool:
    with np.errstate(over="ignore"):
        inside = (values >= span[0]) & (values <= span[1])
    return bool(np.count_nonzero(inside) >= _SHARE_INSIDE * values.size)


def _width(span: GrayRange) -> float:
    return span[1] - span[0]


Thumbnail = NDArray[np.float32]

# (width, height) of thumbnails, and image pixels averaged along each axis of a thumbnail pixel.
_THUMBNAIL_SIZE = (24, 18)
_PIXELS_AVERAGED = 4
# Gray levels in which the ratio of two means is reliable: above noise and below saturation.
_DARKEST, _BRIGHTEST = 12.0, 200.0
# Share of a thumbnail that must be reliable.
_MIN_RELIABLE_SHARE = 0.1
# Smaller changes of the log gain are ignored; they do not change color bins.
_MIN_CHANGE = 0.04
# What one gain may leave unexplained, as a share of the change between the images and of the
# contrast in each. More is a change of the scene or of the camera's view.
_MAX_UNEXPLAINED, _MAX_UNEXPLAINED_CONTRAST = 0.5, 2.0
# Time constant in seconds of the gain's return to 1: slower than the templates.
_TIME_CONSTANT_OF_GAIN = 10.0
# Larger factors from one image to the next are a jump, not a cloud.
_JUMP = 1.2
# Largest factor of the correction; more leaves too few levels for colors.
_MAX_CORRECTION = 4.0


@dataclass(frozen=True, eq=False)
class Illumination:
    """Brightness of a stream of 8-bit images, relative to that of the templates.

    Automatic exposure, a lamp or a cloud multiplies the whole image by one factor. Divided by this
    gain, the colors match the templates again.

    Attributes:
        gain: Brightness relative to the templates, > 0. It is unlimited, so that it returns to 1
            when the light does.
        thumbnail: Thumbnail of the last image; None before the first, and for more than 8 bits.
        change: Brightness relative to the last image.
    """

    gain: float = 1.0
    thumbnail: Thumbnail | None = None
    change: float = 1.0

    @property
    def has_jumped(self) -> bool:
        """Whether the brightness changed abruptly with this image."""
        return abs(math.log(self.change)) > math.log(_JUMP)

    def update(self, image: NDArray[np.generic], learning: float) -> Illumination:
        """The illumination of this image, of the last one's size.

        The gain returns to 1 over the seconds in which templates learned the illumination since.
        """
        if image.dtype != np.uint8:
            return self
        thumbnail = _thumbnail(image)
        change = 1.0 if self.thumbnail is None else _change(self.thumbnail, thumbnail)
        gain = change * self.gain ** math.exp(-learning / _TIME_CONSTANT_OF_GAIN)
        return Illumination(1.0 if abs(math.log(gain)) < _MIN_CHANGE else gain, thumbnail, change)


UNCHANGED_ILLUMINATION = Illumination()
"""The illumination of a stream's first image."""


def gain_table(gain: float) -> NDArray[np.uint8]:
    """(256,) lookup table that divides gray levels by a gain, within the largest correction."""
    gain = min(max(gain, 1.0 / _MAX_CORRECTION), _MAX_CORRECTION)
    return np.rint(np.minimum(np.arange(256) / gain, 255.0)).astype(np.uint8)


def _thumbnail(image: NDArray[np.generic]) -> Thumbnail:
    """(18, 24) brightness, each the mean of a few pixels."""
    width, height = _THUMBNAIL_SIZE
    sampled_size = (width * _PIXELS_AVERAGED, height * _PIXELS_AVERAGED)
    sampled = cv2.resize(image, sampled_size, interpolation=cv2.INTER_NEAREST)
    small = cv2.resize(sampled, _THUMBNAIL_SIZE, interpolation=cv2.INTER_AREA)
    means: Thumbnail = np.asarray(small, dtype=np.float32)
    return means if means.ndim == 2 else means.mean(axis=2)


def _change(before: Thumbnail, now: Thumbnail) -> float:
    """Brightness of `now` relative to `before`; 1 if one factor does not explain the change."""
    darkest, brightest = np.minimum(before, now), np.maximum(before, now)
    is_reliable = (darkest > _DARKEST) & (brightest < _BRIGHTEST)
    if np.count_nonzero(is_reliable) < _MIN_RELIABLE_SHARE * is_reliable.size:
        return 1.0
    pixels_before, pixels_now = before[is_reliable], now[is_reliable]
    # At most half of the pixels changed by the least that counts: most images need no logarithms.
    least = np.float32(math.exp(_MIN_CHANGE))
    brighter = np.count_nonzero(pixels_now >= pixels_before * least)
    darker = np.count_nonzero(pixels_now <= pixels_before / least)
    if max(brighter, darker) <= len(pixels_now) // 2:
        return 1.0
    logs = np.log([pixels_before, pixels_now])
    log_ratio = logs[1] - logs[0]
    change = float(np.median(log_ratio))
    unexplained = np.median(np.abs(log_ratio - change))
    # Of a uniform image, such as a covered lens, every factor explains everything.
    contrast = np.median(np.abs(logs - np.median(logs, axis=1, keepdims=True)), axis=1).min()
    allowed = min(
        _MAX_UNEXPLAINED * np.median(np.abs(log_ratio)), _MAX_UNEXPLAINED_CONTRAST * contrast
    )
    if unexplained > allowed:
        return 1.0
    return math.exp(change)
