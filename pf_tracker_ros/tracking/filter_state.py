"""All that is known of the target between two frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.cues.fusion import DistractorRatios, Templates
from pf_tracker_ros.filter import KalmanFilter, MotionModel, ParticleSet
from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.tracking.estimate import Estimate, TrackStatus


@dataclass(frozen=True, eq=False)
class SavedTemplates:
    """What a target looked like before the light jumped.

    Attributes:
        templates: Of then.
        change: The brightness after the jump, relative to that before.
        age: Seconds since then.
    """

    templates: Templates
    change: float
    age: float = 0.0


@dataclass(frozen=True, eq=False)
class FilterState:
    """All that is known of one target, a value: a frame makes another of it.

    Nothing in it belongs to the scene or to another target, and nothing in it changes: a target
    that is followed again from here meets the same chances.

    Attributes:
        first_box: That its motion counts from: the one that it was started on, or moved to.
        motion: How it moves.
        kalman_filter: A Kalman filter that runs ahead of the particles; None where none is asked for.
        particles: Its state, as drawn for the next frame.
        templates: What it looks like.
        first_templates: What it looked like when it was first seen by each cue.
        distractor_ratios: How much of what is around it looks like it.
        status: Whether it is seen, and for how long it has not been.
        last_seen_box: Its last box while it was tracked.
        second_peak: Likeliest box beside it in the last frame, pixels; None without a search.
        known_distractor: Box of what is known not to be it, pixels, since both were seen at once; kept
            while it is out of sight.
        frames_since_seen: Frames in a row in which it was not tracked.
        followed_frames: Frames since the first one.
        generator_state: Where its own source of random numbers stands.
        estimate: As told in the last frame.
        saved_templates: What it looked like before the light jumped, while that may be a flash; None
            where it has not.
        distractor_box: (4,) box, pixels, of what looked like it beside it in the last frame; None where
            nothing did, or nobody looked for it.
    """

    first_box: Box
    motion: MotionModel
    kalman_filter: KalmanFilter | None
    particles: ParticleSet
    templates: Templates
    first_templates: Templates
    distractor_ratios: DistractorRatios
    status: TrackStatus
    last_seen_box: Box
    second_peak: Box | None
    known_distractor: Box | None
    frames_since_seen: int
    followed_frames: int
    generator_state: GeneratorState
    estimate: Estimate
    saved_templates: SavedTemplates | None = None
    distractor_box: NDArray[np.float64] | None = None
