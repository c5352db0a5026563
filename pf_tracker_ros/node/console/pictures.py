"""Image messages as JPEG, for browsers."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.decoding.decoder import ImageDecoder
from pf_tracker_ros.decoding.image_decoding import ImageError
from pf_tracker_ros.frames.gray_range import range_of, sample, to_8_bit

_QUALITY = 80
# Wider pictures show no more on a screen, and take their time on the way.
_WIDEST = 1920
_LARGEST = 2**25


@dataclass(frozen=True)
class Picture:
    """A picture for the page.

    Attributes:
        width: Of the image that it shows, pixels.
        height: Of the same.
        jpeg: Its bytes, of the same aspect ratio; empty where it cannot be shown.
        error: Why it cannot, or empty.
    """

    width: int
    height: int
    jpeg: bytes
    error: str = ""


def picture_of(message: Image | CompressedImage) -> Picture:
    """Decode an image message and encode it for the page."""
    try:
        image = ImageDecoder(_LARGEST).decode(message)
        if not image.size:
            return Picture(0, 0, b"", "the image has no pixels")
        if image.dtype != "uint8":
            image = to_8_bit(image, range_of(sample(image), margin=0.0))
        height, width = image.shape[:2]
        if width > _WIDEST:
            size = (_WIDEST, max(1, round(height * _WIDEST / width)))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    except (ImageError, cv2.error, ValueError) as error:
        return Picture(0, 0, b"", f"the image cannot be shown: {error}")
    return Picture(width, height, jpeg.tobytes())
