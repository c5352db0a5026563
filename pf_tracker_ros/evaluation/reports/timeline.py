"""The timeline of a recording: the states and the confidence of its targets, and its video."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, NamedTuple

from pf_tracker_ros.evaluation.reports.content import SequenceContent
from pf_tracker_ros.evaluation.reports.losses import Loss, losses


@dataclass(frozen=True)
class RecordingVideo:
    """How the recording is played.

    Attributes:
        video: Address of the annotated video, relative to the page; empty without one.
        frame_rate: Frames of the video in a second.
        frames: Number of frames of the recording.
        image_size: (width, height) in pixels; (0, 0) if unknown.
        has_depth: Whether depth images were used.
    """

    video: str
    frame_rate: float
    frames: int
    image_size: tuple[int, int]
    has_depth: bool = False


class Run(NamedTuple):
    """Successive frames in the same state, counted from 0."""

    first: int
    frames: int
    state: str


class Row(NamedTuple):
    """The timeline of a target.

    Attributes:
        name: Name of the target.
        runs: Its states, in order.
        lines: Points of its confidence, for an SVG `polyline` each: x in frames, y from 0 for a
            confidence of 1 to 1 for 0.
    """

    name: str
    runs: Sequence[Run]
    lines: Sequence[str]


class Timeline(NamedTuple):
    """The timeline of all targets.

    Attributes:
        recording_video: How the recording is played.
        rows: The targets.
        losses: Where they were out of sight, at most 40.
        loss_count: Number of all such places.
        data: For the script of the page.
    """

    recording_video: RecordingVideo
    rows: Sequence[Row]
    losses: Sequence[Loss]
    loss_count: int
    data: dict[str, Any]


def timeline(contents: Sequence[SequenceContent], recording_video: RecordingVideo) -> Timeline:
    """The timeline of the targets of a recording."""
    rows = [Row(one.name, list(_runs(one)), list(_lines(one))) for one in contents]
    found, count = losses(contents, recording_video.image_size, has_depth=recording_video.has_depth)
    data = {
        "rate": recording_video.frame_rate,
        "frames": recording_video.frames,
        "targets": [
            {
                "name": content.name,
                "first": content.first,
                "runs": row.runs,
                "confidence": [_rounded(value) for value in content.confidence.tolist()],
            }
            for content, row in zip(contents, rows, strict=True)
        ],
    }
    return Timeline(recording_video, rows, found, count, data)


def _runs(content: SequenceContent) -> Iterator[Run]:
    first = content.first
    for state, group in groupby(content.states):
        frames = len(list(group))
        yield Run(first, frames, state)
        first += frames


def _lines(content: SequenceContent) -> Iterator[str]:
    points = enumerate(content.confidence.tolist(), start=content.first)
    for is_known, group in groupby(points, lambda point: not math.isnan(point[1])):
        if is_known:
            # Twice, so that a single frame has a line.
            yield " ".join(f"{x},{1 - y:.3g} {x + 1},{1 - y:.3g}" for x, y in group)


def _rounded(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 2)
