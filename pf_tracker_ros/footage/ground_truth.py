"""Ground-truth files: one line `x,y,width,height` a frame, absent targets included."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.footage.access import check_file, exists
from pf_tracker_ros.footage.base import FootageError

GROUND_TRUTH_FILE = "groundtruth.txt"
# The second name is that of the OTB sequences.
GROUND_TRUTH_FILES = (GROUND_TRUTH_FILE, "groundtruth_rect.txt")

_ABSENT = (np.nan, np.nan, np.nan, np.nan)


def ground_truth_file(folder: Path) -> Path | None:
    """The ground truth of a sequence folder: the first of `GROUND_TRUTH_FILES` that is there.

    Returns:
        Its path, whatever kind of file it is; None without one.

    Raises:
        FootageError: This user may not look into the folder.
    """
    return next((folder / name for name in GROUND_TRUTH_FILES if exists(folder / name)), None)


def parse_box(line: str) -> tuple[float, float, float, float]:
    """Parse one line of a ground-truth file.

    Args:
        line: Four numbers separated by commas, semicolons or white space.

    Returns:
        (x, y, width, height) in pixels; four NaN where the target is absent, which is written as
        a `nan` among the numbers or as a width or height of 0.

    Raises:
        FootageError: There are not exactly four numbers, one is infinite, or the width or height
            is negative.
    """
    try:
        values = [float(part) for part in re.split(r"\s*[,;]\s*|\s+", line.strip())]
    except ValueError:
        values = []
    if len(values) == 4 and np.isnan(values).any():
        return _ABSENT
    if len(values) != 4 or not np.isfinite(values).all() or min(values[2:]) < 0:
        raise FootageError(
            f"{line.strip()!r} is not a box; expected x,y,width,height in pixels, four finite "
            "numbers, width and height above 0, or nan for all where the target is absent"
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
