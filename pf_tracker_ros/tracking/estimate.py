"""What the tracker knows about the target after one frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.background import BackgroundState

TrackState = Literal["tracking", "occluded", "lost"]


@dataclass(frozen=True)
class Estimate:
    """The tracker's answer for one frame; its arrays are read-only.

    Attributes:
        box: (x, y, width, height) in pixels, (x, y) the top-left corner counted from 0.
        state: "tracking" while the measurements support the box; "occluded" while they do not;
            "lost" when that has lasted too long.
        confidence: 0 (nothing at the box looks like the target) to 1 (exactly the template), as
            `TrackParameters.confidence` lets it rise.
        covariance: (2, 2), px^2: covariance of the box's center under the weighted particles; after
            a search, of where the target is about that center, given the confidence.
        particles: (N, D) particle states, columns as named by the motion model.
        particle_boxes: (N, 4) the particles as (x, y, width, height) boxes in pixels.
        weights: (N,) normalized weights of the particles, before resampling.
        effective_sample_size: 1 / sum of squared weights, from 1 to N.
        powers: Name of a cue to its power in this frame's likelihood; they sum to 1.
        background: What the background model is worth in this frame; None where there is none.
    """

    box: tuple[float, float, float, float]
    state: TrackState
    confidence: float
    covariance: NDArray[np.float64]
    particles: NDArray[np.float64]
    particle_boxes: NDArray[np.float64]
    weights: NDArray[np.float64]
    effective_sample_size: float
    powers: Mapping[str, float]
    background: BackgroundState | None = None
