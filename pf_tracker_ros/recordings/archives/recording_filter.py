"""The rules by which entries of a folder without a target are recordings, if a detector is used."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pf_tracker_ros.footage import is_bag
from pf_tracker_ros.footage.access import entries, exists, lexists
from pf_tracker_ros.footage.images import IMAGE_SUFFIXES
from pf_tracker_ros.recordings.output_files import BAG, BOXES, VIDEO
from pf_tracker_ros.recordings.sidecar_files import (
    DETECTIONS_SUFFIX,
    detections_file,
    has_unique_stem,
    has_video_suffix,
)


@dataclass(frozen=True)
class RecordingFilter:
    """Accepts entries of a folder as recordings without a target.

    Attributes:
        description: The accepted kinds, for messages.
        matches: Whether an entry is accepted.
        accepts_image_folders: Whether a folder of images is accepted too.
        accepts_targeted: Whether recordings with a target are accepted too, of any kind.
    """

    description: str
    matches: Callable[[Path], bool]
    accepts_image_folders: bool
    accepts_targeted: bool = True

    def is_image_folder(self, folder: Path) -> bool:
        """Whether a folder without recordings is accepted as a folder of images.

        Raises:
            FootageError: It cannot be listed.
        """
        return self.accepts_image_folders and any(
            path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")
            for path in entries(folder)
        )


def filter_from_options(options: argparse.Namespace) -> RecordingFilter | None:
    """The filter for the options of `track`; None without a detector."""
    if options.detections_topic:
        return RecordingFilter("bags", _is_bag, accepts_image_folders=False, accepts_targeted=False)
    if options.detector:
        return any_footage()
    if options.detections:
        example = f"drive{DETECTIONS_SUFFIX} for drive.mcap"
        return RecordingFilter(
            f"bags, videos and folders of images, from the file beside each, such as {example}",
            _is_footage_or_detected,
            accepts_image_folders=True,
        )
    return None


def any_footage() -> RecordingFilter:
    """A filter that accepts every bag, video and folder of images."""
    return RecordingFilter(
        "bags, videos and folders of images", _is_footage, accepts_image_folders=True
    )


def _is_bag(path: Path) -> bool:
    return is_bag(path) and not _is_output(path, BAG)


def _is_footage(path: Path) -> bool:
    if has_video_suffix(path):
        return not path.is_dir() and not _is_output(path, VIDEO)
    return _is_bag(path)


def _is_footage_or_detected(path: Path) -> bool:
    return _is_footage(path) or (
        path.is_file() and lexists(detections_file(path)) and has_unique_stem(path)
    )


def _is_output(path: Path, name: str) -> bool:
    """Whether `track` has written this file, by its name and the boxes.csv beside it."""
    return path.name == name and exists(path.with_name(BOXES))
