"""Reads bags with `rosbags`, a package of PyPI that needs no ROS."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pf_tracker_ros.footage.bag_reading import BagTopic


class RosbagsReader:
    """A bag read by `rosbags`; see `BagReader`.

    Args:
        path: The bag, opened at once.

    Raises:
        ImportError: `rosbags` is not installed.
    """

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag2 import Reader

        self._reader = Reader(path)
        self._reader.open()

    def topics(self) -> list[BagTopic]:
        """See `BagReader.topics`."""
        # One topic may have several connections, for example one for each QoS profile.
        counts: dict[tuple[str, str], int] = {}
        for connection in self._reader.connections:
            key = connection.topic, connection.msgtype
            counts[key] = counts.get(key, 0) + connection.msgcount
        return [BagTopic(name, kind, count) for (name, kind), count in counts.items()]

    def messages(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """See `BagReader.messages`."""
        connections = [each for each in self._reader.connections if each.topic == topic]
        for _, log_time, message in self._reader.messages(connections):
            yield log_time, bytes(message)

    def close(self) -> None:
        """See `BagReader.close`."""
        self._reader.close()
