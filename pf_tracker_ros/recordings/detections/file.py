"""Detections from a text file, a line each as the MOT challenge has them.

    frame, id, x, y, width, height, score[, label or numbers ...]

Frames, x and y count from 1, in pixels; the score is 0 to 1. The id is not looked at. What follows
the score is the label if it is no number. A line of a frame's number alone says that the detector
saw the frame and found nothing; of frames without any line it says nothing.
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

_FORM = "lines frame,id,x,y,width,height,score without a heading"
_LEAST_COLUMNS = 7


class DetectionFile(DetectionSource):
    """Hears what a file says of each frame, as that comes; see `DetectionSource`.

    Args:
        path: The file, read at once.

    Raises:
        RecordingError: It cannot be read, or holds something else.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._found: dict[int, list[_Line]] = defaultdict(list)
        for number, cells in _cells(path):
            try:
                self._take(cells)
            except ValueError as error:
                raise RecordingError(f"{path}, line {number}: {error}", WRONG_DETECTIONS) from error
        if not self._found:
            raise RecordingError(f"{path} is empty; allowed: {_FORM}", WRONG_DETECTIONS)

    def before(self, frame: RecordedFrame) -> Iterator[DetectorOutput]:  # noqa: D102
        lines = self._found.get(frame.index + 1)
        if lines is not None:
            boxes, scores, labels = zip(*lines, strict=True) if lines else ((), (), ())
            yield DetectorOutput(Detections(boxes, scores, labels), frame.stamp)

    def finish(self, frame_count: int) -> None:  # noqa: D102
        last = max(self._found)
        if last > frame_count:
            raise RecordingError(
                f"{self._path} has detections of frame {last}, and the recording has "
                f"{frame_count}: they are of another recording, or do not count from 1",
                WRONG_DETECTIONS,
            )

    def _take(self, cells: Sequence[str]) -> None:
        """Take a line.

        Raises:
            ValueError: It is none.
        """
        frame = _number(cells[0], "the frame")
        if frame < 1 or frame != math.floor(frame):
            raise ValueError(f"the frame is {cells[0]}; allowed: whole numbers from 1")
        lines = self._found[int(frame)]
        if len(cells) == 1:
            return
        if len(cells) < _LEAST_COLUMNS:
            raise ValueError(f"it has {len(cells)} columns; allowed: {_FORM}")
        names = ("x", "y", "the width", "the height", "the score")
        x, y, width, height, score = map(_number, cells[2:_LEAST_COLUMNS], names)
        if min(width, height) <= 0:
            raise ValueError(f"the box is {width:g} x {height:g} px; allowed: above 0")
        if not 0.0 <= score <= 1.0:
            raise ValueError(f"the score is {score:g}; allowed: 0 to 1")
        lines.append(_Line((x - 1.0, y - 1.0, width, height), score, _label(cells)))


class _Line(NamedTuple):
    box: tuple[float, float, float, float]
    score: float
    label: str


def _cells(path: Path) -> Iterator[tuple[int, list[str]]]:
    """The number of each line that is not empty, from 1, and what stands in it."""
    try:
        check_file(path, "file of detections")
        with path.open(newline="", encoding="utf-8-sig") as file:
            # Strict, as a quotation mark that is not closed would swallow all lines below it.
            for cells in (reader := csv.reader(file, skipinitialspace=True, strict=True)):
                if any(cell.strip() for cell in cells):
                    yield reader.line_num, [cell.strip() for cell in cells]
    except FootageError as error:
        raise RecordingError(str(error), WRONG_DETECTIONS) from error
    except (OSError, ValueError, csv.Error) as error:
        raise RecordingError(
            f"file of detections {path} cannot be read ({error}); allowed: {_FORM}",
            WRONG_DETECTIONS,
        ) from error


def _number(text: str, name: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{name} is {text!r}; allowed: {_FORM}") from None
    if not math.isfinite(value):
        raise ValueError(f"{name} is {text}; allowed: finite numbers")
    return value


def _label(cells: Sequence[str]) -> str:
    label, *others = cells[_LEAST_COLUMNS:] or [""]
    if not label or _is_number(label):
        return ""
    if any(other and not _is_number(other) for other in others):
        parts = ", ".join([label, *others])
        raise ValueError(f'the label is {parts}; allowed: "{parts}", as it has a comma')
    return label


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
