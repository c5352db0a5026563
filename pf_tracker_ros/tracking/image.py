"""Checks of what comes from outside: images and boxes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Percentiles that an image's gray range spans: single hot or dead pixels must not stretch it.
_RANGE_PERCENTILES = (1.0, 99.0)
_RANGE_MARGIN = 0.25
_RANGE_SAMPLES = 20_000
# Seconds in which a range comes nearer to that of the images by a factor of e: slow beside the
# templates, quick beside a sensor that warms up.
_RANGE_TIME = 10.0


def check_image(image: NDArray[np.generic]) -> None:
    """Refuse what is not an image.

    Raises:
        ValueError: `image` is not (H, W, 3) uint8, (H, W) uint8 or (H, W) uint16, or is empty.
    """
    allowed = "(H, W, 3) uint8 BGR, (H, W) uint8 or (H, W) uint16"
    if not isinstance(image, np.ndarray):
        raise ValueError(f"image is a {type(image).__name__}; allowed: an array {allowed}")
    color = image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8
    gray = image.ndim == 2 and image.dtype in (np.uint8, np.uint16)
    if not (color or gray):
        raise ValueError(f"image is {image.shape} {image.dtype}; allowed: {allowed}")
    if image.size == 0:
        raise ValueError(f"image is {image.shape}, which has no pixels")


def check_box(box: ArrayLike, image_size: tuple[int, int]) -> tuple[float, float, float, float]:
    """The box as four floats.

    Args:
        box: (x, y, width, height) in pixels.
        image_size: (width, height) of the image that it lies in.

    Raises:
        ValueError: Not four finite numbers, no area, larger than the image, or outside it.
    """
    values = _numbers(box)
    if values is None or values.shape != (4,) or not np.isfinite(values).all():
        raise ValueError(
            f"box is {box!r}; expected four finite numbers (x, y, width, height) in pixels"
        )
    x, y, width, height = (float(value) for value in values)
    image_width, image_height = image_size
    text = f"box ({x:g}, {y:g}, {width:g}, {height:g})"
    if width < 1.0 or height < 1.0:
        raise ValueError(f"{text} is too small; width and height must be at least 1 px")
    if width > image_width or height > image_height:
        raise ValueError(f"{text} is larger than the image, {image_width} x {image_height} px")
    center_x, center_y = x + width / 2, y + height / 2
    if not (0 <= center_x <= image_width and 0 <= center_y <= image_height):
        raise ValueError(
            f"the center of {text} is outside the image, {image_width} x {image_height} px"
        )
    return x, y, width, height


def check_interval(interval: float) -> float:
    """The interval as a float.

    Raises:
        ValueError: Not a finite number of seconds of at least 0.
    """
    seconds = _numbers(interval)
    if seconds is None or seconds.shape != () or not 0.0 <= seconds < math.inf:
        raise ValueError(f"dt is {interval!r}; allowed: a finite number of seconds from 0 up")
    return float(seconds)


def _numbers(values: object) -> NDArray[np.float64] | None:
    """A number, or numbers of any shape, as an array; None for what only resembles them.

    Truth values, texts, times, complex numbers and Python objects are refused, although NumPy
    would turn some of them into numbers.
    """
    if isinstance(values, Sequence) and any(isinstance(one, bool | np.bool_) for one in values):
        return None
    try:
        array = np.asarray(values)
        return array.astype(np.float64) if array.dtype.kind in "iuf" else None
    except (TypeError, ValueError):
        return None


def gray_range(image: NDArray[np.generic]) -> tuple[float, float] | None:
    """The (dark, bright) values that the image's 8-bit version spans; None for 8 bit.

    Args:
        image: (H, W) uint16 or float32, where pixels that are not finite are left out, or uint8.
    """
    if image.dtype == np.uint8:
        return None
    stride = max(1, math.isqrt(image.size // _RANGE_SAMPLES))
    sample = image[::stride, ::stride]
    values = sample[np.isfinite(sample)].astype(np.float64)
    if values.size == 0:
        return 0.0, 1.0
    low, high = (float(value) for value in np.percentile(values, _RANGE_PERCENTILES))
    smallest = 1.0 if image.dtype == np.uint16 else 1e-6 * max(1.0, abs(low), abs(high))
    margin = _RANGE_MARGIN * max(high - low, smallest)
    return low - margin, high + margin


def adapted_range(
    span: tuple[float, float] | None, image: NDArray[np.generic], interval: float
) -> tuple[float, float] | None:
    """The range after a frame: a little nearer to what `gray_range` says of it.

    Args:
        span: The range before.
        image: The frame, of the kind that `span` was made for.
        interval: Seconds since the frame before.
    """
    own = gray_range(image)
    if span is None or own is None:
        return span
    share = -math.expm1(-interval / _RANGE_TIME)
    return span[0] + share * (own[0] - span[0]), span[1] + share * (own[1] - span[1])


def to_8_bit(image: NDArray[np.generic], span: Sequence[float] | None) -> NDArray[np.uint8]:
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
