"""Detections from a text file in the format of the MOT challenge.

Each line is a detection:

    frame, id, x, y, width, height, score[, label or numbers ...]

Frames count from 1. x and y are in pixels, counted from 1. The score is 0 to 1. The id is ignored.
The column after the score is the label, unless it is a number. A line with only a frame number
means that the detector processed the frame and found nothing. A frame without a line was not
processed. See https://motchallenge.net/instructions/.
"""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.access import check_file
from pf_tracker_ros.recordings.detections.source import DetectionSource, DetectorOutput
from pf_tracker_ros.recordings.errors import WRONG_DETECTIONS, RecordingError
from pf_tracker_ros.recordings.recording import RecordedFrame
from pf_tracker_ros.targets.detections import Detections

_FORMAT = "lines frame,id,x,y,width,height,score without a heading"
_MIN_COLUMNS = 7


class DetectionFile(DetectionSource):
    """Detections of a file, each output together with its frame; see `DetectionSource`.

    Args:
        path: Of the file, which is read at once.

    Raises:
        RecordingError: It cannot be read, or has another format.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._detections: dict[int, list[_Detection]] = defaultdict(list)
        for number, cells in _cells(path):
            try:
                self._add_line(cells)
            except ValueError as error:
                raise RecordingError(f"{path}, line {number}: {error}", WRONG_DETECTIONS) from error
        if not self._detections:
            raise RecordingError(f"{path} is empty; allowed: {_FORMAT}", WRONG_DETECTIONS)

    def detections_before(self, frame: RecordedFrame) -> Iterator[DetectorOutput]:  # noqa: D102
        detections = self._detections.get(frame.index + 1)
        if detections is not None:
            columns = zip(*detections, strict=True) if detections else ((), (), ())
            yield DetectorOutput(Detections(*columns), frame.stamp)

    def finish(self, frame_count: int) -> None:  # noqa: D102
        last = max(self._detections)
        if last > frame_count:
            raise RecordingError(
                f"{self._path} has detections in frame {last}, but the recording has "
                f"{frame_count} frames: they belong to another recording",
                WRONG_DETECTIONS,
            )

    def _add_line(self, cells: Sequence[str]) -> None:
        """Add a line.

        Raises:
            ValueError: It has another format.
        """
        frame = _number(cells[0], "the frame")
        if frame < 1 or frame != math.floor(frame):
            raise ValueError(f"the frame is {cells[0]}; allowed: whole numbers from 1")
        detections = self._detections[int(frame)]
        if len(cells) == 1:
            return
        if len(cells) < _MIN_COLUMNS:
            raise ValueError(f"it has {len(cells)} columns; allowed: {_FORMAT}")
        names = ("x", "y", "the width", "the height", "the score")
        x, y, width, height, score = map(_number, cells[2:_MIN_COLUMNS], names)
        if min(width, height) <= 0:
            raise ValueError(f"the box is {width:g} x {height:g} px; allowed: above 0")
        if not 0.0 <= score <= 1.0:
            raise ValueError(f"the score is {score:g}; allowed: 0 to 1")
        box = (x - 1.0, y - 1.0, width, height)
        detections.append(_Detection(box, score, _label(cells)))


class _Detection(NamedTuple):
    box: tuple[float, float, float, float]
    score: float
    label: str


def _cells(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of each nonempty line, counted from 1, and its cells."""
    try:
        check_file(path, "detection file")
        with path.open(newline="", encoding="utf-8-sig") as file:
            # Strict: otherwise an unclosed quotation mark would swallow all lines below it.
            for cells in (reader := csv.reader(file, skipinitialspace=True, strict=True)):
                if any(cell.strip() for cell in cells):
                    yield reader.line_num, [cell.strip() for cell in cells]
    except FootageError as error:
        raise RecordingError(str(error), WRONG_DETECTIONS) from error
    except (OSError, ValueError, csv.Error) as error:
        raise RecordingError(
            f"detection file {path} cannot be read ({error}); allowed: {_FORMAT}",
            WRONG_DETECTIONS,
        ) from error


def _number(text: str, name: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{name} is {text!r}; allowed: {_FORMAT}") from None
    if not math.isfinite(value):
        raise ValueError(f"{name} is {text}; allowed: finite numbers")
    return value


def _label(cells: Sequence[str]) -> str:
    label, *others = cells[_MIN_COLUMNS:] or [""]
    if not label or _is_number(label):
        return ""
    if any(other and not _is_number(other) for other in others):
        parts = ", ".join([label, *others])
        raise ValueError(f'the label is {parts}; allowed: "{parts}", in quotes for the comma')
    return label


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
