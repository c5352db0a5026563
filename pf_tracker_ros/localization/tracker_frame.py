"""The tracker's result for one image, as the localizer takes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.targets.tracked_target import TrackedTarget


@dataclass(frozen=True, eq=False)
class ReportedTarget:
    """A target in one frame, as the tracker reports it.

    Attributes:
        id: From 1, never reused.
        label: Of the tracker, possibly empty.
        state: `tracking`, `occluded` or `lost`.
        confidence: 0 to 1.
        box: (x, y, width, height) in pixels.
        box_covariance: (4, 4) covariance of center x, center y, width and height, px^2.
    """

    id: int
    label: str
    state: str
    confidence: float
    box: Box
    box_covariance: NDArray[np.float64]

    @classmethod
    def of(cls, target: TrackedTarget) -> ReportedTarget:
        """A target as it reads on `~/status`: the covariance is that of the upper triangle."""
        estimate = target.estimate
        covariance = np.triu(estimate.box_covariance) + np.triu(estimate.box_covariance, 1).T
        confidence = float(estimate.confidence)
        return cls(target.id, target.label, estimate.state, confidence, estimate.box, covariance)


@dataclass(frozen=True, eq=False)
class TrackerFrame:
    """The tracker's result for one image.

    Attributes:
        stamp: Of the image, nanoseconds.
        frame_id: Of the image.
        is_skipped: Whether the tracker did not process the image.
        state: Of the selected target, or `idle`.
        selected: Id of the selected target, 0 without.
        image_size: (width, height) of the image, pixels; None if it is unknown.
        targets: All targets.
    """

    stamp: int
    frame_id: str
    is_skipped: bool
    state: str
    selected: int
    image_size: tuple[int, int] | None
    targets: tuple[ReportedTarget, ...]
