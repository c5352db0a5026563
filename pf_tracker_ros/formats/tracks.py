"""Tracks of labeled boxes: the form that all formats are read into and written from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.access import check_file

UNLABELED = "target"
"""Label of a target without one, in formats that require a label."""
# Pixels; boxes are written with three decimals.
_DECIMALS = 3
# Largest deviation of an interpolated corner coordinate in sides of the box; at least one pixel.
_TOLERANCE = 0.05
# Frame numbers above are taken for an error: a day has 2.6 million frames at 30 Hz.
_MAX_FRAME = 10**8


class FormatError(ValueError):
    """A file of labeled boxes that cannot be read; the message has its name and the place in it."""


@dataclass(frozen=True)
class LabeledBox:
    """A target in one frame.

    Attributes:
        box: (x, y, width, height) in pixels, (x, y) the top-left corner counted from 0; None where
            the target is absent.
        occluded: Whether it is occluded, at least in part.
        confidence: 0 to 1, NaN if unknown.
        is_keyframe: Whether the box was set by a person, False if by interpolation or a tracker.
            True if unknown.
    """

    box: Box | None
    occluded: bool = False
    confidence: float = math.nan
    is_keyframe: bool = True


@dataclass(frozen=True)
class BoxTrack:
    """A target over time.

    Attributes:
        id: From 0, unique in its file.
        label: Class or name, or empty.
        boxes: Frame, counted from 0, to its box, in order of the frames. In a frame that is missing
            here, the target is absent, or no one has looked.
    """

    id: int
    label: str
    boxes: Mapping[int, LabeledBox]

    def ground_truth(self, frame_count: int) -> NDArray[np.float64]:
        """(frame_count, 4) boxes; a row of NaN where the target is absent."""
        truth = np.full((frame_count, 4), np.nan)
        for frame, labeled in self.boxes.items():
            if labeled.box is not None and frame < frame_count:
                truth[frame] = labeled.box
        return truth


@dataclass(frozen=True)
class RecordingInfo:
    """The recording of the boxes, for formats that describe it.

    Attributes:
        name: Name of its file or folder.
        frame_count: Number of its frames.
        image_sizes: First frame, counted from 0, of each size of the images, in order, to that
            (width, height) in pixels; empty if unknown.
    """

    name: str
    frame_count: int
    image_sizes: Mapping[int, tuple[int, int]]

    def size_at(self, frame: int) -> tuple[int, int]:
        """(width, height) of the image of a frame, pixels; (0, 0) if unknown."""
        sizes = (size for first, size in reversed([*self.image_sizes.items()]) if first <= frame)
        return next(sizes, next(iter(self.image_sizes.values()), (0, 0)))


def describe_recording(name: str, images: Iterable[NDArray[Any] | None]) -> RecordingInfo:
    """Describe a recording by its images, all in order; None stands for a damaged one.

    They may end with a FootageError: the frames from there on have the size of the last image.

    Raises:
        FootageError: There is no image, or none before it.
    """
    sizes: dict[int, tuple[int, int]] = {}
    count = 0
    try:
        for image in images:
            if image is not None:
                height, width = image.shape[:2]
                if next(reversed(sizes.values()), None) != (width, height):
                    sizes[count] = width, height
            count += 1
    except FootageError:
        if not sizes:
            raise
    if not sizes:
        raise FootageError(f"{name} has no image")
    return RecordingInfo(name, count, sizes)


class TracksBuilder:
    """Collects boxes in any order.

    Args:
        path: File that they come from, for messages.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._boxes: dict[int, dict[int, LabeledBox]] = {}
        self._labels: dict[int, str] = {}

    def add(self, id: int, frame: int, labeled: LabeledBox, label: str = "") -> None:
        """Add a box; the first label of a track counts.

        Raises:
            ValueError: The track has a box in this frame already, or the box is invalid.
        """
        boxes = self._boxes.setdefault(id, {})
        if frame in boxes:
            raise ValueError(f"track {id} has a second box in this frame; allowed: one")
        if labeled.box is not None:
            _check_box(labeled.box)
        boxes[frame] = labeled
        if label and not self._labels.get(id):
            self._labels[id] = "" if label == UNLABELED else label

    def tracks(self) -> tuple[BoxTrack, ...]:
        """The tracks with a box, in order of their ids, each from its first box on.

        Raises:
            FormatError: There is no box.
        """
        tracks = []
        for id, boxes in sorted(self._boxes.items()):
            present = [frame for frame, labeled in boxes.items() if labeled.box is not None]
            if present:
                first = min(present)
                kept = {frame: boxes[frame] for frame in sorted(boxes) if frame >= first}
                tracks.append(BoxTrack(id, self._labels.get(id, ""), kept))
        if not tracks:
            raise FormatError(f"{self._path} has no box; expected at least one")
        return tuple(tracks)


def _check_box(box: Box) -> None:
    if not all(map(math.isfinite, box)):
        raise ValueError(f"the box is {box}; allowed: finite numbers")
    if min(box[2:]) <= 0:
        raise ValueError(
            f"the box is {box[2]:g} x {box[3]:g} px; allowed: width and height above 0"
        )


