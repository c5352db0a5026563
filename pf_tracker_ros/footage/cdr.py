"""Deserializes the ROS message types read from recordings; needs no ROS.

1. A CDR message begins with four bytes of encapsulation; the second is the byte order.
2. In a message that begins with a std_msgs/Header, the stamp follows: int32 seconds, uint32
   nanoseconds.
3. Each number begins at a multiple of its size, counted from the end of the encapsulation.

A message type is described by the names and types of its fields, in order. A type is one or more
format characters of `struct` for numbers, `stamp`, `text`, `octets`, or a sequence of numbers
(`*d`) or of what is described elsewhere (`*POINT`). A field named `-` is skipped, and a dot in a
name nests messages.
"""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

from pf_tracker_ros.footage.base import FootageError
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import join_stamp

# Plain CDR of version 1 and 2 (OMG DDS-XTYPES 1.3, table 60): big endian, little endian.
_BYTE_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<", b"\x00\x06": ">", b"\x00\x07": "<"}
# In version 2 the alignment is at most four bytes.
_VERSION_2 = (b"\x00\x06", b"\x00\x07")
_ZSTANDARD_MAGIC = b"\x28\xb5\x2f\xfd"
_ENCAPSULATION_SIZE = 4

_HEADER = "stamp stamp, frame_id text"
_DESCRIPTIONS = {
    "POINT": "x f, y f, - f",
    # Its pose of seven numbers, with their covariance.
    "HYPOTHESIS": f"hypothesis.class_id text, hypothesis.score d, - {'d' * (7 + 36)}",
    "DETECTION": "- stamp, - text, results *HYPOTHESIS, bbox.center.position.x d, "
    "bbox.center.position.y d, bbox.center.theta d, bbox.size_x d, bbox.size_y d, - text",
    "TRANSFORM": f"{_HEADER}, child_frame_id text, translation.x d, translation.y d, "
    "translation.z d, rotation.x d, rotation.y d, rotation.z d, rotation.w d",
}


def header_stamp(message: bytes) -> int:
    """Stamp of a serialized message that begins with a std_msgs/Header.

    Args:
        message: The message in CDR, encapsulation included.

    Returns:
        The stamp in nanoseconds.

    Raises:
        FootageError: This is not such a message.
    """
    return int(_Reader(message, least=struct.calcsize("iI")).field("stamp"))


def deserialize_image(message: bytes) -> Any:
    """A serialized sensor_msgs/Image.

    Returns:
        The fields of the message, with `stamp` in nanoseconds and `frame_id` of its header. `data`
        is a view of the serialized message.

    Raises:
        FootageError: This is not such a message, or it is truncated.
    """
    fields = "height I, width I, encoding text, is_bigendian B, step I, data octets"
    return _Reader(message).fields(f"{_HEADER}, {fields}")


def deserialize_compressed_image(message: bytes) -> Any:
    """A serialized sensor_msgs/CompressedImage; see `deserialize_image`."""
    return _Reader(message).fields(f"{_HEADER}, format text, data octets")


def deserialize_polygon(message: bytes) -> list[tuple[float, float]]:
    """The points (x, y) of a serialized geometry_msgs/PolygonStamped; see `deserialize_image`."""
    polygon = _Reader(message).fields(f"{_HEADER}, points *POINT")
    return [(point.x, point.y) for point in polygon.points]


def deserialize_detections(message: bytes) -> Any:
    """Boxes and hypotheses of a serialized vision_msgs/Detection2DArray; see `deserialize_image`.

    Returns:
        `stamp` in nanoseconds, and `detections` with the fields `bbox` and `results`.
    """
    return _Reader(message).all_fields(f"{_HEADER}, detections *DETECTION")


def deserialize_camera_info(message: bytes) -> Any:
    """A serialized sensor_msgs/CameraInfo; see `deserialize_image`."""
    return _Reader(message).all_fields(
        f"{_HEADER}, height I, width I, distortion_model text, d *d, k {'d' * 9}, - {'d' * 9}, "
        f"p {'d' * 12}, binning_x I, binning_y I, roi.x_offset I, roi.y_offset I, roi.height I, "
        "roi.width I, - B"
    )


def deserialize_odometry(message: bytes) -> Any:
    """The pose of a serialized nav_msgs/Odometry; see `deserialize_image`."""
    position = "".join(f"pose.pose.position.{axis} d, " for axis in "xyz")
    orientation = "".join(f"pose.pose.orientation.{axis} d, " for axis in "xyzw")
    # Covariance, and the twist of six numbers with its own.
    left = f"- {'d' * (36 + 6 + 36)}"
    return _Reader(message).all_fields(f"{_HEADER}, - text, {position}{orientation}{left}")


