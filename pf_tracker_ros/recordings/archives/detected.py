"""Which recordings of an archive detections are looked for in: these need no target."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pf_tracker_ros.footage import is_bag
from pf_tracker_ros.footage.access import entries, exists, is_there
from pf_tracker_ros.footage.images import IMAGE_SUFFIXES
from pf_tracker_ros.recordings.beside import (
    DETECTIONS_ENDING,
    detections_file,
    is_only_one,
    is_video_by_name,
)
from pf_tracker_ros.recordings.files import BAG, BOXES, VIDEO


@dataclass(frozen=True)
class DetectedRecordings:
    """Which recordings of an archive detections are looked for in.

    Attributes:
        named: What they are, for messages.
        includes: Whether something is one, by its name and those beside it.
        with_images: Whether a folder of images is one too.
        with_targeted: Whether there may be any in each recording with a target too; else those
            that are none themselves are left out.
    """

    named: str
    includes: Callable[[Path], bool]
    with_images: bool
    with_targeted: bool = True

    def is_images(self, folder: Path) -> bool:
        """Whether a folder in which no recording is found is one itself.

        Raises:
            FootageError: It cannot be listed.
        """
        return self.with_images and any(
            path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".")
            for path in entries(folder)
        )


def detected_recordings(options: argparse.Namespace) -> DetectedRecordings | None:
    """Those for the options of `track`; None where nothing is detected."""
    if options.detections_topic:
        return DetectedRecordings("bags", _is_bag, with_images=False, with_targeted=False)
    if options.detector:
        return any_footage()
    if options.detections:
        beside = f"drive{DETECTIONS_ENDING} for drive.mcap"
        return DetectedRecordings(
            f"bags, videos and folders of images, with detections beside them, such as {beside}",
            _is_footage_or_detected,
            with_images=True,
        )
    return None


def any_footage() -> DetectedRecordings:
    """Every bag, video and folder of images."""
    return DetectedRecordings("bags, videos and folders of images", _is_footage, with_images=True)


def _is_bag(path: Path) -> bool:
    return is_bag(path) and not _is_output(path, BAG)


def _is_footage(path: Path) -> bool:
    if is_video_by_name(path):
        return not path.is_dir() and not _is_output(path, VIDEO)
    return _is_bag(path)


def _is_footage_or_detected(path: Path) -> bool:
    return _is_footage(path) or (
        path.is_file() and is_there(detections_file(path)) and is_only_one(path)
    )


def _is_output(path: Path, name: str) -> bool:
    """Whether this is what `track` itself has written there under a name."""
    return path.name == name and exists(path.with_name(BOXES))
