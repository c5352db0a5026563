"""Compressed image messages as arrays that the tracker takes: JPEG and PNG.

A few bytes can announce an image of gigabytes, and hold much besides the image. So before a decoder
sees a file, its announced size is checked, and how much work its pixels are:

- PNG: the number of chunks, and what the image data inflates to. Texts and color profiles, which a
  decoder would inflate too, are left out, as are thumbnails, transparency and animations.
- JPEG: the number of segments, and of scans, as each costs as much as a whole image; and that there
  is as much data as the size takes, as a decoder fills up what is missing. Thumbnails, positions,
  color profiles, comments and whatever follows the image are left out.

Which of the two it is follows from the data: publishers disagree on what `format` says.

Sources: ISO/IEC 15948, Portable Network Graphics, sections 5, 8 and 11. ITU-T T.81, annex B; T.871
for the JFIF and Adobe segments, which tell the color space.
"""

from __future__ import annotations

import re
import struct
import zlib
from typing import Any, Protocol

import cv2
import numpy as np

from pf_tracker_ros.decoding.image_decoding import ImageError, Pixels, check_sides, quote
from pf_tracker_ros.plurals import counted

# An image's orientation is that of the camera: the box of a target must not turn with a tag.
_FLAGS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION

_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_HEADER_END = 33
# Encoders make chunks of several kilobytes, and a few others: more are there to keep us busy.
_MOST_CHUNKS = 1000
_LEAST_CHUNK = 1024
# Samples a pixel for each color type.
_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}

_JPEG = b"\xff\xd8\xff"
_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
# Neither an escaped 255, a restart of the scan nor a filling.
_JPEG_MARKER = re.compile(rb"\xff([^\x00\xd0-\xd7\xff])")
_SCAN = 0xDA
# Fewest bits of a block in a frame with Huffman codes, the only ones that cameras make: one for the
# mean, and one that ends the other coefficients where these are not in scans of their own.
_BLOCK_BITS = {0xC0: 2, 0xC1: 2, 0xC2: 1}
# Tables of codes and of quantization, the restart interval, and the color space.
_NEEDED = (0xC4, 0xDB, 0xDD, 0xE0, 0xEE)
# What applications add, and comments.
_LEFT_OUT = (*range(0xE0, 0xF0), 0xFE)
# Color profiles and descriptions take up to some hundreds, each scan a few.
_MOST_SEGMENTS = 1000
# libjpeg makes 10 of a color image and 18 of one with four components; encoders that search for the
# smallest file, such as mozjpeg, end between these.
_MOST_SCANS = 18


class CompressedImage(Protocol):
    """What a sensor_msgs/CompressedImage tells, whoever deserialized it.

    Attributes:
        format: What the publisher calls it.
        data: The file.
    """

    @property
    def format(self) -> str: ...  # noqa: D102
    @property
    def data(self) -> Any: ...  # noqa: D102


