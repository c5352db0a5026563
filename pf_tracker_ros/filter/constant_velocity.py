"""Constant velocity, the simplest motion model with a velocity.

1. x_k = x_{k-1} + dt v_{k-1} + u, v_k = v_{k-1} + w.
2. u and w are Gaussian random walks, with variances in proportion to the interval dt.
3. The box size is constant (`ConstantVelocity`) or a geometric random walk: width and height are
   multiplied by the exponential of Gaussian noise (`ConstantVelocityAndSize`).

Source: Li et al. 2007, equation (3), for intervals of any length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.filter.kalman_filter import SMALLEST_STD
from pf_tracker_ros.filter.motion import (
    MOTION_MODELS,
    PRIOR_POSITION_STD,
    PRIOR_VELOCITY_STD,
    declared_aspect_noise,
    declared_position_noise,
    declared_size_noise,
    declared_velocity_noise,
    limit_centers,
    limit_sizes,
)
from pf_tracker_ros.filter.proposals import CenterPrior


@dataclass(frozen=True)
class ConstantVelocityParameters:
    """Constant velocity with a box of constant size."""

    position_noise: float = declared_position_noise()
    velocity_noise: float = declared_velocity_noise()


@dataclass(frozen=True)
class ConstantVelocityAndSizeParameters(ConstantVelocityParameters):
    """Constant velocity with a box of changing size."""

    size_noise: float = declared_size_noise()
    aspect_noise: float = declared_aspect_noise()


@MOTION_MODELS.register("constant_velocity", ConstantVelocityParameters)
class ConstantVelocity:
    """State (x, y, vx, vy) in pixels and pixels per second; the box size is constant.

    Args:
        box: (x, y, width, height) of the target in the first frame, pixels.
        parameters: Noise.
    """

    columns: tuple[str, ...] = ("x", "y", "velocity_x", "velocity_y")

    def __init__(self, box: Box, parameters: ConstantVelocityParameters) -> None:
        x, y, width, height = box
        self._center = np.array([x + width / 2, y + height / 2])
        self._size = (width, height)
        self._box_size = np.sqrt(np.array([width * height]))
        self._position_noise = parameters.position_noise
        self._noise = np.repeat([parameters.position_noise, parameters.velocity_noise], 2)

    def sample_prior(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """See `MotionModel.sample_prior`; source: Li et al. 2007, section 3."""
        std = self._box_size * np.repeat([PRIOR_POSITION_STD, PRIOR_VELOCITY_STD], 2)
        states = generator.standard_normal((count, 4)) * std
        states[:, :2] += self._center
        return states

    def predict(
        self, states: NDArray[np.float64], interval: float, generator: np.random.Generator
    ) -> NDArray[np.float64]:
        """See `MotionModel.predict`; source: Li et al. 2007, equation (3)."""
        noise = generator.standard_normal((len(states), 4))
        noise *= math.sqrt(interval) * self._box_sizes(states)
        noise *= self._noise
        predicted = states.copy()
        for axis in range(2):
            predicted[:, axis] += states[:, 2 + axis] * interval
        predicted[:, :4] += noise
        return predicted

    def center_prior(self, states: NDArray[np.float64], interval: float) -> CenterPrior:
        """See `SearchableMotion.center_prior`."""
        mean = states[:, :2] + states[:, 2:4] * interval
        std = self.random_walk_std(interval) * self._box_sizes(states)
        return CenterPrior(mean, np.maximum(std, SMALLEST_STD))

    def random_walk_std(self, seconds: float) -> float:
        """See `SearchableMotion.random_walk_std`."""
        return float(self._position_noise * np.sqrt(seconds))

    def with_boxes(
        self, states: NDArray[np.float64], boxes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See `SearchableMotion.with_boxes`."""
        moved = states.copy()
        moved[:, :2] = boxes[:, :2] + boxes[:, 2:] / 2
        return moved

    def constrain(
        self, states: NDArray[np.float64], image_size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """See `MotionModel.constrain`."""
        return limit_centers(states, image_size)

    def boxes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `MotionModel.boxes`."""
        boxes = np.empty((len(states), 4))
        # By column: three times as fast as by rows of two numbers.
        width, height = self._size
        np.subtract(states[:, 0], width / 2, out=boxes[:, 0])
        np.subtract(states[:, 1], height / 2, out=boxes[:, 1])
        boxes[:, 2] = width
        boxes[:, 3] = height
        return boxes

    def _box_sizes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 1) box sizes of the states, or (1,) if all are equal."""
        return self._box_size


@MOTION_MODELS.register("constant_velocity_and_size", ConstantVelocityAndSizeParameters)
class ConstantVelocityAndSize(ConstantVelocity):
    """State (x, y, vx, vy, width, height): constant velocity, size as a geometric random walk.

    Box size and aspect ratio have independent noise: a target that approaches changes its size,
    but rarely its shape.

    Args:
        box: (x, y, width, height) of the target in the first frame, pixels.
        parameters: Noise.
    """

    columns: tuple[str, ...] = (*ConstantVelocity.columns, "width", "height")

    def __init__(self, box: Box, parameters: ConstantVelocityAndSizeParameters) -> None:
        super().__init__(box, parameters)
        self._size_noise = parameters.size_noise
        self._aspect_noise = parameters.aspect_noise

    def sample_prior(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """See `MotionModel.sample_prior`."""
        sizes = np.broadcast_to(self._size, (count, 2))
        return np.hstack([super().sample_prior(count, generator), sizes])

    def predict(
        self, states: NDArray[np.float64], interval: float, generator: np.random.Generator
    ) -> NDArray[np.float64]:
        """See `MotionModel.predict`."""
        predicted = super().predict(states, interval, generator)
        walk = generator.standard_normal((2, len(states))) * np.sqrt(interval)
        log_size = self._size_noise * walk[0]
        log_aspect = self._aspect_noise * walk[1]
        predicted[:, 4] *= np.exp(log_size + log_aspect / 2)
        predicted[:, 5] *= np.exp(log_size - log_aspect / 2)
        return predicted

    def with_boxes(
        self, states: NDArray[np.float64], boxes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See `SearchableMotion.with_boxes`."""
        moved = super().with_boxes(states, boxes)
        moved[:, 4:6] = boxes[:, 2:]
        return moved

    def constrain(
        self, states: NDArray[np.float64], image_size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """See `MotionModel.constrain` and `limit_sizes`."""
        constrained = super().constrain(states, image_size)
        constrained[:, 4:6] = limit_sizes(states[:, 4:6], self._size, image_size)
        return constrained

    def boxes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `MotionModel.boxes`."""
        boxes = np.empty((len(states), 4))
        boxes[:, 2:] = states[:, 4:6]
        boxes[:, :2] = states[:, :2] - boxes[:, 2:] / 2
        return boxes

    def _box_sizes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sqrt(states[:, 4:5] * states[:, 5:6])
