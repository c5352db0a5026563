"""All that is known of the target between two frames."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.background import BackgroundModel
from pf_tracker_ros.cues.fusion import Distraction, Templates
from pf_tracker_ros.filter import Box, KalmanForesight, MotionModel, ParticleSet
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.track_state import Track


@dataclass(frozen=True)
class Target:
    """All that is known of the target; a frame replaces it whole or not at all.

    Only the background model learns in place: copying it would cost more than the frame.

    Attributes:
        first_box: That it was started on.
        motion: How it moves.
        foresight: A Kalman filter that runs ahead of the particles; None where none is asked for.
        background: What is around it; None where no cue asks.
        particles: Its state, as drawn for the next frame.
        templates: What it looks like.
        distraction: How much of what is around it looks like it.
        track: Whether it is seen, and for how long it has not been.
        seen_box: Its last box while it was tracked.
        hidden_frames: Frames in a row in which it was not tracked.
        followed_frames: Frames since the first one.
        estimate: As told in the last frame.
    """

    first_box: Box
    motion: MotionModel
    foresight: KalmanForesight | None
    background: BackgroundModel | None
    particles: ParticleSet
    templates: Templates
    distraction: Distraction
    track: Track
    seen_box: Box
    hidden_frames: int
    followed_frames: int
    estimate: Estimate
