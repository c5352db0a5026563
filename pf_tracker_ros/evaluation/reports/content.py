"""What a report tells of a sequence: a target over all frames."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation import metrics
from pf_tracker_ros.evaluation.results import FrameDetails, Scores, SequenceResult

_WORST = 10
_STRIP = 8
# Neighbors look alike: of worst frames that follow each other one is enough.
_APART = 5


_ALWAYS_TOLD = ("tracking", "occluded", "lost")
_ELSE_TOLD = ("idle", "absent", "skipped")


class FrameRange(NamedTuple):
    """Frames in a row, counted from 0, `last` included."""

    first: int
    last: int


@dataclass(frozen=True, eq=False)
class SequenceContent:
    """A target in the frames of one sequence.

    Attributes:
        name: Of the sequence.
        boxes: (frames, 4) x, y, width, height in pixels; a row of NaN where there is none. While
            the target is lost, the last one before.
        true_boxes: (frames, 4), a row of NaN where the target is absent; None without any truth.
        states: (frames,) "tracking", "occluded", "lost", "idle", "skipped", or "absent" where one
            of several targets was not told of.
        confidence: (frames,) 0 to 1, NaN where it is unknown.
        effective_sample_size: (frames,), NaN where it is unknown.
        cue_weights: Name of a cue to its (frames,) weight.
        scores: The figures, None where they are not known.
        success_curve: (21,) mean over the seeds, None without any truth.
        precision_curve: (51,) likewise.
        first: Number of the first of the frames, where these are not all.
        has_ended: Whether there were more frames, in which the target was no more.
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
        """Their number."""
        return len(self.boxes)

    @cached_property
    def overlaps(self) -> NDArray[np.float64] | None:
        """(frames,) intersection over union, NaN where a box is missing; None without any truth."""
        return self._compared(metrics.overlap)

    @cached_property
    def center_errors(self) -> NDArray[np.float64] | None:
        """(frames,) pixels, NaN where a box is missing; None without any truth."""
        return self._compared(metrics.center_errors)

    @property
    def lost_ranges(self) -> list[FrameRange]:
        """Where the tracker calls the target lost."""
        return self.frame_ranges("lost")

    def frame_ranges(self, state: str) -> list[FrameRange]:
        """The frames of a state, by their numbers."""
        return frame_ranges(self.states, state, self.first)

    @property
    def share_by_state(self) -> dict[str, float]:
        """State to the share of frames in it, 0 to 1."""
        names = dict.fromkeys((*_ALWAYS_TOLD, *self.states))
        return {name: self.states.count(name) / self.frames for name in names}

    @property
    def sampled_frames(self) -> list[int]:
        """Frames to show, evenly over the sequence."""
        chosen = np.linspace(0, self.frames - 1, min(self.frames, _STRIP)).round()
        return [int(index) for index in chosen]

    @property
    def worst_frames(self) -> list[int]:
        """The frames with the least overlap, or where that is unknown the least confidence.

        At most ten, not too near to each other, the worst first.
        """
        overlaps = self.overlaps
        badness: NDArray[np.float64] = self.confidence if overlaps is None else overlaps
        order = np.lexsort((self.confidence, badness))
        chosen: list[int] = []
        for index in map(int, order):
            if math.isnan(float(badness[index])) or len(chosen) == _WORST:
                break
            if all(abs(index - other) >= _APART for other in chosen):
                chosen.append(index)
        return chosen

    def _compared(self, measure: metrics.Measure) -> NDArray[np.float64] | None:
        if self.true_boxes is None:
            return None
        known = np.asarray(np.isfinite(self.boxes).all(axis=1))
        found = measure(np.where(known[:, None], self.boxes, 0.0), self.true_boxes)
        return np.asarray(np.where(known, found, np.nan))


def frame_ranges(states: Sequence[str], state: str, first: int = 0) -> list[FrameRange]:
    """The frames of a state among those of all frames in a row, the first one of that number."""
    found, begin = [], first
    for each, frames in groupby(states):
        end = begin + len(list(frames))
        if each == state:
            found.append(FrameRange(begin, end - 1))
        begin = end
    return found


def state_columns(states: Collection[str]) -> tuple[str, ...]:
    """The states that a table has columns for, so that the shares of a row are all there.

    Args:
        states: That there are in any row.
    """
    return (*_ALWAYS_TOLD, *(state for state in _ELSE_TOLD if state in states))


def content_of(result: SequenceResult) -> SequenceContent:
    """What there is to tell of an evaluated sequence; of several seeds, the first is shown."""
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
    """(frames, 4) boxes, where there is none the last one before; NaN before the first."""
    kept = np.full((len(boxes), 4), np.nan)
    for index, box in enumerate(boxes):
        if box is not None:
            kept[index] = box
        elif index:
            kept[index] = kept[index - 1]
    return kept
