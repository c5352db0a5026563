"""Which gray values an image of more than 8 bits shows: its 8-bit view spans them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# (dark, bright): the values that become 0 and 255.
GrayRange = tuple[float, float]

# Percentiles that an image's gray range spans: single hot or dead pixels must not stretch it.
_PERCENTILES = (1.0, 99.0)
_MARGIN = 0.25
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
    stride = max(1, math.isqrt(image.size // _SAMPLES))
    sample = image[::stride, ::stride]
    values = sample[np.isfinite(sample)].astype(np.float64)
    if values.size == 0:
        return 0.0, 1.0
    low, high = (float(value) for value in np.percentile(values, _PERCENTILES))
    smallest = 1.0 if image.dtype == np.uint16 else 1e-6 * max(1.0, abs(low), abs(high))
    margin = _MARGIN * max(high - low, smallest)
    return low - margin, high + margin


def adapt_range(
    span: GrayRange | None, image: NDArray[np.generic], interval: float
) -> GrayRange | None:
    """The range after a frame: a little nearer to what `gray_range` says of it.

    Args:
        span: The range before.
        image: The frame, of the kind that `span` was made for.
        interval: Seconds since the frame before.
    """
    own = gray_range(image)
    if span is None or own is None:
        return span
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
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = (image.astype(np.float32) - low) * (255.0 / (high - low))
    if image.dtype != np.uint16:
        np.nan_to_num(scaled, copy=False, nan=0.0)
    return np.clip(scaled, 0.0, 255.0).astype(np.uint8)
