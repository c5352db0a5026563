"""Encoding of image messages as JPEG for browsers."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.decoding.image_decoding import ImageError, decode_image
from pf_tracker_ros.frames.exposure import range_of, sample, to_8_bit

# Pixels; screens show no more of a wider picture.
_MAX_WIDTH = 1920
_MAX_PIXELS = 2**25
# Pixels; in a narrower picture nobody recognizes the person to draw a box around.
_MIN_WIDTH = 320
# Few scales, so that one encoding serves several windows.
_SCALES = (1.0, 0.75, 0.5, 0.35, 0.25, 0.18, 0.125)


@dataclass(frozen=True)
class QualityLevel:
    """Quality and size of an encoded image.

    Attributes:
        quality: JPEG quality, 0 to 100.
        scale: Side lengths relative to the image.
    """

    quality: int
    scale: float = 1.0


QUALITY_LEVELS = (
    QualityLevel(80),
    QualityLevel(65),
    QualityLevel(50),
    QualityLevel(35),
    QualityLevel(40, 0.75),
    QualityLevel(50, 0.5),
    QualityLevel(35, 0.5),
    QualityLevel(40, 0.35),
    QualityLevel(30, 0.25),
)
"""From the best on; the sizes fall by about the same factor from each to the next."""


@dataclass(frozen=True)
class EncodedImage:
    """An image for the page.

    Attributes:
        width: Of the original image, pixels.
        height: Of the original image, pixels.
        jpeg: The encoded bytes, with the same aspect ratio; empty on an error.
        error: The error, or empty.
    """

    width: int
    height: int
    jpeg: bytes
    error: str = ""


def encode_image(message: Image | CompressedImage, level: QualityLevel) -> EncodedImage:
    """Decode an image message and encode it for the page."""
    try:
        image = decode_image(message, _MAX_PIXELS)
        if not image.size:
            return EncodedImage(0, 0, b"", "the image has no pixels")
        if image.dtype != "uint8":
            image = to_8_bit(image, range_of(sample(image), margin=0.0))
        height, width = image.shape[:2]
        columns = round(min(_MAX_WIDTH, max(1.0, width * level.scale)))
        if columns < width:
            size = (columns, max(1, round(height * columns / width)))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, level.quality])
    except (ImageError, cv2.error, ValueError) as error:
        return EncodedImage(0, 0, b"", f"the image cannot be shown: {error}")
    return EncodedImage(width, height, jpeg.tobytes())


def count_usable_levels(image_width: int) -> int:
    """How many of `QUALITY_LEVELS`, from the best on, are wide enough to draw a target on."""
    return sum(one.scale == 1.0 or image_width * one.scale >= _MIN_WIDTH for one in QUALITY_LEVELS)


def scale_for(image_width: float, window_width: float) -> float:
    """The smallest scale at which an image fills a window; widths in pixels."""
    sufficient = [scale for scale in _SCALES if image_width * scale >= window_width]
    return min(sufficient, default=1.0)
