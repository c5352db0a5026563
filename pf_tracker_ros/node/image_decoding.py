"""Image messages as arrays that the tracker takes, without a copy where the layout allows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image

Pixels = NDArray[Any]

# OpenCV's remap and warps take no larger images.
LARGEST_SIDE = 32766


class ImageError(ValueError):
    """An image message that cannot be decoded.

    Attributes:
        field: The message's field that is wrong, for example `step`.
    """

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"image refused: {problem}")
        self.field = field


@dataclass(frozen=True)
class Encoding:
    """How one encoding lays out its pixels, and how to make them a tracker's image.

    Attributes:
        sample_type: NumPy type of one sample, without its byte order.
        channels: Samples per pixel.
        to_image: From the message's pixels, (height, width) or (height, width, channels), in the
            machine's byte order, to (height, width, 3) uint8 BGR or (height, width) uint8 or
            uint16.
    """

    sample_type: str
    channels: int
    to_image: Callable[[Pixels], Pixels]


def _unchanged(pixels: Pixels) -> Pixels:
    return pixels


def _rgb_to_bgr(pixels: Pixels) -> Pixels:
    # A view with its channels reversed costs nothing here and ten times as much in every use.
    return cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)


ENCODINGS: Mapping[str, Encoding] = MappingProxyType(
    {
        "bgr8": Encoding("u1", 3, _unchanged),
        "mono16": Encoding("u2", 1, _unchanged),
        "mono8": Encoding("u1", 1, _unchanged),
        "rgb8": Encoding("u1", 3, _rgb_to_bgr),
    }
)


def decode(message: Image) -> Pixels:
    """The image of a message.

    Nothing is allocated before the message's sizes have been found to agree with its data. Padded
    rows are honored; data after the last row is ignored.

    Args:
        message: An image in one of `ENCODINGS`.

    Returns:
        (height, width, 3) uint8 BGR, (height, width) uint8 or (height, width) uint16 in the
        machine's byte order; read-only where it is a view of the message's data.

    Raises:
        ImageError: The encoding is not known, or the sizes do not agree with each other or with
            the data.
    """
    encoding = ENCODINGS.get(message.encoding)
    if encoding is None:
        allowed = ", ".join(ENCODINGS)
        raise ImageError(
            "encoding", f"its encoding is '{message.encoding[:40]}'; allowed: {allowed}"
        )
    order = ">" if message.is_bigendian else "<"
    sample_type = np.dtype(order + encoding.sample_type)
    pixel_size = sample_type.itemsize * encoding.channels
    _check_layout(message, pixel_size)

    shape: tuple[int, ...] = (message.height, message.width)
    strides: tuple[int, ...] = (message.step, pixel_size)
    if encoding.channels > 1:
        shape += (encoding.channels,)
        strides += (sample_type.itemsize,)
    pixels: Pixels = np.ndarray(shape, sample_type, buffer=message.data, strides=strides)
    pixels.flags.writeable = False
    if not (sample_type.isnative and pixels.flags.aligned):
        pixels = pixels.astype(sample_type.newbyteorder("="))
    return encoding.to_image(pixels)


def _check_layout(message: Image, pixel_size: int) -> None:
    for field in ("width", "height"):
        value = getattr(message, field)
        if not 1 <= value <= LARGEST_SIDE:
            raise ImageError(field, f"its {field} is {value} px; allowed: 1 to {LARGEST_SIDE}")
    row = message.width * pixel_size
    if message.step < row:
        raise ImageError(
            "step",
            f"its step is {message.step} bytes; allowed: at least {row}, a row of "
            f"{message.width} px in {message.encoding}",
        )
    needed = message.height * message.step
    if len(message.data) < needed:
        raise ImageError(
            "data",
            f"its data has {len(message.data)} bytes; allowed: at least {needed}, "
            f"{message.height} rows with a step of {message.step} bytes",
        )
