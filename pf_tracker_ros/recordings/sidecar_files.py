"""Sidecar files, which stand beside a recording under its name: its targets and its detections."""

from __future__ import annotations

from pathlib import Path

from pf_tracker_ros.footage.access import entries, is_folder, resolved

TARGET_SUFFIX = ".target.yaml"
DETECTIONS_SUFFIX = ".detections.csv"
SIDECAR_SUFFIXES = (TARGET_SUFFIX, DETECTIONS_SUFFIX)
# By name: to inspect the content of a file in an object store, it would have to be downloaded.
_VIDEO_SUFFIXES = (
    ".3gp", ".avi", ".flv", ".m2ts", ".m4v", ".mjpeg", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg",
    ".mts", ".ogv", ".webm", ".wmv",
)  # fmt: skip


def sidecar_file(source: Path, suffix: str) -> Path:
    """Path of a sidecar file of a recording: `drive.target.yaml` beside `drive.mcap`."""
    path = resolved(source)
    name = path.name if is_folder(path) else path.stem
    return path.with_name(f"{name}{suffix}")


def has_video_suffix(path: Path) -> bool:
    """Whether a file has the name of a video."""
    return path.suffix.lower() in _VIDEO_SUFFIXES


def has_unique_stem(path: Path) -> bool:
    """Whether no other entry of its folder has the same sidecar files.

    Raises:
        FootageError: The folder cannot be listed.
    """
    same_stem = [each for each in entries(path.parent) if target_file(each) == target_file(path)]
    return [each for each in same_stem if not each.name.endswith(SIDECAR_SUFFIXES)] == [path]


def target_file(source: Path) -> Path:
    """Path of the target file of a recording: `drive.target.yaml` beside `drive.mcap`."""
    return sidecar_file(source, TARGET_SUFFIX)


def detections_file(source: Path) -> Path:
    """Path of the detections of a recording: `drive.detections.csv` beside `drive.mcap`."""
    return sidecar_file(source, DETECTIONS_SUFFIX)
