"""Compressed image messages as arrays that the tracker takes: JPEG and PNG.

A few bytes can announce an image of gigabytes. So the header is read first, and only what is of a
size that was agreed on is handed to a decompressor. Which of the two it is follows from the data:
publishers disagree on what `format` says.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import cv2
import numpy as np
from sensor_msgs.msg import CompressedImage

from pf_tracker_ros.node.images.image_decoding import ImageError, Pixels, check_sides

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PNG_END = b"IEND"
_JPEG_SIGNATURE = b"\xff\xd8\xff"
_JPEG_END = b"\xff\xd9"
_JPEG_SCAN = b"\xff\xda"
# Start of frame in all its kinds; what else lies in this range are tables.
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
# A progressive image takes about ten scans, and each one costs as much as a whole image.
_MOST_SCANS = 100
# An image's orientation is that of the camera: the box of a target must not turn with a tag.
_FLAGS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION


def decode_compressed(message: CompressedImage, largest: float) -> Pixels:
    """The image of a compressed message.

    Args:
        message: A JPEG or PNG image, gray or color, 8 or 16 bits a channel.
        largest: Most pixels; nothing is allocated for an image that announces more.

    Returns:
        (height, width, 3) uint8 BGR, (height, width) uint8 or (height, width) uint16.

    Raises:
        ImageError: It is neither, is damaged or cut off, or has more pixels.
    """
    data = memoryview(message.data).cast("B")
    width, height = _announced_size(bytes(data[:8]), data, message.format)
    check_sides(width, height)
    if width * height > largest:
        raise ImageError(
            "data",
            f"it announces {width} x {height} px; allowed: {largest:.0f} px in all, the parameter "
            "'largest_image'",
        )
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), _FLAGS)
    except cv2.error as error:
        raise ImageError("data", f"its data cannot be decoded: {error.err}") from error
    if image is None or image.shape[:2] != (height, width):
        raise ImageError("data", f"its data, {len(data)} bytes, is damaged")
    if image.ndim == 3 and image.dtype == np.uint16:
        return (image >> 8).astype(np.uint8)
    return image


def _announced_size(signature: bytes, data: memoryview, image_format: str) -> tuple[int, int]:
    if signature == _PNG_SIGNATURE:
        return _png_size(data)
    if signature.startswith(_JPEG_SIGNATURE):
        return _jpeg_size(data)
    hint = "; subscribe to another transport" if "compressedDepth" in image_format else ""
    raise ImageError(
        "format",
        f"its data, {len(data)} bytes of the format '{image_format[:40]}', begin neither as JPEG "
        f"nor as PNG; allowed: these two{hint}",
    )


def _png_size(data: memoryview) -> tuple[int, int]:
    if len(data) < 33 or bytes(data[12:16]) != b"IHDR":
        raise ImageError("data", f"its data, {len(data)} bytes, is not a whole PNG image")
    if _PNG_END not in bytes(data[-64:]):
        raise ImageError("data", f"its data, {len(data)} bytes, is cut off before the end")
    width, height = struct.unpack(">II", data[16:24])
    return width, height


def _jpeg_size(data: memoryview) -> tuple[int, int]:
    for marker, begin, end in _jpeg_segments(data):
        if marker in _JPEG_FRAMES and end - begin >= 7:
            height, width = struct.unpack(">HH", data[begin + 1 : begin + 5])
            _check_scans(bytes(data[end:]))
            return width, height
    raise ImageError("data", f"its data, {len(data)} bytes, is not a whole JPEG image")


def _jpeg_segments(data: memoryview) -> Iterator[tuple[int, int, int]]:
    """Marker, begin and end of the content of each segment before the first scan."""
    position = 2
    while position + 4 <= len(data) and data[position] == 0xFF:
        marker = data[position + 1]
        if marker == 0xFF:
            position += 1
            continue
        (length,) = struct.unpack(">H", data[position + 2 : position + 4])
        end = position + 2 + length
        if length < 2 or end > len(data) or marker == _JPEG_SCAN[1]:
            return
        yield marker, position + 4, end
        position = end


def _check_scans(rest: bytes) -> None:
    if rest.count(_JPEG_SCAN) > _MOST_SCANS:
        raise ImageError("data", f"its data has more than {_MOST_SCANS} scans")
    if rest.find(_JPEG_END, rest.find(_JPEG_SCAN) + 1) < 0:
        raise ImageError("data", "its data is cut off before the end")
