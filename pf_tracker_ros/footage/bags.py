"""Image topics of rosbag2 recordings, as serialized messages.

Reads folders with metadata.yaml (sqlite3 or MCAP, with or without zstd compression by file or by
message) and bare .mcap and .db3 files. Messages keep their recorded bytes.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pf_tracker_ros.footage.access import exists
from pf_tracker_ros.footage.bag_reading import (
    BAG_SUFFIXES,
    METADATA_FILE,
    BagReader,
    BagTopic,
    reading,
)
from pf_tracker_ros.footage.base import FootageError, PartialFootageError
from pf_tracker_ros.footage.cdr import (
    deserialize_compressed_image,
    deserialize_image,
    header_stamp,
)
from pf_tracker_ros.messages import IMAGE_TYPE, POLYGON_TYPE
from pf_tracker_ros.plurals import counted

COMPRESSED_IMAGE_TYPE = "sensor_msgs/msg/CompressedImage"
GROUND_TRUTH_SUFFIX = "ground_truth"


@dataclass(frozen=True)
class BagImage:
    """One recorded image message.

    Attributes:
        stamp: Stamp of the header in nanoseconds.
        log_time: Time of recording in nanoseconds.
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
        image_topic: Topic of the images.
        image_type: `sensor_msgs/msg/Image` or `sensor_msgs/msg/CompressedImage`.
        image_count: Number of images according to the bag; 0 if unknown.
        ground_truth_topic: Topic of the true boxes, None without one.
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

    def images(self) -> Generator[BagImage, None, None]:
        """Read the images in the order of recording; each call starts from the first.

        Yields:
            The messages.

        Raises:
            FootageError: The bag is corrupt or holds no image on this topic.
            PartialFootageError: It holds fewer than it declares.
        """
        count = 0
        with reading(self.path) as reader:
            ground_truth = self._read_ground_truth(reader)
            for log_time, message in reader.messages(self.image_topic):
                stamp = header_stamp(message)
                yield BagImage(stamp, log_time, message, ground_truth.get(stamp))
                count += 1
        if not count:
            raise FootageError(f"bag {self.path} has no message on topic {self.image_topic}")
        if count < self.image_count:
            declared = counted(self.image_count, "image")
            raise PartialFootageError(
                f"bag {self.path} is damaged: it contains {count} of its {declared} on "
                f"{self.image_topic}"
            )

    def deserialize(self, image: BagImage, index: int) -> Any:
        """The fields of a recorded message, see `cdr.deserialize_image`.

        Args:
            image: From `images`.
            index: Of the image, for the error.

        Raises:
            FootageError: It is no such message.
        """
        is_compressed = self.image_type == COMPRESSED_IMAGE_TYPE
        read = deserialize_compressed_image if is_compressed else deserialize_image
        try:
            return read(image.message)
        except FootageError as error:
            raise FootageError(f"bag {self.path}, frame {index}: {error}") from error

    def _read_ground_truth(self, reader: BagReader) -> dict[int, bytes]:
        if self.ground_truth_topic is None:
            return {}
        return {
            header_stamp(message): message
            for _, message in reader.messages(self.ground_truth_topic)
        }


def is_bag(path: Path) -> bool:
    """Whether a path is a rosbag2 folder or a storage file of one.

    Raises:
        FootageError: A parent folder is not accessible.
    """
    if exists(path) and path.is_dir():
        return exists(path / METADATA_FILE)
    return path.suffix in BAG_SUFFIXES


def open_bag(path: str | Path, topic: str = "", ground_truth_topic: str = "") -> ImageBag:
    """Find the images and the ground truth in a bag.

    Args:
        path: A rosbag2 folder or a .mcap file.
        topic: Image topic; empty for the only one.
        ground_truth_topic: Topic of type PolygonStamped with a box for each image; empty for the
            only one whose name ends with `ground_truth`, if any.

    Returns:
        The topics; `ImageBag.images` reads the messages.

    Raises:
        FootageError: The bag cannot be read, or the topic is missing or ambiguous.
    """
    bag = Path(path)
    with reading(bag) as reader:
        topics = sorted(reader.topics(), key=lambda each: each.name)
    images = _by_name(topics, (IMAGE_TYPE, COMPRESSED_IMAGE_TYPE))
    all_topics = ", ".join(f"{each.name} ({each.message_type})" for each in topics)
    if not images:
        raise FootageError(
            f"bag {bag} has no topic of type {IMAGE_TYPE} or {COMPRESSED_IMAGE_TYPE}; there are: "
            f"{all_topics or 'no topics'}"
        )
    names = ", ".join(sorted(images))
    if topic and topic not in images:
        raise FootageError(f"bag {bag} has no image topic {topic}; image topics are: {names}")
    cameras = sorted(name for name in images if "depth" not in name) or sorted(images)
    if not topic and len(cameras) > 1:
        raise FootageError(f"bag {bag} has several image topics; choose one: {names}")
    selected = images[topic or cameras[0]]
    return ImageBag(
        path=bag,
        image_topic=selected.name,
        image_type=selected.message_type,
        image_count=selected.message_count,
        ground_truth_topic=_choose_ground_truth(bag, topics, ground_truth_topic),
    )


def read_topic(path: Path, topic: str) -> Generator[tuple[int, bytes], None, None]:
    """Read the messages of a topic in the order of recording.

    Yields:
        Log time in nanoseconds, and the message in CDR.

    Raises:
        FootageError: The bag is corrupt.
    """
    with reading(path) as reader:
        yield from reader.messages(topic)


def topics_of_type(path: Path, message_type: str) -> list[str]:
    """The names of the topics of a type in a bag, sorted.

    Raises:
        FootageError: The bag cannot be read.
    """
    with reading(path) as reader:
        return sorted(_by_name(reader.topics(), (message_type,)))


def _choose_ground_truth(bag: Path, topics: list[BagTopic], topic: str) -> str | None:
    polygons = sorted(_by_name(topics, (POLYGON_TYPE,)))
    if topic:
        if topic not in polygons:
            raise FootageError(
                f"bag {bag} has no topic {topic} of type {POLYGON_TYPE}; there are: "
                f"{', '.join(polygons) or 'none'}"
            )
        return topic
    named = [name for name in polygons if name.endswith(GROUND_TRUTH_SUFFIX)]
    if len(named) > 1:
        raise FootageError(
            f"bag {bag} has several topics with ground truth; choose one: {', '.join(named)}"
        )
    return named[0] if named else None


def _by_name(topics: list[BagTopic], types: tuple[str, ...]) -> dict[str, BagTopic]:
    return {each.name: each for each in topics if each.message_type in types}
