"""Text of the MOT challenge: a line for each box.

    frame, id, x, y, width, height, confidence, class, visibility

Frames count from 1, x and y are in pixels counted from 1. The class is a number from 1 on, the line
of its label in a labels file: `drive.labels.txt` beside `drive.txt`, or `labels.txt` in the same
folder, as CVAT writes it. -1 means unknown. A target is absent in frames without a line.
See https://motchallenge.net/instructions/.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from pf_tracker_ros.formats.tracks import (
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

_LINE = "frame,id,x,y,width,height[,confidence[,class[,visibility]]]"
_BOX = ("x", "y", "the width", "the height")


def read_mot(path: Path) -> tuple[BoxTrack, ...]:
    """Read a file; raises FormatError."""
    labels = _labels_beside(path)
    tracks = TracksBuilder(path)
    for number, line in numbered_lines(path):
        try:
            (cells,) = csv.reader([line], skipinitialspace=True, strict=True)
            if len(cells) < 6:
                raise ValueError(f"it has {len(cells)} columns; allowed: {_LINE}")
            frame = as_whole(cells[0], "the frame", least=1) - 1
            x, y, width, height = four_numbers(cells[2:6], _BOX)
            confidence, label, visibility = [*cells[6:9], "-1", "-1", "-1"][:3]
            labeled = LabeledBox(
                (x - 1.0, y - 1.0, width, height),
                occluded=0.0 <= as_number(visibility, "the visibility") < 0.5,
                confidence=_known(as_number(confidence, "the confidence")),
            )
            tracks.add(as_whole(cells[1], "the id"), frame, labeled, _label(label, labels))
        except (ValueError, csv.Error) as error:
            raise FormatError(f"{path}, line {number}: {error}") from error
    return tracks.tracks()


def write_mot(path: Path, tracks: Sequence[BoxTrack], info: RecordingInfo) -> None:
    """Write a file; the labels go into that of `write_mot_labels`."""
    labels = _labels(tracks)
    lines = []
    for frame, track, labeled, box in present_boxes(tracks):
        x, y, width, height = box
        confidence = -1 if math.isnan(labeled.confidence) else round(labeled.confidence, 4)
        number = labels.index(track.label) + 1 if track.label else -1
        numbers = ",".join(map(number_text, (x + 1.0, y + 1.0, width, height)))
        lines.append(
            f"{frame + 1},{track.id},{numbers},{confidence},{number},{0 if labeled.occluded else 1}"
        )
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def write_mot_labels(path: Path, tracks: Sequence[BoxTrack], info: RecordingInfo) -> None:
    """Write the label of each class number, one in a line."""
    path.write_text("".join(f"{label}\n" for label in _labels(tracks)), encoding="utf-8")


def _labels(tracks: Sequence[BoxTrack]) -> list[str]:
    return sorted({track.label for track in tracks if track.label})


def _labels_beside(path: Path) -> list[str]:
    for name in (f"{path.stem}.labels.txt", "labels.txt"):
        if path.with_name(name).is_file():
            return [line for _, line in numbered_lines(path.with_name(name))]
    return []


def _label(text: str, labels: Sequence[str]) -> str:
    """The label of a class number; a text is taken as the label itself, as in detection files."""
    try:
        number = float(text)
    except ValueError:
        return text.strip()
    if number < 1:
        return ""
    if not labels:
        return f"class {number_text(number)}"
    if not number.is_integer() or number > len(labels):
        raise ValueError(f"the class is {text}; allowed by the labels file: 1 to {len(labels)}")
    return labels[int(number) - 1]


def _known(value: float) -> float:
    return value if value >= 0.0 else math.nan
