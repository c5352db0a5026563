"""Deserializes the ROS message types read from recordings; needs no ROS.

1. A CDR message begins with four bytes of encapsulation; the second is the byte order.
2. In a message that begins with a std_msgs/Header, the stamp follows: int32 seconds, uint32
   nanoseconds.
3. Each number begins at a multiple of its size, counted from the end of the encapsulation.
"""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

from pf_tracker_ros.footage.base import FootageError
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import join_stamp

# Plain CDR of version 1 and 2 (OMG DDS-XTYPES 1.3, table 60): big endian, little endian.
_STAMP_LAYOUTS = {
    b"\x00\x00": ">iI",
    b"\x00\x01": "<iI",
    b"\x00\x06": ">iI",
    b"\x00\x07": "<iI",
}
# In version 2 the alignment is at most four bytes.
_VERSION_2 = (b"\x00\x06", b"\x00\x07")
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
    layout = _stamp_layout(message, struct.calcsize("iI"))
    seconds, nanoseconds = struct.unpack_from(layout, message, _ENCAPSULATION_SIZE)
    return join_stamp(seconds, nanoseconds)


def _stamp_layout(message: bytes, least: int) -> str:
    """Layout of a stamp in the byte order of a message with at least so many bytes of fields."""
    if message[:4] == _ZSTANDARD_MAGIC:
        raise FootageError(
            "the messages are compressed one by one, as only metadata.yaml says; give the rosbag2 "
            "folder instead of the file"
        )
    layout = _STAMP_LAYOUTS.get(bytes(message[:2]))
    if layout is None or len(message) < _ENCAPSULATION_SIZE + least:
        raise FootageError(
            f"a message of {counted(len(message), 'byte')} beginning with "
            f"{message[:4].hex() or 'nothing'} is not CDR; accepted is plain CDR of either byte "
            "order"
        )
    return layout


def deserialize_image(message: bytes) -> Any:
    """A serialized sensor_msgs/Image.

    Returns:
        The fields of the message, with `stamp` in nanoseconds and `frame_id` of its header. `data`
        is a view of the serialized message.

    Raises:
        FootageError: This is not such a message, or it is truncated.
    """
    fields = _Fields(message)
    return SimpleNamespace(
        stamp=fields.stamp,
        frame_id=fields.text(),
        height=fields.number("I"),
        width=fields.number("I"),
        encoding=fields.text(),
        is_bigendian=fields.number("B"),
        step=fields.number("I"),
        data=fields.octets(),
    )


def deserialize_compressed_image(message: bytes) -> Any:
    """A serialized sensor_msgs/CompressedImage; see `deserialize_image`.

    Raises:
        FootageError: This is not such a message, or it is truncated.
    """
    fields = _Fields(message)
    return SimpleNamespace(
        stamp=fields.stamp, frame_id=fields.text(), format=fields.text(), data=fields.octets()
    )


def deserialize_polygon(message: bytes) -> list[tuple[float, float]]:
    """The points (x, y) of a serialized geometry_msgs/PolygonStamped.

    Raises:
        FootageError: This is not such a message, or it is truncated.
    """
    fields = _Fields(message)
    fields.text()
    points = []
    for _ in range(fields.number("I")):
        x, y, _ = fields.number("f"), fields.number("f"), fields.number("f")
        points.append((x, y))
    return points


def deserialize_detections(message: bytes) -> SimpleNamespace:
    """Boxes and hypotheses of a serialized vision_msgs/Detection2DArray.

    Returns:
        `stamp` in nanoseconds, and `detections` with the fields `bbox` and `results`.

    Raises:
        FootageError: This is not such a message, or it is truncated.
    """
    fields = _Fields(message)
    fields.text()
    detections = [_detection(fields) for _ in range(fields.number("I"))]
    fields.check_end()
    return SimpleNamespace(stamp=fields.stamp, detections=detections)


def deserialize_camera_info(message: bytes) -> Any:
    """A serialized sensor_msgs/CameraInfo; see `deserialize_image`.

    Raises:
        FootageError: This is not such a message, or it is truncated.
    """
    fields = _Fields(message)
    frame_id = fields.text()
    height, width = fields.numbers("II")
    model = fields.text()
    d = fields.numbers("d" * fields.number("I"))
    k, _, p = fields.numbers("d" * 9), fields.numbers("d" * 9), fields.numbers("d" * 12)
    binning_x, binning_y, *region = fields.numbers("IIIIII")
    # Whether the region is rectified.
    fields.number("B")
    fields.check_end()
    names = ("x_offset", "y_offset", "height", "width")
    return SimpleNamespace(
        stamp=fields.stamp,
        frame_id=frame_id,
        height=height,
        width=width,
        distortion_model=model,
        d=d,
        k=k,
        p=p,
        binning_x=binning_x,
        binning_y=binning_y,
        roi=SimpleNamespace(**dict(zip(names, region, strict=True))),
    )


def deserialize_odometry(message: bytes) -> Any:
    """The pose of a serialized nav_msgs/Odometry; see `deserialize_image`.

    Raises:
        FootageError: This is not such a message, or it is truncated.
    """
    fields = _Fields(message)
    frame_id = fields.text()
    # Name of the child frame.
    fields.text()
    pose = SimpleNamespace(position=_vector(fields, "xyz"), orientation=_vector(fields, "xyzw"))
    # Covariance, and the twist of six numbers with its own.
    fields.numbers("d" * (36 + 6 + 36))
    fields.check_end()
    return SimpleNamespace(stamp=fields.stamp, frame_id=frame_id, pose=SimpleNamespace(pose=pose))


