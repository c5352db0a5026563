"""Affine motion: each step multiplies the offset from the first box by a factor and shifts it.

1. x_k - x_0 = a (x_{k-1} - x_0) + b + u, where x_0 is the first box and u is Gaussian noise with
   independent axes. Counting from x_0 instead of the image's corner only changes b.
2. An offset decays for a < 1, stays for a = 1 (the default) and grows for a > 1.
3. One step of the equation is `MODEL_STEP` seconds. t steps have the factor a^t and the shift
   b (1 - a^t) / (1 - a), so two half steps make one step.
4. A particle has no velocity. With a Kalman filter, which has one, b includes velocity * interval.

Source: Zhang Bo, equation (4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.filter.gaussian import Gaussian
from pf_tracker_ros.filter.kalman_filter import SMALLEST_STD, KalmanFilter, LinearStep
from pf_tracker_ros.filter.motion import (
    MODEL_STEP,
    MOTION_MODELS,
    PRIOR_POSITION_STD,
    SMALLEST_SIDE,
    declared_position_noise,
    declared_size_noise,
    declared_velocity_noise,
    model_steps,
)
from pf_tracker_ros.filter.proposals import Transition, propose_from_transition
from pf_tracker_ros.parameters import declared

# Initial standard deviation of the Kalman filter's velocity, box sizes per second.
_KALMAN_VELOCITY_STD = 0.2


@dataclass(frozen=True)
class AffineMotionParameters:
    """Affine motion."""

    position_noise: float = declared_position_noise()
    velocity_noise: float = declared_velocity_noise()
    size_noise: float = declared_size_noise()
    factor: float = declared(
        1.0,
        "Factor of the last offset from the first box (a): 1 keeps position and size, less pulls "
        "them back.",
        minimum=0.0,
        maximum=1.5,
    )
    drift: tuple[float, ...] = declared(
        (0.0, 0.0),
        "Constant velocity to the right and downwards; b is this times the length of a step.",
        unit="box sizes per second",
        minimum=-100.0,
        maximum=100.0,
        lengths=(2,),
    )


@dataclass(frozen=True)
class _Affine:
    """Transition prior x_k = factor x_{k-1} + shift + u, u with standard deviation `noise_std`."""

    factor: float
    shift: NDArray[np.float64]
    noise_std: NDArray[np.float64]

    def mean(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.factor * states + self.shift

    def std(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.noise_std


@MOTION_MODELS.register("affine", AffineMotionParameters)
class AffineMotion:
    """State (x, y, log_scale): center in pixels, logarithm of size / first size.

    Args:
        box: (x, y, width, height) of the target in the first frame, pixels.
        parameters: Factor, drift and noise.
    """

    columns: tuple[str, ...] = ("x", "y", "log_scale")
    measured_columns: int = 3

    def __init__(self, box: Box, parameters: AffineMotionParameters) -> None:
        x, y, width, height = box
        self._first = np.array([x + width / 2, y + height / 2, 0.0])
        self._size = np.array([width, height])
        self._box_size = float(np.sqrt(width * height))
        self._parameters = parameters

    def sample_prior(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """See `MotionModel.sample_prior`."""
        std = PRIOR_POSITION_STD * self._box_size
        return self._first + generator.standard_normal((count, 3)) * [std, std, 0.0]

    def transition(self, interval: float, belief: NDArray[np.float64] | None = None) -> Transition:
        """The transition prior; see `LinearizableMotion.transition`."""
        factor, shift = self._step(interval)
        if belief is not None:
            shift = shift + interval * belief[3:]
        position = self._parameters.position_noise * self._box_size
        noise = np.array([position, position, self._parameters.size_noise])
        return _Affine(factor, shift, np.maximum(np.sqrt(interval) * noise, SMALLEST_STD))

    def linear_step(self, interval: float) -> LinearStep:
        """Affine motion with a velocity; see `LinearizableMotion.linear_step`.

        The velocity of the scale is 0, because the particles measure the size too inaccurately.
        """
        factor, shift = self._step(interval)
        matrix = np.eye(6)
        matrix[:3, :3] *= factor
        matrix[:3, 3:] = interval * np.eye(3)
        velocity = self._parameters.velocity_noise * self._box_size
        noise = np.array([0.0, 0.0, self._parameters.size_noise, velocity, velocity, 0.0])
        return LinearStep(matrix, np.concatenate([shift, np.zeros(3)]), np.sqrt(interval) * noise)

    def _step(self, interval: float) -> tuple[float, NDArray[np.float64]]:
        """Factor and (3,) shift of an interval in seconds, for states in image coordinates."""
        parameters = self._parameters
        steps = model_steps(interval)
        factor = parameters.factor**steps
        decay = 1.0 - parameters.factor
        summed_steps = (1.0 - factor) / decay if abs(decay) > 1e-9 else steps
        shift = summed_steps * MODEL_STEP * self._box_size * np.array([*parameters.drift, 0.0])
        return factor, shift + (1.0 - factor) * self._first

    def predict(
        self, states: NDArray[np.float64], interval: float, generator: np.random.Generator
    ) -> NDArray[np.float64]:
        """See `MotionModel.predict`; source: Zhang Bo, equation (4)."""
        return propose_from_transition(states, self.transition(interval), generator).states

    def constrain(
        self, states: NDArray[np.float64], image_size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """See `MotionModel.constrain`; sides stay between `SMALLEST_SIDE` and the image size."""
        smallest = min(1.0, float((SMALLEST_SIDE / self._size).max()))
        largest = max(1.0, float((image_size / self._size).min()))
        lower = [0.0, 0.0, np.log(smallest)]
        return np.clip(states, lower, [*image_size, np.log(largest)])

    def boxes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `MotionModel.boxes`."""
        sizes = np.exp(states[:, 2:]) * self._size
        return np.hstack([states[:, :2] - sizes / 2, sizes])

    def kalman_filter(self) -> KalmanFilter:
        """See `KalmanFilteredMotion.kalman_filter`."""
        velocity = _KALMAN_VELOCITY_STD * self._box_size
        std = np.array([1.0, 1.0, 0.01, velocity, velocity, 0.0])
        belief = Gaussian(np.concatenate([self._first, np.zeros(3)]), np.diag(std**2))
        return KalmanFilter(belief, self)
