"""The head of a serialized ROS message, read without deserializing the rest.

A CDR message begins with four bytes of encapsulation, of which the second tells the byte order;
a message whose first field is a std_msgs/Header goes on with its stamp: int32 seconds, uint32
nanoseconds.
"""

from __future__ import annotations

import struct

from pf_tracker_ros.footage.base import FootageError
from pf_tracker_ros.stamps import join

# Plain CDR of version 1 and 2 (OMG DDS-XTYPES 1.3, table 60): big endian, little endian.
_STAMP_LAYOUTS = {
    b"\x00\x00": ">iI",
    b"\x00\x01": "<iI",
    b"\x00\x06": ">iI",
    b"\x00\x07": "<iI",
}
_ZSTANDARD_MAGIC = b"\x28\xb5\x2f\xfd"
_ENCAPSULATION_SIZE = 4


def header_stamp(message: bytes) -> int:
    """Stamp of a serialized message that begins with a std_msgs/Header.

    Args:
        message: The message in CDR, encapsulation included.

    Returns:
        The stamp in nanoseconds.

    Raises:
        FootageError: This is not such a message.
    """
    if message[:4] == _ZSTANDARD_MAGIC:
        raise FootageError(
            "the messages are compressed one by one, which only metadata.yaml tells; give the "
            "rosbag2 folder instead of the file"
        )
    layout = _STAMP_LAYOUTS.get(bytes(message[:2]))
    if layout is None or len(message) < _ENCAPSULATION_SIZE + struct.calcsize(layout):
        raise FootageError(
            f"a message of {len(message)} bytes beginning with {message[:4].hex() or 'nothing'} "
            "is not CDR; accepted is plain CDR of either byte order"
        )
    seconds, nanoseconds = struct.unpack_from(layout, message, _ENCAPSULATION_SIZE)
    return join(seconds, nanoseconds)
