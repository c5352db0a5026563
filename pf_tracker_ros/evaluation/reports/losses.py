"""Where targets were out of sight, and what the boxes and the confidence tell about the cause.

1. An episode is a run of frames in which the target is occluded, lost or not reported.
   Occlusions of fewer than `_MIN_OCCLUSION` frames are no episodes.
2. The cause is read from the last box before it, in this order: frames were skipped, another target
   covers the box, the box touches the edge of the image, the target was not reported, or how fast
   the confidence fell.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation.reports.content import SequenceContent, states_in_ranges
from pf_tracker_ros.plurals import counted

_OUT_OF_SIGHT = ("occluded", "lost", "unreported")
_MIN_OCCLUSION = 3
_MAX_LISTED = 40
# Share of the box that another one covers.
_COVERED = 0.3
# Distance to the edge of the image, as a share of the box's side.
_NEAR_EDGE = 0.1
# Frames in which a sudden fall of the confidence happens, and those that are looked at.
_SUDDEN, _LOOK_BACK = 3, 30
_NOTABLE_FALL = 0.1


class Loss(NamedTuple):
    """An episode in which a target was out of sight.

    Attributes:
        target: Name of the target.
        first: Its first frame, counted from 0.
        last: Its last frame.
        states: Its state; several with their frames, as in "occluded in 5 to 6; lost in 7".
        cause: What the data tell about the cause, as a sentence.
        outcome: How it ended, as a sentence.
    """

    target: str
    first: int
    last: int
    states: str
    cause: str
    outcome: str


def losses(
    contents: Sequence[SequenceContent], image_size: tuple[int, int], *, has_depth: bool = False
) -> tuple[list[Loss], int]:
    """The episodes of all targets of a recording, in order of their first frames.

    Args:
        contents: The targets.
        image_size: (width, height) in pixels; (0, 0) if unknown.
        has_depth: Whether depth images were used.

    Returns:
        The longest episodes, at most 40, and the number of all.
    """
    scene = _Scene(contents, image_size, has_depth)
    found = [loss for content in contents for loss in _losses(content, scene)]
    longest = sorted(found, key=lambda loss: loss.first - loss.last)[:_MAX_LISTED]
    return sorted(longest, key=lambda loss: loss.first), len(found)


class _Scene(NamedTuple):
    """What all episodes share; attributes as the arguments of `losses`."""

    contents: Sequence[SequenceContent]
    image_size: tuple[int, int]
    has_depth: bool


def _losses(content: SequenceContent, scene: _Scene) -> Iterator[Loss]:
    index = 0
    for is_out, frames in groupby(content.states, lambda state: state in _OUT_OF_SIGHT):
        states = list(frames)
        start, index = index, index + len(states)
        is_short = set(states) == {"occluded"} and len(states) < _MIN_OCCLUSION
        if not is_out or is_short:
            continue
        ranges = states_in_ranges(states, content.first + start)
        yield Loss(
            content.name,
            content.first + start,
            content.first + index - 1,
            states[0] if len(set(states)) == 1 else "; ".join(ranges),
            _cause(content, start, scene),
            _outcome(content, start, index),
        )


def _cause(content: SequenceContent, start: int, scene: _Scene) -> str:
    before = content.states[max(0, start - _SUDDEN) : start]
    if skipped := before.count("skipped"):
        return f"after {counted(skipped, 'skipped frame')}"
    box = content.boxes[start]
    if not np.isfinite(box).all():
        return "no box before it"
    number = content.first + start
    for other in scene.contents:
        index = number - other.first
        if other is content or not 0 <= index < other.frames or other.states[index] != "tracking":
            continue
        if _covered_share(box, other.boxes[index]) > _COVERED:
            return f"behind {other.name}"
    if edge := _edge(box, scene.image_size):
        return f"at the {edge} edge of the image"
    if content.states[start] == "unreported":
        return "not reported: it had ended, or could not be told from a target in front of it"
    return _fall(content.confidence, start, has_depth=scene.has_depth)


def _covered_share(box: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    low = np.maximum(box[:2], other[:2])
    high = np.minimum(box[:2] + box[2:], other[:2] + other[2:])
    return float(np.prod(np.clip(high - low, 0.0, None)) / np.prod(box[2:]))


def _edge(box: NDArray[np.float64], image_size: tuple[int, int]) -> str:
    if not all(image_size):
        return ""
    x, y, width, height = box
    distances = {
        "left": x / width,
        "right": (image_size[0] - x - width) / width,
        "upper": y / height,
        "lower": (image_size[1] - y - height) / height,
    }
    nearest = min(distances, key=lambda name: distances[name])
    return nearest if distances[nearest] < _NEAR_EDGE else ""


def _fall(confidence: NDArray[np.float64], start: int, *, has_depth: bool) -> str:
    """How the confidence fell up to a frame."""
    low = float(confidence[start])
    past = confidence[max(0, start - _LOOK_BACK) : start]
    past = past[np.isfinite(past)]
    if math.isnan(low):
        return "the confidence is unknown"
    if not len(past):
        return f"from the first frame on, at a confidence of {low:.2f}"
    high = float(past.max())
    if high - low < _NOTABLE_FALL:
        sources = "something that has no box here" + (", or by its depth" if has_depth else "")
        return f"the confidence stayed at {low:.2f}: the tracker took it for hidden by {sources}"
    frames = len(past) - int(np.flatnonzero(past >= high - 0.1 * (high - low))[-1])
    values = f"from {high:.2f} to {low:.2f} in {counted(frames, 'frame')}"
    if frames <= _SUDDEN:
        return f"the confidence fell {values}: something covered it, or it jumped"
    return f"the confidence fell {values}: it was covered or changed its looks"


def _outcome(content: SequenceContent, start: int, end: int) -> str:
    if end == content.frames:
        return "not found again"
    if content.states[end] != "tracking":
        return f"then {content.states[end]}"
    before, after = (content.boxes[index] for index in (max(0, start - 1), end))
    distance = np.linalg.norm(after[:2] + after[2:] / 2 - before[:2] - before[2:] / 2)
    place = f", {distance:.0f} px away" if np.isfinite(distance) else ""
    return f"found again in frame {content.first + end}{place}"
