"""Decodes sensor_msgs/Image, and JPEG and PNG in sensor_msgs/CompressedImage.

A raw image is not copied if the layout allows:

1. Check that sizes, step and length of the data agree.
2. View the data as an array of pixels, or of rows for planar YUV.
3. Convert color to BGR.

A compressed image is checked before it reaches the decoder, because a few bytes can declare an
image of gigabytes, or contain much besides the image:

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
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Protocol, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.plurals import counted

Pixels = NDArray[Any]

# Limit of OpenCV's remap and warps.
LARGEST_SIDE = 32766

# Characters of an encoding in an error message.
_LONGEST_QUOTE = 40

# BT.601 video levels, as in OpenCV's other YUV conversions: (Y, U, V, 1) to (B, G, R).
_YUV_TO_BGR = np.array(
    [
        [1.164, 2.018, 0.0, -276.928],
        [1.164, -0.391, -0.813, 135.488],
        [1.164, 0.0, 1.596, -222.912],
    ]
)


class RawImage(Protocol):
    """The fields of a sensor_msgs/Image, from any deserializer.

    Attributes:
        height: Rows.
        width: Pixels in a row.
        encoding: One of `ENCODINGS`.
        is_bigendian: Whether samples of several bytes are big endian.
        step: Bytes of a row, including padding.
        data: The rows.
    """

    @property
    def height(self) -> int: ...  # noqa: D102
    @property
    def width(self) -> int: ...  # noqa: D102
    @property
    def encoding(self) -> str: ...  # noqa: D102
    @property
    def is_bigendian(self) -> int: ...  # noqa: D102
    @property
    def step(self) -> int: ...  # noqa: D102
    @property
    def data(self) -> Any: ...  # noqa: D102


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


class ImageError(ValueError):
    """An image message that cannot be decoded.

    Attributes:
        field: The invalid field, for example `step`.

    Args:
        field: As the attribute.
        problem: Description for the error message.
    """

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"image refused: {problem}")
        self.field = field


@dataclass(frozen=True)
class Encoding:
    """Pixel layout of an encoding, and its conversion to an image.

    Attributes:
        sample_type: NumPy type of a sample, without byte order.
        channels: Samples per pixel.
        to_image: Converts the message's pixels, (height, width) or (height, width, channels) in
            native byte order, to (height, width, 3) uint8 BGR or (height, width) uint8, uint16 or
            float32. With `chroma_rows` it receives whole rows, (rows, step).
        chroma_rows: Rows of color per row of the image, stored after the image's rows.
        multiple_of: (width, height) that the image's sides must be multiples of.
        min_side: Minimum of width and height.
    """

    sample_type: str
    channels: int
    to_image: Callable[[Pixels], Pixels]
    chroma_rows: float = 0.0
    multiple_of: tuple[int, int] = (1, 1)
    min_side: int = 1


def _unchanged(pixels: Pixels) -> Pixels:
    return pixels


def _converted(code: int) -> Callable[[Pixels], Pixels]:
    # A view with reversed channels costs nothing here, but makes every use ten times as slow.
    return partial(cv2.cvtColor, code=code)


def _from_nv21(rows: Pixels) -> Pixels:
    return cv2.cvtColor(rows[:, : rows.shape[1] // 2 * 2], cv2.COLOR_YUV2BGR_NV21)


def _from_nv24(rows: Pixels) -> Pixels:
    height, step = rows.shape[0] // 3, rows.shape[1]
    colors = rows[height:].reshape(height, step, 2)
    return cv2.transform(np.dstack([rows[:height], colors]), _YUV_TO_BGR)


_GRAY_8 = Encoding("u1", 1, _unchanged)
_GRAY_16 = Encoding("u2", 1, _unchanged)
_BGR = Encoding("u1", 3, _unchanged)
_UYVY = Encoding("u1", 2, _converted(cv2.COLOR_YUV2BGR_UYVY), multiple_of=(2, 1))
_YUYV = Encoding("u1", 2, _converted(cv2.COLOR_YUV2BGR_YUYV), multiple_of=(2, 1))


def _bayer(pattern: str) -> dict[str, Encoding]:
    """The encodings of a Bayer pattern.

    16-bit patterns become gray, because gain control exists for gray images only.
    """
    color = getattr(cv2, f"COLOR_Bayer{pattern}2BGR")
    gray = getattr(cv2, f"COLOR_Bayer{pattern}2GRAY")
    name = f"bayer_{pattern.lower()}"
    return {
        f"{name}8": Encoding("u1", 1, _converted(color), min_side=3),
        f"{name}16": Encoding("u2", 1, _converted(gray), min_side=3),
    }


# In the order of error messages, the most common ones first.
ENCODINGS: Mapping[str, Encoding] = MappingProxyType(
    {
        "bgr8": _BGR,
        "mono16": _GRAY_16,
        "mono8": _GRAY_8,
        "rgb8": Encoding("u1", 3, _converted(cv2.COLOR_RGB2BGR)),
        "bgra8": Encoding("u1", 4, _converted(cv2.COLOR_BGRA2BGR)),
        "rgba8": Encoding("u1", 4, _converted(cv2.COLOR_RGBA2BGR)),
        "8UC1": _GRAY_8,
        "8UC3": _BGR,
        "16UC1": _GRAY_16,
        "32FC1": Encoding("f4", 1, _unchanged),
        "yuv422": _UYVY,
        "uyvy": _UYVY,
        "yuv422_yuy2": _YUYV,
        "yuyv": _YUYV,
        "nv21": Encoding("u1", 1, _from_nv21, chroma_rows=0.5, multiple_of=(2, 2)),
        "nv24": Encoding("u1", 1, _from_nv24, chroma_rows=2.0),
        **_bayer("BGGR"),
        **_bayer("GBRG"),
        **_bayer("GRBG"),
        **_bayer("RGGB"),
    }
)


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


def decode_raw(message: RawImage) -> Pixels:
    """The image of a message in one of `ENCODINGS`.

    The sizes are checked against the data before memory is allocated. At most three times the size
    of the data is allocated. Data after the last row is ignored.

    Returns:
        (height, width, 3) uint8 BGR, (height, width) uint8, uint16 or, from 32FC1, float32 in
        native byte order; read-only if it is a view of the message's data.

    Raises:
        ImageError: The encoding is unknown, or the sizes do not agree with each other or the data.
    """
    encoding = ENCODINGS.get(message.encoding)
    if encoding is None:
        allowed = ", ".join(ENCODINGS)
        raise ImageError(
            "encoding", f"its encoding is {quote(message.encoding)}; allowed: {allowed}"
        )
    order = ">" if message.is_bigendian else "<"
    sample_type = np.dtype(order + encoding.sample_type)
    pixel_size = sample_type.itemsize * encoding.channels
    rows = _checked_row_count(message, encoding, pixel_size)

    shape: tuple[int, ...] = (rows, message.step if encoding.chroma_rows else message.width)
    strides: tuple[int, ...] = (message.step, pixel_size)
    if encoding.channels > 1:
        shape += (encoding.channels,)
        strides += (sample_type.itemsize,)
    pixels: Pixels = np.ndarray(shape, sample_type, buffer=message.data, strides=strides)
    pixels.flags.writeable = False
    if not (sample_type.isnative and pixels.flags.aligned):
        pixels = pixels.astype(sample_type.newbyteorder("="))
    return encoding.to_image(pixels)[:, : message.width]


def check_sides(width: int, height: int) -> None:
    """Check the sides of an image.

    Raises:
        ImageError: A side is 0 px or above `LARGEST_SIDE`.
    """
    for field, value in (("width", width), ("height", height)):
        if not 1 <= value <= LARGEST_SIDE:
            raise ImageError(field, f"its {field} is {value} px; allowed: 1 to {LARGEST_SIDE}")


def quote(text: str) -> str:
    """Quote a message's text in an error: shortened, without control characters."""
    printable = "".join(letter if letter.isprintable() else "?" for letter in text[:_LONGEST_QUOTE])
    return f"'{printable}'"


def _checked_row_count(message: RawImage, encoding: Encoding, pixel_size: int) -> int:
    """The number of rows in the data, with the chroma rows."""
    check_sides(message.width, message.height)
    for field, divisor in zip(("width", "height"), encoding.multiple_of, strict=True):
        value, minimum = getattr(message, field), encoding.min_side
        if value % divisor or value < minimum:
            allowed = f"multiples of {divisor}" if divisor > 1 else f"at least {minimum}"
            raise ImageError(
                field, f"its {field} is {value} px; allowed in {message.encoding}: {allowed}"
            )
    row_size = message.width * pixel_size
    if message.step < row_size:
        raise ImageError(
            "step",
            f"its step is {counted(message.step, 'byte')}; allowed: at least {row_size}, a row of "
            f"{message.width} px in {message.encoding}",
        )
    rows = round(message.height * (1.0 + encoding.chroma_rows))
    size = rows * message.step
    if len(message.data) < size:
        raise ImageError(
            "data",
            f"its data has {counted(len(message.data), 'byte')}; allowed: at least {size}, "
            f"{counted(rows, 'row')} with a step of {counted(message.step, 'byte')}",
        )
    return rows


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
