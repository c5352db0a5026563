"""What a target begins with at a box, and begins anew with: motion, particles, foresight."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.filter import (
    MOTION_MODELS,
    ForeseenMotion,
    KalmanForesight,
    MotionModel,
    ParticleSet,
)
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.target import Target


class Beginning:
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

    def spread(
        self, motion: MotionModel, image_size: tuple[int, int], draw: np.random.Generator
    ) -> ParticleSet:
        """Particles around the box that a motion begins with.

        Args:
            motion: Of the target.
            image_size: (width, height), pixels.
            draw: Source of randomness.
        """
        states = motion.prior(self._particles, draw)
        return ParticleSet.uniform(motion.constrain(states, image_size))

    def spread_anew(
        self,
        target: Target,
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
        particles = self.spread(motion, image_size, draw)
        boxes = motion.boxes(particles.states)
        if "log_scale" in motion.columns:
            # The motion of the target counts it from the first box.
            states = particles.states.copy()
            scale = np.log(box[2:] / np.array(target.first_box[2:])).mean()
            states[:, motion.columns.index("log_scale")] += scale
            particles = particles.move(states)
        return particles, boxes

    def foresight(self, motion: MotionModel) -> KalmanForesight | None:
        """The Kalman filter of a motion; None where none is asked for."""
        return cast(ForeseenMotion, motion).foresight() if self._foresees else None
