"""Decodes depth images, raw or compressed.

1. A raw image is 16UC1 in millimeters or 32FC1 in meters (REP 118). mono16 counts as 16UC1.
2. A compressed one of the transport `compressed` is a PNG of 16UC1.
3. One of the transport `compressedDepth` begins with 12 bytes: a number that is ignored, and two
   single-precision parameters a and b. A PNG of 16 bits follows. For 32FC1 it holds inverse
   depths v, and the depth is a / (v - b), without a measurement for v = 0.

Sources: REP 118; the definition of the transport, compressed_depth_image_transport.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from pf_tracker_ros.decoding.image_decoding import (
    CompressedImage,
    ImageError,
    Pixels,
    RawImage,
    decode_compressed,
    decode_raw,
    quote,
)

_RAW_ENCODINGS = ("16UC1", "mono16", "32FC1")
_HEADER = struct.Struct("<Iff")


def decode_depth(message: RawImage | CompressedImage, max_pixels: int) -> Pixels:
    """The depth image of a message.

    Args:
        message: sensor_msgs/Image or CompressedImage.
        max_pixels: Maximum number of pixels of a compressed image.

    Returns:
        (height, width) uint16 in millimeters, 0 or 65535 without a measurement; or (height, width)
        float32 in meters, not finite or 0 without a measurement.

    Raises:
        ImageError: The message has no such image.
    """
    # Only CompressedImage has this field.
    if hasattr(message, "format"):
        return _decode_compressed(cast(CompressedImage, message), max_pixels)
    if message.encoding not in _RAW_ENCODINGS:
        raise ImageError(
            "encoding",
            f"its encoding is {quote(message.encoding)}; allowed for depth: 16UC1 in millimeters, "
            "32FC1 in meters",
        )
    return decode_raw(message)


@dataclass(frozen=True)
class _File:
    """The file in a message of the transport compressedDepth.

    Attributes:
        format: Of the message.
        data: The file.
    """

    format: str
    data: Any


def _decode_compressed(message: CompressedImage, max_pixels: int) -> Pixels:
    if "compressedDepth" not in message.format:
        return _png_of(message, max_pixels)
    data = memoryview(message.data).cast("B")
    if len(data) < _HEADER.size or "rvl" in message.format.lower():
        raise ImageError(
            "format",
            f"its format is {quote(message.format)} with {len(data)} bytes; allowed: PNG behind "
            f"{_HEADER.size} bytes (parameter format:=png of the publisher)",
        )
    _, numerator, offset = _HEADER.unpack_from(data)
    values = _png_of(_File("png", data[_HEADER.size :]), max_pixels)
    if not message.format.lstrip().startswith("32FC1"):
        return values
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depths = np.float32(numerator) / (values.astype(np.float32) - np.float32(offset))
    return np.where(values == 0, np.float32(np.nan), depths)


def _png_of(message: CompressedImage, max_pixels: int) -> Pixels:
    image = decode_compressed(message, max_pixels)
    if image.ndim != 2 or image.dtype != np.uint16:
        raise ImageError(
            "format",
            f"its data of the format {quote(message.format)} has {image.dtype.itemsize * 8} bits; "
            "allowed for depth: PNG with 16 bits a pixel",
        )
    return image
