"""MCAP files that were cut off, as a recorder leaves them that lost its power.

A whole file begins and ends with the same eight bytes. One without those at its end lacks its index
as well, but what was recorded before can be saved.
"""

from __future__ import annotations

from pathlib import Path

from pf_tracker_ros.footage.access import entries

_MAGIC = b"\x89MCAP0\r\n"


def is_cut_off(path: Path) -> bool:
    """Whether a file begins as MCAP and does not end as such; False for one that is unreadable."""
    try:
        with path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                return False
            file.seek(-len(_MAGIC), 2)
            # The file's only magic is no end.
            return file.tell() == 0 or file.read() != _MAGIC
    except OSError:
        return False


def recovery_advice(bag: Path) -> str | None:
    """What to do about cut-off MCAP files.

    Args:
        bag: A rosbag2 folder, with or without metadata.yaml, or a storage file.

    Returns:
        The end of a sentence; None if no file of the bag is cut off.

    Raises:
        FootageError: The folder cannot be listed.
    """
    is_folder = bag.is_dir()
    files = [path for path in entries(bag) if path.is_file()] if is_folder else [bag]
    broken = sorted(path for path in files if path.suffix == ".mcap" and is_cut_off(path))
    if not broken:
        return None
    names = " and ".join(path.name for path in broken)
    verb = "was" if len(broken) == 1 else "were"
    advice = (
        f"{names} {verb} cut off before the recorder finished; save what is in there with "
        f"`mcap recover {broken[0].name} -o recovered.mcap`"
    )
    if is_folder:
        advice += f", put it in place of the file and run `ros2 bag reindex {bag.name}`"
    return advice
