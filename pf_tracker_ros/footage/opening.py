"""Opens footage of any kind by its path."""

from __future__ import annotations

from pathlib import Path

from pf_tracker_ros.footage.access import entries, exists
from pf_tracker_ros.footage.bag_reading import BAG_SUFFIXES, recovery_advice
from pf_tracker_ros.footage.bags import is_bag
from pf_tracker_ros.footage.base import DEFAULT_FRAME_RATE, Footage, FootageError
from pf_tracker_ros.footage.ground_truth import GROUND_TRUTH_FILE, ground_truth_file
from pf_tracker_ros.footage.images import IMAGE_SUFFIXES, ImageFolderFootage, image_paths
from pf_tracker_ros.footage.sequences import read_sequence
from pf_tracker_ros.footage.videos import VideoFootage

ACCEPTED = (
    "accepted are a video file, a folder of images, a sequence folder "
    f"({GROUND_TRUTH_FILE} and frames), a rosbag2 folder and a .mcap file"
)


def existing_path(path: str | Path) -> Path:
    """The path of a source with `~` expanded.

    Raises:
        FootageError: The path does not exist or is not accessible.
    """
    if not str(path):
        raise FootageError(f"no source is given; {ACCEPTED}")
    try:
        expanded = Path(path).expanduser()
    except RuntimeError as error:
        raise FootageError(f"{path} names no folder ({error}); {ACCEPTED}") from error
    if not exists(expanded):
        raise FootageError(f"there is no {expanded}; {ACCEPTED}")
    return expanded


def open_footage(path: str | Path, *, frame_rate: float = DEFAULT_FRAME_RATE) -> Footage:
    """Open a video file, a folder of images or a sequence folder.

    Args:
        path: The source.
        frame_rate: Frames per second of a source without a rate of its own (images).

    Returns:
        The footage; its first frame has been decoded successfully.

    Raises:
        FootageError: It cannot be read; the message has the reason and what is accepted.
    """
    source = existing_path(path)
    if is_bag(source):
        raise FootageError(f"{source} is a bag; open it with open_bag")
    if not source.is_dir():
        return VideoFootage(source, frame_rate=frame_rate)
    if ground_truth_file(source) is not None:
        return read_sequence(source, frame_rate=frame_rate)
    storage = sorted(entry for entry in entries(source) if entry.suffix in BAG_SUFFIXES)
    if storage:
        names = ", ".join(entry.name for entry in storage)
        raise FootageError(
            f"folder {source} has {names} but no metadata.yaml, so it is not a rosbag2 folder; "
            + (recovery_advice(source) or "run `ros2 bag reindex`, or give the .mcap file itself")
        )
    if not image_paths(source):
        raise FootageError(
            f"folder {source} has no images ({', '.join(IMAGE_SUFFIXES)}), no {GROUND_TRUTH_FILE} "
            f"and no metadata.yaml; {ACCEPTED}"
        )
    return ImageFolderFootage(source, frame_rate=frame_rate)
