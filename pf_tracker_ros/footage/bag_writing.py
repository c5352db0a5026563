"""Writes MCAP bags for `ros2 bag`; needs no ROS."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.atomic_files import hidden_folder
from pf_tracker_ros.footage.base import Footage, FootageError
from pf_tracker_ros.footage.ground_truth import true_box
from pf_tracker_ros.messages import IMAGE_TYPE, POLYGON_TYPE, box_message, image_message
from pf_tracker_ros.stamps import split_stamp

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, Qos
    from rosbags.typesys.store import Typestore

_GROUND_TRUTH_TOPIC = "/ground_truth"


class BagWriter:
    """Context manager that writes one MCAP bag. The bag appears when the block ends without error.

    A path that ends in `.mcap` becomes a single file, any other a rosbag2 folder with
    metadata.yaml.

    Args:
        path: Path of the bag.

    Raises:
        FootageError: The path exists, or the package rosbags is missing.
    """

    def __init__(self, path: str | Path) -> None:
        try:
            from rosbags.rosbag2 import StoragePlugin, Writer
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise FootageError(
                "writing a bag needs the Python package rosbags: pip install rosbags"
            ) from error
        self._path = Path(path)
        if self._path.exists():
            raise FootageError(f"bag {self._path} exists already; remove it or choose another path")
        self._make_writer = partial(Writer, version=9, storage_plugin=StoragePlugin.MCAP)
        self._typestore: Typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}
        self._field_defaults: dict[str, dict[str, Any]] = {}

    def __enter__(self) -> BagWriter:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            folder = stack.enter_context(hidden_folder(self._path.parent, ".bag_"))
            self._writer = self._make_writer(folder / self._path.stem)
            self._writer.open()
            self._staging_folder = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        with self._staging_folder:
            self._writer.__exit__(*error)
            if error[0] is None:
                self._move_into_place()

    def _move_into_place(self) -> None:
        finished = self._writer.path
        if self._path.suffix == ".mcap":
            finished = finished / f"{self._path.stem}.mcap"
        finished.replace(self._path)

    def add_topic(self, topic: str, message_type: str) -> None:
        """Add a topic of a standard message type, played back with rclpy's default QoS.

        Args:
            topic: Full topic name.
            message_type: For example `sensor_msgs/msg/Image`.
        """
        self._connections[topic] = self._writer.add_connection(
            topic,
            message_type,
            typestore=self._typestore,
            offered_qos_profiles=[_default_qos()],
        )

    def write(self, topic: str, log_time: int, message: bytes) -> None:
        """Write a message in CDR to an added topic; the log time is in nanoseconds."""
        self._writer.write(self._connections[topic], log_time, message)

    def write_message(self, topic: str, log_time: int, message: Any) -> None:
        """Write a message made by `new`; as `write`."""
        octets = self._typestore.serialize_cdr(message, self._connections[topic].msgtype)
        self.write(topic, log_time, bytes(octets))

    def write_image(self, topic: str, stamp: int, image: NDArray[Any]) -> None:
        """Write an image as sensor_msgs/msg/Image with the frame id "camera".

        Args:
            topic: One of the added topics.
            stamp: Stamp and log time in nanoseconds.
            image: As for `image_message`.
        """
        self.write_message(topic, stamp, image_message(self.new, self.header(stamp), image))

    def header(self, stamp: int, frame_id: str = "camera") -> Any:
        """A header with a stamp in nanoseconds."""
        seconds, nanoseconds = split_stamp(stamp)
        time = self.new("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        return self.new("std_msgs/msg/Header", stamp=time, frame_id=frame_id)

    def new(self, message_type: str, /, **fields: Any) -> Any:
        """Make a message; other fields are 0 or empty."""
        if message_type not in self._field_defaults:
            _, declared = self._typestore.fielddefs[message_type]
            defaults = {name: self._default(*kind) for name, kind in declared}
            self._field_defaults[message_type] = defaults
        values = {**self._field_defaults[message_type], **fields}
        return self._typestore.types[message_type](**values)

    def _default(self, kind: Any, details: Any) -> Any:
        """Default of a field, from its declaration in the type store."""
        if kind.name == "NAME":
            return self.new(details)
        if kind.name == "BASE":
            return "" if details[0] == "string" else 0
        (element, name), _ = details
        return np.zeros(0, name[0]) if element.name == "BASE" else []


def write_footage(footage: Footage, path: str | Path, *, topic: str = "/image") -> int:
    """Write footage into an MCAP bag, and its ground truth, if any, on `/ground_truth`.

    Frames without target get no ground-truth message.

    Args:
        footage: The footage.
        path: As for `BagWriter`.
        topic: Image topic.

    Returns:
        The number of frames written.

    Raises:
        FootageError: The footage cannot be read or the bag cannot be written.
    """
    count = 0
    boxes = footage.ground_truth
    with BagWriter(path) as writer:
        writer.add_topic(topic, IMAGE_TYPE)
        if boxes is not None:
            writer.add_topic(_GROUND_TRUTH_TOPIC, POLYGON_TYPE)
        for frame in footage.frames():
            writer.write_image(topic, frame.stamp, frame.image)
            if box := true_box(boxes, count):
                message = box_message(writer.new, writer.header(frame.stamp), box)
                writer.write_message(_GROUND_TRUTH_TOPIC, frame.stamp, message)
            count += 1
    return count


def _default_qos() -> Qos:
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    # RMW_DURATION_INFINITE.
    unlimited = QosTime(sec=9_223_372_036, nsec=854_775_807)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=10,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.VOLATILE,
        deadline=unlimited,
        lifespan=unlimited,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=unlimited,
        avoid_ros_namespace_conventions=False,
    )
