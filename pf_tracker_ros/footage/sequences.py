"""Sequence folders: frames and a ground-truth box for each.

- Ground truth: `groundtruth.txt` or `groundtruth_rect.txt` has a line `x,y,width,height` for each
  frame in pixels, (x, y) the top-left corner counted from 0; four `nan` for an absent target.
- Frames: images in `img/`, or the video that `video` in `meta.json` names (path relative to the
  folder), from frame `first_frame`, counted from 0.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.footage.access import check_file, exists
from pf_tracker_ros.footage.base import DEFAULT_FRAME_RATE, Footage, FootageError
from pf_tracker_ros.footage.ground_truth import (
    GROUND_TRUTH_FILE,
    ground_truth_file,
    read_ground_truth,
)
from pf_tracker_ros.footage.images import ImageFolderFootage
from pf_tracker_ros.footage.videos import VideoFootage
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.plurals import counted

META_FILE = "meta.json"
IMAGE_FOLDER = "img"


class SequenceFootage:
    """Frames with a ground-truth box for each.

    Args:
        frames: The images.
        name: Name of the sequence.
        ground_truth: (frames, 4) boxes; a row of NaN where the target is absent.
        span: Numbers of the first image with a box and of the one after the last; None for the end.
    """

    def __init__(
        self,
        frames: Footage,
        name: str,
        ground_truth: NDArray[np.float64],
        span: tuple[int, int | None] = (0, None),
    ) -> None:
        self._frames = frames
        self._span = span
        self.name = name
        self.frame_count: int | None = len(ground_truth)
        self.nominal_interval = frames.nominal_interval
        self.ground_truth: NDArray[np.float64] | None = ground_truth

    def frames(self) -> Iterator[Frame]:
        """Read the frames in order; see `Footage.frames`."""
        return islice(self._frames.frames(), *self._span)


def read_sequence(path: str | Path, *, frame_rate: float = DEFAULT_FRAME_RATE) -> SequenceFootage:
    """Open a sequence folder.

    Args:
        path: The folder.
        frame_rate: Frames per second of a source without a rate of its own (images).

    Returns:
        The footage, with ground truth.

    Raises:
        FootageError: A part is missing or unreadable, or the numbers of boxes and frames differ.
    """
    folder = Path(path)
    if not (exists(folder) and folder.is_dir()):
        raise FootageError(
            f"{folder} is not a folder; a sequence is a folder with {GROUND_TRUTH_FILE} and frames "
            f"in {IMAGE_FOLDER}/ or in the video of {META_FILE}"
        )
    boxes_file = ground_truth_file(folder) or folder / GROUND_TRUTH_FILE
    ground_truth = read_ground_truth(boxes_file)
    meta = _read_meta(folder / META_FILE)
    frames: Footage
    if "video" in meta:
        frames = _open_video(folder, meta, len(ground_truth), frame_rate)
    elif (folder / IMAGE_FOLDER).is_dir():
        frames = ImageFolderFootage(folder / IMAGE_FOLDER, frame_rate=frame_rate)
    else:
        raise FootageError(
            f"sequence {folder} has no frames; expected a folder {IMAGE_FOLDER}/, or 'video' in "
            f"{META_FILE}"
        )
    if frames.frame_count != len(ground_truth):
        boxes = counted(len(ground_truth), "box", "boxes")
        raise FootageError(
            f"sequence {folder} has {counted(frames.frame_count or 0, 'frame')} but {boxes} in "
            f"{boxes_file.name}; expected a box for each frame"
        )
    return SequenceFootage(frames, str(meta.get("name", folder.resolve().name)), ground_truth)


def _read_meta(path: Path) -> dict[str, Any]:
    if not exists(path):
        return {}
    check_file(path, "meta data")
    try:
        meta = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise FootageError(f"{path} cannot be read as JSON: {error}") from error
    if not isinstance(meta, dict):
        raise FootageError(f"{path} contains {type(meta).__name__}; expected a JSON object")
    return meta


def _open_video(
    folder: Path, meta: dict[str, Any], frame_count: int, frame_rate: float
) -> VideoFootage:
    first_frame = meta.get("first_frame", 0)
    if not isinstance(meta["video"], str):
        raise FootageError(f"{folder / META_FILE}: 'video' is {meta['video']!r}; expected a path")
    if isinstance(first_frame, bool) or not isinstance(first_frame, int) or first_frame < 0:
        raise FootageError(
            f"{folder / META_FILE}: 'first_frame' is {first_frame!r}; expected a whole number "
            "from 0"
        )
    video = folder / meta["video"]
    if not exists(video):
        raise FootageError(f"{folder / META_FILE}: there is no video {video}")
    return VideoFootage(
        video, first_frame=first_frame, frame_count=frame_count, frame_rate=frame_rate
    )
