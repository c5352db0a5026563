"""KITTI tracking: a line for each box, with columns separated by spaces.

    frame id type truncated occluded alpha left top right bottom
    height width length x y z rotation_y [score]

Frames count from 0, corners are in pixels counted from 0. `occluded` is 0 (visible) to 2 (largely
occluded), 3 if unknown. The columns from `alpha` on that describe the object in space are written
as unknown: -10, -1 and -1000. Lines of type DontCare, regions without labels, are ignored. A type
has no spaces: those in labels are written as underscores. A target is absent in frames without a
line. See the development kit of https://www.cvlibs.net/datasets/kitti/eval_tracking.php.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from pf_tracker_ros.formats.tracks import (
    UNLABELED,
    BoxTrack,
    FormatError,
    LabeledBox,
    RecordingInfo,
    TracksBuilder,
    as_number,
    as_whole,
    four_numbers,
    number_text,
    numbered_lines,
    present_boxes,
)

KITTI_COLUMNS = 17
_CORNERS = ("left", "top", "right", "bottom")
_UNKNOWN_IN_SPACE = "-1 -1 -1 -1000 -1000 -1000 -10"


def read_kitti(path: Path) -> tuple[BoxTrack, ...]:
    """Read a file; raises FormatError."""
    tracks = TracksBuilder(path)
    for number, line in numbered_lines(path):
        cells = line.split()
        try:
            if not KITTI_COLUMNS <= len(cells) <= KITTI_COLUMNS + 1:
                raise ValueError(
                    f"it has {len(cells)} columns; allowed in KITTI tracking: {KITTI_COLUMNS}, or "
                    f"{KITTI_COLUMNS + 1} with a score"
                )
            frame = as_whole(cells[0], "the frame")
            if cells[2] == "DontCare":
                continue
            left, top, right, bottom = four_numbers(cells[6:10], _CORNERS)
            has_score = len(cells) > KITTI_COLUMNS
            labeled = LabeledBox(
                (left, top, right - left, bottom - top),
                occluded=as_whole(cells[4], "occluded", least=-1) in (1, 2),
                confidence=as_number(cells[-1], "the score") if has_score else math.nan,
            )
            tracks.add(as_whole(cells[1], "the id"), frame, labeled, cells[2])
        except ValueError as error:
            raise FormatError(f"{path}, line {number}: {error}") from error
    return tracks.tracks()


def write_kitti(path: Path, tracks: Sequence[BoxTrack], info: RecordingInfo) -> None:
    """Write a file."""
    lines = []
    for frame, track, labeled, (x, y, width, height) in present_boxes(tracks):
        label = "_".join(track.label.split()) or UNLABELED
        corners = " ".join(map(number_text, (x, y, x + width, y + height)))
        score = "" if math.isnan(labeled.confidence) else f" {round(labeled.confidence, 4)}"
        lines.append(
            f"{frame} {track.id} {label} -1 {int(labeled.occluded)} -10 {corners} "
            f"{_UNKNOWN_IN_SPACE}{score}"
        )
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
