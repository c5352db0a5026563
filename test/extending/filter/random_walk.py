"""Random walk: the target goes on from where it is, in any direction.

A motion model of one's own, complete. As a file in `pf_tracker_ros/filter` it is there: nothing
else has to know of it. `random_walk` in the parameter `motion.model` chooses it, and its parameters
then count.

What more a model can do it tells by its methods: one with those of `SearchableMotion` works with
`proposal.method` "search", one with that of `KalmanFilteredMotion` with "kalman". This one has neither,
and is refused there.
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


# What can be tuned, each with its range. What other models have too is declared by a function of
# `motion`, so that it means the same in all. The full names are `motion.position_noise` and
# `motion.vertical_share`.
@dataclass(frozen=True)
class RandomWalkParameters:
    """A random walk."""

    position_noise: float = declared_position_noise()
    vertical_share: float = declared(
        1.0,
        "Share of the position's noise that its vertical part has; less than 1 for targets that "
        "stay on level ground.",
        minimum=0.0,
        maximum=1.0,
    )


# A model is made for each target, of its first box. States are arrays, one row a particle; a model
# is told the seconds between frames, so the variance of its noise grows with them.
@MOTION_MODELS.register("random_walk", RandomWalkParameters)
class RandomWalk:
    """State (x, y) in pixels; the box keeps its size.

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
        across = parameters.position_noise * self._box_size
        self._noise = np.array([across, parameters.vertical_share * across])

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
