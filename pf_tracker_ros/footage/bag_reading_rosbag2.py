"""Reads bags with `rosbag2_py`, which comes with a ROS from apt.

Written against the interface that rosbag2 documents for Jazzy (`rosbag2_py` 0.26: its bindings and
its tests), as no package index has it to run here.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pf_tracker_ros.footage.bag_reading import BagTopic, topics_of

# A folder's metadata.yaml names its storage.
_STORAGE_BY_SUFFIX = {".mcap": "mcap", ".db3": "sqlite3"}


class Rosbag2Reader:
    """A bag read by `rosbag2_py`, as `RosbagsReader` reads it.

    Args:
        path: The bag, opened at once.

    Raises:
        ImportError: `rosbag2_py` is not installed.
    """

    def __init__(self, path: Path) -> None:
        import rosbag2_py  # type: ignore[import-not-found,unused-ignore]

        self._library = rosbag2_py
        self._path = path
        metadata = self._open().get_metadata()
        self._topics = topics_of(
            (each.topic_metadata.name, each.topic_metadata.type, each.message_count)
            for each in metadata.topics_with_message_count
        )

    def topics(self) -> list[BagTopic]:
        """See `RosbagsReader.topics`."""
        return list(self._topics)

    def messages(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """See `RosbagsReader.messages`."""
        # A reader goes through its bag once.
        reader = self._open()
        reader.set_filter(self._library.StorageFilter(topics=[topic]))
        while reader.has_next():
            _, message, log_time = reader.read_next()
            yield log_time, message

    def close(self) -> None:
        """See `RosbagsReader.close`; the library closes a file with the reader that has it open."""

    def _open(self) -> Any:
        is_folder = self._path.is_dir()
        # The plain reader hands compressed messages out as they are.
        is_compressed = is_folder and bool(
            self._library.MetadataIo().read_metadata(str(self._path)).compression_format
        )
        reader = (
            self._library.SequentialCompressionReader()
            if is_compressed
            else self._library.SequentialReader()
        )
        storage = "" if is_folder else _STORAGE_BY_SUFFIX.get(self._path.suffix, "")
        reader.open(
            self._library.StorageOptions(uri=str(self._path), storage_id=storage),
            self._library.ConverterOptions("cdr", "cdr"),
        )
        return reader
