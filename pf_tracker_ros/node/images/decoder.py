"""From any image message to the one array that the tracker sees."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.frames.gray_range import adapt_range, gray_range, to_8_bit
from pf_tracker_ros.node.images.compressed_decoding import decode_compressed
from pf_tracker_ros.node.images.image_decoding import Pixels, decode
from pf_tracker_ros.stamps import NANOSECONDS, stamp_of

# A range that is as old as this has been left behind as far as it can be.
_LONGEST_INTERVAL = 60.0


class ImageDecoder:
    """Decodes raw and compressed images; remembers which range of 32-bit values is in use.

    Values of 32 bits have no range of their own: 0 to 1, kelvin, meters. The range is that of the
    first image, without outliers, and follows those after it slowly, so that a target keeps its
    gray. (16-bit images go to the tracker as they are, which does the same for them.)

    Attributes:
        largest: Most pixels of a compressed image.

    Args:
        largest: Most pixels of a compressed image.
    """

    def __init__(self, largest: int) -> None:
        self.largest = largest
        self._range: tuple[float, float] | None = None
        self._stamp = 0.0

    def decode(self, message: Image | CompressedImage) -> Pixels:
        """The image of a message.

        Returns:
            (height, width, 3) uint8 BGR, (height, width) uint8 or (height, width) uint16; a
            read-only view of the message's data where its layout allows.

        Raises:
            ImageError: The message holds no such image.
        """
        if isinstance(message, CompressedImage):
            return decode_compressed(message, self.largest)
        image = decode(message)
        if image.dtype != np.float32:
            return image
        stamp = stamp_of(message.header) / NANOSECONDS
        interval = min(abs(stamp - self._stamp), _LONGEST_INTERVAL)
        self._stamp = stamp
        self._range = adapt_range(self._range, image, interval) or gray_range(image)
        return to_8_bit(image, self._range)