def interpolated(boxes: Mapping[int, LabeledBox]) -> dict[int, LabeledBox]:
    """Fill the frames between boxes as CVAT does: linearly; after an absent box absent.

    A box keeps its occlusion up to the next one.

    Args:
        boxes: Frame to box, in order of the frames.
    """
    filled: dict[int, LabeledBox] = {}
    last: tuple[int, LabeledBox] | None = None
    for frame, labeled in boxes.items():
        if last is not None and last[1].box is not None:
            start, before = last
            end = labeled.box or before.box
            for between in range(start + 1, frame):
                share = (between - start) / (frame - start)
                box = _mix(before.box, end, share)
                filled[between] = replace(before, box=box, is_keyframe=False)
        filled[frame] = labeled
        last = frame, labeled
    return filled


def _mix(one: Box | None, other: Box | None, share: float) -> Box:
    assert one is not None
    assert other is not None
    x, y, width, height = (
        first + share * (second - first) for first, second in zip(one, other, strict=True)
    )
    return x, y, width, height


def with_keyframes(boxes: Mapping[int, LabeledBox]) -> dict[int, LabeledBox]:
    """Mark further boxes as keyframes, so that linear interpolation between them gives the others.

    A labeling tool interpolates between keyframes, so a correction there changes all frames up to
    the next keyframes. The boxes themselves stay. Changes of presence and occlusion are keyframes.

    Source: Douglas and Peucker 1973, "Algorithms for the reduction of the number of points required
    to represent a digitized line or its caricature", on the four corner coordinates over time.

    Args:
        boxes: Frame to box, in order of the frames.
    """
    marked: dict[int, LabeledBox] = {}
    for run in _runs(boxes):
        frames = np.array([frame for frame, _ in run])
        corners = np.array([_corners(labeled.box) for _, labeled in run if labeled.box])
        sizes = corners[:, 2:] - corners[:, :2] if len(corners) else np.ones((1, 2))
        tolerances = np.maximum(_TOLERANCE * sizes.min(axis=1), 1.0)
        kept = {number for number, (_, labeled) in enumerate(run) if labeled.is_keyframe} | {0}
        if len(corners):
            kept.add(len(run) - 1)
        pending = list(pairwise(sorted(kept))) if len(corners) else []
        while pending:
            first, last = pending.pop()
            if last - first < 2:
                continue
            shares = (frames[first : last + 1] - frames[first]) / (frames[last] - frames[first])
            line = corners[first] + shares[:, None] * (corners[last] - corners[first])
            errors = np.abs(corners[first : last + 1] - line).max(axis=1)
            errors /= tolerances[first : last + 1]
            worst = first + int(errors.argmax())
            if errors.max() > 1.0:
                kept.add(worst)
                pending += [(first, worst), (worst, last)]
        for number, (frame, labeled) in enumerate(run):
            marked[frame] = replace(labeled, is_keyframe=number in kept)
    return marked


def _runs(boxes: Mapping[int, LabeledBox]) -> Iterator[list[tuple[int, LabeledBox]]]:
    """Runs of successive frames with the same presence and occlusion."""
    run: list[tuple[int, LabeledBox]] = []
    for frame, labeled in boxes.items():
        if run and (
            frame != run[-1][0] + 1
            or (labeled.box is None) != (run[-1][1].box is None)
            or labeled.occluded != run[-1][1].occluded
        ):
            yield run
            run = []
        run.append((frame, labeled))
    if run:
        yield run


def _corners(box: Box) -> tuple[float, float, float, float]:
    return box[0], box[1], box[0] + box[2], box[1] + box[3]


def present_boxes(tracks: Iterable[BoxTrack]) -> list[tuple[int, BoxTrack, LabeledBox, Box]]:
    """Frame, track, labeled box and box of every present target, by frame and id."""
    rows = [
        (frame, track, labeled, labeled.box)
        for track in tracks
        for frame, labeled in track.boxes.items()
        if labeled.box is not None
    ]
    return sorted(rows, key=lambda row: (row[0], row[1].id))


def number_text(value: float) -> str:
    """A coordinate in pixels with at most three decimals."""
    text = f"{value:.{_DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def rounded(value: float) -> float:
    """A coordinate in pixels, rounded to three decimals."""
    return round(value, _DECIMALS)


def read_text(path: Path) -> str:
    """The text of a file.

    Raises:
        FormatError: It cannot be read, or is not UTF-8.
    """
    try:
        check_file(path, "file of boxes")
        return path.read_text(encoding="utf-8-sig")
    except FootageError as error:
        raise FormatError(str(error)) from error
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path} cannot be read as text ({error})") from error


def numbered_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number, counted from 1, and text of each line that is not empty; raises as `read_text`."""
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if line.strip():
            yield number, line.strip()


def as_number(text: str, name: str) -> float:
    """A finite number.

    Raises:
        ValueError: It is none.
    """
    try:
        value = float(text)
    except (TypeError, ValueError, OverflowError):
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{name} is {text!r}; allowed: finite numbers")
    return value


def as_whole(text: str, name: str, least: int = 0) -> int:
    """A whole number from `least`, also written as 3.0.

    Raises:
        ValueError: It is none.
    """
    value = as_number(text, name)
    if not value.is_integer() or not least <= value <= _MAX_FRAME:
        raise ValueError(f"{name} is {text!r}; allowed: whole numbers from {least}")
    return int(value)


def four_numbers(values: Sequence[str], names: Sequence[str]) -> Box:
    """Four numbers with their names as a box."""
    x, y, width, height = (
        as_number(value, name) for value, name in zip(values, names, strict=True)
    )
    return x, y, width, height
