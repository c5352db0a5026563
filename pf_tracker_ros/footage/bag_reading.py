"""Bags as topics and serialized messages, read by `rosbag2_py` of ROS, or by `rosbags` of PyPI.

A complete MCAP file begins and ends with the same eight magic bytes. A truncated one, as after a
power failure of the recorder, also lacks its index, but `mcap recover` saves the messages.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from pf_tracker_ros.footage.access import check_file, entries, exists
from pf_tracker_ros.footage.base import FootageError

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


class RosbagsReader:
    """An open bag, read by `rosbags`, which needs no ROS.

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


# For bare files; a folder's metadata.yaml names its storage.
_STORAGE_BY_SUFFIX = {".mcap": "mcap", ".db3": "sqlite3"}


class Rosbag2Reader:
    """An open bag, read by `rosbag2_py` with the interface of `RosbagsReader`.

    Written against the interface of Jazzy (bindings and tests of `rosbag2_py` 0.26). It is on no
    package index, so the tests run against a stand-in.

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
        is_compressed = False
        if is_folder:
            metadata = self._library.MetadataIo().read_metadata(str(self._path))
            is_compressed = bool(metadata.compression_format)
            for name in metadata.relative_file_paths:
                if Path(name).is_absolute() or ".." in Path(name).parts:
                    raise FootageError(
                        f"bag {self._path} names the file {name}, which is not in its folder; "
                        "copy it there, and run `ros2 bag reindex`"
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


BagReader: TypeAlias = Rosbag2Reader | RosbagsReader
"""An open bag. A damaged bag may raise any exception."""


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
        # The metadata may name any file.
        is_special = entry.exists() and not entry.is_file()
        if (is_part or is_special) and not entry.is_dir():
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


_MAGIC = b"\x89MCAP0\r\n"


def is_incomplete_mcap(path: Path) -> bool:
    """Whether a file has the magic bytes only at its beginning; False for an unreadable file."""
    try:
        with path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                return False
            file.seek(-len(_MAGIC), 2)
            # With only eight bytes, the beginning is not also an end.
            return file.tell() == 0 or file.read() != _MAGIC
    except OSError:
        return False


def recovery_advice(bag: Path) -> str | None:
    """How to recover a bag with truncated MCAP files.

    Args:
        bag: A rosbag2 folder, with or without metadata.yaml, or a storage file.

    Returns:
        A clause for an error message; None if no file is truncated.

    Raises:
        FootageError: The folder cannot be listed.
    """
    is_folder = bag.is_dir()
    files = [path for path in entries(bag) if path.is_file()] if is_folder else [bag]
    broken = sorted(path for path in files if path.suffix == ".mcap" and is_incomplete_mcap(path))
    if not broken:
        return None
    names = " and ".join(path.name for path in broken)
    verb = "is" if len(broken) == 1 else "are"
    advice = (
        f"{names} {verb} truncated; recover the messages with "
        f"`mcap recover {broken[0].name} -o recovered.mcap`"
    )
    if is_folder:
        advice += f", replace the file by it and run `ros2 bag reindex {bag.name}`"
    return advice
