"""Decodes sensor_msgs/CompressedImage: JPEG and PNG; `decode_image` also takes raw images.

A few bytes can declare an image of gigabytes, or contain much besides the image. A file is checked
before it reaches the decoder:

1. The format follows from the data, as publishers disagree on the field `format`.
2. The declared size must not exceed the limit.
3. PNG: the number of chunks, and the size of the inflated pixels, are limited. Texts, color
   profiles, thumbnails, transparency and animations are removed.
4. JPEG: the number of segments is limited, and that of scans, each of which costs as much as an
   image. There must be enough data for the size, as a decoder fills up missing data. Metadata,
   thumbnails, comments and anything after the image are removed.

Sources: ISO/IEC 15948, Portable Network Graphics, sections 5, 8 and 11. ITU-T T.81, annex B; T.871
for the JFIF and Adobe segments, which define the color space.
"""

from __future__ import annotations

import re
import struct
import zlib
from typing import Any, Protocol, cast

import cv2
import numpy as np

from pf_tracker_ros.decoding.image_decoding import (
    ImageError,
    Pixels,
    RawImage,
    check_sides,
    decode_raw,
    quote,
)
from pf_tracker_ros.plurals import counted

# Orientation tags are ignored, because boxes refer to the pixels as stored.
_FLAGS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION

_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_HEADER_END = 33
# Encoders write chunks of several kilobytes, and a few small ones.
_MAX_CHUNKS = 1000
_MIN_CHUNK = 1024
# Samples per pixel by color type.
_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}

_JPEG = b"\xff\xd8\xff"
_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
# Excludes an escaped 255, a restart of the scan and fill bytes.
_JPEG_MARKER = re.compile(rb"\xff([^\x00\xd0-\xd7\xff])")
_SCAN = 0xDA
# Minimum of bits per block in frames with Huffman codes, the only ones of cameras: one for the
# mean, and one for the end of the other coefficients unless these have their own scans.
_BLOCK_BITS = {0xC0: 2, 0xC1: 2, 0xC2: 1}
# Tables of codes and of quantization, the restart interval, and the color space.
_NEEDED = (0xC4, 0xDB, 0xDD, 0xE0, 0xEE)
# Application segments and comments.
_REMOVED = (*range(0xE0, 0xF0), 0xFE)
# Color profiles and descriptions take up to some hundreds, each scan a few.
_MAX_SEGMENTS = 1000
# libjpeg writes 10 for a color image and 18 for four components; optimizing encoders such as
# mozjpeg are in between.
_MAX_SCANS = 18


class CompressedImage(Protocol):
    """The fields of a sensor_msgs/CompressedImage, from any deserializer.

    Attributes:
        format: The publisher's name of the format.
        data: The file.
    """

    @property
    def format(self) -> str: ...  # noqa: D102
    @property
    def data(self) -> Any: ...  # noqa: D102


def decode_image(message: RawImage | CompressedImage, max_pixels: float) -> Pixels:
    """The image of a raw or compressed message.

    Args:
        message: The message.
        max_pixels: Maximum number of pixels of a compressed image.

    Returns:
        (height, width, 3) uint8 BGR, or (height, width) uint8, uint16 or float32; a read-only view
        of the message's data if the layout allows.

    Raises:
        ImageError: The message contains no such image.
    """
    # Only CompressedImage has this field.
    if hasattr(message, "format"):
        return decode_compressed(cast(CompressedImage, message), max_pixels)
    return decode_raw(message)


def decode_compressed(message: CompressedImage, max_pixels: float) -> Pixels:
    """The image of a compressed message.

    Args:
        message: A JPEG or PNG image, gray or color, 8 or 16 bits a channel.
        max_pixels: Maximum number of pixels, checked before anything is allocated.

    Returns:
        (height, width, 3) uint8 BGR, (height, width) uint8 or (height, width) uint16.

    Raises:
        ImageError: The data is neither, damaged, truncated, too large, or takes more work than an
            image of its size.
    """
    data = memoryview(message.data).cast("B")
    if data[: len(_PNG)] == _PNG:
        parts = _parts_of_png(data, max_pixels)
    elif data[: len(_JPEG)] == _JPEG:
        parts = _parts_of_jpeg(data, max_pixels)
    else:
        hint = "; subscribe to another transport" if "compressedDepth" in message.format else ""
        raise ImageError(
            "format",
            f"its data, {counted(len(data), 'byte')} of the format {quote(message.format)}, begins "
            f"neither as JPEG nor as PNG; allowed: these two{hint}",
        )
    try:
        image = cv2.imdecode(np.frombuffer(b"".join(parts), np.uint8), _FLAGS)
    except cv2.error as error:
        raise ImageError("data", f"its data cannot be decoded: {error.err}") from error
    if image is None:
        raise _invalid(data, "is damaged")
    if image.ndim == 3 and image.dtype == np.uint16:
        return (image >> 8).astype(np.uint8)
    return image


