"""Bag reader for `rosbag2_py`, a package of ROS.

Written against the interface of Jazzy (bindings and tests of `rosbag2_py` 0.26). It is on no
package index, so the tests run against a stand-in.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pf_tracker_ros.footage.bag_reading import BagTopic, topics_of

# For bare files; a folder's metadata.yaml names its storage.
_STORAGE_BY_SUFFIX = {".mcap": "mcap", ".db3": "sqlite3"}


class Rosbag2Reader:
    """An open bag, with the interface of `RosbagsReader`.

    Args:
        path: The bag.

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
        # A reader iterates over its bag only once.
        reader = self._open()
        reader.set_filter(self._library.StorageFilter(topics=[topic]))
        while reader.has_next():
            _, message, log_time = reader.read_next()
            yield log_time, message

    def close(self) -> None:
        """See `RosbagsReader.close`; the library closes a file when its reader is deleted."""

    def _open(self) -> Any:
        is_folder = self._path.is_dir()
        # The plain reader does not decompress messages.
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
