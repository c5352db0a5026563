"""Ground-truth files: one line `x,y,width,height` for each frame, also for an absent target."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.footage.access import check_file, exists
from pf_tracker_ros.footage.base import FootageError

GROUND_TRUTH_FILE = "groundtruth.txt"
# The second name is used by the OTB sequences.
GROUND_TRUTH_FILES = (GROUND_TRUTH_FILE, "groundtruth_rect.txt")

_ABSENT = (np.nan, np.nan, np.nan, np.nan)


def ground_truth_file(folder: Path) -> Path | None:
    """The first of `GROUND_TRUTH_FILES` that exists in a folder, of any kind; None without one.

    Raises:
        FootageError: The folder is not accessible.
    """
    return next((folder / name for name in GROUND_TRUTH_FILES if exists(folder / name)), None)


def true_box(boxes: NDArray[np.float64] | None, index: int) -> Box | None:
    """The box of a frame; None where the target is absent, or without ground truth.

    Args:
        boxes: (frames, 4), as from `read_ground_truth`; None without ground truth.
        index: Of the frame, counted from 0.
    """
    is_known = boxes is not None and np.isfinite(boxes[index]).all()
    return as_box(boxes[index]) if boxes is not None and is_known else None


def parse_box(line: str) -> tuple[float, float, float, float]:
    """Parse one line of a ground-truth file.

    Args:
        line: Four numbers separated by commas, semicolons or white space.

    Returns:
        (x, y, width, height) in pixels; four NaN for an absent target, whose line has a `nan` or a
        width or height of 0.

    Raises:
        FootageError: Not exactly four numbers, an infinite one, or a negative width or height.
    """
    try:
        values = [float(part) for part in re.split(r"\s*[,;]\s*|\s+", line.strip())]
    except ValueError:
        values = []
    if len(values) == 4 and np.isnan(values).any():
        return _ABSENT
    if len(values) != 4 or not np.isfinite(values).all() or min(values[2:]) < 0:
        raise FootageError(
            f"{line.strip()!r} is not a box; expected x,y,width,height in pixels with width and "
            "height above 0, or four nan for an absent target"
        )
    return (values[0], values[1], values[2], values[3]) if min(values[2:]) > 0 else _ABSENT


def read_ground_truth(path: Path) -> NDArray[np.float64]:
    """Read a ground-truth file.

    Returns:
        (frames, 4) boxes x, y, width, height in pixels; a row of NaN where the target is absent.

    Raises:
        FootageError: The file is missing, empty or has a line that is not a box.
    """
    check_file(path, "ground truth")
    try:
        lines = path.read_text(encoding="utf-8-sig").rstrip().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise FootageError(
            f"ground truth {path} cannot be read ({error}); expected a text file with a line "
            "x,y,width,height for each frame"
        ) from error
    if not lines:
        raise FootageError(f"ground truth {path} is empty; expected a box for each frame")
    boxes = []
    for number, line in enumerate(lines, start=1):
        try:
            boxes.append(parse_box(line))
        except FootageError as error:
            raise FootageError(f"{path}, line {number}: {error}") from error
    return np.array(boxes, dtype=np.float64)
