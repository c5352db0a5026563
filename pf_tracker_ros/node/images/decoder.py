"""From any image message to the one array that the tracker sees."""

from __future__ import annotations

from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.node.images.compressed_decoding import decode_compressed
from pf_tracker_ros.node.images.image_decoding import Pixels, decode


class ImageDecoder:
    """Decodes raw and compressed images.

    Attributes:
        largest: Most pixels of a compressed image.

    Args:
        largest: As the attribute.
    """

    def __init__(self, largest: int) -> None:
        self.largest = largest

    def decode(self, message: Image | CompressedImage) -> Pixels:
        """The image of a message.

        Returns:
            (height, width, 3) uint8 BGR, or (height, width) uint8, uint16 or float32; a read-only
            view of the message's data where its layout allows.

        Raises:
            ImageError: The message holds no such image.
        """
        if isinstance(message, CompressedImage):
            return decode_compressed(message, self.largest)
        return decode(message)
