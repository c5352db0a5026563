"""Random walk: the target moves from its last position in any direction.

A complete example of a motion model. The file alone, in `pf_tracker_ros/filter` or declared by an
entry point, adds it. `random_walk` in the parameter `motion.model` selects it and activates its
parameters.

A model with the methods of `SearchableMotion` works with `proposal.method` "search", one with that
of `KalmanFilteredMotion` with "kalman". This one has neither, so these methods are rejected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.filter.motion import (
    MOTION_MODELS,
    PRIOR_POSITION_STD,
    declared_position_noise,
    limit_centers,
)
from pf_tracker_ros.parameters import declared


# The parameters with their ranges. A function of `motion` declares those that several models share.
# Their full names are `motion.position_noise` and `motion.vertical_share`.
@dataclass(frozen=True)
class RandomWalkParameters:
    """A random walk."""

    position_noise: float = declared_position_noise()
    vertical_share: float = declared(
        1.0,
        "Vertical noise of the position, relative to the horizontal noise; less than 1 for targets "
        "on level ground.",
        minimum=0.0,
        maximum=1.0,
    )


# Each target has its own model, constructed from the first box. States are arrays with one row per
# particle. The variance of the noise grows with the interval between frames, in seconds.
@MOTION_MODELS.register("random_walk", RandomWalkParameters)
class RandomWalk:
    """State (x, y) in pixels; the box size is constant.

    Args:
        box: (x, y, width, height) of the target in the first frame, pixels.
        parameters: Noise.
    """

    columns: tuple[str, ...] = ("x", "y")

    def __init__(self, box: Box, parameters: RandomWalkParameters) -> None:
        x, y, width, height = box
        self._center = np.array([x + width / 2, y + height / 2])
        self._size = np.array([width, height])
        self._box_size = np.sqrt(width * height)
        horizontal = parameters.position_noise * self._box_size
        self._noise = np.array([horizontal, parameters.vertical_share * horizontal])

    def sample_prior(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """See `MotionModel.sample_prior`."""
        offsets = generator.standard_normal((count, 2)) * PRIOR_POSITION_STD * self._box_size
        return self._center + offsets

    def predict(
        self, states: NDArray[np.float64], interval: float, generator: np.random.Generator
    ) -> NDArray[np.float64]:
        """See `MotionModel.predict`."""
        return states + generator.standard_normal(states.shape) * np.sqrt(interval) * self._noise

    def constrain(
        self, states: NDArray[np.float64], image_size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """See `MotionModel.constrain`."""
        return limit_centers(states, image_size)

    def boxes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `MotionModel.boxes`."""
        return np.hstack([states - self._size / 2, np.broadcast_to(self._size, states.shape)])