def _parts_of_png(data: memoryview, max_pixels: float) -> list[bytes | memoryview]:
    """The chunks needed for the pixels. The decoder checks their order and checksums."""
    if len(data) < _PNG_HEADER_END or bytes(data[12:16]) != b"IHDR":
        raise _invalid(data, "is not a whole PNG image")
    width, height, depth, color_type = struct.unpack_from(">IIBB", data, 16)
    _check_size(width, height, max_pixels)
    parts: list[bytes | memoryview] = [data[:_PNG_HEADER_END]]
    pixels, end = [], _PNG_HEADER_END
    for _ in range(_MAX_CHUNKS + len(data) // _MIN_CHUNK):
        start, end = end, end + 12 + int.from_bytes(data[end : end + 4], "big")
        if end > len(data):
            raise _invalid(data, "is truncated")
        kind = bytes(data[start + 4 : start + 8])
        if kind[:1].isupper():
            parts.append(data[start:end])
        if kind == b"IDAT":
            pixels.append(data[start + 8 : end - 4])
        if kind == b"IEND":
            break
    else:
        raise _invalid(data, "has too many chunks")
    # A row has a filter byte and ends with a whole byte; interlacing doubles the rows.
    bits = _SAMPLES.get(color_type, 0) * min(depth, 16)
    max_bytes = width * height * bits // 8 + 4 * height + 16
    inflater = zlib.decompressobj()
    try:
        if len(inflater.decompress(b"".join(pixels), max_bytes + 1)) > max_bytes:
            raise _invalid(data, "inflates to more than its declared size")
    except zlib.error as error:
        raise _invalid(data, "is damaged") from error
    if not inflater.eof or inflater.unused_data:
        raise _invalid(data, "is damaged")
    return parts


def _parts_of_jpeg(data: memoryview, max_pixels: float) -> list[bytes | memoryview]:
    """The segments needed for the pixels: tables, frame, scans and color space."""
    parts: list[bytes | memoryview] = [_JPEG_START]
    scans = scan_bytes = min_bytes = 0
    marker = _JPEG_MARKER.search(data, len(_JPEG_START))
    for _ in range(_MAX_SEGMENTS):
        if marker is None or (marker[0] == _JPEG_END and scan_bytes < min_bytes):
            raise _invalid(data, "is truncated")
        if marker[0] == _JPEG_END and scans:
            return [*parts, _JPEG_END]
        kind, begin, start = marker[1][0], marker.start(), marker.end()
        end = start + int.from_bytes(data[start : start + 2], "big")
        marker = _JPEG_MARKER.search(data, end)
        next_start = marker.start() if marker else len(data)
        content = data[start + 2 : end]
        if kind in _BLOCK_BITS and not min_bytes and len(content) >= 6:
            depth, height, width, components = struct.unpack(">BHHB", content[:6])
            _check_size(width, height, max_pixels)
            if depth != 8 or components not in (1, 3, 4):
                found = f"{components} components of {depth} bits"
                raise _invalid(data, f"has {found}; allowed: 1, 3 or 4 of 8 bits")
            min_bytes = 1 + width * height // 64 * _BLOCK_BITS[kind] // 8
        elif kind == _SCAN and min_bytes:
            scans, scan_bytes = scans + 1, scan_bytes + next_start - end
            if scans > _MAX_SCANS:
                raise _invalid(data, f"has more than {_MAX_SCANS} scans")
        elif kind not in (*_NEEDED, *_REMOVED):
            raise _invalid(data, "is not a whole JPEG image")
        if kind not in _REMOVED or kind in _NEEDED:
            parts.append(data[begin:next_start])
    raise _invalid(data, "has too many segments")


def _check_size(width: int, height: int, max_pixels: float) -> None:
    check_sides(width, height)
    if width * height > max_pixels:
        raise ImageError(
            "data",
            f"it declares {width} x {height} px; allowed: {max_pixels:.0f} px in all, the "
            "parameter 'max_image_pixels'",
        )


def _invalid(data: memoryview, problem: str) -> ImageError:
    return ImageError("data", f"its data, {counted(len(data), 'byte')}, {problem}")
