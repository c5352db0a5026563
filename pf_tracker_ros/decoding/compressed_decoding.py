"""Compressed image messages as arrays that the tracker takes: JPEG and PNG.

A few bytes can announce an image of gigabytes, and hold much besides the image. So the file is read
first, and only its pixels, in a size that was agreed on, are handed to a decoder. Which of the two
formats it is follows from the data: publishers disagree on what `format` says.
"""

from __future__ import annotations

from typing import Any, Protocol

import cv2
import numpy as np

from pf_tracker_ros.decoding.image_decoding import (
    ImageError,
    Pixels,
    SizeCheck,
    check_sides,
    quote,
)
from pf_tracker_ros.decoding.jpeg_reading import SIGNATURE as JPEG_SIGNATURE
from pf_tracker_ros.decoding.jpeg_reading import pixel_data_of_jpeg
from pf_tracker_ros.decoding.png_reading import SIGNATURE as PNG_SIGNATURE
from pf_tracker_ros.decoding.png_reading import pixel_data_of_png
from pf_tracker_ros.plurals import counted

# An image's orientation is that of the camera: the box of a target must not turn with a tag.
_FLAGS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION


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
    width = height = 0

    def check_size(announced_width: int, announced_height: int) -> None:
        nonlocal width, height
        width, height = announced_width, announced_height
        check_sides(width, height)
        if width * height > largest:
            raise ImageError(
                "data",
                f"it announces {width} x {height} px; allowed: {largest:.0f} px in all, the "
                "parameter 'largest_image'",
            )

    pixel_data = _pixel_data(data, message.format, check_size)
    try:
        image = cv2.imdecode(np.frombuffer(pixel_data, np.uint8), _FLAGS)
    except cv2.error as error:
        raise ImageError("data", f"its data cannot be decoded: {error.err}") from error
    if image is None or image.shape[:2] != (height, width):
        raise ImageError("data", f"its data, {counted(len(data), 'byte')}, is damaged")
    if image.ndim == 3 and image.dtype == np.uint16:
        return (image >> 8).astype(np.uint8)
    return image


def _pixel_data(data: memoryview, image_format: str, check_size: SizeCheck) -> bytes:
    """What a decoder needs to see of the data."""
    if data[: len(PNG_SIGNATURE)] == PNG_SIGNATURE:
        return pixel_data_of_png(data, check_size)
    if data[: len(JPEG_SIGNATURE)] == JPEG_SIGNATURE:
        return pixel_data_of_jpeg(data, check_size)
    hint = "; subscribe to another transport" if "compressedDepth" in image_format else ""
    raise ImageError(
        "format",
        f"its data, {counted(len(data), 'byte')} of the format {quote(image_format)}, begin "
        f"neither as JPEG nor as PNG; allowed: these two{hint}",
    )
