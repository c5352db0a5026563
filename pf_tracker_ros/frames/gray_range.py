"""Which gray values an image of more than 8 bits shows: its 8-bit view spans them."""

from __future__ import annotations

import math
from typing import Any

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
