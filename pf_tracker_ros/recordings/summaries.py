"""What is kept of a tracked frame once its image is gone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.evaluation.reports.content import SequenceContent, kept_boxes
from pf_tracker_ros.evaluation.results import FrameDetails
from pf_tracker_ros.recordings.tracking import TrackedFrame, row_of
from pf_tracker_ros.targets.tracked_target import TrackedTarget

ABSENT = (np.nan, np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class FrameSummary:
    """A tracked frame without its image.

    Attributes:
        stamp: Nanoseconds.
        state: `skipped`, `idle`, or the state of the track.
        box: (x, y, width, height) in pixels, None without one.
        true_box: Likewise.
        confidence: 0 to 1, NaN where it is unknown.
        seconds: What the tracker took for it, NaN where it did not track.
        effective_sample_size: NaN where it is unknown.
        powers: Name of a cue to its power.
    """

    stamp: int
    state: str
    box: Box | None
    true_box: Box | None
    confidence: float = np.nan
    seconds: float = np.nan
    effective_sample_size: float = np.nan
    powers: Mapping[str, float] = field(default_factory=dict)


def summary_of(tracked: TrackedFrame, target: TrackedTarget | None = None) -> FrameSummary:
    """What is kept of a frame and of one of its targets, by default the only one that may be."""
    row = row_of(target) if target else tracked.rows[0]
    estimate = target.estimate if target else tracked.estimate
    return FrameSummary(
        stamp=tracked.frame.stamp,
        state=row.state,
        box=row.box,
        true_box=tracked.frame.true_box,
        confidence=float(estimate.confidence) if estimate else np.nan,
        seconds=tracked.seconds if tracked.outcome == "tracked" else np.nan,
        effective_sample_size=float(estimate.effective_sample_size) if estimate else np.nan,
        powers=dict(estimate.powers) if estimate else {},
    )


def content_of_frames(
    name: str, frames: Sequence[FrameSummary], true_boxes: NDArray[np.float64] | None
) -> SequenceContent:
    """What there is to tell of a recording, without figures.

    Args:
        name: Of the recording.
        frames: In order, at least one.
        true_boxes: (frames, 4) what the boxes are compared with; None without such.
    """
    boxes = kept_boxes([each.box for each in frames])
    return SequenceContent(name, boxes, true_boxes, **vars(FrameDetails.of(frames)))
