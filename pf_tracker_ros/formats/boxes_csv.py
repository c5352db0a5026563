"""`boxes.csv` of `track`, read by its headings.

Required columns are frame (from 0), id, x, y, width and height. An empty box means that the target
is absent. A row without a target, of state `idle` or `skipped`, says nothing about it.
"""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

from pf_tracker_ros.formats.tracks import (
    BoxTrack,
    FormatError,
    LabeledBox,
    TracksBuilder,
    as_number,
    as_whole,
    four_numbers,
    read_text,
)

_REQUIRED = ("frame", "id", "x", "y", "width", "height")
_NO_TARGET = ("idle", "skipped")


def has_boxes_csv_heading(line: str) -> bool:
    """Whether the first line of a file has these columns."""
    return {*_REQUIRED} <= {cell.strip() for cell in line.split(",")}


def read_boxes_csv(path: Path) -> tuple[BoxTrack, ...]:
    """Read a file; raises FormatError."""
    tracks = TracksBuilder(path)
    rows = csv.DictReader(io.StringIO(read_text(path)), restval="", strict=True)
    try:
        for row in rows:
            if row.get("state") in _NO_TARGET or not row["id"]:
                continue
            if None in row:
                raise ValueError("it has more columns than the heading")
            cells = [row[name] for name in _REQUIRED[2:]]
            confidence = row.get("confidence")
            labeled = LabeledBox(
                four_numbers(cells, _REQUIRED[2:]) if any(cells) else None,
                occluded=row.get("state") == "occluded",
                confidence=as_number(confidence, "the confidence") if confidence else math.nan,
            )
            frame = as_whole(row["frame"], "the frame")
            tracks.add(as_whole(row["id"], "the id"), frame, labeled, row.get("label") or "")
    except (ValueError, csv.Error) as error:
        raise FormatError(f"{path}, line {rows.line_num}: {error}") from error
    return tracks.tracks()
