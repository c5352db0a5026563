"""Image messages as JPEG, for browsers."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.decoding.decoder import ImageDecoder
from pf_tracker_ros.decoding.image_decoding import ImageError
from pf_tracker_ros.frames.exposure import range_of, sample, to_8_bit

# Wider pictures show no more on a screen, and take their time on the way.
_WIDEST = 1920
_LARGEST = 2**25
# Few sizes, so that one picture serves several windows.
_SCALES = (1.0, 0.75, 0.5, 0.35, 0.25, 0.18, 0.125)


@dataclass(frozen=True)
class QualityLevel:
    """How much of an image a picture shows.

    Attributes:
        quality: Of the JPEG, 0 to 100.
        scale: Of its sides, relative to the image's.
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
"""From the most on, each about as much less than the one before."""


@dataclass(frozen=True)
class EncodedImage:
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


def encode_image(message: Image | CompressedImage, detail: QualityLevel) -> EncodedImage:
    """Decode an image message and encode it for the page."""
    try:
        image = ImageDecoder(_LARGEST).decode(message)
        if not image.size:
            return EncodedImage(0, 0, b"", "the image has no pixels")
        if image.dtype != "uint8":
            image = to_8_bit(image, range_of(sample(image), margin=0.0))
        height, width = image.shape[:2]
        shown = round(min(_WIDEST, max(1.0, width * detail.scale)))
        if shown < width:
            size = (shown, max(1, round(height * shown / width)))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, detail.quality])
    except (ImageError, cv2.error, ValueError) as error:
        return EncodedImage(0, 0, b"", f"the image cannot be shown: {error}")
    return EncodedImage(width, height, jpeg.tobytes())


def scale_for(image_width: float, window_width: float) -> float:
    """The least scale at which an image fills a window; both widths in pixels."""
    fitting = [scale for scale in _SCALES if image_width * scale >= window_width]
    return min(fitting, default=1.0)
