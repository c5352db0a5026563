"""What a frame's measurement is worth, and so what is told of the target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.cues.fusion import Powers
from pf_tracker_ros.filter import ParticleSet
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.estimate import Estimate, FrozenPowers
from pf_tracker_ros.tracking.track_state import Track


@dataclass(frozen=True, eq=False)
class Judgment:
    """What is told of the target in a frame.

    Attributes:
        box: (4,) of the target, pixels.
        confidence: That it is the target, 0 to 1.
        track: Whether it is seen, and for how long it has not been.
        particles: Told with the box.
        boxes: (N, 4) of them, pixels.
        learns: Whether what is in the box may be learned.
        look_alike: See `Target.look_alike`.
    """

    box: NDArray[np.float64]
    confidence: float
    track: Track
    particles: ParticleSet
    boxes: NDArray[np.float64]
    learns: bool = True
    look_alike: Box | None = None

    def estimate(self, frame: Frame, powers: Powers, covariance: NDArray[np.float64]) -> Estimate:
        """As it is told to the outside; its arrays are read-only from then on.

        Args:
            frame: That it is of.
            powers: Of the cues in that frame.
            covariance: (2, 2) of the target's center, px^2.
        """
        self.boxes.setflags(write=False)
        covariance.setflags(write=False)
        return Estimate(
            box=as_box(self.box),
            state=self.track.state,
            confidence=self.confidence,
            covariance=covariance,
            particles=self.particles.states,
            particle_boxes=self.boxes,
            weights=self.particles.weights,
            effective_sample_size=self.particles.effective_sample_size,
            powers=FrozenPowers(powers),
            background=frame.background,
        )
