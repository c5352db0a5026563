"""What a target begins with at a box; and what is done with it that is known beside the pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import cast

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.filter import (
    MOTION_MODELS,
    KalmanFilter,
    KalmanFilteredMotion,
    MotionModel,
    ParticleSet,
)
from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.assessment import Assessment
from pf_tracker_ros.tracking.estimate import TrackStatus
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.measurement import Measurer
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.prediction import Predictor


class FilterInitializer:
    """Makes what a target begins with, as the parameters say.

    Args:
        parameters: Every tunable.
    """

    def __init__(self, parameters: TrackerParameters) -> None:
        self._motion = parameters.motion
        self._particles = parameters.particles
        self._foresees = parameters.proposal.method == "kalman"

    def motion(self, first_box: Box) -> MotionModel:
        """How a target moves from a box on."""
        model = self._motion.model
        return MOTION_MODELS[model](first_box, self._motion.of_models[model])

    def initial_particles(
        self, motion: MotionModel, image_size: tuple[int, int], draw: np.random.Generator
    ) -> ParticleSet:
        """Particles around the box that a motion begins with.

        Args:
            motion: Of the target.
            image_size: (width, height), pixels.
            draw: Source of randomness.
        """
        states = motion.sample_prior(self._particles, draw)
        return ParticleSet.uniform(motion.constrain(states, image_size))

    def redraw_particles(
        self,
        target: FilterState,
        box: NDArray[np.float64],
        image_size: tuple[int, int],
        draw: np.random.Generator,
    ) -> tuple[ParticleSet, NDArray[np.float64]]:
        """Particles of a target around another (4,) box, and their (N, 4) boxes.

        Args:
            target: Whose motion they go on with.
            box: In pixels.
            image_size: (width, height), pixels.
            draw: Source of randomness.
        """
        motion = self.motion(as_box(box))
        particles = self.initial_particles(motion, image_size, draw)
        boxes = motion.boxes(particles.states)
        if "log_scale" in motion.columns:
            # The motion of the target counts it from the first box.
            states = particles.states.copy()
            scale = np.log(box[2:] / np.array(target.first_box[2:])).mean()
            states[:, motion.columns.index("log_scale")] += scale
            particles = particles.move(states)
        return particles, boxes

    def kalman_filter(self, motion: MotionModel) -> KalmanFilter | None:
        """The Kalman filter of a motion; None where none is asked for."""
        return cast(KalmanFilteredMotion, motion).kalman_filter() if self._foresees else None


class StateOperations:
    """Does with a target what others tell: the targets in front of it, or a detector.

    Args:
        predictor: Draws the particles of the next frame.
        measurer: Looks at a frame.
        initializer: Makes the motion of a target.
        lost_after: Seconds, from 0 on; being hidden for longer adds nothing.
    """

    def __init__(
        self,
        predictor: Predictor,
        measurer: Measurer,
        initializer: FilterInitializer,
        lost_after: float,
    ) -> None:
        self._predictor = predictor
        self._measurer = measurer
        self._initializer = initializer
        self._lost_after = lost_after

    def coast(self, target: FilterState, frame: Frame, interval: float) -> FilterState:
        """The target one frame later, where the motion model alone takes it.

        For a frame that is known not to show it: nothing is looked at, and nothing learned. What
        nobody looks at is the less sure the longer that goes on: its confidence is halved in each
        `lost_after`.

        Args:
            target: After the last frame.
            frame: The next one.
            interval: Seconds since the last one.
        """
        draw = target.generator_state.generator()
        prediction = self._predictor.predict(target, interval, frame.size, draw)
        particles, motion = prediction.particles, target.motion
        boxes = motion.boxes(particles.states)
        box = motion.boxes(particles.mean[None])[0]
        time_since_seen = target.status.time_since_seen + interval
        track = TrackStatus("occluded", min(time_since_seen, self._lost_after))
        assessment = Assessment(box, self._doubted(target, interval), track, particles, boxes)
        covariance = particles.covariance[:2, :2].copy()
        return replace(
            target,
            kalman_filter=prediction.kalman_filter,
            particles=particles,
            status=track,
            frames_since_seen=target.frames_since_seen + 1,
            followed_frames=target.followed_frames + 1,
            generator_state=GeneratorState.of(draw),
            estimate=assessment.to_estimate(frame, target.estimate.cue_weights, covariance),
            distractor_box=None,
        )

    def _doubted(self, target: FilterState, interval: float) -> float:
        """The confidence of a target that nobody has looked at for one more interval."""
        if self._lost_after == 0.0:
            return 0.0
        return target.estimate.confidence * 0.5 ** (interval / self._lost_after)

    def move_to(self, target: FilterState, box: Box) -> FilterState:
        """The target with its particles brought along to another box; they keep their velocities.

        Args:
            target: As the frame at hand left it.
            box: Where it is in that frame.
        """
        columns, told = target.motion.columns, target.estimate
        before, after = np.array(told.box), np.array(box)
        shift = after[:2] + after[2:] / 2 - before[:2] - before[2:] / 2
        factor = after[2:] / before[2:]
        # States without sides count from a first box: from this one on.
        first_box, scale = target.first_box, 0.0
        if "width" not in columns:
            first_box, scale = box, float(np.log(before[2:] / first_box[2:]).mean())
        motion = self._initializer.motion(first_box)
        moved = partial(_moved, columns=columns, shift=shift, factor=factor, scale=scale)
        kalman_filter = self._initializer.kalman_filter(motion)
        if kalman_filter and target.kalman_filter:
            belief = target.kalman_filter.belief
            belief = replace(belief, mean=moved(belief.mean[None])[0])
            kalman_filter = replace(kalman_filter, belief=belief)
        boxes = told.particle_boxes + np.hstack([shift, 0.0, 0.0])
        return replace(
            target,
            first_box=first_box,
            motion=motion,
            kalman_filter=kalman_filter,
            particles=target.particles.move(moved(target.particles.states)),
            last_seen_box=box if target.status.state == "tracking" else target.last_seen_box,
            estimate=replace(told, box=box, particle_boxes=boxes),
        )

    def relearn(self, target: FilterState, frame: Frame) -> FilterState:
        """The target with templates of what is in its box now, as if it was first seen here."""
        templates = self._measurer.templates(frame, np.array(target.estimate.box))
        return replace(target, templates=templates, first_templates=templates, saved_templates=None)


def _moved(
    states: NDArray[np.float64],
    *,
    columns: Sequence[str],
    shift: NDArray[np.float64],
    factor: NDArray[np.float64],
    scale: float,
) -> NDArray[np.float64]:
    """States that are brought along with a box.

    Args:
        states: (N, D or more), the motion's columns first.
        columns: The D names.
        shift: (2,) of the center, pixels.
        factor: (2,) from the sides before to those after.
        scale: Logarithm of the size before, counted from the first box, where states have it.
    """
    states = states.copy()
    for number, name in enumerate(columns):
        axis = 0 if name.endswith(("x", "width")) else 1
        match name.removeprefix("earlier_"):
            case "x" | "y":
                states[:, number] += shift[axis]
            case "width" | "height":
                states[:, number] *= factor[axis]
            case "log_scale":
                states[:, number] -= scale
    return states
