"""Write MCAP recordings that `ros2 bag` plays, without ROS installed."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.atomic_files import hidden_folder
from pf_tracker_ros.footage.base import Footage, FootageError
from pf_tracker_ros.messages import IMAGE_TYPE, POLYGON_TYPE, box_message, image_message
from pf_tracker_ros.stamps import split_stamp

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, Qos
    from rosbags.typesys.store import Typestore

Reliability = Literal["reliable", "best_effort"]


class BagWriter:
    """Writes one MCAP bag; a context manager, finished when left without an error.

    A path that ends in `.mcap` becomes a single file, any other a rosbag2 folder with
    metadata.yaml.

    Args:
        path: Where it will be once finished.

    Raises:
        FootageError: Something is there already, or the package rosbags is missing.
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
            raise FootageError(f"{self._path} exists already; a bag does not overwrite anything")
        self._make = partial(Writer, version=9, storage_plugin=StoragePlugin.MCAP)
        self._typestore: Typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}
        self._blank: dict[str, dict[str, Any]] = {}

    def __enter__(self) -> BagWriter:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            folder = stack.enter_context(hidden_folder(self._path.parent, ".bag_"))
            self._writer = self._make(folder / self._path.stem)
            self._writer.open()
            self._workplace = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        with self._workplace:
            self._writer.__exit__(*error)
            if error[0] is None:
                self._put_in_place()

    def _put_in_place(self) -> None:
        finished = self._writer.path
        if self._path.suffix == ".mcap":
            finished = finished / f"{self._path.stem}.mcap"
        finished.replace(self._path)

    def add_topic(
        self,
        topic: str,
        message_type: str,
        *,
        reliability: Reliability = "reliable",
        depth: int = 10,
    ) -> None:
        """Add a topic of the common interfaces, with the QoS profile that a player shall offer.

        Args:
            topic: Full topic name.
            message_type: For example `sensor_msgs/msg/Image`.
            reliability: Reliability of the QoS profile.
            depth: Queue length of the QoS profile.
        """
        self._connections[topic] = self._writer.add_connection(
            topic,
            message_type,
            typestore=self._typestore,
            offered_qos_profiles=[_qos(reliability, depth)],
        )

    def write(self, topic: str, log_time: int, message: bytes) -> None:
        """Write a message that is serialized already.

        Args:
            topic: One of the added topics.
            log_time: Nanoseconds.
            message: The message in CDR.
        """
        self._writer.write(self._connections[topic], log_time, message)

    def write_message(self, topic: str, log_time: int, message: Any) -> None:
        """Write a message made by `new`.

        Args:
            topic: One of the added topics.
            log_time: Nanoseconds.
            message: Of the topic's type.
        """
        octets = self._typestore.serialize_cdr(message, self._connections[topic].msgtype)
        self.write(topic, log_time, bytes(octets))

    def write_image(self, topic: str, stamp: int, image: NDArray[Any]) -> None:
        """Write an image as sensor_msgs/msg/Image, with the frame "camera" and its log time.

        Args:
            topic: One of the added topics.
            stamp: Nanoseconds.
            image: As for `image_message`.
        """
        self.write_message(topic, stamp, image_message(self.new, self.header(stamp), image))

    def header(self, stamp: int, frame_id: str = "camera") -> Any:
        """A header with a stamp in nanoseconds."""
        seconds, nanoseconds = split_stamp(stamp)
        time = self.new("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        return self.new("std_msgs/msg/Header", stamp=time, frame_id=frame_id)

    def new(self, message_type: str, /, **fields: Any) -> Any:
        """A message; what is left out is 0 or empty."""
        if message_type not in self._blank:
            _, declared = self._typestore.fielddefs[message_type]
            self._blank[message_type] = {name: self._usual(*kind) for name, kind in declared}
        return self._typestore.types[message_type](**{**self._blank[message_type], **fields})

    def _usual(self, kind: Any, details: Any) -> Any:
        """What a field is in a blank message, by its declaration in the type store."""
        if kind.name == "NAME":
            return self.new(details)
        if kind.name == "BASE":
            return "" if details[0] == "string" else 0
        (element, name), _ = details
        return np.zeros(0, name[0]) if element.name == "BASE" else []


def write_footage(
    footage: Footage,
    path: str | Path,
    *,
    topic: str = "/image",
    ground_truth_topic: str = "/ground_truth",
    frame_id: str = "camera",
) -> int:
    """Write footage into an MCAP bag, with its ground truth where there is one.

    A frame whose target is absent gets no message with a box.

    Args:
        footage: What to write.
        path: The bag; a single file if it ends in `.mcap`, else a rosbag2 folder.
        topic: Image topic.
        ground_truth_topic: Topic of the boxes.
        frame_id: Frame of all headers.

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
            writer.add_topic(ground_truth_topic, POLYGON_TYPE)
        for frame in footage.frames():
            header = writer.header(frame.stamp, frame_id)
            image = image_message(writer.new, header, frame.image)
            writer.write_message(topic, frame.stamp, image)
            if boxes is not None and not np.isnan(boxes[count]).any():
                box = box_message(writer.new, header, boxes[count])
                writer.write_message(ground_truth_topic, frame.stamp, box)
            count += 1
    return count


def _qos(reliability: Reliability, depth: int) -> Qos:
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    # What the ROS middleware interface calls an infinite duration.
    unlimited = QosTime(sec=9_223_372_036, nsec=854_775_807)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=depth,
        reliability=QosReliability[reliability.upper()],
        durability=QosDurability.VOLATILE,
        deadline=unlimited,
        lifespan=unlimited,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=unlimited,
        avoid_ros_namespace_conventions=False,
    )
