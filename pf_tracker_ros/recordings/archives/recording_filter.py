"""Which recordings of an archive detections are looked for in: these need no target."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pf_tracker_ros.footage import is_bag
from pf_tracker_ros.footage.access import entries, exists, lexists
from pf_tracker_ros.footage.images import IMAGE_SUFFIXES
from pf_tracker_ros.recordings.files import BAG, BOXES, VIDEO
from pf_tracker_ros.recordings.sidecar_files import (
    DETECTIONS_SUFFIX,
    detections_file,
    has_unique_stem,
    has_video_suffix,
)


@dataclass(frozen=True)
class RecordingFilter:
    """Which recordings of an archive detections are looked for in.

    Attributes:
        description: What they are, for messages.
        matches: Whether something is one, by its name and those beside it.
        accepts_image_folders: Whether a folder of images is one too.
        accepts_targeted: Whether there may be any in each recording with a target too; else those
            that are none themselves are left out.
    """

    description: str
    matches: Callable[[Path], bool]
    accepts_image_folders: bool
    accepts_targeted: bool = True

    def is_image_folder(self, folder: Path) -> bool:
        """Whether a folder in which no recording is found is one itself.

        Raises:
            FootageError: It cannot be listed.
        """
        return self.accepts_image_folders and any(
            path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")
            for path in entries(folder)
        )


def filter_from_options(options: argparse.Namespace) -> RecordingFilter | None:
    """Those for the options of `track`; None where nothing is detected."""
    if options.detections_topic:
        return RecordingFilter("bags", _is_bag, accepts_image_folders=False, accepts_targeted=False)
    if options.detector:
        return any_footage()
    if options.detections:
        beside = f"drive{DETECTIONS_SUFFIX} for drive.mcap"
        return RecordingFilter(
            f"bags, videos and folders of images, with detections beside them, such as {beside}",
            _is_footage_or_detected,
            accepts_image_folders=True,
        )
    return None


def any_footage() -> RecordingFilter:
    """Every bag, video and folder of images."""
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
    """Whether this is what `track` itself has written there under a name."""
    return path.name == name and exists(path.with_name(BOXES))
