"""Decodes sensor_msgs/Image, without a copy if the layout allows.

1. Check that sizes, step and length of the data agree.
2. View the data as an array of pixels, or of rows for planar YUV.
3. Convert color to BGR.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Protocol

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


def decode_raw(message: RawImage) -> Pixels:
    """The image of a message.

    The sizes are checked against the data before memory is allocated. At most three times the size
    of the data is allocated. Data after the last row is ignored.

    Args:
        message: An image in one of `ENCODINGS`.

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
