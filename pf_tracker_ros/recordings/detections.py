"""Detections for the frames of a recording: from a file, a bag or a built-in detector.

A detection source tells what a detector has reported between two frames.
"""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from pf_tracker_ros.background import UPDATE_EVERY
from pf_tracker_ros.footage import FootageError, is_bag
from pf_tracker_ros.footage.access import check_file
from pf_tracker_ros.footage.bags import read_topic, topics_of_type
from pf_tracker_ros.footage.cdr import deserialize_detections
from pf_tracker_ros.foreign_code import ForeignError
from pf_tracker_ros.messages import DETECTIONS_TYPE
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.recordings.errors import REFUSED, WRONG_DETECTIONS, RecordingError
from pf_tracker_ros.recordings.recording import RecordedFrame
from pf_tracker_ros.targets.built_in_detectors import DETECTORS, DetectorThread
from pf_tracker_ros.targets.detections import (
    Detections,
    check_message_size,
    detections_from_message,
)
from pf_tracker_ros.targets.session import DROPPED_ARRIVALS, Outcome


class DetectorOutput(NamedTuple):
    """One output of a detector, as the node would receive it.

    Attributes:
        detections: Of one frame; None on an error.
        stamp: Of this frame, nanoseconds; 0 means the next frame.
        error: Why there are no detections, or empty.
    """

    detections: Detections | None
    stamp: int = 0
    error: str = ""


class DetectionSource:
    """Source of detections for one pass through a recording; the base class has none."""

    @property
    def warning(self) -> str:
        """Warning at the end of the recording, or empty."""
        return ""

    def detections_before(self, frame: RecordedFrame) -> Iterator[DetectorOutput]:
        """Yield the outputs since the previous frame.

        Raises:
            FootageError: The recording can be read only in part.
        """
        return iter(())

    def on_frame(self, frame: RecordedFrame, outcome: Outcome) -> None:
        """Receive a tracked frame."""

    def finish(self, frame_count: int) -> None:
        """Check the detections after the last frame. Later detections are dropped.

        Raises:
            RecordingError: The detections belong to another recording.
        """

    def close(self) -> None:
        """Release its resources."""


_FORMAT = "lines frame,id,x,y,width,height,score without a heading"
_MIN_COLUMNS = 7


class DetectionFile(DetectionSource):
    """Detections from a text file in the format of the MOT challenge; see `DetectionSource`.

    Each line is a detection:

        frame, id, x, y, width, height, score[, label or numbers ...]

    Frames count from 1. x and y are in pixels, counted from 1. The score is 0 to 1. The id is
    ignored. The column after the score is the label, unless it is a number. A line with only a
    frame number means that the detector processed the frame and found nothing. A frame without a
    line was not processed. See https://motchallenge.net/instructions/. Each output comes together
    with its frame.

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


class DetectionTopic(DetectionSource):
    """Detections of a topic, in the recorded order of messages and images; see `DetectionSource`.

    Args:
        path: Of the bag.
        topic: Of type vision_msgs/Detection2DArray.

    Raises:
        RecordingError: There is no such topic, or the recording is not a bag.
        FootageError: The bag cannot be read.
    """

    def __init__(self, path: Path, topic: str) -> None:
        if not is_bag(path):
            raise RecordingError(
                f"--detections-topic applies to bags, and {path} is not a bag; allowed here: "
                "--detections or --detector NAME",
                REFUSED,
            )
        topics = topics_of_type(path, DETECTIONS_TYPE)
        if topic not in topics:
            raise RecordingError(
                f"bag {path} has no topic {topic} of type {DETECTIONS_TYPE}; available: "
                f"{', '.join(topics) or 'none'}",
                WRONG_DETECTIONS,
            )
        self._name = f"bag {path}, topic {topic}"
        self._messages = read_topic(path, topic)
        self._next = next(self._messages, None)
        self._count = 0

    def detections_before(self, frame: RecordedFrame) -> Iterator[DetectorOutput]:  # noqa: D102
        while self._next is not None and self._next[0] <= frame.log_time:
            yield self._convert(self._next[1])
            self._count += 1
            self._next = next(self._messages, None)

    def close(self) -> None:  # noqa: D102
        self._messages.close()

    def _convert(self, octets: bytes) -> DetectorOutput:
        try:
            check_message_size(octets)
        except ValueError as error:
            return DetectorOutput(None, error=f"detections refused: {error}")
        try:
            message = deserialize_detections(octets)
        except FootageError as error:
            raise FootageError(f"{self._name}, message {self._count}: {error}") from error
        return DetectorOutput(detections_from_message(message), message.stamp)


_FINDS = {
    "people": "people at least 100 px high",
    "motion": (
        "moving objects in front of a static camera, after it has learned the background from its "
        f"first {UPDATE_EVERY} frames"
    ),
}


class BuiltInDetector(DetectionSource):
    """Runs a detector on the same frames as the node; see `DetectionSource`.

    The detections of a frame arrive before the next frame, so they do not depend on the clock.

    Args:
        name: A key of `DETECTORS`.
        rate: Largest number of processed frames per second of the recording.

    Raises:
        RecordingError: The detector is not available.
    """

    def __init__(self, name: str, rate: float) -> None:
        self._name = name
        self._frame_count = self._last_frame = self._detection_count = 0
        try:
            detector = DETECTORS.make(name, DETECTORS.parameters_of(name)())
            self._thread = DetectorThread(detector, rate)
        except ValueError as error:
            raise RecordingError(str(error)) from error

    @property
    def warning(self) -> str:
        """That there were no detections, or empty."""
        if self._detection_count:
            return ""
        finds = f"; it finds {_FINDS[self._name]}" if self._name in _FINDS else ""
        return (
            f"the detector '{self._name}' found nothing in {counted(self._frame_count, 'frame')}"
            f"{finds}; raise --detector-rate to process more frames"
        )

    def detections_before(self, frame: RecordedFrame) -> Iterator[DetectorOutput]:  # noqa: D102
        try:
            result = self._thread.take(wait=True)
        except ForeignError as error:
            # On an earlier frame than this one.
            yield DetectorOutput(
                None,
                error=f"the detector '{self._name}' failed in frame {self._last_frame}: {error}",
            )
        else:
            if result is not None:
                self._detection_count += len(result.detections)
                yield DetectorOutput(result.detections, result.stamp)

    def on_frame(self, frame: RecordedFrame, outcome: Outcome) -> None:  # noqa: D102
        if frame.image is None or outcome.frame in DROPPED_ARRIVALS:
            return
        if self._thread.offer(frame.image, frame.stamp):
            self._frame_count, self._last_frame = self._frame_count + 1, frame.index

    def close(self) -> None:  # noqa: D102
        self._thread.close()
