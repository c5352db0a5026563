"""Sequence folders: frames and a ground-truth box for each.

A sequence folder has `groundtruth.txt`, one line `x,y,width,height` a frame in pixels, (x, y) the
top-left corner counted from 0; and the frames, either as images in `img/` or, where `meta.json`
has `video`, as a stretch of that file (path relative to the folder) from frame `first_frame`,
counted from 0.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.footage.base import DEFAULT_FRAME_RATE, Footage, FootageError, Frame
from pf_tracker_ros.footage.images import ImageFolderFootage
from pf_tracker_ros.footage.videos import VideoFootage

GROUND_TRUTH_FILE = "groundtruth.txt"
META_FILE = "meta.json"
IMAGE_FOLDER = "img"


def parse_box(line: str) -> tuple[float, float, float, float]:
    """Parse one line of a ground-truth file.

    Args:
        line: Four numbers separated by commas, semicolons or white space.

    Returns:
        (x, y, width, height) in pixels.

    Raises:
        FootageError: There are not exactly four finite numbers with a positive width and height.
    """
    try:
        values = [float(part) for part in re.split(r"\s*[,;]\s*|\s+", line.strip())]
    except ValueError:
        values = []
    if len(values) != 4 or not np.isfinite(values).all() or min(values[2:]) <= 0:
        raise FootageError(
            f"{line.strip()!r} is not a box; expected x,y,width,height in pixels, four finite "
            "numbers, width and height above 0"
        )
    return values[0], values[1], values[2], values[3]


def read_ground_truth(path: Path) -> NDArray[np.float64]:
    """Read a ground-truth file.

    Returns:
        (frames, 4) boxes x, y, width, height in pixels.

    Raises:
        FootageError: The file is missing, empty or has a line that is not a box.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").rstrip().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise FootageError(
            f"ground truth {path} cannot be read ({error}); expected a text file with one line "
            "x,y,width,height a frame"
        ) from error
    if not lines:
        raise FootageError(f"ground truth {path} is empty; expected one box a frame")
    boxes = []
    for number, line in enumerate(lines, start=1):
        try:
            boxes.append(parse_box(line))
        except FootageError as error:
            raise FootageError(f"{path}, line {number}: {error}") from error
    return np.array(boxes, dtype=np.float64)


class SequenceFootage:
    """Frames with a ground-truth box for each."""

    def __init__(self, frames: Footage, name: str, ground_truth: NDArray[np.float64]) -> None:
        """Join frames and boxes.

        Args:
            frames: Where the pictures come from, as many as there are boxes.
            name: Name of the sequence.
            ground_truth: (frames, 4) boxes.
        """
        self._frames = frames
        self.name = name
        self.frame_count: int | None = len(ground_truth)
        self.nominal_interval = frames.nominal_interval
        self.ground_truth: NDArray[np.float64] | None = ground_truth

    def frames(self) -> Iterator[Frame]:
        """Read the frames in order; see `Footage.frames`."""
        return self._frames.frames()


def read_sequence(path: str | Path, *, frame_rate: float = DEFAULT_FRAME_RATE) -> SequenceFootage:
    """Open a sequence folder.

    Args:
        path: The folder.
        frame_rate: Frames a second, used where the source does not tell.

    Returns:
        The footage, with ground truth.

    Raises:
        FootageError: A part is missing or unreadable, or there are not as many boxes as frames.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise FootageError(
            f"{folder} is not a folder; a sequence is a folder with {GROUND_TRUTH_FILE} and the "
            f"frames in {IMAGE_FOLDER}/ or in the video that {META_FILE} names"
        )
    ground_truth = read_ground_truth(folder / GROUND_TRUTH_FILE)
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
        raise FootageError(
            f"sequence {folder} has {frames.frame_count} frames but {len(ground_truth)} boxes in "
            f"{GROUND_TRUTH_FILE}; expected one box a frame"
        )
    return SequenceFootage(frames, str(meta.get("name", folder.resolve().name)), ground_truth)


def _read_meta(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {}
    try:
        meta = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FootageError(f"{path} cannot be read as JSON: {error}") from error
    if not isinstance(meta, dict):
        raise FootageError(f"{path} holds {type(meta).__name__}; expected a JSON object")
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
    if not video.is_file():
        raise FootageError(f"{folder / META_FILE}: there is no video {video}")
    return VideoFootage(
        video, first_frame=first_frame, frame_count=frame_count, frame_rate=frame_rate
    )
