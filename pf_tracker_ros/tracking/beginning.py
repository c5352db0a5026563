"""What a target begins with at a box, and begins anew with: motion, particles, foresight."""

from __future__ import annotations

from typing import cast

import numpy as np

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.filter import (
    MOTION_MODELS,
    ForeseenMotion,
    KalmanForesight,
    MotionModel,
    ParticleSet,
)
from pf_tracker_ros.tracking.parameters import TrackerParameters


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
        return MOTION_MODELS[self._motion.model](first_box, self._motion.of_model[""])

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

    def foresight(self, motion: MotionModel) -> KalmanForesight | None:
        """The Kalman filter of a motion; None where none is asked for."""
        return cast(ForeseenMotion, motion).foresight() if self._foresees else None