def decode_compressed(message: CompressedImage, max_pixels: float) -> Pixels:
    """The image of a compressed message.

    Args:
        message: A JPEG or PNG image, gray or color, 8 or 16 bits a channel.
        max_pixels: Most pixels; nothing is allocated for an image that announces more.

    Returns:
        (height, width, 3) uint8 BGR, (height, width) uint8 or (height, width) uint16.

    Raises:
        ImageError: It is neither, is damaged or cut off, has more pixels, or is more work than an
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
            f"its data, {counted(len(data), 'byte')} of the format {quote(message.format)}, begin "
            f"neither as JPEG nor as PNG; allowed: these two{hint}",
        )
    try:
        image = cv2.imdecode(np.frombuffer(b"".join(parts), np.uint8), _FLAGS)
    except cv2.error as error:
        raise ImageError("data", f"its data cannot be decoded: {error.err}") from error
    if image is None:
        raise _unusable(data, "is damaged")
    if image.ndim == 3 and image.dtype == np.uint16:
        return (image >> 8).astype(np.uint8)
    return image


def _parts_of_png(data: memoryview, max_pixels: float) -> list[bytes | memoryview]:
    """The chunks that the pixels need. Their order and checksums are the decoder's to check."""
    if len(data) < _PNG_HEADER_END or bytes(data[12:16]) != b"IHDR":
        raise _unusable(data, "is not a whole PNG image")
    width, height, depth, color_type = struct.unpack_from(">IIBB", data, 16)
    _check_announced(width, height, max_pixels)
    parts: list[bytes | memoryview] = [data[:_PNG_HEADER_END]]
    pixels, end = [], _PNG_HEADER_END
    for _ in range(_MOST_CHUNKS + len(data) // _LEAST_CHUNK):
        start, end = end, end + 12 + int.from_bytes(data[end : end + 4], "big")
        if end > len(data):
            raise _unusable(data, "is cut off before the end")
        kind = bytes(data[start + 4 : start + 8])
        if kind[:1].isupper():
            parts.append(data[start:end])
        if kind == b"IDAT":
            pixels.append(data[start + 8 : end - 4])
        if kind == b"IEND":
            break
    else:
        raise _unusable(data, "has more chunks than an image takes")
    # A row begins with its filter and ends with a whole byte; interlaced there are twice as many.
    bits = _SAMPLES.get(color_type, 0) * min(depth, 16)
    most = width * height * bits // 8 + 4 * height + 16
    inflater = zlib.decompressobj()
    try:
        if len(inflater.decompress(b"".join(pixels), most + 1)) > most:
            raise _unusable(data, "inflates to more than its size announces")
    except zlib.error as error:
        raise _unusable(data, "is damaged") from error
    if not inflater.eof or inflater.unused_data:
        raise _unusable(data, "is damaged")
    return parts


def _parts_of_jpeg(data: memoryview, max_pixels: float) -> list[bytes | memoryview]:
    """The segments that the pixels need: tables, frame, scans, and what tells the color space."""
    parts: list[bytes | memoryview] = [_JPEG_START]
    scans = scanned = least = 0
    marker = _JPEG_MARKER.search(data, len(_JPEG_START))
    for _ in range(_MOST_SEGMENTS):
        if marker is None or (marker[0] == _JPEG_END and scanned < least):
            raise _unusable(data, "is cut off before the end")
        if marker[0] == _JPEG_END and scans:
            return [*parts, _JPEG_END]
        kind, begin, start = marker[1][0], marker.start(), marker.end()
        end = start + int.from_bytes(data[start : start + 2], "big")
        marker = _JPEG_MARKER.search(data, end)
        following = marker.start() if marker else len(data)
        content = data[start + 2 : end]
        if kind in _BLOCK_BITS and not least and len(content) >= 6:
            depth, height, width, components = struct.unpack(">BHHB", content[:6])
            _check_announced(width, height, max_pixels)
            if depth != 8 or components not in (1, 3, 4):
                found = f"{components} components of {depth} bits"
                raise _unusable(data, f"has {found}; allowed: 1, 3 or 4 of 8 bits")
            least = 1 + width * height // 64 * _BLOCK_BITS[kind] // 8
        elif kind == _SCAN and least:
            scans, scanned = scans + 1, scanned + following - end
            if scans > _MOST_SCANS:
                raise _unusable(data, f"has more than {_MOST_SCANS} scans")
        elif kind not in (*_NEEDED, *_LEFT_OUT):
            raise _unusable(data, "is not a whole JPEG image")
        if kind not in _LEFT_OUT or kind in _NEEDED:
            parts.append(data[begin:following])
    raise _unusable(data, "has more segments than an image takes")


def _check_announced(width: int, height: int, max_pixels: float) -> None:
    check_sides(width, height)
    if width * height > max_pixels:
        raise ImageError(
            "data",
            f"it announces {width} x {height} px; allowed: {max_pixels:.0f} px in all, the parameter "
            "'max_image_pixels'",
        )


def _unusable(data: memoryview, problem: str) -> ImageError:
    return ImageError("data", f"its data, {counted(len(data), 'byte')}, {problem}")
