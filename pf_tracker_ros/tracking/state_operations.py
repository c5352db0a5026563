"""Initial state of a target, and changes of a state that no pixels cause.

`FilterInitializer` makes the motion model, the particles and the Kalman filter at a box.
`StateOperations` applies external information, such as occlusion by other targets or detections:
coast (predict without an update), move to another box, relearn the templates. Each operation takes
a `FilterState` and returns another one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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
from pf_tracker_ros.tracking.assessment import Assessment, ConfidenceCalibration
from pf_tracker_ros.tracking.box_covariance import particle_covariance
from pf_tracker_ros.tracking.estimate import TrackStatus
from pf_tracker_ros.tracking.exemplars import Exemplars
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.measurement import Measurer
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.prediction import Predictor
from pf_tracker_ros.values import replace


class FilterInitializer:
    """Makes motion models, particles and Kalman filters."""

    def __init__(self, parameters: TrackerParameters) -> None:
        self._motion = parameters.motion
        self._particles = parameters.particles
        self._uses_kalman = parameters.proposal.method == "kalman"

    def motion(self, first_box: Box) -> MotionModel:
        """Motion model of a target that starts at a box."""
        model = self._motion.model
        return MOTION_MODELS[model](first_box, self._motion.of_models[model])

    def initial_particles(
        self, motion: MotionModel, image_size: tuple[int, int], generator: np.random.Generator
    ) -> ParticleSet:
        """Particles from the prior around a motion model's first box."""
        states = motion.sample_prior(self._particles, generator)
        return ParticleSet.uniform(motion.constrain(states, image_size))

    def redraw_particles(
        self,
        state: FilterState,
        box: NDArray[np.float64],
        image_size: tuple[int, int],
        generator: np.random.Generator,
    ) -> tuple[ParticleSet, NDArray[np.float64]]:
        """Particles of a target from the prior around a (4,) box, pixels; their (N, 4) boxes."""
        motion = self.motion(as_box(box))
        particles = self.initial_particles(motion, image_size, generator)
        boxes = motion.boxes(particles.states)
        if "log_scale" in motion.columns:
            # The scale of a state is relative to the first box of its own motion model.
            states = particles.states.copy()
            scale = np.log(box[2:] / np.array(state.first_box[2:])).mean()
            states[:, motion.columns.index("log_scale")] += scale
            particles = particles.move(states)
        return particles, boxes

    def kalman_filter(self, motion: MotionModel) -> KalmanFilter | None:
        """Initial Kalman filter of a motion model; None with another proposal."""
        return cast(KalmanFilteredMotion, motion).kalman_filter() if self._uses_kalman else None


class StateOperations:
    """Changes of a filter state by external information."""

    def __init__(
        self,
        predictor: Predictor,
        measurer: Measurer,
        initializer: FilterInitializer,
        lost_after: float,
        calibration: ConfidenceCalibration,
    ) -> None:
        self._predictor = predictor
        self._measurer = measurer
        self._initializer = initializer
        self._lost_after = lost_after
        self._calibration = calibration

    def coast(self, state: FilterState, frame: Frame, interval: float) -> FilterState:
        """The state one frame later by the motion model alone, for an occluded target.

        No pixels are read and nothing is learned. The confidence halves in each `lost_after`.
        """
        generator = state.generator_state.generator()
        prediction = self._predictor.predict(state, interval, frame.size, generator)
        particles, motion = prediction.particles, state.motion
        boxes = motion.boxes(particles.states)
        box = motion.boxes(particles.mean[None])[0]
        time_since_seen = state.status.time_since_seen + interval
        status = TrackStatus(
            "occluded",
            min(time_since_seen, self._lost_after),
            hidden_for=state.status.hidden_for,
        )
        halvings = interval / self._lost_after if self._lost_after else math.inf
        confidence = state.confidence * 0.5**halvings
        assessment = Assessment(box, confidence, status, particles, boxes)
        covariance = particle_covariance(particles, boxes)
        return replace(
            state,
            kalman_filter=prediction.kalman_filter,
            particles=particles,
            status=status,
            frames_since_seen=state.frames_since_seen + 1,
            followed_frames=state.followed_frames + 1,
            generator_state=GeneratorState.of(generator),
            confidence=confidence,
            estimate=assessment.to_estimate(
                frame, state.estimate.cue_weights, covariance, self._calibration
            ),
            distractor_box=None,
            occlusion_evidence=state.occlusion_evidence.advance(interval),
            standing=None,
            place_factor=1.0,
            growth=0.0,
        )

    def move_to(self, state: FilterState, box: Box) -> FilterState:
        """The state with particles and estimate moved to another box of its frame.

        Velocities stay.
        """
        columns, estimate = state.motion.columns, state.estimate
        before, after = np.array(estimate.box), np.array(box)
        shift = after[:2] + after[2:] / 2 - before[:2] - before[2:] / 2
        factor = after[2:] / before[2:]
        # Particles without a width are relative to the first box: it becomes the new box.
        first_box, scale = state.first_box, 0.0
        if "width" not in columns:
            first_box, scale = box, float(np.log(before[2:] / first_box[2:]).mean())
        motion = self._initializer.motion(first_box)
        move = partial(_moved_states, columns=columns, shift=shift, factor=factor, scale=scale)
        kalman_filter = self._initializer.kalman_filter(motion)
        if kalman_filter and state.kalman_filter:
            belief = state.kalman_filter.belief
            belief = replace(belief, mean=move(belief.mean[None])[0])
            kalman_filter = replace(kalman_filter, belief=belief)
        boxes = estimate.particle_boxes + np.hstack([shift, 0.0, 0.0])
        return replace(
            state,
            first_box=first_box,
            motion=motion,
            kalman_filter=kalman_filter,
            particles=state.particles.move(move(state.particles.states)),
            last_seen_box=box if state.status.state == "tracking" else state.last_seen_box,
            estimate=replace(estimate, box=box, particle_boxes=boxes),
        )

    def relearn(self, state: FilterState, frame: Frame) -> FilterState:
        """The state with templates and exemplars of its box in this frame."""
        box = np.array(state.estimate.box)
        return replace(
            state,
            templates=self._measurer.templates(frame, box),
            exemplars=Exemplars.of(frame, box),
            saved_templates=None,
        )


def _moved_states(
    states: NDArray[np.float64],
    *,
    columns: Sequence[str],
    shift: NDArray[np.float64],
    factor: NDArray[np.float64],
    scale: float,
) -> NDArray[np.float64]:
    """(N, D or more) states, the D named columns first, moved with a box.

    The center is moved by a (2,) shift, pixels, and the sides by (2,) factors. The scale is the
    logarithm of the old size over that of the old first box, for states with one.
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