def deserialize_imu(message: bytes) -> Any:
    """The acceleration of a serialized sensor_msgs/Imu; see `deserialize_image`."""
    acceleration = "".join(f"linear_acceleration.{axis} d, " for axis in "xyz")
    # Orientation and angular velocity, each with its covariance.
    skipped = f"- {'d' * (4 + 9 + 3 + 9)}"
    return _Reader(message).all_fields(
        f"{_HEADER}, {skipped}, {acceleration}linear_acceleration_covariance {'d' * 9}"
    )


def deserialize_transforms(message: bytes) -> Any:
    """The transforms of a serialized tf2_msgs/TFMessage; see `deserialize_image`.

    Returns:
        An object with `transforms`, each with `stamp`, `frame_id`, `child_frame_id`, `translation`
        and `rotation`, and with the stamp of the first of them, 0 without.
    """
    found = _Reader(message).all_fields("transforms *TRANSFORM")
    found.stamp, found.frame_id = found.transforms[0].stamp if found.transforms else 0, ""
    return found


class _Reader:
    """Reads the fields of a message in order.

    Args:
        message: The message in CDR, encapsulation included.
        least: Bytes of fields that it has to have.
    """

    def __init__(self, message: bytes, least: int = 0) -> None:
        if message[:4] == _ZSTANDARD_MAGIC:
            raise FootageError(
                "the messages are compressed one by one, as only metadata.yaml says; give the "
                "rosbag2 folder instead of the file"
            )
        order = _BYTE_ORDERS.get(bytes(message[:2]))
        if order is None or len(message) < _ENCAPSULATION_SIZE + least:
            raise FootageError(
                f"a message of {counted(len(message), 'byte')} beginning with "
                f"{message[:4].hex() or 'nothing'} is not CDR; accepted is plain CDR of either "
                "byte order"
            )
        self._order = order
        self._max_alignment = 4 if bytes(message[:2]) in _VERSION_2 else 8
        self._message = message
        self._offset = _ENCAPSULATION_SIZE

    def fields(self, description: str) -> SimpleNamespace:
        """The next fields, as described."""
        found = SimpleNamespace()
        for each in description.split(", "):
            name, kind = each.split(" ")
            value = self.field(kind)
            if name == "-":
                continue
            *parents, last = name.split(".")
            owner = found
            for parent in parents:
                owner = owner.__dict__.setdefault(parent, SimpleNamespace())
            setattr(owner, last, value)
        return found

    def all_fields(self, description: str) -> SimpleNamespace:
        """All fields of the message, as described.

        Raises:
            FootageError: The message is longer than its type, by more than padding.
        """
        found = self.fields(description)
        left = len(self._message) - self._offset
        if left >= _ENCAPSULATION_SIZE:
            raise FootageError(
                f"a message of {len(self._message)} bytes is {left} bytes longer than its topic's "
                "type; it is of another type or version"
            )
        return found

    def field(self, kind: str) -> Any:
        """The next field, of a type as in the module's description."""
        if kind.startswith("*"):
            count = self._number("I")
            element = _DESCRIPTIONS.get(kind[1:])
            # A damaged count is refused at once, and not after all that could be elements.
            self._check_end(self._offset + count * _least_size(element or kind[1:]))
            read = self.fields if element else self.field
            return [read(element or kind[1:]) for _ in range(count)]
        if kind == "stamp":
            return join_stamp(self._number("i"), self._number("I"))
        if kind in ("octets", "text"):
            octets = self._octets()
            return octets if kind == "octets" else _text(octets)
        numbers = [self._number(one) for one in kind]
        return numbers if len(kind) > 1 else numbers[0]

    def _number(self, kind: str) -> Any:
        layout = self._order + kind
        size = struct.calcsize(layout)
        padding = (_ENCAPSULATION_SIZE - self._offset) % min(size, self._max_alignment)
        begin = self._advance(padding + size) + padding
        return struct.unpack_from(layout, self._message, begin)[0]

    def _octets(self) -> memoryview:
        begin = self._advance(self._number("I"))
        return memoryview(self._message)[begin : self._offset]

    def _advance(self, size: int) -> int:
        """Move by so many bytes; returns where they begin."""
        begin, self._offset = self._offset, self._offset + size
        self._check_end(self._offset)
        return begin

    def _check_end(self, end: int) -> None:
        if end > len(self._message):
            raise FootageError(
                f"a message of {len(self._message)} bytes is truncated, or not of its topic's type"
            )


def _least_size(description: str) -> int:
    """Bytes that fields take up at least: without padding, with empty texts and sequences."""
    kinds = [each.split(" ")[-1] for each in description.split(", ")]
    sizes = {"stamp": 8, "text": 4, "octets": 4}
    return sum(
        sizes.get(kind) or (4 if kind.startswith("*") else struct.calcsize(f"={kind}"))
        for kind in kinds
    )


def _text(octets: memoryview) -> str:
    """A string; invalid UTF-8 is replaced."""
    return bytes(octets).rstrip(b"\0").decode("utf-8", "replace")
