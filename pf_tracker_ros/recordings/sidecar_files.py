"""What stands beside a recording under its name: its target, and a detector's boxes."""

from __future__ import annotations

from pathlib import Path

from pf_tracker_ros.footage.access import entries, is_folder, resolved

TARGET_SUFFIX = ".target.yaml"
DETECTIONS_SUFFIX = ".detections.csv"
SIDECAR_SUFFIXES = (TARGET_SUFFIX, DETECTIONS_SUFFIX)
# What a file holds is not known before it is opened, which in an object store takes a copy.
_VIDEO_SUFFIXES = (
    ".3gp", ".avi", ".flv", ".m2ts", ".m4v", ".mjpeg", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg",
    ".mts", ".ogv", ".webm", ".wmv",
)  # fmt: skip


def sidecar_file(source: Path, ending: str) -> Path:
    """Where a file of a recording stands: `drive.target.yaml` beside `drive.mcap`."""
    place = resolved(source)
    name = place.name if is_folder(place) else place.stem
    return place.with_name(f"{name}{ending}")


def has_video_suffix(path: Path) -> bool:
    """Whether the ending of a file's name is that of videos."""
    return path.suffix.lower() in _VIDEO_SUFFIXES


def has_unique_stem(path: Path) -> bool:
    """Whether nothing else in its folder would have the same files beside it.

    Raises:
        FootageError: The folder cannot be listed.
    """
    beside = [each for each in entries(path.parent) if target_file(each) == target_file(path)]
    return [each for each in beside if not each.name.endswith(SIDECAR_SUFFIXES)] == [path]


def target_file(source: Path) -> Path:
    """Where the target of a recording stands: `drive.target.yaml` beside `drive.mcap`."""
    return sidecar_file(source, TARGET_SUFFIX)


def detections_file(source: Path) -> Path:
    """Where the detections in a recording stand: `drive.detections.csv` beside `drive.mcap`."""
    return sidecar_file(source, DETECTIONS_SUFFIX)
