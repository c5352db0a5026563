"""Targets that are taken on, moved and learned by what is known beside their frame's pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.filter.randomness import Randomness
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.beginning import Beginning
from pf_tracker_ros.tracking.judgment import Judgment
from pf_tracker_ros.tracking.measurement import Measurer
from pf_tracker_ros.tracking.prediction import Predictor
from pf_tracker_ros.tracking.target import Target
from pf_tracker_ros.tracking.track_state import Track


class Steering:
    """Does with a target what others tell: the targets in front of it, or a detector.

    Args:
        predictor: Draws the particles of the next frame.
        measurer: Looks at a frame.
        beginning: Makes the motion of a target.
        lost_after: Seconds; being hidden for longer adds nothing.
    """

    def __init__(
        self, predictor: Predictor, measurer: Measurer, beginning: Beginning, lost_after: float
    ) -> None:
        self._predictor = predictor
        self._measurer = measurer
        self._beginning = beginning
        self._lost_after = lost_after

    def coast(self, target: Target, frame: Frame, interval: float) -> Target:
        """The target one frame later, where the motion model alone takes it.

        For a frame that is known not to show it: nothing is looked at, and nothing learned.

        Args:
            target: After the last frame.
            frame: The next one.
            interval: Seconds since the last one.
        """
        draw = target.randomness.generator()
        prediction = self._predictor.predict(target, interval, frame.size, draw)
        particles, motion = prediction.particles, target.motion
        boxes = motion.boxes(particles.states)
        box = motion.boxes(particles.mean[None])[0]
        hidden_for = target.track.hidden_for + interval
        track = Track("occluded", min(hidden_for, self._lost_after))
        judged = Judgment(box, target.estimate.confidence, track, particles, boxes)
        covariance = particles.covariance[:2, :2].copy()
        return replace(
            target,
            foresight=prediction.foresight,
            particles=particles,
            track=track,
            hidden_frames=target.hidden_frames + 1,
            followed_frames=target.followed_frames + 1,
            randomness=Randomness.of(draw),
            estimate=judged.estimate(frame, target.estimate.powers, covariance),
        )

    def move(self, target: Target, box: Box) -> Target:
        """The target with its particles brought along to another box; they keep their velocities.

        Args:
            target: As the frame at hand left it.
            box: Where it is in that frame.
        """
        before = np.array(target.estimate.box)
        size, after = before[2:], np.array(box)
        shift = after[:2] + after[2:] / 2 - before[:2] - size / 2
        factor = after[2:] / size
        states = target.particles.states.copy()
        columns = target.motion.columns
        for axis, (place, side) in enumerate((("x", "width"), ("y", "height"))):
            for name in (place, f"earlier_{place}"):
                if name in columns:
                    states[:, columns.index(name)] += shift[axis]
            for name in (side, f"earlier_{side}"):
                if name in columns:
                    states[:, columns.index(name)] *= factor[axis]
        motion = target.motion if "width" in columns else self._beginning.motion(box)
        particles = target.particles.move(states)
        told = target.estimate
        boxes = told.particle_boxes + np.hstack([shift, 0.0, 0.0])
        return replace(
            target,
            motion=motion,
            particles=particles,
            seen_box=box if target.track.state == "tracking" else target.seen_box,
            estimate=replace(told, box=box, particle_boxes=boxes),
        )

    def relearn(self, target: Target, frame: Frame) -> Target:
        """The target with templates of what is in its box now, as if it was first seen here."""
        templates = self._measurer.templates(frame, np.array(target.estimate.box))
        return replace(target, templates=templates, first_templates=templates)
