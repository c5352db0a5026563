"""Bags as topics and serialized messages, read by `rosbag2_py` of ROS, or by `rosbags` of PyPI."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from pf_tracker_ros.footage.access import check_file, entries, exists
from pf_tracker_ros.footage.base import FootageError
from pf_tracker_ros.footage.mcap import recovery_advice

if TYPE_CHECKING:
    from pf_tracker_ros.footage.bag_reading_rosbag2 import Rosbag2Reader
    from pf_tracker_ros.footage.bag_reading_rosbags import RosbagsReader

BagReader: TypeAlias = "Rosbag2Reader | RosbagsReader"
"""An open bag. A damaged bag may raise any exception."""

METADATA_FILE = "metadata.yaml"
BAG_SUFFIXES = (".mcap", ".db3")


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag.

    Attributes:
        name: Full topic name.
        message_type: For example `sensor_msgs/msg/Image`.
        message_count: Number of messages according to the bag; 0 if unknown.
    """

    name: str
    message_type: str
    message_count: int


def topics_of(counts: Iterable[tuple[str, str, int]]) -> list[BagTopic]:
    """Topics from names, types and counts. The counts of repeated topics, as one a QoS, add up."""
    sums: dict[tuple[str, str], int] = {}
    for name, message_type, count in counts:
        sums[name, message_type] = sums.get((name, message_type), 0) + count
    return [BagTopic(*topic, count) for topic, count in sums.items()]


@contextmanager
def reading(path: Path) -> Iterator[BagReader]:
    """Open a bag within a block; reading errors become FootageErrors.

    Args:
        path: A rosbag2 folder or a storage file.

    Raises:
        FootageError: The bag cannot be read, or no library for it is installed.
    """
    _check_files(path)
    # On a corrupt file the readers of YAML, SQLite, MCAP and zstd raise nearly any exception.
    try:
        reader = _open(path)
        try:
            yield reader
        finally:
            reader.close()
    except (FootageError, GeneratorExit):
        raise
    except Exception as error:
        raise _unreadable(path, error) from error


def _open(path: Path) -> BagReader:
    from pf_tracker_ros.footage.bag_reading_rosbag2 import Rosbag2Reader
    from pf_tracker_ros.footage.bag_reading_rosbags import RosbagsReader

    for reader_type in (Rosbag2Reader, RosbagsReader):
        with suppress(ImportError):
            return reader_type(path)
    raise FootageError(
        "reading a bag needs rosbag2_py (apt: ros-jazzy-rosbag2-py) or the Python package rosbags "
        "(pip install rosbags)"
    )


def _check_files(path: Path) -> None:
    if not (exists(path) and path.is_dir()):
        check_file(path, "bag")
        return
    for entry in entries(path):
        is_part = entry.name == METADATA_FILE or set(entry.suffixes) & set(BAG_SUFFIXES)
        if is_part and not entry.is_dir():
            check_file(entry, "bag file")


def _unreadable(path: Path, error: Exception) -> FootageError:
    lines = str(error).strip().splitlines()
    reason = lines[0] if lines else type(error).__name__
    advice = recovery_advice(path)
    if advice is not None:
        return FootageError(f"bag {path} cannot be read ({reason}): {advice}")
    return FootageError(
        f"bag {path} cannot be read ({reason}); accepted are rosbag2 folders with {METADATA_FILE} "
        "(sqlite3 or mcap storage, zstd compression) and bare .mcap or .db3 files"
    )
