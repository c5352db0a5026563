"""Write MCAP recordings that `ros2 bag` plays, without ROS installed."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import box_corners
from pf_tracker_ros.files import hidden_folder
from pf_tracker_ros.footage.bags import GROUND_TRUTH_TYPE, IMAGE_TYPE
from pf_tracker_ros.footage.base import Footage, FootageError
from pf_tracker_ros.footage.markers import Outline, outline_markers
from pf_tracker_ros.footage.messages import PARTICLE_FIELDS, image_encoding, particle_columns
from pf_tracker_ros.stamps import parts

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, Qos
    from rosbags.typesys.store import Typestore

# sensor_msgs/PointField has it so.
_FLOAT32 = 7

PARTICLES_TYPE = "sensor_msgs/msg/PointCloud2"
STATUS_TYPE = "diagnostic_msgs/msg/DiagnosticArray"
MARKERS_TYPE = "visualization_msgs/msg/MarkerArray"

Reliability = Literal["reliable", "best_effort"]


class Status(NamedTuple):
    """One of several statuses.

    Attributes:
        name: Of the node that tells it, or of its part.
        level: 0 OK, 1 WARN, 2 ERROR.
        text: One sentence for people.
        values: What there is to know, key to value.
    """

    name: str
    level: int
    text: str
    values: Mapping[str, str | float | int]


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

    def write_image(self, topic: str, stamp: int, image: NDArray[Any], **where: Any) -> None:
        """Write an image as sensor_msgs/msg/Image.

        Args:
            topic: One of the added topics.
            stamp: Nanoseconds.
            image: (H, W, 3) uint8 BGR, (H, W) uint8 or (H, W) uint16.
            where: `frame_id`, frame of the header, by default "camera"; and `log_time` in
                nanoseconds, by default the stamp.
        """
        pixels = np.ascontiguousarray(image, dtype=image.dtype.newbyteorder("<"))
        fields = {
            "height": image.shape[0],
            "width": image.shape[1],
            "encoding": image_encoding(image),
            "step": pixels.strides[0],
            "data": pixels.reshape(-1).view(np.uint8),
        }
        self._write_stamped(topic, IMAGE_TYPE, stamp, **where, **fields)

    def write_box(self, topic: str, stamp: int, box: Sequence[float], **where: Any) -> None:
        """Write a box as geometry_msgs/msg/PolygonStamped of its corners.

        Args:
            topic: One of the added topics.
            stamp: Nanoseconds.
            box: (x, y, width, height) in pixels.
            where: As for `write_image`.
        """
        points = [self._new("geometry_msgs/msg/Point32", x=x, y=y) for x, y in box_corners(box)]
        polygon = self._new("geometry_msgs/msg/Polygon", points=points)
        self._write_stamped(topic, GROUND_TRUTH_TYPE, stamp, **where, polygon=polygon)

    def write_particles(
        self,
        topic: str,
        stamp: int,
        boxes: NDArray[np.float64],
        weights: NDArray[np.float64],
        *,
        ids: NDArray[np.integer[Any]] | None = None,
        **where: Any,
    ) -> None:
        """Write particles as sensor_msgs/msg/PointCloud2 of their boxes' centers.

        Args:
            topic: One of the added topics.
            stamp: Nanoseconds.
            boxes: (N, 4) x, y, width, height in pixels.
            weights: (N,) their weights.
            ids: (N,) of the targets that they are of, which make one more field; None for none.
            where: As for `write_image`.
        """
        columns = particle_columns(boxes, weights)
        names: tuple[str, ...] = PARTICLE_FIELDS
        if ids is not None:
            columns = np.column_stack([columns, ids.astype(np.float32)])
            names = (*PARTICLE_FIELDS, "id")
        size, step = columns.itemsize, columns.itemsize * len(names)
        fields: dict[str, Any] = {
            "height": 1,
            "width": len(columns),
            "fields": [
                self._new(
                    "sensor_msgs/msg/PointField",
                    **{"name": name, "offset": index * size, "datatype": _FLOAT32, "count": 1},
                )
                for index, name in enumerate(names)
            ],
            "is_bigendian": sys.byteorder == "big",
            "point_step": step,
            "row_step": step * len(columns),
            "data": np.frombuffer(columns.tobytes(), np.uint8),
            "is_dense": True,
        }
        self._write_stamped(topic, PARTICLES_TYPE, stamp, **where, **fields)

    def write_statuses(
        self, topic: str, stamp: int, statuses: Sequence[Status], **where: Any
    ) -> None:
        """Write statuses as one diagnostic_msgs/msg/DiagnosticArray.

        Args:
            topic: One of the added topics.
            stamp: Nanoseconds.
            statuses: One after another.
            where: As for `write_image`.
        """
        messages = []
        for status in statuses:
            values = [
                self._new("diagnostic_msgs/msg/KeyValue", key=key, value=str(value))
                for key, value in status.values.items()
            ]
            fields = {"level": status.level, "name": status.name, "message": status.text}
            kind = "diagnostic_msgs/msg/DiagnosticStatus"
            messages.append(self._new(kind, **fields, values=values))
        self._write_stamped(topic, STATUS_TYPE, stamp, **where, status=messages)

    def write_outlines(
        self,
        topic: str,
        stamp: int,
        outlines: Sequence[Outline],
        *,
        frame_id: str = "camera",
        log_time: int | None = None,
    ) -> None:
        """Write boxes with texts as visualization_msgs/msg/MarkerArray, which replaces the last.

        Args:
            topic: One of the added topics.
            stamp: Nanoseconds.
            outlines: One after another.
            frame_id: Frame of the headers.
            log_time: Nanoseconds; None takes the stamp.
        """
        markers = outline_markers(self._new, self._header(stamp, frame_id), outlines)
        message = self._new(MARKERS_TYPE, markers=markers)
        self._write_message(topic, MARKERS_TYPE, stamp, log_time, message)

    def _header(self, stamp: int, frame_id: str) -> Any:
        seconds, nanoseconds = parts(stamp)
        time = self._new("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        return self._new("std_msgs/msg/Header", stamp=time, frame_id=frame_id)

    def _write_stamped(
        self,
        topic: str,
        message_type: str,
        stamp: int,
        *,
        frame_id: str = "camera",
        log_time: int | None = None,
        **fields: Any,
    ) -> None:
        """Write a message with a header and further fields."""
        message = self._new(message_type, header=self._header(stamp, frame_id), **fields)
        self._write_message(topic, message_type, stamp, log_time, message)

    def _write_message(
        self, topic: str, message_type: str, stamp: int, log_time: int | None, message: Any
    ) -> None:
        octets = bytes(self._typestore.serialize_cdr(message, message_type))
        self.write(topic, stamp if log_time is None else log_time, octets)

    def _new(self, message_type: str, **fields: Any) -> Any:
        """A message; what is left out is 0 or empty."""
        if message_type not in self._blank:
            _, declared = self._typestore.fielddefs[message_type]
            self._blank[message_type] = {name: self._usual(*kind) for name, kind in declared}
        return self._typestore.types[message_type](**{**self._blank[message_type], **fields})

    def _usual(self, kind: Any, details: Any) -> Any:
        """What a field is in a blank message, by its declaration in the type store."""
        if kind.name == "NAME":
            return self._new(details)
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
            writer.add_topic(ground_truth_topic, GROUND_TRUTH_TYPE)
        for frame in footage.frames():
            writer.write_image(topic, frame.stamp, frame.image, frame_id=frame_id)
            if boxes is not None and not np.isnan(boxes[count]).any():
                box = boxes[count]
                writer.write_box(ground_truth_topic, frame.stamp, box, frame_id=frame_id)
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
