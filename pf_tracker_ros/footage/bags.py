"""Images in rosbag2 recordings, as the serialized messages that were recorded.

Reads folders with metadata.yaml (sqlite3 or MCAP, with or without zstd compression by file or by
message) and bare .mcap and .db3 files, by way of `rosbags`. Nothing is deserialized: a message
goes out again as the bytes that came in.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pf_tracker_ros.footage.base import FootageError
from pf_tracker_ros.footage.cdr import header_stamp

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2 import Reader

IMAGE_TYPE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE_TYPE = "sensor_msgs/msg/CompressedImage"
GROUND_TRUTH_TYPE = "geometry_msgs/msg/PolygonStamped"
GROUND_TRUTH_ENDING = "ground_truth"
BAG_SUFFIXES = (".mcap", ".db3")


@dataclass(frozen=True)
class BagImage:
    """One recorded image message.

    Attributes:
        stamp: Stamp of the header in nanoseconds.
        log_time: When it was recorded, in nanoseconds.
        message: The message in CDR, as recorded.
        ground_truth: The PolygonStamped in CDR with the same stamp, None without one.
    """

    stamp: int
    log_time: int
    message: bytes
    ground_truth: bytes | None


@dataclass(frozen=True)
class ImageBag:
    """The images of one topic of a bag.

    Attributes:
        path: The bag.
        image_topic: Topic that the images come from.
        image_type: `sensor_msgs/msg/Image` or `sensor_msgs/msg/CompressedImage`.
        image_count: Number of messages on it, as far as the bag tells; 0 if it does not.
        ground_truth_topic: Topic that the boxes come from, None without one.
    """

    path: Path
    image_topic: str
    image_type: str
    image_count: int
    ground_truth_topic: str | None

    @property
    def name(self) -> str:
        """Short name for messages and tables."""
        return self.path.stem

    def images(self) -> Iterator[BagImage]:
        """Read the images in the order of recording; each call starts from the first.

        Yields:
            The messages.

        Raises:
            FootageError: The bag is corrupt or holds no image on this topic.
        """
        with _reading(self.path) as reader:
            ground_truth = self._read_ground_truth(reader)
            found = False
            for log_time, message in _messages(reader, self.image_topic):
                stamp = header_stamp(message)
                yield BagImage(stamp, log_time, message, ground_truth.get(stamp))
                found = True
        if not found:
            raise FootageError(f"bag {self.path} has no message on topic {self.image_topic}")

    def _read_ground_truth(self, reader: Reader) -> dict[int, bytes]:
        if self.ground_truth_topic is None:
            return {}
        return {
            header_stamp(message): message
            for _, message in _messages(reader, self.ground_truth_topic)
        }


def is_bag(path: Path) -> bool:
    """Whether a path is a rosbag2 folder or a storage file of one."""
    if path.is_dir():
        return (path / "metadata.yaml").exists()
    return path.suffix in BAG_SUFFIXES


def open_bag(path: str | Path, topic: str = "", ground_truth_topic: str = "") -> ImageBag:
    """Find the images and the ground truth in a bag.

    Args:
        path: A rosbag2 folder or a .mcap file.
        topic: Image topic; empty takes the only one that there is.
        ground_truth_topic: Topic of type PolygonStamped with a box for each image; empty takes
            the only one whose name ends with `ground_truth`, if there is one.

    Returns:
        What is there; the messages are read by `ImageBag.images`.

    Raises:
        FootageError: The bag cannot be read, or the topic is missing or not the only one.
    """
    bag = Path(path)
    with _reading(bag) as reader:
        connections = list(reader.connections)
    images = _by_topic(connections, (IMAGE_TYPE, COMPRESSED_IMAGE_TYPE))
    all_topics = ", ".join(
        f"{connection.topic} ({connection.msgtype})"
        for connection in sorted(connections, key=lambda connection: connection.topic)
    )
    if not images:
        raise FootageError(
            f"bag {bag} has no topic of type {IMAGE_TYPE} or {COMPRESSED_IMAGE_TYPE}; there are: "
            f"{all_topics or 'no topics at all'}"
        )
    if topic and topic not in images:
        raise FootageError(
            f"bag {bag} has no image topic {topic}; image topics are: {', '.join(sorted(images))}"
        )
    if not topic and len(images) > 1:
        raise FootageError(
            f"bag {bag} has several image topics, choose one: {', '.join(sorted(images))}"
        )
    chosen = images[topic] if topic else next(iter(images.values()))
    return ImageBag(
        path=bag,
        image_topic=chosen.topic,
        image_type=chosen.msgtype,
        image_count=chosen.msgcount,
        ground_truth_topic=_choose_ground_truth(bag, connections, ground_truth_topic),
    )


def _choose_ground_truth(bag: Path, connections: list[Connection], topic: str) -> str | None:
    polygons = sorted(_by_topic(connections, (GROUND_TRUTH_TYPE,)))
    if topic:
        if topic not in polygons:
            raise FootageError(
                f"bag {bag} has no topic {topic} of type {GROUND_TRUTH_TYPE}; there are: "
                f"{', '.join(polygons) or 'none'}"
            )
        return topic
    named = [name for name in polygons if name.endswith(GROUND_TRUTH_ENDING)]
    if len(named) > 1:
        raise FootageError(
            f"bag {bag} has several topics with ground truth, choose one: {', '.join(named)}"
        )
    return named[0] if named else None


def _by_topic(connections: list[Connection], types: tuple[str, ...]) -> dict[str, Connection]:
    return {
        connection.topic: connection for connection in connections if connection.msgtype in types
    }


def _messages(reader: Reader, topic: str) -> Iterator[tuple[int, bytes]]:
    # One topic may have several connections, for example one for each QoS profile.
    connections = [connection for connection in reader.connections if connection.topic == topic]
    for _, log_time, message in reader.messages(connections):
        yield log_time, bytes(message)


@contextmanager
def _reading(path: Path) -> Iterator[Reader]:
    try:
        from rosbags.rosbag2 import Reader
    except ImportError as error:
        raise FootageError(
            "reading a bag needs the Python package rosbags: pip install rosbags"
        ) from error
    # A corrupt file can make the readers of YAML, SQLite, MCAP and zstd raise nearly anything;
    # to the user it is all one: this bag cannot be read.
    try:
        reader = Reader(path)
        reader.open()
    except Exception as error:
        raise _unreadable(path, error) from error
    try:
        yield reader
    except (FootageError, GeneratorExit):
        raise
    except Exception as error:
        raise _unreadable(path, error) from error
    finally:
        reader.close()


def _unreadable(path: Path, error: Exception) -> FootageError:
    reason = str(error).strip().splitlines()
    return FootageError(
        f"bag {path} cannot be read ({reason[0] if reason else type(error).__name__}); accepted "
        "are rosbag2 folders with metadata.yaml (sqlite3 or mcap storage, zstd compression) and "
        "bare .mcap or .db3 files"
    )
