"""Content of a report: the data of a target over the frames of a sequence."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation import metrics
from pf_tracker_ros.evaluation.results import FrameDetails, Scores, SequenceResult

_MAX_WORST = 10
# Better frames, by overlap or confidence, need no look.
_WORTH_A_LOOK = 0.5
_MAX_SAMPLED = 8
# Minimum distance of the worst frames, as neighbors look alike.
_MIN_DISTANCE = 5

_STANDARD_STATES = ("tracking", "occluded", "lost")
_OTHER_STATES = ("idle", "unreported", "skipped")


class FrameRange(NamedTuple):
    """A range of frames, counted from 0, including `last`."""

    first: int
    last: int


class GroundRegion(NamedTuple):
    """A 90 % region of a position on the ground: an ellipse.

    Attributes:
        x: Middle, meters.
        y: Middle, meters.
        first: Longer half axis, meters.
        second: Shorter half axis, meters.
        angle: Of the longer axis from x to y, radians.
    """

    x: float
    y: float
    first: float
    second: float
    angle: float


@dataclass(frozen=True, eq=False)
class GroundTrack:
    """The way of a target on the ground.

    Attributes:
        name: Name of the target.
        positions: (frames, 2) x and y in meters; NaN without a position.
        regions: Some of the 90 % regions on the way.
    """

    name: str
    positions: NDArray[np.float64]
    regions: Sequence[GroundRegion]


@dataclass(frozen=True, eq=False)
class GroundView:
    """Targets and camera from above.

    Attributes:
        tracks: The targets.
        camera: (frames, 2) positions of the camera, meters.
        axes: (frames, 2) unit vectors of its horizontal direction.
        frame: Name of the fixed frame.
    """

    tracks: Sequence[GroundTrack]
    camera: NDArray[np.float64]
    axes: NDArray[np.float64]
    frame: str


@dataclass(frozen=True, eq=False)
class SequenceContent:
    """A target in the frames of one sequence.

    Attributes:
        name: Name of the sequence.
        boxes: (frames, 4) x, y, width, height in pixels; a row of NaN without box. While the
            target is lost, the last box is repeated.
        true_boxes: (frames, 4), a row of NaN for an absent target; None without ground truth.
        states: (frames,) "tracking", "occluded", "lost", "idle", "skipped", or "unreported" where
            one of several targets was not reported.
        confidence: (frames,) 0 to 1, NaN if unknown.
        effective_sample_size: (frames,), NaN if unknown.
        cue_weights: Name of a cue to its (frames,) weight.
        scores: The figures, None if unknown.
        success_curve: (21,) mean over the seeds, None without ground truth.
        precision_curve: (51,) likewise.
        first: Number of the target's first frame in the recording.
        has_ended: Whether the target ended before the recording.
    """

    name: str
    boxes: NDArray[np.float64]
    true_boxes: NDArray[np.float64] | None
    states: tuple[str, ...]
    confidence: NDArray[np.float64]
    effective_sample_size: NDArray[np.float64]
    cue_weights: Mapping[str, NDArray[np.float64]]
    scores: Scores | None = None
    success_curve: NDArray[np.float64] | None = None
    precision_curve: NDArray[np.float64] | None = None
    first: int = 0
    has_ended: bool = False

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.boxes)

    @cached_property
    def overlaps(self) -> NDArray[np.float64] | None:
        """(frames,) intersection over union, NaN without box; None without ground truth."""
        return self._compared(metrics.overlap)

    @cached_property
    def center_errors(self) -> NDArray[np.float64] | None:
        """(frames,) pixels, NaN without box; None without ground truth."""
        return self._compared(metrics.center_errors)

    @property
    def states_in_words(self) -> str:
        """The frames of each state; those of tracking are the others."""
        parts = states_in_ranges(self.states, self.first)
        if "tracking" in self.states:
            parts.append("otherwise tracking" if parts else "tracking")
        return "; ".join(parts)

    def frame_ranges(self, state: str) -> list[FrameRange]:
        """Ranges of frames in a state."""
        return frame_ranges(self.states, state, self.first)

    @property
    def share_by_state(self) -> dict[str, float]:
        """State to the share of frames in it, 0 to 1."""
        names = dict.fromkeys((*_STANDARD_STATES, *self.states))
        return {name: self.states.count(name) / self.frames for name in names}

    @property
    def sampled_frames(self) -> list[int]:
        """At most eight frames, evenly spaced over the sequence."""
        indices = np.linspace(0, self.frames - 1, min(self.frames, _MAX_SAMPLED)).round()
        return [int(index) for index in indices]

    @property
    def worst_frames(self) -> list[int]:
        """At most ten frames below 0.5, worst first: by overlap, or by confidence without truth."""
        overlaps = self.overlaps
        quality: NDArray[np.float64] = self.confidence if overlaps is None else overlaps
        order = np.lexsort((self.confidence, quality))
        worst: list[int] = []
        for index in map(int, order):
            if not quality[index] < _WORTH_A_LOOK or len(worst) == _MAX_WORST:
                break
            if all(abs(index - other) >= _MIN_DISTANCE for other in worst):
                worst.append(index)
        return worst

    def _compared(self, measure: metrics.Measure) -> NDArray[np.float64] | None:
        if self.true_boxes is None:
            return None
        has_box = np.asarray(np.isfinite(self.boxes).all(axis=1))
        values = measure(np.where(has_box[:, None], self.boxes, 0.0), self.true_boxes)
        return np.asarray(np.where(has_box, values, np.nan))


def states_in_ranges(states: Sequence[str], first: int = 0) -> list[str]:
    """Each state but tracking with the ranges of its frames; arguments as for `frame_ranges`."""
    return [
        f"{state} in {', '.join(map(_listed, frame_ranges(states, state, first)))}"
        for state in (*_STANDARD_STATES, *_OTHER_STATES)
        if state != "tracking" and state in states
    ]


def frame_ranges(states: Sequence[str], state: str, first: int = 0) -> list[FrameRange]:
    """Ranges of frames in a state, given the states of all frames and the first one's number."""
    ranges, begin = [], first
    for each, frames in groupby(states):
        end = begin + len(list(frames))
        if each == state:
            ranges.append(FrameRange(begin, end - 1))
        begin = end
    return ranges


def _listed(frames: FrameRange) -> str:
    first, last = frames
    return f"{first} to {last}" if last > first else str(first)


def state_columns(states: Collection[str]) -> tuple[str, ...]:
    """The states that need a column in a table."""
    return (*_STANDARD_STATES, *(state for state in _OTHER_STATES if state in states))


def content_of(result: SequenceResult) -> SequenceContent:
    """The content of an evaluated sequence, for its first seed."""
    frames = len(result.true_boxes)
    unknown = np.full(frames, np.nan)
    details = result.details or FrameDetails(("",) * frames, unknown, unknown, {})
    states = tuple(
        "lost" if is_lost else state or "tracking"
        for is_lost, state in zip(result.lost[0], details.states, strict=True)
    )
    return SequenceContent(
        name=result.name,
        boxes=result.boxes[0],
        true_boxes=result.true_boxes,
        **vars(replace(details, states=states)),
        scores=result.scores,
        success_curve=result.success_curve,
        precision_curve=result.precision_curve,
    )


def forward_fill(boxes: Sequence[Sequence[float] | None]) -> NDArray[np.float64]:
    """(frames, 4) boxes with gaps filled by the last box; NaN before the first."""
    filled = np.full((len(boxes), 4), np.nan)
    for index, box in enumerate(boxes):
        if box is not None:
            filled[index] = box
        elif index:
            filled[index] = filled[index - 1]
    return filled