def deserialize_imu(message: bytes) -> Any:
    """The acceleration of a serialized sensor_msgs/Imu; see `deserialize_image`.

    Raises:
        FootageError: This is not such a message, or it is truncated.
    """
    fields = _Fields(message)
    frame_id = fields.text()
    # Orientation and angular velocity, each with its covariance.
    fields.numbers("d" * (4 + 9 + 3 + 9))
    acceleration, covariance = _vector(fields, "xyz"), fields.numbers("d" * 9)
    fields.check_end()
    return SimpleNamespace(
        stamp=fields.stamp,
        frame_id=frame_id,
        linear_acceleration=acceleration,
        linear_acceleration_covariance=covariance,
    )


def deserialize_transforms(message: bytes) -> Any:
    """The transforms of a serialized tf2_msgs/TFMessage; see `deserialize_image`.

    Returns:
        An object with `transforms`, each with `stamp`, `frame_id`, `child_frame_id`, `translation`
        and `rotation`, and with the stamp of the first of them, 0 without.

    Raises:
        FootageError: This is not such a message, or it is truncated.
    """
    fields = _Fields(message, has_header=False)
    transforms = [_transform(fields) for _ in range(fields.number("I"))]
    fields.check_end()
    stamp = transforms[0].stamp if transforms else 0
    return SimpleNamespace(stamp=stamp, frame_id="", transforms=transforms)


def _transform(fields: _Fields) -> SimpleNamespace:
    return SimpleNamespace(
        stamp=join_stamp(*fields.numbers("iI")),
        frame_id=fields.text(),
        child_frame_id=fields.text(),
        translation=_vector(fields, "xyz"),
        rotation=_vector(fields, "xyzw"),
    )


def _vector(fields: _Fields, names: str) -> SimpleNamespace:
    return SimpleNamespace(**dict(zip(names, fields.numbers("d" * len(names)), strict=True)))


def _detection(fields: _Fields) -> SimpleNamespace:
    # Header.
    fields.numbers("iI")
    fields.text()
    results = [_hypothesis(fields) for _ in range(fields.number("I"))]
    x, y, theta, size_x, size_y = fields.numbers("ddddd")
    center = SimpleNamespace(position=SimpleNamespace(x=x, y=y), theta=theta)
    # Id.
    fields.text()
    bbox = SimpleNamespace(center=center, size_x=size_x, size_y=size_y)
    return SimpleNamespace(results=results, bbox=bbox)


def _hypothesis(fields: _Fields) -> SimpleNamespace:
    hypothesis = SimpleNamespace(class_id=fields.text(), score=fields.number("d"))
    # Pose of seven numbers, and its covariance.
    fields.numbers("d" * (7 + 36))
    return SimpleNamespace(hypothesis=hypothesis)


class _Fields:
    """Reads the fields of a message in order.

    Attributes:
        stamp: Of the header, nanoseconds; 0 without.

    Args:
        message: The message in CDR, encapsulation included.
        has_header: Whether it begins with a std_msgs/Header.
    """

    def __init__(self, message: bytes, *, has_header: bool = True) -> None:
        self._order = _stamp_layout(message, 0)[0]
        self._max_alignment = 4 if bytes(message[:2]) in _VERSION_2 else 8
        self._message = message
        self.stamp, self._offset = 0, _ENCAPSULATION_SIZE
        if has_header:
            self.stamp = header_stamp(message)
            self._offset += struct.calcsize("iI")

    def number(self, kind: str) -> Any:
        """The next field, a number with a format character of `struct`."""
        layout = self._order + kind
        size = struct.calcsize(layout)
        padding = (_ENCAPSULATION_SIZE - self._offset) % min(size, self._max_alignment)
        begin = self._offset + padding
        if begin + size > len(self._message):
            raise self._truncated()
        self._offset = begin + size
        return struct.unpack_from(layout, self._message, begin)[0]

    def numbers(self, kinds: str) -> list[Any]:
        """The next fields, numbers with format characters of `struct`."""
        return [self.number(kind) for kind in kinds]

    def check_end(self) -> None:
        """Check that only padding is left.

        Raises:
            FootageError: The message is longer than its type.
        """
        left = len(self._message) - self._offset
        if left >= _ENCAPSULATION_SIZE:
            raise FootageError(
                f"a message of {len(self._message)} bytes is {left} bytes longer than its topic's "
                "type; it is of another type or version"
            )

    def octets(self) -> memoryview:
        """The next field, a sequence of octets."""
        length = self.number("I")
        if self._offset + length > len(self._message):
            raise self._truncated()
        begin, self._offset = self._offset, self._offset + length
        return memoryview(self._message)[begin : self._offset]

    def text(self) -> str:
        """The next field, a string; invalid UTF-8 is replaced."""
        return bytes(self.octets()).rstrip(b"\0").decode("utf-8", "replace")

    def _truncated(self) -> FootageError:
        return FootageError(
            f"a message of {len(self._message)} bytes is truncated, or not of its topic's type"
        )
