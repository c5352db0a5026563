"""Bag reader for `rosbags`, a package of PyPI that needs no ROS."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pf_tracker_ros.footage.bag_reading import BagTopic, topics_of


class RosbagsReader:
    """An open bag.

    Args:
        path: The bag.

    Raises:
        ImportError: `rosbags` is not installed.
    """

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag2 import Reader

        self._reader = Reader(path)
        self._reader.open()

    def topics(self) -> list[BagTopic]:
        """The topics, one for each name and type."""
        connections = self._reader.connections
        return topics_of((each.topic, each.msgtype, each.msgcount) for each in connections)

    def messages(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Log time in nanoseconds and CDR of each message of a topic, in the order of recording."""
        connections = [each for each in self._reader.connections if each.topic == topic]
        for _, log_time, message in self._reader.messages(connections):
            yield log_time, bytes(message)

    def close(self) -> None:
        """Close the files."""
        self._reader.close()
