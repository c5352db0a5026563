"""Decodes raw and compressed image messages to the tracker's image."""

from __future__ import annotations

from typing import cast

from pf_tracker_ros.decoding.compressed_decoding import CompressedImage, decode_compressed
from pf_tracker_ros.decoding.image_decoding import Pixels, RawImage, decode_raw


class ImageDecoder:
    """Decodes raw and compressed images.

    Attributes:
        max_pixels: Maximum number of pixels of a compressed image.

    Args:
        max_pixels: As the attribute.
    """

    def __init__(self, max_pixels: int) -> None:
        self.max_pixels = max_pixels

    def decode(self, message: RawImage | CompressedImage) -> Pixels:
        """The image of a message.

        Returns:
            (height, width, 3) uint8 BGR, or (height, width) uint8, uint16 or float32; a read-only
            view of the message's data if the layout allows.

        Raises:
            ImageError: The message contains no such image.
        """
        # Only CompressedImage has this field.
        if hasattr(message, "format"):
            return decode_compressed(cast(CompressedImage, message), self.max_pixels)
        return decode_raw(message)
