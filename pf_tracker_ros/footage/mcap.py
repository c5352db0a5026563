"""Truncated MCAP files, as after a power failure of the recorder.

A complete file begins and ends with the same eight magic bytes. A truncated file also lacks its
index, but `mcap recover` saves the messages.
"""

from __future__ import annotations

from pathlib import Path

from pf_tracker_ros.footage.access import entries

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
